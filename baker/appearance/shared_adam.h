// Adam for numbers that neighbours learn together, because each alone sees too little: a splat shows its highlight in one image of a
// hundred or in none.
//
// The step of a splat is the sum of its own and of those of the groups of 16, 128 and 1024 splats it belongs to; each level runs Adam on
// the sum of its members' gradients. Groups are runs in memory: splats are kept in Morton order, so members are neighbours. Groups that
// learn next to nothing stand still instead of following noise at full rate: the root of the second moment is raised by a tenth of the
// level's root mean square.
#pragma once

#include "base/byte_stream.h"
#include "base/host_device.h"

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

class SharedAdam {
public:
    static constexpr float kStill = 0.1f;
    static constexpr int kNumbers = 4; // per splat: one, and three that share a second moment
    struct Rates {
        float first = 0, rest = 0, beta1 = 0.9f, beta2 = 0.99f;
    };
    /// One group: its moments from the sum x of its members' gradients.
    NACRE_HD static void learn(const float x[kNumbers], const Rates& rates, float m[kNumbers], float v[2])
    {
        for (int k = 0; k < kNumbers; ++k) m[k] += (1 - rates.beta1) * (x[k] - m[k]);
        v[0] += (1 - rates.beta2) * (x[0] * x[0] - v[0]);
        v[1] += (1 - rates.beta2) * ((x[1] * x[1] + x[2] * x[2] + x[3] * x[3]) / 3 - v[1]);
    }
    /// The corrections of momentum and second moment after so many steps.
    struct Correction {
        float first, second;
    };
    /// What the root of the second moment is raised by, from the sum of all groups' second moments.
    NACRE_HD static float floorOf(double sum, size_t groups, const Correction& c) { return kStill * std::sqrt(float(sum / double(groups)) / c.second) + 1e-15f; }
    /// What is to be subtracted of each of a group's members.
    NACRE_HD static void stepOf(const float m[kNumbers], const float v[2], const float still[2], const Rates& rates, const Correction& c, float out[kNumbers])
    {
        const float first = rates.first / c.first / (std::sqrt(v[0] / c.second) + still[0]);
        const float rest = rates.rest / c.first / (std::sqrt(v[1] / c.second) + still[1]);
        for (int k = 0; k < kNumbers; ++k) out[k] = m[k] * (k == 0 ? first : rest);
    }

    /// Without sharing every splat learns alone.
    explicit SharedAdam(bool sharing = true) : sharing_(sharing) {}
    /// gradient: [count][kNumbers]; active: [count]. Returns what is to be subtracted, [count][kNumbers], valid until the next call;
    /// zero for splats that were not active.
    std::span<const float> step(std::span<const float> gradient, std::span<const uint8_t> active, const Rates& rates);
    /// After splats have changed places.
    void reset() { levels_.clear(); }

    void save(ByteWriter& out) const;
    bool load(ByteReader& in, size_t count);

    static constexpr int kShifts[] = {0, 4, 7, 10}; // log2 of the groups' sizes
    struct Level {
        int steps = 0;
        std::vector<float> momentum, second; // [groups][kNumbers], [groups][2]
    };
    /// One for each of kShifts, or only the first; none before the first step.
    std::vector<Level>& levels() { return levels_; }
    static Correction correction(const Rates& rates, int steps) { return {1 - std::pow(rates.beta1, float(steps)), 1 - std::pow(rates.beta2, float(steps))}; }
    static size_t groupCount(size_t count, int shift) { return count == 0 ? 0 : ((count - 1) >> shift) + 1; }
    bool sharing() const { return sharing_; }

private:
    void stepLevel(Level& level, int shift, std::span<const float> gradient, std::span<const uint8_t> active, const Rates& rates);
    bool sharing_;
    std::vector<Level> levels_;
    std::vector<float> sums_, deltas_;
    std::vector<uint8_t> on_;
};

} // namespace nacre
