// Where a bake stands between its first and its last step: how long it is, how large its steps are, and what is due when.
#pragma once

#include "base/result.h"
#include "train/bake.h"

namespace nacre {

/// The options with all that is left to the quality filled in. kBadInput: no such quality.
Result<BakeOptions> withDefaults(BakeOptions options, const OlatDataset& dataset);

/// A bake ends after so many steps or so much time, whichever comes first. Progress is the fraction of it that is done.
class Schedule {
public:
    /// Of a bake with these options, as the user gave them, that begins now.
    Schedule(const BakeOptions& options, const OlatDataset& dataset);

    bool byTime() const { return budgetSeconds_ > 0; } // else progress, and with it every byte, follows the steps alone
    int iterations() const { return iterations_; }
    double seconds() const; // since the bake began, without the time between an interruption and its resumption, and what is left out

    /// So many seconds were no work of the bake.
    void leaveOut(double seconds) { start_ += seconds; }
    /// Goes on with a bake that had run for so long.
    void resume(double seconds);
    /// Call before the first step of this process, with the number of those made before.
    void beginTraining(int step, size_t passLength);

    double progress(int step) const;
    double expectedSteps(int step, double progress) const; // of the whole bake
    double rate(int step, double progress) const;          // of the learning rates at the start
    double secondsLeft(double progress) const;             // -1: unknown

    /// True when every camera has looked at the splats, in so many steps.
    bool allHaveLooked(int stepsSinceReset) const { return stepsSinceReset >= pass_; }
    bool densifies(int stepsSinceReset, double progress) const;
    size_t growth(size_t splats) const; // how many splats a densification may add

private:
    double start_; // of the clock
    int iterations_;
    double budgetSeconds_; // 0: by iterations alone
    double resumedSeconds_ = 0, startedProgress_ = 0;
    int startedStep_ = 0, pass_ = 0, watch_ = 0; // steps in which all cameras look, and in which enough do
};

} // namespace nacre
