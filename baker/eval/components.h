// Which part of what an asset shows came which way: straight off the surface, or scattered beneath it.
#pragma once

#include "eval/evaluate.h"

#include <optional>

namespace nacre {

/// Share of the radiance (luminance, summed over up to 16 evenly spread images of an evaluation) that the residual gives, 0 to 1: only these
/// are drawn again, without it. Empty if the asset's model does not tell them apart. Edits of the renderer are cleared.
Result<std::optional<double>> scatteredShare(const OlatSplit& split, const EvalResult& evaluated, SplatRenderer& renderer);

} // namespace nacre
