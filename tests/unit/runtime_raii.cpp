// The C++ layer: the same scene as through the C API, everything destroyed once, results instead of exceptions.
#include "runtime_fixture.h"

#include "nacre/nacre.hpp"

#include <type_traits>

using namespace nacre::test;
namespace rt = nacre::runtime;

static_assert(!std::is_copy_constructible_v<rt::Asset> && !std::is_copy_assignable_v<rt::Asset>);
static_assert(std::is_nothrow_move_constructible_v<rt::View> && std::is_nothrow_move_assignable_v<rt::View>);

TEST_CASE("the C++ layer draws what the C API draws, owns what it makes and destroys it once")
{
    if (!haveGl()) return;
    const nacre::SplatAsset source = randomAsset(60, 9, 4), wax = randomSss(60, kAllSss, 4);
    const std::vector<nacre::Light> lamp = {pointLight({1, 1, 2}, glm::vec3(3))};
    const nacre::Camera camera = lookAt({0, 0, 2}, {0, 0, 0}, 33, 33, 40);
    Host plain(source);
    plain.place(wax);
    const nacre::Image expected = plain.draw(camera, lamp);

    auto gl = nacre::HeadlessGl::create();
    REQUIRE(gl);
    std::string messages;
    auto desc = rt::make<NacreContextDesc>();
    desc.message = [](NacreSeverity, const char* text, void* user) { *static_cast<std::string*>(user) += text; };
    desc.messageUser = &messages;
    CHECK(rt::Context::create(desc).code == NACRE_ERROR_INVALID_ARGUMENT); // no getProcAddress
    CHECK_FALSE(messages.empty());
    desc.getProcAddress = nacre::HeadlessGl::getProcAddress;
    auto context = rt::Context::create(desc);
    REQUIRE(context);

    const auto bytes = nacre::encodeAsset(source), waxBytes = nacre::encodeAsset(wax);
    CHECK(context->loadAsset(bytes->data(), 10).code == NACRE_ERROR_BAD_ASSET);
    CHECK_FALSE(*context->loadAsset(bytes->data(), 10));
    auto asset = context->loadAsset(bytes->data(), bytes->size()), inSteps = context->decodeAsset(waxBytes->data(), waxBytes->size());
    REQUIRE(asset);
    REQUIRE(inSteps);
    int steps = 0;
    for (auto left = inSteps->uploadStep(1000); left && *left > 0; left = inSteps->uploadStep(1000)) ++steps;
    CHECK(steps > 1);
    CHECK(asset->info()->splatCount == 60);
    auto reduced = rt::make<NacreDetail>();
    reduced.splats = 0.5f; // the file has no order of importance
    CHECK(context->loadAsset(bytes->data(), bytes->size(), &reduced).code == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(context->decodeAsset(bytes->data(), bytes->size(), &reduced).code == NACRE_ERROR_INVALID_ARGUMENT);

    auto first = asset->instance(), second = inSteps->instance();
    auto view = context->view();
    REQUIRE((first && second && view));
    CHECK(context->setLights(std::vector<NacreLight>{toNacre(lamp[0])}) == NACRE_OK);
    const NacreDrawDesc draw = describe(camera);
    const auto shoot = [&] {
        REQUIRE((*gl)->beginFrame(33, 33));
        CHECK_MESSAGE(view->draw(draw) == NACRE_OK, messages);
        return (*gl)->readFrame();
    };
    CHECK(largestDifference(shoot(), expected) == 0.0f);
    CHECK(view->stats()->instancesDrawn == 2);

    rt::Instance moved = std::move(*second); // the owner changes, the scene does not
    CHECK_FALSE(*second);
    second->reset();
    CHECK(largestDifference(shoot(), expected) == 0.0f);
    moved = std::move(moved);
    CHECK(context->info()->instances == 2);
    moved = rt::Instance();
    CHECK(context->info()->instances == 1);
    {
        const rt::Instance again(first->release());
        CHECK(context->info()->instances == 1);
    }
    CHECK(context->info()->instances == 0);
    asset->reset();
    CHECK(asset->info().code == NACRE_ERROR_INVALID_ARGUMENT);

    auto orphan = inSteps->instance(); // outlives the context: stale, and no harm
    context->reset();
    CHECK(orphan->setHidden(true) == NACRE_ERROR_INVALID_ARGUMENT);
    CHECK(view->draw(draw) == NACRE_ERROR_INVALID_ARGUMENT);
}
