// bigs on the training side: coefficients of all splats, evaluated and updated with SIMD over splats.
//
// Layout: blocks of 16 splats, one cache line per coefficient: value[(block * coefficients + k) * 16 + lane]. Coefficients in the order
// tDir 25, tInd 25x3, rho 3, lobe 7 (normal of any length, log sharpness, k rgb), shadow 1, forward 4 (log sharpness, f rgb), s pairs x3. The gradient is never stored: the
// Adam step follows in registers. Adam keeps a momentum per coefficient but one second moment per splat and group (tDir, tInd, rho, each
// degree of s): a third less traffic in a step that is bound by memory, and noise averaged over the group. Only sharpness and k are
// stepped elsewhere (SharedAdam): few images show a splat its highlight, so neighbours learn together.
#pragma once

#include "appearance/bigs/bigs.h"
#include "appearance/trainable.h"
#include "render/aligned_vector.h"
#include "render/channel_stride.h"

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

constexpr int kLanes16 = 16;
constexpr size_t kColorStride = channelStride(3 * kMaxLightsPerStep); // floats per visible splat of colours and their gradients

constexpr int kTDir = 0, kTInd = 25, kRho = 100, kLobe = 103, kShadow = 110, kForward = 111, kScatter = 115; // first coefficient of each channel
constexpr int kLobeSharpness = kLobe + 3, kLobeColor = kLobe + 4;

enum BigsGroup { kGroupDirect, kGroupIndirect, kGroupRho, kGroupNormal, kGroupShadow, kGroupScatter0, kBigsGroups = kGroupScatter0 + 5 };

struct BigsParameters {
    int sFunctions = 0;               // 0, 1, 4, 9, 16 or 25
    size_t count = 0;
    AlignedVector<float> value, momentum; // [blocks][coefficients()][16]
    AlignedVector<float> secondMoment;    // [blocks][kBigsGroups][16]
    std::vector<uint8_t> visibility;      // [count][kVisibilityTexels]; empty: nothing shades anything
    std::vector<uint8_t> scatters;        // [count]: 0 where s is left out, and zero; empty: s is everywhere

    int coefficients() const { return kScatter + 3 * bigsPairCount(sFunctions); }
    size_t blocks() const { return (count + kLanes16 - 1) / kLanes16; }
    size_t index(size_t splat, int k) const { return (splat / kLanes16 * coefficients() + k) * kLanes16 + splat % kLanes16; }
    void resize(size_t newCount);     // new splats are zero
    /// Row `to` becomes a copy of row `from`, its optimiser state cleared.
    void copySplat(size_t from, size_t to);
    /// splat i of the result is splat order[i] of this, optimiser state included.
    void permute(std::span<const uint32_t> order);
    /// Rows without s from here on; all else, optimiser state included, stays.
    void dropScatter();
    /// s only where kept[splat] != 0.
    void keepScatter(std::span<const uint8_t> kept);
};

/// How many SH functions of each channel are in use (bands are switched on one after the other), and whether the lobe is.
struct BigsBands {
    int direct = 25, indirect = 25, scatter = 0;
    bool lobe = false, forward = false;
};

/// One direction more, without radiance, at which the regularisers are evaluated (BiGS section 5.1).
struct BigsRandomLight {
    bool on = false;
    float direction[3] = {0, 0, 1};
};

struct BigsUpdate {
    float rate[kBigsGroups] = {};
    float beta1 = 0.9f, beta2 = 0.99f;
    int step = 1;                     // from 1, for bias correction
    float positiveWeight = 0, energyWeight = 0; // of BiGS eq. 15 and 14, already divided by the number of splats
};

constexpr int kBigsTermStride = 40;   // floats per splat: 8 per light and for the random light

/// Gradient of sharpness and k, for SharedAdam: [splat][4] d log sharpness, d k; active[splat] if the splat took part.
struct BigsLobeGradients {
    std::vector<float> gradient;
    std::vector<uint8_t> active;
    void clear(size_t count) { gradient.assign(4 * count, 0.0f), active.assign(count, 0); }
};

/// Colours (radiance) of the visible splats: colors[visible][kColorStride], three per light. Keeps the unclamped terms
/// [block][kBigsTermStride][16] (64-byte aligned) for the backward pass.
void bigsForward(const BigsParameters& parameters, const VisibleView& view, const LitView& lit, const BigsBands& bands,
                 const BigsRandomLight& random, float* colors, float* terms);

/// One Adam step of every visible splat with active[visible] != 0 from dColors[visible][kColorStride], after bigsForward of the same arguments.
/// Overwrites `lobe` with bands.lobe, `forward` with bands.forward.
void bigsBackwardAndStep(BigsParameters& parameters, const VisibleView& view, const LitView& lit, const BigsBands& bands,
                         const BigsRandomLight& random, const uint8_t* active, const float* dColors, const float* terms,
                         const BigsUpdate& update, BigsLobeGradients& lobe, BigsLobeGradients& forward);

} // namespace nacre
