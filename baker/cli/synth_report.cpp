// The report of nacre synth: warnings, the table, and the same as JSON.
#include "synth_report.h"

#include <cmath>
#include <cstdio>

namespace nacre::cli {

static constexpr double kLeakWarning = 0.005; // of the walks; below that a picture does not show it
static constexpr double kBackFaceWarning = 0.01; // of the object in any picture

void warnAbout(const SynthReport& report)
{
    for (const SynthReport::Split& s : report.splits) {
        if (s.emptyCameras > 0)
            warn(format("split '%s': %zu of %zu cameras see nothing of the object: it is wholly transparent, seen from behind, smaller than a pixel or out of sight",
                        s.name.c_str(), s.emptyCameras, s.cameras));
        if (s.backFaces > kBackFaceWarning)
            warn(format("split '%s': in one picture, %.0f %% of the object shows what is behind back faces of single-sided materials, which glTF hides from "
                        "cameras; if they should be seen, mark the material doubleSided or turn the triangles round", s.name.c_str(), 100 * s.backFaces));
        if (s.leakedWalks > kLeakWarning)
            warn(format("split '%s': %.1f %% of the light paths under a scattering surface left through a hole of it; close the mesh", s.name.c_str(),
                        100 * s.leakedWalks));
        if (s.cutWalks > kLeakWarning)
            warn(format("split '%s': %.1f %% of the light paths under a scattering surface were cut short; the object is many mean free paths thick",
                        s.name.c_str(), 100 * s.cutWalks));
        if (s.clipped > 0)
            warn(format("split '%s': %.2f %% of the object's pixels are brighter than 1 and clipped in 8-bit files", s.name.c_str(), 100 * s.clipped));
    }
}

Totals totalsOf(const SynthReport& report)
{
    Totals t;
    for (const SynthReport::Split& s : report.splits) {
        t.images += s.images, t.written += s.written, t.missing += s.missing, t.cameras += s.cameras;
        t.renderSeconds += s.seconds, t.rays += s.rays;
    }
    return t;
}

void printReport(const SynthArguments& args, const SynthReport& report, const Totals& t)
{
    std::printf("%-12s  %6s  %8s  %7s  %7s  %8s\n", "split", "images", "rendered", "samples", "noise", "s/camera");
    for (const SynthReport::Split& s : report.splits) {
        const std::string perCamera = s.cameras > 0 ? format("%.2f", s.seconds / double(s.cameras)) : "-";
        std::printf("%-12s  %6zu  %8zu  %7s  %7s  %8s\n", oneLine(s.name).c_str(), s.images, s.written,
                    s.written > 0 ? format("%.0f", s.samplesPerPixel).c_str() : "-",
                    s.written > 0 && std::isfinite(s.noise) ? format("%.4f", s.noise).c_str() : "-", // one pass has no spread to tell
                    perCamera.c_str());
    }
    std::printf("%s: %s convention, %zu images, %zu rendered in %.1f s: %.2f s per camera, %.2f million rays per second\n", args.output.c_str(),
                args.convention.c_str(), t.images, t.written, report.seconds, t.perCamera(), t.raysPerSecond() * 1e-6);
    if (t.missing > 0)
        std::printf("%zu images are not there yet; the shard that renders the last of a split describes it (or the same command without --shard)\n",
                    t.missing);
}

Json reportJson(const SynthArguments& args, const SynthReport& report, const Totals& t)
{
    Json splits = Json::object();
    for (const SynthReport::Split& s : report.splits)
        splits[s.name] = {{"images", s.images}, {"rendered", s.written}, {"missing", s.missing}, {"cameras", s.cameras}, {"seconds", s.seconds},
                          {"samples_per_pixel", s.samplesPerPixel}, {"noise", s.noise}, {"rays", s.rays}};
    return {{"convention", args.convention}, {"images", t.images}, {"rendered", t.written}, {"missing", t.missing},
            {"seconds", report.seconds}, {"seconds_per_camera", t.perCamera()}, {"rays_per_second", t.raysPerSecond()},
            {"splits", splits}};
}

} // namespace nacre::cli
