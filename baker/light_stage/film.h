// What the passes of one render add up to.
#pragma once

#include "base/image.h"
#include "light_stage/path_tracer.h"
#include "light_stage/sampling.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace nacre::stage {

/// The mean luminance below which an image counts as that bright: nobody waits for the last grain of a night scene.
constexpr double kDarkestMean = 0.05;

/// A pixel is added to by one thread, pass after pass, so sums do not depend on threads.
class Film {
public:
    Film(size_t pixels, size_t lights) : pixels_(pixels), lights_(lights), sum_(pixels * lights * 3), shown_(pixels * lights, glm::vec2(0.0f)), coverage_(pixels) {}

    /// `radiance`: 3 floats per light, summed over the samples of a pass, of which `hits` met the object.
    void add(size_t pixel, const float* radiance, float hits)
    {
        coverage_[pixel] += hits;
        float* sum = sum_.data() + 3 * pixel * lights_;
        for (size_t l = 0; l < lights_; ++l) {
            const float* c = radiance + 3 * l;
            for (size_t k = 0; k < 3; ++k) sum[3 * l + k] += c[k];
            const float shown = std::min(1.0f, luminance({c[0], c[1], c[2]}) / kSamplesPerPass);
            shown_[pixel * lights_ + l] += glm::vec2(shown, shown * shown);
        }
    }

    /// RenderStats::noise of every light after `passes` passes, from their spread; infinite after one.
    std::vector<float> noise(int passes) const
    {
        std::vector<double> mean(lights_), variance(lights_);
        double object = 0.0;
        const double n = passes;
        for (size_t p = 0; p < pixels_; ++p) {
            if (coverage_[p] < 0.5f * float(passes * kSamplesPerPass)) continue;
            object += 1.0;
            for (size_t l = 0; l < lights_; ++l) {
                const glm::dvec2 moments = glm::dvec2(shown_[p * lights_ + l]) / n;
                mean[l] += moments.x;
                if (passes > 1) variance[l] += std::max(0.0, moments.y - moments.x * moments.x) / (n - 1.0);
            }
        }
        std::vector<float> noise(lights_, passes > 1 ? 0.0f : INFINITY);
        for (size_t l = 0; l < lights_ && passes > 1 && object > 0.0; ++l)
            noise[l] = float(std::sqrt(variance[l] / object) / std::max(mean[l] / object, kDarkestMean));
        return noise;
    }

    /// Means, one image per light.
    std::vector<Image> images(int width, int height, int passes) const
    {
        std::vector<Image> images(lights_);
        const float scale = 1.0f / float(passes * kSamplesPerPass);
        for (size_t l = 0; l < lights_; ++l) {
            Image& image = images[l];
            image.width = width;
            image.height = height;
            image.rgba.resize(4 * pixels_);
            for (size_t p = 0; p < pixels_; ++p) {
                for (size_t c = 0; c < 3; ++c) image.rgba[4 * p + c] = sum_[3 * (p * lights_ + l) + c] * scale;
                image.rgba[4 * p + 3] = coverage_[p] * scale;
            }
        }
        return images;
    }

private:
    size_t pixels_ = 0, lights_ = 0;
    std::vector<float> sum_;       // [pixel][light][rgb], over all samples
    std::vector<glm::vec2> shown_; // [pixel][light], over the passes: luminance as shown (1 at most) and its square
    std::vector<float> coverage_;  // [pixel], samples
};

} // namespace nacre::stage
