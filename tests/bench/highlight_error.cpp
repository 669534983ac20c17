// PSNR of the brightest pixels: those whose reference luma (Rec. 709 weights of display values) exceeds a threshold, over all images of
// `nacre eval --images` folders.
//   highlight_error DIR...
#include "base/color.h"
#include "interchange/exr.h"

#include <cmath>
#include <cstdio>
#include <filesystem>

using namespace nacre;

constexpr float kLuma = 0.8f;

int main(int argc, char** argv)
{
    if (argc < 2) {
        std::fprintf(stderr, "usage: highlight_error DIR...\n");
        return 2;
    }
    for (int a = 1; a < argc; ++a) {
        double squared = 0;
        size_t pixels = 0;
        int images = 0;
        for (;; ++images) {
            char name[32];
            std::snprintf(name, sizeof name, "/%04d_", images);
            const std::string path = argv[a] + std::string(name);
            if (!std::filesystem::exists(path + "render.exr")) break;
            const auto render = readExr(path + "render.exr"), reference = readExr(path + "reference.exr");
            if (!render || !reference || render->rgba.size() != reference->rgba.size()) {
                std::fprintf(stderr, "%s\n", !render ? render.error().message.c_str() : !reference ? reference.error().message.c_str() : "sizes differ");
                return 2;
            }
            const auto display = [](float x) { return srgbFromLinear(std::fmin(std::fmax(x, 0.0f), 1.0f)); };
            for (size_t i = 0; i < reference->rgba.size(); i += 4) {
                const float *x = &render->rgba[i], *r = &reference->rgba[i];
                if (0.2126f * display(r[0]) + 0.7152f * display(r[1]) + 0.0722f * display(r[2]) <= kLuma) continue;
                ++pixels;
                for (int c = 0; c < 3; ++c) squared += std::pow(double(display(x[c]) - display(r[c])), 2) / 3;
            }
        }
        if (images == 0) {
            std::fprintf(stderr, "%s: no 0000_render.exr (nacre eval --images)\n", argv[a]);
            return 2;
        }
        std::printf("%s: %d images, %zu pixels above luma %.1f, %.2f dB\n", argv[a], images, pixels, double(kLuma),
                    pixels ? -10 * std::log10(std::fmax(squared / double(pixels), 1e-12)) : INFINITY);
    }
}
