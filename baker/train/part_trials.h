// Trials of the optional parts of a model: what each is worth, and which splats do without it.
#pragma once

#include "train/checkpoint.h"
#include "train/schedule.h"

#include <functional>

namespace nacre {

/// Makes one step that may be undone; splatErrors as Trainer::step. An error ends the trial.
using TrialStep = std::function<Result<LossStats>(const Trainer::Moment& moment, double* splatErrors)>;

/// Tries each part that is due and has not been tried; leaves out what it is not worth, notes its worth in `state` and counts the steps
/// that were kept. After an error the trainer and the state are as if the trial that failed had never begun.
Status leaveOutParts(Trainer& trainer, const Schedule& schedule, const TrialStep& step, BakeState& state);

} // namespace nacre
