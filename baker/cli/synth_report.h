// What nacre synth says when it is done.
#pragma once

#include "cli.h"

#include "light_stage/synth.h"
#include "synth_arguments.h"

namespace nacre::cli {

struct Totals {
    size_t images = 0, written = 0, missing = 0, cameras = 0;
    double renderSeconds = 0;
    uint64_t rays = 0;
    double perCamera() const { return cameras > 0 ? renderSeconds / double(cameras) : 0.0; }
    double raysPerSecond() const { return renderSeconds > 0 ? double(rays) / renderSeconds : 0.0; }
};

Totals totalsOf(const SynthReport& report);
void warnAbout(const SynthReport& report);
void printReport(const SynthArguments& args, const SynthReport& report, const Totals& totals);
Json reportJson(const SynthArguments& args, const SynthReport& report, const Totals& totals);

} // namespace nacre::cli
