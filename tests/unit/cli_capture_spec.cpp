#include "cli/capture_spec.h"

#include <doctest/doctest.h>

using namespace nacre;
using namespace nacre::cli;

TEST_CASE("a capture's text: a kind alone has usual errors, keys change single ones, units may be left out, and its own text means the same")
{
    const auto stage = parseCapture("stage"), phone = parseCapture("phone"), other = parseCapture("stage:light-error=2deg,gain=5,jpeg,spill=0px");
    REQUIRE(stage);
    REQUIRE(phone);
    REQUIRE(other);
    CHECK(stage->lightError == 1);
    CHECK(stage->gain == 3);
    CHECK(stage->jpeg == 0);
    CHECK(phone->kind == CaptureKind::kPhone);
    CHECK(phone->flash == 5);
    CHECK(phone->pose == 0.3);
    CHECK(other->lightError == 2);
    CHECK(other->gain == 5);
    CHECK(other->jpeg == 92);
    CHECK(other->spill == 0);
    CHECK(other->electrons == stage->electrons);
    for (const char* text : {"stage", "phone", "stage:light-error=0.25,turn=-30deg,blank=0%", "phone:jpeg=75,lights-off,flash=2.5cm", "phone:clean"}) {
        const auto once = parseCapture(text);
        REQUIRE(once);
        const auto twice = parseCapture(textOf(*once));
        REQUIRE(twice);
        CHECK(textOf(*twice) == textOf(*once));
        CHECK(twice->lightsOff == once->lightsOff);
        CHECK(twice->clean == once->clean);
    }
}

TEST_CASE("what is wrong with a capture's text is named")
{
    const std::pair<const char*, const char*> bad[] = {{"", "stage or phone"}, {"tripod", "stage or phone"}, {"stage:flash=5cm", "light-error"}, {"phone:spill=2", "flash"},
                                                       {"stage:", "light-error"}, {"stage:gain=3mm", "gain from 0 to 100 %"}, {"stage:gain=-1", "gain from"},
                                                       {"stage:gain=nan", "gain from"}, {"stage:gain", "gain from"}, {"phone:jpeg=9.5", "whole number"},
                                                       {"stage:holes=1,", "light-error"}, {"phone:pose=11deg", "10 deg"},
                                                       {"stage:clean=0", "takes no value"}, {"phone:lights-off=1", "takes no value"}, {"stage:gain=3,gain=5", "once"},
                                                       {"phone:jpeg=80,png", "once"}, {"phone:clean,flash=5", "alone"}, {"stage:gain=", "gain from"},
                                                       {"stage:gain=%", "gain from"}, {"stage:,", "missing"}};
    for (const auto& [text, expected] : bad) {
        INFO(text);
        const auto capture = parseCapture(text);
        REQUIRE_FALSE(capture);
        CHECK(capture.error().code == ErrorCode::kBadInput);
        CHECK(capture.error().message.find(expected) != std::string::npos);
    }
}
