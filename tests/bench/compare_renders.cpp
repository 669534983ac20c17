// PSNR between the renders of two `nacre eval --images` folders of the same split, e.g. GL against the reference renderer.
//   compare_renders DIR_A DIR_B
// Prints each image and the mean and minimum; exit code 2 if the folders do not match.
#include "eval/metrics.h"
#include "interchange/exr.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>

int main(int argc, char** argv)
{
    if (argc != 3) {
        std::fprintf(stderr, "usage: compare_renders DIR_A DIR_B\n");
        return 2;
    }
    double sum = 0, worst = 1e9;
    int count = 0;
    for (;; ++count) {
        char name[32];
        std::snprintf(name, sizeof name, "/%04d_render.exr", count);
        const std::string a = argv[1] + std::string(name), b = argv[2] + std::string(name);
        if (!std::filesystem::exists(a) && !std::filesystem::exists(b)) break;
        const auto imageA = nacre::readExr(a), imageB = nacre::readExr(b);
        if (!imageA || !imageB) {
            std::fprintf(stderr, "%s\n", (imageA ? imageB : imageA).error().message.c_str());
            return 2;
        }
        const nacre::ImageMetrics m = nacre::compareImages(*imageA, *imageB);
        std::printf("%04d %.2f dB\n", count, m.psnr);
        sum += m.psnr, worst = std::min(worst, m.psnr);
    }
    if (count == 0) {
        std::fprintf(stderr, "%s: no 0000_render.exr\n", argv[1]);
        return 2;
    }
    std::printf("%d images: mean %.2f dB, minimum %.2f dB\n", count, sum / count, worst);
    return 0;
}
