// An asset made simpler than it was baked: fewer splats, fewer parts. The runtime does it when it loads, `nacre tune` to write a smaller file,
// `nacre report` to measure what it costs: all by this one function.
//
// The order of importance follows from the channel `importance`: log2 of the mean over views of a splat's squared blending weights, summed over
// the pixels. A random order in which a splat's odds grow with it (weighted sampling; Efraimidis and Spirakis 2006), drawn with numbers that are
// evenly spread along a space-filling curve: each share of the splats is a prefix of the order, and spread evenly over the object. At a
// quarter of the splats 28.3 dB of bunny_wax's 30.5, where the quarter that shows most has 26.4 and a uniform random one, grown as well, 27.1.
// Those that stay grow over those that go, by share^-growth, which was measured against the whole asset (baker/pack/importance.h), and take
// on the mean of what these were made of: 0.2 to 1 dB.
#pragma once

#include "base/result.h"
#include "splats/splat_asset.h"

#include <cstdint>
#include <string>
#include <vector>

namespace nacre {

/// The most important splats first. `asset` has the channel `importance`.
std::vector<uint32_t> orderOfImportance(const SplatAsset& asset);

/// Finite, within the ranges of Detail. Error kBadInput names the field.
Status checkDetail(const Detail& detail);

/// `asset`: valid, expanded (coded_channels.h). Maps that a reader draws from the splats (drawnVisibility) are, afterwards, those of the splats
/// that are left. Errors kBadInput: checkDetail; fewer splats asked of an asset without an order of importance, which names what makes one.
Status reduceDetail(SplatAsset& asset, const Detail& detail);

/// "35 % of the splats, no lobe, 9 transport functions"; "everything".
std::string detailText(const Detail& detail);

} // namespace nacre
