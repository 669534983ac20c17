// Blending on the device: twin of rasterForward and rasterBackward (render/raster.h), of blendPixel and blendPixelBackward.
//
// A block of threads is a tile, a warp 8 x 4 of its pixels: two of the 4x4 blocks of TileEntry::blockMask. Entries come in chunks through shared
// memory, the next one on its way while one is blended; each warp walks those that touch its blocks. Backward, the gradient of a splat's
// colours is a product of matrices, [splats x pixels] of weights by [pixels x channels] of the image's gradient: each warp blends up to 16
// splats with a pixel per lane and leaves weights and d ln(alpha) in shared memory, then turns round and multiplies with 1 x 4 or 2 x 4 sums
// per lane. The sums of eight warps are added in their order, the rows of one splat in tile order: no atomics, the same bytes each time.
#pragma once

#include "device/device.h"
#include "device/tiles.h"
#include "render/channel_stride.h"
#include "render/tile_splat.h"

#include <stdexcept>

#ifdef __CUDACC__
#define NACRE_UNROLL_TWICE _Pragma("unroll 2") // the next loop
#else
#define NACRE_UNROLL_TWICE
#endif

namespace nacre::NACRE_BACKEND {

namespace detail {

struct alignas(16) Float4 {
    float v[4];
};

/// Where in its tile and in the image a thread's pixel is.
struct TilePixel {
    float dx, dy;     // from the tile's centre
    size_t at;        // in a plane
    bool inside;
    NACRE_DEVICE TilePixel(const Thread& t, const TileView& view)
    {
        const int x = int(t.warp() % 2) * 8 + int(t.lane()) % 8, y = int(t.warp() / 2) * 4 + int(t.lane()) / 8;
        const int column = int(t.block()) % view.tilesX * kTileSize + x, row = int(t.block()) / view.tilesX * kTileSize + y;
        dx = float(x) + 0.5f - 0.5f * kTileSize, dy = float(y) + 0.5f - 0.5f * kTileSize;
        inside = column < view.width && row < view.height;
        at = inside ? size_t(row) * size_t(view.width) + size_t(column) : 0;
    }
};

/// Bits of TileEntry::blockMask that are a warp's pixels.
NACRE_DEVICE inline uint32_t warpBlocks(uint32_t warp) { return 3u << (4 * (warp / 2) + 2 * (warp % 2)); }

NACRE_DEVICE inline uint32_t lowestBit(uint32_t bits)
{
#ifdef __CUDA_ARCH__
    return uint32_t(__ffs(int(bits))) - 1;
#else
    return uint32_t(__builtin_ctz(bits));
#endif
}

/// Some entries of a tile with their splats and colours, in shared memory.
template <int C, uint32_t Entries>
struct Chunk {
    static constexpr uint32_t kQuads = uint32_t(C + 3) / 4;
    struct alignas(16) Splat {
        TileSplat splat;
        uint32_t blockMask, unused;
    };
    Splat splats[Entries];
    Float4 colors[Entries][kQuads];
};

/// Brings chunks to shared memory through registers: the loads of one are under way while the last is worked on, those of the entries that say
/// what to load one chunk further ahead. Thread e * 8 + q brings quad q of the colours of entry e, thread e its splat.
template <int C, uint32_t Entries>
class ChunkLoader {
    using Target = Chunk<C, Entries>;
    static_assert(Entries * 8 <= 256 && Entries <= 32 && Target::kQuads <= 8);

public:
    NACRE_DEVICE ChunkLoader(const Thread& t, const TileView& view, const float* colors)
        : view_(view), colors_(colors), entry_(t.thread() / 8), quad_(t.thread() % 8), splat_(t.thread()),
          centerX_(float(int(t.block()) % view.tilesX * kTileSize) + 0.5f * kTileSize),
          centerY_(float(int(t.block()) / view.tilesX * kTileSize) + 0.5f * kTileSize), next_(view.tileStart[t.block()]), end_(view.tileStart[t.block() + 1])
    {
        loadEntries();
        loadValues();
    }
    NACRE_DEVICE void put(Target& to)
    {
        if (colorThere_) to.colors[entry_][quad_] = color_;
        if (splatThere_) to.splats[splat_] = {tileSplat(projected_, centerX_, centerY_), mask_, 0};
        loadValues();
    }

private:
    NACRE_DEVICE void loadEntries()
    {
        colorAhead_ = entry_ < Entries && quad_ < Target::kQuads && next_ + entry_ < end_;
        splatAhead_ = splat_ < Entries && next_ + splat_ < end_;
        if (colorAhead_) colorVisible_ = view_.entries[next_ + entry_].visible;
        if (splatAhead_) splatVisible_ = view_.entries[next_ + splat_].visible, maskAhead_ = view_.entries[next_ + splat_].blockMask;
        next_ += Entries;
    }
    NACRE_DEVICE void loadValues()
    {
        colorThere_ = colorAhead_, splatThere_ = splatAhead_, mask_ = maskAhead_;
        if (colorThere_) color_ = reinterpret_cast<const Float4*>(colors_ + size_t(colorVisible_) * channelStride(C))[quad_];
        if (splatThere_) projected_ = view_.projected[splatVisible_];
        loadEntries();
    }

    const TileView& view_;
    const float* colors_;
    const uint32_t entry_, quad_, splat_;
    const float centerX_, centerY_;
    uint32_t next_, end_;
    uint32_t colorVisible_ = 0, splatVisible_ = 0, maskAhead_ = 0, mask_ = 0;
    bool colorAhead_ = false, splatAhead_ = false, colorThere_ = false, splatThere_ = false;
    Float4 color_{};
    ProjectedGaussian<float> projected_{};
};

struct SplatAlpha {
    float alpha;
    bool on, capped;
};

NACRE_DEVICE inline SplatAlpha splatAlpha(const TileSplat& s, float dx, float dy, float transmittance)
{
    const float x = dx - s.x, y = dy - s.y;
    const float power = s.logOpacity - ((s.b * y + s.a * x) * x + s.c * y * y);
    const float raw = std::exp2(power);
    return {raw < kMaxAlpha ? raw : kMaxAlpha, power >= kMinLogAlpha && transmittance >= kMinTransmittance, !(raw < kMaxAlpha)};
}

/// Floor, per pair of a pixel and a splat that touches its warp: 14 + C multiply-adds and one power of two; bytes are those of entries, splats and
/// colours, 12 + 36 + 4 C per (splat, tile), and 4 (C + 1) per pixel.
template <int C>
struct BlendForwardKernel {
    static constexpr uint32_t kThreads = kTilePixels, kEntries = 32;
    struct Shared {
        Chunk<C, kEntries> chunk[2];
        uint32_t alive[2][kThreads / kWarp];
    };
    TileView view;
    const float* colors;
    float* planes;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const TilePixel pixel(t, view);
        const uint32_t count = view.tileStart[t.block() + 1] - view.tileStart[t.block()], blocks = warpBlocks(t.warp());
        float sum[C], transmittance = pixel.inside ? 1.0f : 0.0f;
        for (float& x : sum) x = 0.0f;
        ChunkLoader<C, kEntries> loader(t, view, colors);
        bool alive = true;
        for (uint32_t first = 0, k = 0; first < count; first += kEntries, k ^= 1) {
            const Chunk<C, kEntries>& chunk = s.chunk[k];
            loader.put(s.chunk[k]);
            t.sync(); // all have left the chunk before this one, whose place the next takes
            if (first > 0) {
                uint32_t any = 0;
                for (uint32_t a : s.alive[k ^ 1]) any |= a;
                if (!any) break;
            }
            const bool touches = first + t.lane() < count && (chunk.splats[t.lane()].blockMask & blocks) != 0;
            const uint32_t touched = t.ballot(kFullWarp, touches);
            for (uint32_t left = alive ? touched : 0; left; left &= left - 1) {
                const uint32_t i = lowestBit(left);
                const SplatAlpha a = splatAlpha(chunk.splats[i].splat, pixel.dx, pixel.dy, transmittance);
                if (a.on) {
                    const float w = a.alpha * transmittance;
                    for (int c = 0; c < C; ++c) sum[c] += w * chunk.colors[i][c / 4].v[c % 4];
                    transmittance -= w;
                }
            }
            alive = t.ballot(kFullWarp, transmittance >= kMinTransmittance) != 0;
            if (t.lane() == 0) s.alive[k][t.warp()] = alive;
        }
        if (!pixel.inside) return;
        const size_t pixels = size_t(view.width) * size_t(view.height);
        for (int c = 0; c < C; ++c) planes[size_t(c) * pixels + pixel.at] = sum[c];
        planes[size_t(C) * pixels + pixel.at] = 1.0f - transmittance;
    }
};

constexpr uint32_t kMoments = 8; // of each row of gradients, six used

/// Of a row of gradients per (splat, tile): channels, the weight, then moments.
template <int C>
constexpr uint32_t kRowQuads = uint32_t(C + 4) / 4;
template <int C>
constexpr uint32_t kRowFloats = 4 * kRowQuads<C> + kMoments;

/// Floor, per pair of a pixel and a splat that touches its warp: 2 C + 40 multiply-adds and one power of two (as much again of the product, C + 1, where
/// a warp's chunk is not full); bytes as forward, and a row of 4 (C + 9) per (splat, tile).
template <int C>
struct BlendBackwardKernel {
    static constexpr uint32_t kThreads = kTilePixels, kWarps = kThreads / kWarp, kEntries = 16;
    static constexpr uint32_t kQuads = kRowQuads<C>;
    static constexpr uint32_t kGroups = kQuads <= 4 ? 4 : 8;              // lanes across quads of channels
    static constexpr uint32_t kRound = 8;                                 // splats that are multiplied at once,
    static constexpr uint32_t kPerLane = kRound * kGroups / kWarp;        // of which a lane has so many, and four channels
    static constexpr uint32_t kLine = kWarp + 4;                          // of weights: banks of four floats differ from splat to splat
    struct Weights {                                                      // of one warp
        float weight[kEntries][kLine], dLog[kEntries][kLine];
    };
    struct Sums {
        float channels[kEntries][4 * kQuads], moments[kEntries][kMoments];
    };
    static_assert(sizeof(Sums) <= sizeof(Weights));
    struct Shared {
        alignas(16) union { Weights weights; Sums sums; } warp[kWarps];
        Float4 dPixel[kThreads][kGroups];                                 // see quadAt
        Chunk<C, kEntries> chunk;
        uint32_t touched[kWarps], alive[kWarps];
    };
    TileView view;
    const float *colors, *planes, *dPlanes;
    float* rows; // [entry][kRowFloats]

    /// Quads are put so that eight lanes that write those of their pixels, and lanes that read those of one pixel, meet different banks.
    NACRE_DEVICE static uint32_t quadAt(uint32_t pixel, uint32_t quad) { return quad ^ (kGroups == 8 ? pixel % 8 : pixel / 2 % 4); }

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const uint32_t start = view.tileStart[t.block()], count = view.tileStart[t.block() + 1] - start, blocks = warpBlocks(t.warp());
        if (count == 0) return; // the whole block
        const TilePixel pixel(t, view);
        float dPixel[C], dAlpha, total;
        loadPixel(t, s, pixel, dPixel, dAlpha, total);
        float transmittance = pixel.inside ? 1.0f : 0.0f, prefix = 0.0f;
        ChunkLoader<C, kEntries> loader(t, view, colors);
        bool alive = true;
        for (uint32_t first = 0; first < count; first += kEntries) {
            loader.put(s.chunk);
            t.sync(); // also: the last chunk's sums have been read
            auto& own = s.warp[t.warp()];
            const uint32_t e = t.lane() % kEntries;
            const bool touches = alive && t.lane() < kEntries && first + e < count && (s.chunk.splats[e].blockMask & blocks) != 0;
            const uint32_t touched = t.ballot(kFullWarp, touches), slots = bitCount(touched);
            for (uint32_t left = touched, slot = 0; left; left &= left - 1, ++slot) {
                const uint32_t i = lowestBit(left);
                const SplatAlpha a = splatAlpha(s.chunk.splats[i].splat, pixel.dx, pixel.dy, transmittance);
                float weight = 0.0f, dLog = 0.0f;
                if (a.on) {
                    float value = dAlpha;
                    for (int c = 0; c < C; ++c) value += dPixel[c] * s.chunk.colors[i][c / 4].v[c % 4];
                    weight = a.alpha * transmittance;
                    prefix += weight * value;
                    if (!a.capped) dLog = a.alpha * (transmittance * value - (total - prefix) / (1.0f - a.alpha)); // a capped splat does not feel its geometry
                    transmittance -= weight;
                }
                own.weights.weight[slot][t.lane()] = weight, own.weights.dLog[slot][t.lane()] = dLog;
            }
            alive = t.ballot(kFullWarp, transmittance >= kMinTransmittance) != 0;
            t.syncWarp(kFullWarp);
            multiply(t, s, touched, slots);
            if (t.lane() == 0) s.touched[t.warp()] = touched, s.alive[t.warp()] = alive;
            t.sync();
            const uint32_t here = count - first < kEntries ? count - first : kEntries;
            addWarps(t, s, rows + size_t(start + first) * kRowFloats<C>, here);
            uint32_t any = 0;
            for (uint32_t a : s.alive) any |= a;
            if (!any) { // the rest is hidden
                for (size_t i = size_t(start + first + here) * kRowFloats<C> + t.thread(); i < size_t(start + count) * kRowFloats<C>; i += kThreads) rows[i] = 0.0f;
                break;
            }
        }
    }

private:
    /// The image's gradient at the thread's pixel, and what the whole pixel contributes to the loss to first order.
    NACRE_DEVICE void loadPixel(const Thread& t, Shared& s, const TilePixel& pixel, float (&dPixel)[C], float& dAlpha, float& total) const
    {
        const size_t pixels = size_t(view.width) * size_t(view.height);
        total = 0.0f;
        for (int c = 0; c < C; ++c) {
            dPixel[c] = pixel.inside ? dPlanes[size_t(c) * pixels + pixel.at] : 0.0f;
            if (pixel.inside) total += planes[size_t(c) * pixels + pixel.at] * dPixel[c];
        }
        dAlpha = pixel.inside ? dPlanes[size_t(C) * pixels + pixel.at] : 0.0f;
        if (pixel.inside) total += planes[size_t(C) * pixels + pixel.at] * dAlpha;
        for (uint32_t q = 0; q < kGroups; ++q) {
            Float4 quad;
            for (uint32_t k = 0; k < 4; ++k) {
                const int c = int(4 * q + k);
                quad.v[k] = c < C ? dPixel[c < C ? c : 0] : c == C ? 1.0f : 0.0f; // the gradient of the weight's own channel is 1
            }
            s.dPixel[t.thread()][quadAt(t.thread(), q)] = quad;
        }
    }

    /// The channels of kRound splats of the warp.
    NACRE_DEVICE void addRound(const Thread& t, const Shared& s, uint32_t first, float (&sums)[kPerLane][4]) const
    {
        const auto& own = s.warp[t.warp()];
        const uint32_t group = t.lane() % kGroups, row = first + t.lane() / kGroups * kPerLane;
        NACRE_UNROLL_TWICE // all eight times: 200 registers
        for (uint32_t p = 0; p < kWarp; p += 4) {
            Float4 w[kPerLane];
            for (uint32_t r = 0; r < kPerLane; ++r) w[r] = *reinterpret_cast<const Float4*>(&own.weights.weight[row + r][p]);
            for (uint32_t k = 0; k < 4; ++k) {
                const uint32_t from = t.warp() * kWarp + p + k;
                const Float4 d = s.dPixel[from][quadAt(from, group)];
                for (uint32_t r = 0; r < kPerLane; ++r)
                    for (uint32_t c = 0; c < 4; ++c) sums[r][c] += w[r].v[k] * d.v[c];
            }
        }
    }

    /// From a warp's weights to its sums over pixels.
    NACRE_DEVICE void multiply(const Thread& t, Shared& s, uint32_t touched, uint32_t slots) const
    {
        constexpr uint32_t kRounds = kEntries / kRound;
        auto& own = s.warp[t.warp()];
        const uint32_t group = t.lane() % kGroups, row = t.lane() / kGroups * kPerLane;
        float sums[kRounds][kPerLane][4] = {};
        static_assert(kRounds == 2);
        addRound(t, s, 0, sums[0]);
        if (slots > kRound) addRound(t, s, kRound, sums[1]);
        float m[6] = {};
        const uint32_t slot = t.lane() % kEntries;
        if (slot < slots) { // half a warp each has the upper two and the lower two rows of the pixels
            uint32_t left = touched;
            for (uint32_t i = 0; i < slot; ++i) left &= left - 1;
            const TileSplat& splat = s.chunk.splats[lowestBit(left)].splat;
            const float x0 = float(t.warp() % 2 * 8) + 0.5f - 0.5f * kTileSize - splat.x;
            const float y0 = float(t.warp() / 2 * 4 + t.lane() / kEntries * 2) + 0.5f - 0.5f * kTileSize - splat.y;
            for (uint32_t line = 0; line < 2; ++line) {
                float sum = 0.0f, sumX = 0.0f, sumXX = 0.0f;
                for (uint32_t column = 0; column < 8; column += 4) {
                    const Float4 g = *reinterpret_cast<const Float4*>(&own.weights.dLog[slot][t.lane() / kEntries * 16 + line * 8 + column]);
                    for (uint32_t k = 0; k < 4; ++k) {
                        const float x = x0 + float(column + k), gx = g.v[k] * x;
                        sum += g.v[k], sumX += gx, sumXX += gx * x;
                    }
                }
                const float y = y0 + float(line);
                m[0] += sum, m[1] += sumX, m[2] += y * sum, m[3] += sumXX, m[4] += y * sumX, m[5] += y * y * sum;
            }
        }
        for (float& x : m) x += t.shuffleXor(kFullWarp, x, kEntries); // also: all have read the weights, whose place the sums take
        t.syncWarp(kFullWarp);
        for (uint32_t round = 0; round < kRounds; ++round)
            for (uint32_t r = 0; r < kPerLane; ++r)
                if (group < kQuads && round * kRound + row + r < slots)
                    *reinterpret_cast<Float4*>(&own.sums.channels[round * kRound + row + r][4 * group]) = {{sums[round][r][0], sums[round][r][1], sums[round][r][2], sums[round][r][3]}};
        if (t.lane() < slots) {
            Float4* to = reinterpret_cast<Float4*>(own.sums.moments[slot]);
            to[0] = {{m[0], m[1], m[2], m[3]}}, to[1] = {{m[4], m[5], 0.0f, 0.0f}};
        }
    }

    /// The rows of `count` entries: the sums of the warps that they touch, in the warps' order.
    NACRE_DEVICE void addWarps(const Thread& t, const Shared& s, float* to, uint32_t count) const
    {
        for (uint32_t i = t.thread(); i < count * kRowFloats<C>; i += kThreads) {
            const uint32_t entry = i / kRowFloats<C>, k = i % kRowFloats<C>;
            float sum = 0.0f;
            for (uint32_t w = 0; w < kWarps; ++w) {
                if (!(s.touched[w] >> entry & 1)) continue;
                const uint32_t slot = bitCount(s.touched[w] & ((1u << entry) - 1));
                sum += k < 4 * kQuads ? s.warp[w].sums.channels[slot][k] : s.warp[w].sums.moments[slot][k - 4 * kQuads];
            }
            to[i] = sum;
        }
    }
};

/// Adds the rows of each splat. Floor: 4 (C + 9) bytes per (splat, tile).
template <int C>
struct SumRowsKernel {
    static constexpr uint32_t kThreads = 256;
    static constexpr uint32_t kQuads = kRowQuads<C>, kMembers = kQuads + 2 <= 4 ? 4 : kQuads + 2 <= 8 ? 8 : 16; // lanes of a splat, a quad each
    static constexpr uint32_t kStride = uint32_t(channelStride(C));
    static_assert(kStride / 4 <= kMembers);
    TileView view;
    const float* rows;
    float* dColors;
    ScreenGradient<float>* dSplats;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const uint32_t v = uint32_t(t.index() / kMembers), member = t.thread() % kMembers;
        const bool there = v < view.visibleCount;
        Float4 sum{};
        if (there && member < kQuads + 2)
            for (uint32_t k = view.pairStart[v]; k < view.pairStart[v + 1]; ++k) {
                const Float4 row = reinterpret_cast<const Float4*>(rows + size_t(view.entryFromPair[k]) * kRowFloats<C>)[member];
                for (int c = 0; c < 4; ++c) sum.v[c] += row.v[c];
            }
        const uint32_t leader = t.lane() - member;
        float m[6];
        for (uint32_t k = 0; k < 6; ++k) m[k] = t.shuffle(kFullWarp, sum.v[k % 4], leader + kQuads + k / 4);
        const float weight = t.shuffle(kFullWarp, sum.v[C % 4], leader + C / 4);
        if (!there) return;
        if (member < kStride / 4) {
            if (member >= kQuads) sum = {};
            if (member == C / 4) sum.v[C % 4] = 0.0f;
            reinterpret_cast<Float4*>(dColors + size_t(v) * kStride)[member] = sum;
        }
        if (member == 0) dSplats[v] = screenGradient(view.projected[v], m, weight);
    }
};

/// Calls use<C>() for the counts of channels that rasterForward takes.
template <class Use>
void withChannels(int channels, Use use)
{
    switch (channels) {
    case 3: return use.template operator()<3>();
    case 6: return use.template operator()<6>();
    case 9: return use.template operator()<9>();
    case 12: return use.template operator()<12>();
    case 14: return use.template operator()<14>();
    case 18: return use.template operator()<18>();
    case 22: return use.template operator()<22>();
    case 26: return use.template operator()<26>();
    }
    throw std::logic_error("no kernels blend " + std::to_string(channels) + " channels");
}

} // namespace detail

/// colors: [visible][channelStride(channels)]; writes channels + 1 planes.
inline void blendForward(Device& device, const TileView& view, const float* colors, int channels, float* planes)
{
    detail::withChannels(channels, [&]<int C>() { launch(device, uint32_t(view.tilesX * view.tilesY), detail::BlendForwardKernel<C>{view, colors, planes}); });
}

class BlendBackward {
public:
    /// `planes` as written by blendForward, dPlanes the loss gradient of the same shape. Overwrites dColors [visible][channelStride] and
    /// dSplats [visible].
    void run(Device& device, const TileView& view, const float* colors, int channels, const float* planes, const float* dPlanes, float* dColors,
             ScreenGradient<float>* dSplats)
    {
        detail::withChannels(channels, [&]<int C>() {
            rows_.reserve(device, size_t(view.entryCount) * detail::kRowFloats<C>);
            launch(device, uint32_t(view.tilesX * view.tilesY), detail::BlendBackwardKernel<C>{view, colors, planes, dPlanes, rows_.data()});
            using Sum = detail::SumRowsKernel<C>;
            launch(device, blocksFor(size_t(view.visibleCount) * Sum::kMembers, Sum::kThreads), Sum{view, rows_.data(), dColors, dSplats});
        });
    }

private:
    Buffer<float> rows_; // the gradients of each (splat, tile)
};

} // namespace nacre::NACRE_BACKEND
