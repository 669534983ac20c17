// Adam for numbers that neighbours learn together, because each alone sees too little: a splat shows its highlight in one image of a
// hundred or in none.
//
// The step of a splat is the sum of its own and of those of the groups of 16, 128 and 1024 splats it belongs to; each level runs Adam on
// the sum of its members' gradients. Groups are runs in memory: splats are kept in Morton order, so members are neighbours. Groups that
// learn next to nothing stand still instead of following noise at full rate: the root of the second moment is raised by a tenth of the
// level's root mean square.
#pragma once

#include "base/byte_stream.h"

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

class SharedAdam {
public:
    static constexpr int kNumbers = 4; // per splat: one, and three that share a second moment
    struct Rates {
        float first = 0, rest = 0, beta1 = 0.9f, beta2 = 0.99f;
    };
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
    static constexpr float kStill = 0.1f;
    struct Level {
        int steps = 0;
        std::vector<float> momentum, second; // [groups][kNumbers], [groups][2]
    };
    /// One for each of kShifts, or only the first; none before the first step.
    std::vector<Level>& levels() { return levels_; }
    bool sharing() const { return sharing_; }

private:
    void stepLevel(Level& level, int shift, std::span<const float> gradient, std::span<const uint8_t> active, const Rates& rates);
    bool sharing_;
    std::vector<Level> levels_;
    std::vector<float> sums_, deltas_;
    std::vector<uint8_t> on_;
};

} // namespace nacre
