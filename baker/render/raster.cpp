// SIMD twin of blendPixel and blendPixelBackward (reference_raster.h). Parity test: tests/unit/render_raster.cpp.
//
// A tile's pixels are stored block by block (4x4), so a vector of 4, 8 or 16 lanes is 1, 2 or 4 rows of one block. Each block walks only the
// splats that touch it. Forward keeps all channels of a vector of pixels in registers. Backward needs sums over pixels of
// weight x channel gradient and of gradient x (1, x, y, x^2, xy, y^2): it turns the lanes around and accumulates, per pixel, a row of 16 channels
// and a row of 6 moments with broadcast multiply-adds, so no horizontal sums are needed.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/raster.cpp"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "render/raster.h"
#include "render/simd_math-inl.h"
#include "render/tile_splat.h"

#include <hwy/cache_control.h>

#include <bit>
#include <cmath>
#include <cstring>

#ifndef NACRE_RASTER_SHARED
#define NACRE_RASTER_SHARED
namespace nacre {

constexpr int kMomentFloats = 8;      // 6 used
constexpr int gradientStride(int channels) { return channelStride(channels) + kMomentFloats; } // sums per channel, then the moments
constexpr int weightChannel(int channels) { return channelStride(channels) - 1; } // its gradient is 1, so its sum is the total blending weight

/// Per-thread scratch of one tile.
struct TileScratch {
    std::vector<TileSplat> splats;
    std::vector<uint32_t> lists;      // 16 rows, one per block: indices into splats
    size_t listSize[16];
    std::span<const uint32_t> list(int block) const { return {lists.data() + size_t(block) * splats.size(), listSize[block]}; }
    alignas(64) float out[(kMaxChannels + 1) * kTilePixels];
    alignas(64) float dOut[(kMaxChannels + 1) * kTilePixels];
    alignas(64) float dOutByPixel[kTilePixels * channelStride(kMaxChannels)];
    alignas(64) float total[kTilePixels];
    alignas(64) float inside[kTilePixels]; // 1 inside the image, 0 outside
};

/// Pixel coordinates from the tile centre, in block order, and the moment basis of each pixel.
struct PixelTables {
    alignas(64) float x[kTilePixels], y[kTilePixels];
    alignas(64) float moments[kTilePixels * 8];
    PixelTables()
    {
        for (int p = 0; p < kTilePixels; ++p) {
            const int block = p / 16, inBlock = p % 16;
            x[p] = float((block % 4) * kBlockSize + inBlock % 4) + 0.5f - 0.5f * kTileSize;
            y[p] = float((block / 4) * kBlockSize + inBlock / 4) + 0.5f - 0.5f * kTileSize;
            const float m[8] = {1, x[p], y[p], x[p] * x[p], x[p] * y[p], y[p] * y[p], 0, 0};
            std::memcpy(moments + 8 * p, m, sizeof m);
        }
    }
};
static const PixelTables kPixels;

/// Copies between image planes and a tile's block order. Pixels outside the image read as 0 and are not written.
struct TileFrame {
    int x0, y0, width, height;
    size_t planeSize;
    bool blockInside(int block) const
    {
        return x0 + (block % 4 + 1) * kBlockSize <= width && y0 + (block / 4 + 1) * kBlockSize <= height;
    }
    template <class Copy>
    void forEachRow(Copy copy) const // copy(offset in tile, offset in plane, pixels)
    {
        for (int row = 0; row < 64; ++row) {
            const int x = x0 + (row / 4 % 4) * kBlockSize, y = y0 + (row / 16) * kBlockSize + row % 4;
            if (y >= height || x >= width) continue;
            const int n = width - x < kBlockSize ? width - x : kBlockSize;
            copy(row * 4, size_t(y) * width + x, n);
        }
    }
    // A copy of a size known when compiling is two moves instead of a loop.
    static void copyRow(float* to, const float* from, int n)
    {
        if (n == kBlockSize) std::memcpy(to, from, kBlockSize * sizeof(float));
        else std::memcpy(to, from, size_t(n) * sizeof(float));
    }
    void load(const float* planes, int count, float* tile) const
    {
        if (x0 + kTileSize > width || y0 + kTileSize > height) std::memset(tile, 0, sizeof(float) * count * kTilePixels);
        forEachRow([&](int t, size_t p, int n) {
            for (int c = 0; c < count; ++c) copyRow(tile + c * kTilePixels + t, planes + c * planeSize + p, n);
        });
    }
    void store(const float* tile, int count, float* planes) const
    {
        forEachRow([&](int t, size_t p, int n) {
            for (int c = 0; c < count; ++c) copyRow(planes + c * planeSize + p, tile + c * kTilePixels + t, n);
        });
    }
    void clear(int count, float* planes) const
    {
        const size_t bytes = size_t(width - x0 < kTileSize ? width - x0 : kTileSize) * sizeof(float);
        for (int c = 0; c < count; ++c)
            for (int y = y0; y < height && y < y0 + kTileSize; ++y) std::memset(planes + c * planeSize + size_t(y) * width + x0, 0, bytes);
    }
};

} // namespace nacre
#endif

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
constexpr size_t kLanes = hn::MaxLanes(D());
using D8 = hn::CappedTag<float, 8>;
constexpr size_t kLanes8 = hn::MaxLanes(D8());

struct Alpha {
    V alpha;
    hn::Mask<D> on;     // reaches kMinAlpha on a pixel that still transmits
    hn::Mask<D> capped; // alpha was cut to kMaxAlpha
};

HWY_INLINE Alpha splatAlpha(const TileSplat& s, V px, V py, V transmittance)
{
    const D d;
    const V dx = hn::Sub(px, hn::Set(d, s.x)), dy = hn::Sub(py, hn::Set(d, s.y));
    const V linear = hn::MulAdd(hn::Set(d, s.b), dy, hn::Mul(hn::Set(d, s.a), dx));
    const V q = hn::MulAdd(linear, dx, hn::Mul(hn::Mul(hn::Set(d, s.c), dy), dy));
    const V power = hn::Sub(hn::Set(d, s.logOpacity), q);
    const V cap = hn::Set(d, kMaxAlpha);
    Alpha r;
    r.on = hn::And(hn::Ge(power, hn::Set(d, kMinLogAlpha)),
                   hn::Ge(transmittance, hn::Set(d, kMinTransmittance)));
    const V raw = exp2(D(), hn::Max(power, hn::Set(d, -126.0f)));
    r.capped = hn::Ge(raw, cap);
    r.alpha = hn::Min(raw, cap);
    return r;
}

template <int C>
HWY_NOINLINE void forwardBlock(const TileScratch& s, const TileEntry* entries, const float* colors, int block, float* out)
{
    const D d;
    for (size_t p = size_t(block) * 16; p < size_t(block + 1) * 16; p += kLanes) {
        const V px = hn::Load(d, kPixels.x + p), py = hn::Load(d, kPixels.y + p);
        V transmittance = hn::Load(d, s.inside + p);
        V sum[C];
        for (int c = 0; c < C; ++c) sum[c] = hn::Zero(d);
        for (uint32_t i : s.list(block)) {
            const Alpha a = splatAlpha(s.splats[i], px, py, transmittance);
            if (hn::AllFalse(d, a.on)) continue;
            const V w = hn::IfThenElseZero(a.on, hn::Mul(a.alpha, transmittance));
            const float* color = colors + size_t(entries[i].visible) * channelStride(C);
            for (int c = 0; c < C; ++c) sum[c] = hn::MulAdd(w, hn::Set(d, color[c]), sum[c]);
            transmittance = hn::Sub(transmittance, w);
            if (hn::AllTrue(d, hn::Lt(transmittance, hn::Set(d, kMinTransmittance)))) break;
        }
        for (int c = 0; c < C; ++c) hn::Store(sum[c], d, out + c * kTilePixels + p);
        hn::Store(hn::Sub(hn::Load(d, s.inside + p), transmittance), d, out + C * kTilePixels + p);
    }
}

template <int C>
HWY_NOINLINE void backwardBlock(TileScratch& s, const TileEntry* entries, const float* colors, int block, float* gradients)
{
    constexpr int kStride = channelStride(C);
    const D d;
    const D8 d8;
    alignas(64) float w[16], dLog[16];
    for (size_t p = size_t(block) * 16; p < size_t(block + 1) * 16; p += kLanes) {
        const V px = hn::Load(d, kPixels.x + p), py = hn::Load(d, kPixels.y + p);
        const V total = hn::Load(d, s.total + p), dAlpha = hn::Load(d, s.dOut + C * kTilePixels + p);
        V transmittance = hn::Load(d, s.inside + p), prefix = hn::Zero(d);
        for (uint32_t i : s.list(block)) {
            const Alpha a = splatAlpha(s.splats[i], px, py, transmittance);
            if (hn::AllFalse(d, a.on)) continue;
            const float* color = colors + size_t(entries[i].visible) * channelStride(C);
            V value = dAlpha;
            for (int c = 0; c < C; ++c) value = hn::MulAdd(hn::Load(d, s.dOut + c * kTilePixels + p), hn::Set(d, color[c]), value);
            const V weight = hn::IfThenElseZero(a.on, hn::Mul(a.alpha, transmittance));
            prefix = hn::MulAdd(weight, value, prefix);
            const V behind = hn::Div(hn::Sub(total, prefix), hn::Sub(hn::Set(d, 1.0f), a.alpha));
            const V grad = hn::Mul(a.alpha, hn::Sub(hn::Mul(transmittance, value), behind));
            hn::Store(weight, d, w);
            hn::Store(hn::IfThenElseZero(hn::AndNot(a.capped, a.on), grad), d, dLog);
            transmittance = hn::Sub(transmittance, weight);

            float* row = gradients + size_t(i) * gradientStride(C);
            constexpr size_t kRow = (C > 8 ? kStride : 8) / kLanes8; // channels beyond 8 only when there are any; the weight sits apart
            hn::Vec<D8> sums[kRow], moments[8 / kLanes8], weights = hn::Zero(d8);
            for (size_t k = 0; k < kRow; ++k) sums[k] = hn::LoadU(d8, row + k * kLanes8);
            for (size_t k = 0; k < 8 / kLanes8; ++k) moments[k] = hn::LoadU(d8, row + kStride + k * kLanes8);
            for (size_t lane = 0; lane < kLanes; ++lane) {
                const auto wl = hn::Set(d8, w[lane]), gl = hn::Set(d8, dLog[lane]);
                for (size_t k = 0; k < kRow; ++k)
                    sums[k] = hn::MulAdd(wl, hn::Load(d8, s.dOutByPixel + (p + lane) * kStride + k * kLanes8), sums[k]);
                for (size_t k = 0; k < 8 / kLanes8; ++k)
                    moments[k] = hn::MulAdd(gl, hn::Load(d8, kPixels.moments + (p + lane) * 8 + k * kLanes8), moments[k]);
                if (C <= 8) weights = hn::Add(weights, wl);
            }
            for (size_t k = 0; k < kRow; ++k) hn::StoreU(sums[k], d8, row + k * kLanes8);
            for (size_t k = 0; k < 8 / kLanes8; ++k) hn::StoreU(moments[k], d8, row + kStride + k * kLanes8);
            if (C <= 8) row[weightChannel(C)] += hn::GetLane(weights);
            if (hn::AllTrue(d, hn::Lt(transmittance, hn::Set(d, kMinTransmittance)))) break;
        }
    }
}

// Localises the tile's splats and sorts them into per-block lists.
void prepareTile(const VisibleSplats& visible, const TileEntry* entries, size_t count, const float* colors, int stride,
                 const TileFrame& frame, TileScratch& s)
{
    constexpr size_t kAhead = 8; // a tile's splats lie anywhere among the visible: fetch them and their colours before they are needed
    s.splats.resize(count);
    s.lists.resize(16 * count);
    std::memset(s.listSize, 0, sizeof s.listSize);
    const float centerX = float(frame.x0) + 0.5f * kTileSize, centerY = float(frame.y0) + 0.5f * kTileSize;
    for (size_t i = 0; i < count; ++i) {
        if (i + kAhead < count) {
            const size_t next = entries[i + kAhead].visible;
            hwy::Prefetch(&visible.projected[next]), hwy::Prefetch(colors + next * size_t(stride));
        }
        const ProjectedGaussian<float>& g = visible.projected[entries[i].visible];
        s.splats[i] = tileSplat(g, centerX, centerY);
        for (uint32_t mask = entries[i].blockMask; mask; mask &= mask - 1) {
            const int block = std::countr_zero(mask);
            s.lists[block * count + s.listSize[block]++] = uint32_t(i);
        }
    }
    for (int p = 0; p < kTilePixels; ++p) {
        const int x = frame.x0 + int(kPixels.x[p] + 0.5f * kTileSize), y = frame.y0 + int(kPixels.y[p] + 0.5f * kTileSize);
        s.inside[p] = x < frame.width && y < frame.height ? 1.0f : 0.0f;
    }
}

template <int C>
void forwardTile(const VisibleSplats& visible, const TileEntry* entries, size_t count, const float* colors, const TileFrame& frame,
                 TileScratch& s, float* planes)
{
    if (count == 0) return frame.clear(C + 1, planes);
    prepareTile(visible, entries, count, colors, channelStride(C), frame, s);
    for (int block = 0; block < 16; ++block) forwardBlock<C>(s, entries, colors, block, s.out);
    frame.store(s.out, C + 1, planes);
}

// The channels of each pixel side by side, four at a time; then zeros, and the one that makes the weight's channel count.
template <int C>
void gatherByPixel(TileScratch& s)
{
    const D d;
    alignas(64) float four[4 * kLanes];
    for (int c = 0; c < channelStride(C); c += 4) {
        const auto channel = [&](int k, size_t p) {
            return k < C ? hn::Load(d, s.dOut + k * kTilePixels + p) : hn::Set(d, k == weightChannel(C) ? 1.0f : 0.0f);
        };
        for (size_t p = 0; p < kTilePixels; p += kLanes) {
            hn::StoreInterleaved4(channel(c, p), channel(c + 1, p), channel(c + 2, p), channel(c + 3, p), d, four);
            for (size_t lane = 0; lane < kLanes; ++lane)
                std::memcpy(s.dOutByPixel + (p + lane) * channelStride(C) + c, four + 4 * lane, 4 * sizeof(float));
        }
    }
}

template <int C>
void backwardTile(const VisibleSplats& visible, const TileEntry* entries, size_t count, const float* colors, const TileFrame& frame,
                  TileScratch& s, const float* planes, const float* dPlanes, float* gradients)
{
    if (count == 0) return;
    prepareTile(visible, entries, count, colors, channelStride(C), frame, s);
    frame.load(planes, C + 1, s.out);
    frame.load(dPlanes, C + 1, s.dOut);
    const D d;
    for (size_t p = 0; p < kTilePixels; p += kLanes) { // what the whole pixel contributes to the loss to first order
        V total = hn::Zero(d);
        for (int c = 0; c <= C; ++c)
            total = hn::MulAdd(hn::Load(d, s.out + c * kTilePixels + p), hn::Load(d, s.dOut + c * kTilePixels + p), total);
        hn::Store(total, d, s.total + p);
    }
    gatherByPixel<C>(s);
    std::memset(gradients, 0, count * gradientStride(C) * sizeof(float));
    for (int block = 0; block < 16; ++block) backwardBlock<C>(s, entries, colors, block, gradients);
}

void forwardTileAny(int channels, const VisibleSplats& visible, const TileEntry* entries, size_t count, const float* colors,
                    const TileFrame& frame, TileScratch& s, float* planes)
{
    switch (channels) {
    case 3: return forwardTile<3>(visible, entries, count, colors, frame, s, planes);
    case 6: return forwardTile<6>(visible, entries, count, colors, frame, s, planes);
    case 9: return forwardTile<9>(visible, entries, count, colors, frame, s, planes);
    case 12: return forwardTile<12>(visible, entries, count, colors, frame, s, planes);
    case 14: return forwardTile<14>(visible, entries, count, colors, frame, s, planes);
    case 18: return forwardTile<18>(visible, entries, count, colors, frame, s, planes);
    case 22: return forwardTile<22>(visible, entries, count, colors, frame, s, planes);
    default: return forwardTile<26>(visible, entries, count, colors, frame, s, planes);
    }
}

void backwardTileAny(int channels, const VisibleSplats& visible, const TileEntry* entries, size_t count, const float* colors,
                     const TileFrame& frame, TileScratch& s, const float* planes, const float* dPlanes, float* gradients)
{
    switch (channels) {
    case 3: return backwardTile<3>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    case 6: return backwardTile<6>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    case 9: return backwardTile<9>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    case 12: return backwardTile<12>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    case 14: return backwardTile<14>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    case 18: return backwardTile<18>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    case 22: return backwardTile<22>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    default: return backwardTile<26>(visible, entries, count, colors, frame, s, planes, dPlanes, gradients);
    }
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cassert>

namespace nacre {

HWY_EXPORT(forwardTileAny);
HWY_EXPORT(backwardTileAny);

[[maybe_unused]] static bool isChannelCount(int n) { return n >= 14 ? n <= kMaxChannels && n % 4 == 2 : n > 0 && n % 3 == 0; }

static tbb::enumerable_thread_specific<TileScratch>& tileScratch()
{
    static tbb::enumerable_thread_specific<TileScratch> scratch; // freed at exit; grows to the fullest tile
    return scratch;
}

static TileFrame tileFrame(const TileLists& tiles, size_t tile)
{
    return {int(tile % tiles.tilesX) * kTileSize, int(tile / tiles.tilesX) * kTileSize, tiles.width, tiles.height,
            size_t(tiles.width) * tiles.height};
}

void rasterForward(const VisibleSplats& visible, const TileLists& tiles, const float* colors, int channels, float* planes)
{
    assert(isChannelCount(channels));
    const auto run = HWY_DYNAMIC_DISPATCH(forwardTileAny);
    tbb::parallel_for(size_t(0), tiles.tileStart.size() - 1, [&](size_t t) {
        run(channels, visible, tiles.entries.data() + tiles.tileStart[t], tiles.tileStart[t + 1] - tiles.tileStart[t], colors,
            tileFrame(tiles, t), tileScratch().local(), planes);
    });
}

void rasterBackward(const VisibleSplats& visible, const TileLists& tiles, const float* colors, int channels, const float* planes,
                    const float* dPlanes, RasterScratch& scratch, float* dColors, ScreenGradient<float>* dSplats)
{
    assert(isChannelCount(channels));
    const size_t stride = size_t(channelStride(channels)), rowStride = size_t(gradientStride(channels));
    scratch.pairGradients.resize(tiles.entries.size() * rowStride);
    const auto run = HWY_DYNAMIC_DISPATCH(backwardTileAny);
    tbb::parallel_for(size_t(0), tiles.tileStart.size() - 1, [&](size_t t) {
        run(channels, visible, tiles.entries.data() + tiles.tileStart[t], tiles.tileStart[t + 1] - tiles.tileStart[t], colors,
            tileFrame(tiles, t), tileScratch().local(), planes, dPlanes,
            scratch.pairGradients.data() + size_t(tiles.tileStart[t]) * rowStride);
    });

    constexpr size_t kAhead = 8;
    const size_t pairs = tiles.entryFromPair.size();
    // Add the rows of each splat in tile order, moving the moments from the tile centre to the splat's mean.
    tbb::parallel_for(tbb::blocked_range<size_t>(0, visible.count(), 256), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t v = range.begin(); v < range.end(); ++v) {
            const ProjectedGaussian<float>& s = visible.projected[v];
            float* dColor = dColors + v * stride;
            std::memset(dColor, 0, stride * sizeof(float));
            float m[6] = {};
            for (uint32_t k = tiles.pairStart[v]; k < tiles.pairStart[v + 1]; ++k) {
                if (k + kAhead < pairs) hwy::Prefetch(scratch.pairGradients.data() + size_t(tiles.entryFromPair[k + kAhead]) * rowStride);
                const uint32_t entry = tiles.entryFromPair[k];
                const float* row = scratch.pairGradients.data() + size_t(entry) * rowStride;
                for (size_t c = 0; c < stride; ++c) dColor[c] += row[c];
                const TileFrame frame = tileFrame(tiles, tiles.entries[entry].tile);
                const float x = s.mean[0] - (float(frame.x0) + 0.5f * kTileSize), y = s.mean[1] - (float(frame.y0) + 0.5f * kTileSize);
                const float* r = row + stride;
                m[0] += r[0];
                m[1] += r[1] - x * r[0];
                m[2] += r[2] - y * r[0];
                m[3] += r[3] - 2 * x * r[1] + x * x * r[0];
                m[4] += r[4] - x * r[2] - y * r[1] + x * y * r[0];
                m[5] += r[5] - 2 * y * r[2] + y * y * r[0];
            }
            dSplats[v] = screenGradient(s, m, dColor[stride - 1]);
            dColor[stride - 1] = 0.0f;
        }
    });
}

} // namespace nacre
#endif
