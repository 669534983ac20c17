#include "appearance/shared_adam.h"

#include <cmath>

namespace nacre {

void SharedAdam::stepLevel(Level& level, int shift, std::span<const float> gradient, std::span<const uint8_t> active, const Rates& rates)
{
    const size_t count = active.size(), groups = groupCount(count, shift);
    if (level.momentum.size() != groups * kNumbers) level = {0, std::vector<float>(groups * kNumbers), std::vector<float>(groups * 2)};
    sums_.assign(groups * kNumbers, 0.0f), on_.assign(groups, 0);
    for (size_t i = 0; i < count; ++i) {
        if (!active[i]) continue;
        const size_t g = i >> shift;
        on_[g] = 1;
        for (size_t k = 0; k < kNumbers; ++k) sums_[g * kNumbers + k] += gradient[i * kNumbers + k];
    }
    ++level.steps;
    double meanFirst = 0, meanRest = 0;
    for (size_t g = 0; g < groups; ++g) {
        float* v = &level.second[g * 2];
        if (on_[g]) learn(&sums_[g * kNumbers], rates, &level.momentum[g * kNumbers], v);
        meanFirst += v[0], meanRest += v[1];
    }
    const Correction corrections = correction(rates, level.steps);
    const float still[2] = {floorOf(meanFirst, groups, corrections), floorOf(meanRest, groups, corrections)};
    for (size_t g = 0; g < groups; ++g) // sums_ now holds the steps
        stepOf(&level.momentum[g * kNumbers], &level.second[g * 2], still, rates, corrections, &sums_[g * kNumbers]);
    for (size_t i = 0; i < count; ++i)
        if (active[i])
            for (size_t k = 0; k < kNumbers; ++k) deltas_[i * kNumbers + k] += sums_[(i >> shift) * kNumbers + k];
}

std::span<const float> SharedAdam::step(std::span<const float> gradient, std::span<const uint8_t> active, const Rates& rates)
{
    levels_.resize(sharing_ ? std::size(kShifts) : 1);
    deltas_.assign(gradient.size(), 0.0f);
    for (size_t k = 0; k < levels_.size(); ++k) stepLevel(levels_[k], kShifts[k], gradient, active, rates);
    return deltas_;
}

void SharedAdam::save(ByteWriter& out) const
{
    out.value(uint32_t(levels_.size()));
    for (const Level& level : levels_) out.value(int32_t(level.steps)), out.array(level.momentum), out.array(level.second);
}

bool SharedAdam::load(ByteReader& in, size_t count)
{
    const uint32_t n = in.value<uint32_t>();
    if (in.failed || (n != 0 && n != (sharing_ ? std::size(kShifts) : 1))) return false;
    levels_.assign(n, {});
    for (size_t k = 0; k < n; ++k) {
        Level& level = levels_[k];
        level.steps = in.value<int32_t>();
        in.array(level.momentum), in.array(level.second);
        const size_t groups = groupCount(count, kShifts[k]);
        if (in.failed || level.momentum.size() != groups * kNumbers || level.second.size() != groups * 2 || level.steps < 0) return false;
    }
    return true;
}

} // namespace nacre
