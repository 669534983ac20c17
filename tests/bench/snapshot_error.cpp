// snapshot_error ASSET.glb DATASET SPLIT [LIGHTS [CAMERAS]]: how near snapshots (nacre convert) are to what they were taken of. Under the
// lights of evenly picked images of the split, seen from evenly picked cameras: PSNR of the snapshot against the asset, both drawn by the scalar
// reference, as displayed (sRGB, cut at white), where the asset covers more than half of a pixel.
#include "asset/asset_io.h"
#include "base/color.h"
#include "dataset/loader.h"
#include "eval/evaluate.h"
#include "pack/lit_snapshot.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

using namespace nacre;

int main(int argc, char** argv)
{
    if (argc < 4) return std::fprintf(stderr, "usage: snapshot_error ASSET.glb DATASET SPLIT [LIGHTS [CAMERAS]]\n"), 2;
    const auto asset = readAsset(argv[1]);
    const auto dataset = loadDataset(argv[2]);
    const OlatSplit* split = dataset ? dataset->find(argv[3]) : nullptr;
    if (!asset || !split) return std::fprintf(stderr, "cannot read the asset or the split\n"), 2;
    const size_t wantedLights = argc > 4 ? size_t(std::atoi(argv[4])) : 6, wantedCameras = argc > 5 ? size_t(std::atoi(argv[5])) : 6;
    const auto reference = makeReferenceRenderer(*asset);
    if (!reference) return 2;

    const auto shown = [](float x) { return srgbFromLinear(std::clamp(x, 0.0f, 1.0f)); };
    double error[2] = {0, 0}, count = 0, seconds = 0;
    const size_t images = split->images.size(), lightCount = std::min(wantedLights, images);
    for (size_t l = 0; l < lightCount; ++l) {
        const auto lights = rendererLights(split->images[l * images / lightCount].light);
        if (!lights) return std::fprintf(stderr, "%s\n", lights.error().message.c_str()), 2;
        for (const bool srgb : {true, false}) {
            const auto start = std::chrono::steady_clock::now();
            const auto snapshot = litSnapshot(*asset, *lights, {srgb, 1});
            if (!snapshot) return std::fprintf(stderr, "%s\n", snapshot.error().message.c_str()), 2;
            seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
            const auto plain = inDatasetFrame(asset->frame, makePlainRenderer(*snapshot, asset->lowPassVariance));
            for (size_t c = 0; c < wantedCameras; ++c) {
                const Camera& camera = split->cameras[c * split->cameras.size() / wantedCameras];
                const auto wanted = (*reference)->render(camera, *lights), found = plain->render(camera, {});
                for (size_t p = 0; p < wanted->rgba.size(); p += 4) {
                    if (wanted->rgba[p + 3] <= 0.5f) continue;
                    count += srgb ? 3 : 0;
                    for (size_t k = p; k < p + 3; ++k) {
                        const double d = shown(wanted->rgba[k]) - (srgb ? std::clamp(found->rgba[k], 0.0f, 1.0f) : shown(found->rgba[k]));
                        error[srgb ? 0 : 1] += d * d;
                    }
                }
            }
        }
    }
    std::printf("%s %s: srgb %.2f dB, linear %.2f dB (masked, %zu lights, %zu cameras), %.1f s per snapshot\n", argv[1], argv[3], -10 * std::log10(error[0] / count),
                -10 * std::log10(error[1] / count), lightCount, wantedCameras, seconds / double(2 * lightCount));
}
