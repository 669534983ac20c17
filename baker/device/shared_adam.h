// SharedAdam (appearance/shared_adam.h) on a device: the same groups and the same mathematics of a group; sums are taken group by group of the level
// below, in a fixed order.
#pragma once

#include "appearance/shared_adam.h"
#include "device/device.h"

#include <iterator>

namespace nacre::NACRE_BACKEND {

constexpr int kAdamNumbers = SharedAdam::kNumbers, kAdamLevels = int(std::size(SharedAdam::kShifts));

/// Sums of the gradients of a level's groups from those of the level below.
struct SumGroups {
    static constexpr uint32_t kThreads = 128;
    const float* below;
    const uint8_t* belowOn;
    float* sums;
    uint8_t* on;
    uint32_t belowCount, groups;
    int shift; // log2 of how many of those below make one
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const size_t g = t.index();
        if (g >= groups) return;
        float sum[kAdamNumbers] = {};
        uint8_t any = 0;
        for (size_t i = g << shift; i < (g + 1) << shift && i < belowCount; ++i) {
            if (!belowOn[i]) continue;
            any = 1;
            for (int k = 0; k < kAdamNumbers; ++k) sum[k] += below[i * kAdamNumbers + size_t(k)];
        }
        on[g] = any;
        for (int k = 0; k < kAdamNumbers; ++k) sums[g * kAdamNumbers + size_t(k)] = sum[k];
    }
};

struct DeviceAdamLevel {
    float *momentum, *second, *still; // still: [2]
    uint32_t groups;
    SharedAdam::Correction correction;
};

constexpr uint32_t kAdamThreads = 256;
struct AdamSums {
    double sum[2][kAdamThreads];
    /// The sums over a block's threads, in sum[..][0].
    NACRE_DEVICE void add(const Thread& t, const double own[2])
    {
        for (int k = 0; k < 2; ++k) sum[k][t.thread()] = own[k];
        for (uint32_t half = kAdamThreads / 2; half > 0; half /= 2) {
            t.sync();
            if (t.thread() < half)
                for (int k = 0; k < 2; ++k) sum[k][t.thread()] += sum[k][t.thread() + half];
        }
        t.sync();
    }
};

/// The groups' moments, and the sum of a block's second moments. Floor: 16 bytes a group, 64 of one that takes part.
struct LearnGroups {
    static constexpr uint32_t kThreads = kAdamThreads;
    using Shared = AdamSums;
    DeviceAdamLevel level;
    const float* sums;
    const uint8_t* on;
    SharedAdam::Rates rates;
    double* ofBlocks; // [blocks][2]
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const size_t g = t.index();
        double own[2] = {};
        if (g < level.groups) {
            if (on[g]) SharedAdam::learn(sums + g * kAdamNumbers, rates, level.momentum + g * kAdamNumbers, level.second + 2 * g);
            for (size_t k = 0; k < 2; ++k) own[k] = double(level.second[2 * g + k]);
        }
        s.add(t, own);
        if (t.thread() < 2) ofBlocks[size_t(2) * t.block() + t.thread()] = s.sum[t.thread()][0];
    }
};

/// By one block, from the sums of LearnGroups'.
struct FindStill {
    static constexpr uint32_t kThreads = kAdamThreads;
    using Shared = AdamSums;
    DeviceAdamLevel level;
    const double* ofBlocks;
    uint32_t blocks;
    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        double own[2] = {};
        for (size_t b = t.thread(); b < blocks; b += kThreads)
            for (size_t k = 0; k < 2; ++k) own[k] += ofBlocks[2 * b + k];
        s.add(t, own);
        if (t.thread() < 2) level.still[t.thread()] = SharedAdam::floorOf(s.sum[t.thread()][0], level.groups, level.correction);
    }
};

/// Keeps its memory.
class DeviceSharedAdam {
public:
    struct Levels {
        DeviceAdamLevel at[kAdamLevels];
        int count;
        SharedAdam::Rates rates;
        /// What is to be subtracted of a splat's numbers.
        NACRE_DEVICE void step(size_t splat, float delta[kAdamNumbers]) const
        {
            for (int k = 0; k < kAdamNumbers; ++k) delta[k] = 0;
            for (int j = 0; j < count; ++j) {
                const size_t g = splat >> shiftOf(j);
                float of[kAdamNumbers];
                SharedAdam::stepOf(at[j].momentum + g * kAdamNumbers, at[j].second + 2 * g, at[j].still, rates, at[j].correction, of);
                for (int k = 0; k < kAdamNumbers; ++k) delta[k] += of[k];
            }
        }
        NACRE_DEVICE static int shiftOf(int level) { return level == 0 ? 0 : 1 + 3 * level; }
    };
    static_assert(SharedAdam::kShifts[0] == 0 && SharedAdam::kShifts[1] == 4 && SharedAdam::kShifts[2] == 7 && SharedAdam::kShifts[3] == 10 && kAdamLevels == 4);

    void upload(Device& device, SharedAdam& host, size_t splats)
    {
        levels_ = host.sharing() ? kAdamLevels : 1;
        still_.reserve(device, 2 * kAdamLevels);
        for (int j = 0; j < levels_; ++j) {
            Level& level = level_[j];
            level.groups = uint32_t(SharedAdam::groupCount(splats, SharedAdam::kShifts[j]));
            level.momentum.reserve(device, level.groups * size_t(kAdamNumbers)), level.second.reserve(device, level.groups * size_t(2));
            level.sums.reserve(device, level.groups * size_t(kAdamNumbers)), level.on.reserve(device, level.groups);
            const bool known = size_t(j) < host.levels().size() && host.levels()[size_t(j)].momentum.size() == level.momentum.size();
            level.steps = known ? host.levels()[size_t(j)].steps : 0;
            if (known) {
                level.momentum.upload(device, std::span<const float>(host.levels()[size_t(j)].momentum));
                level.second.upload(device, std::span<const float>(host.levels()[size_t(j)].second));
            } else {
                level.momentum.zero(device), level.second.zero(device);
            }
        }
    }
    void download(Device& device, SharedAdam& host) const
    {
        if (level_[0].steps == 0) return host.reset();
        host.levels().resize(size_t(levels_));
        for (int j = 0; j < levels_; ++j) {
            SharedAdam::Level& to = host.levels()[size_t(j)];
            to.steps = level_[j].steps;
            to.momentum.resize(level_[j].momentum.size()), to.second.resize(level_[j].second.size());
            level_[j].momentum.download(device, std::span(to.momentum)), level_[j].second.download(device, std::span(to.second));
        }
    }

    /// gradient: [splats][kAdamNumbers] where active[splat] != 0. What it returns is valid until the next call.
    Levels step(Device& device, const float* gradient, const uint8_t* active, const SharedAdam::Rates& rates)
    {
        Levels out{};
        out.count = levels_, out.rates = rates;
        for (int j = 0; j < levels_; ++j) {
            Level& level = level_[j];
            ++level.steps;
            out.at[j] = {level.momentum.data(), level.second.data(), still_.data() + 2 * j, level.groups, SharedAdam::correction(rates, level.steps)};
            if (j > 0) {
                const uint32_t below = level_[j - 1].groups;
                launch(device, blocksFor(level.groups, SumGroups::kThreads),
                       SumGroups{gradient, active, level.sums.data(), level.on.data(), below, level.groups, SharedAdam::kShifts[j] - SharedAdam::kShifts[j - 1]});
                gradient = level.sums.data(), active = level.on.data();
            }
            const uint32_t blocks = blocksFor(level.groups, LearnGroups::kThreads);
            ofBlocks_.reserve(device, size_t(2) * blocks);
            launch(device, blocks, LearnGroups{out.at[j], gradient, active, rates, ofBlocks_.data()});
            launch(device, blocks > 0, FindStill{out.at[j], ofBlocks_.data(), blocks});
        }
        return out;
    }

private:
    struct Level {
        int steps = 0;
        uint32_t groups = 0;
        Buffer<float> momentum, second, sums;
        Buffer<uint8_t> on;
    };
    Level level_[kAdamLevels];
    int levels_ = kAdamLevels;
    Buffer<float> still_;
    Buffer<double> ofBlocks_;
};

} // namespace nacre::NACRE_BACKEND
