#include "draw_list.h"

#include <algorithm>

namespace nacre {

/// The first gap between placed rows that is wide enough.
static int findGap(const std::map<uint32_t, ListRows>& placed, int count)
{
    std::vector<ListRows> taken;
    for (const auto& [key, rows] : placed) taken.push_back(rows);
    std::sort(taken.begin(), taken.end(), [](const ListRows& a, const ListRows& b) { return a.first < b.first; });
    int first = 0;
    for (const ListRows& t : taken) {
        if (t.first - first >= count) break;
        first = t.first + t.count;
    }
    return first;
}

Failure DrawList::place(uint32_t key, uint32_t splats, ListRows* rows)
{
    const auto known = placed_.find(key);
    const auto rowsAt = [&](int width) { return int((splats + uint32_t(width) - 1) / uint32_t(width)); };
    if (known != placed_.end()) return *rows = known->second, Failure{};
    const int count = rowsAt(width_), first = findGap(placed_, count);
    if (first + count > rows_)
        if (Failure f = allocate(std::max(first + count, rows_ + rows_ / 2))) return f;
    const int wide = rowsAt(width_); // allocate may have made the list wider
    *rows = {findGap(placed_, wide), wide};
    placed_[key] = *rows;
    return {};
}

void DrawList::remove(uint32_t key) { placed_.erase(key); }

/// At least so many rows of today's width. Where a texture of the GPU cannot hold them, the list is made wider and packed anew.
Failure DrawList::allocate(int rows)
{
    const int most = context_.gl.maxTextureSize;
    while (rows > most && 2 * width_ <= most) {
        int next = 0;
        for (auto& [key, r] : placed_) r = {next, (r.count + 1) / 2}, next += r.count;
        width_ *= 2, rows = (rows + 1) / 2 + int(placed_.size()) + 1;
    }
    if (rows > most) return {NACRE_ERROR_UNSUPPORTED, "a view of so many splats does not fit this GPU's textures (GL_MAX_TEXTURE_SIZE " + std::to_string(most) + ")"};
    clearHostErrors(context_);
    color = {}, projected0 = {}, projected1 = {}, order = {}, attributes = {};
    colorTarget_ = {}, projectedTarget_ = {};
    rows_ = 0;
    color = Texture(context_, GL_RGBA32F, width_, rows);
    projected0 = Texture(context_, GL_RGBA32F, width_, rows);
    projected1 = Texture(context_, GL_RGBA32F, width_, rows);
    order = Texture(context_, GL_R32UI, width_, rows);
    colorTarget_ = Framebuffer(context_);
    colorTarget_.attach(0, color);
    const bool colored = allocated(context_.gl);
    projectedTarget_ = Framebuffer(context_);
    projectedTarget_.attach(0, projected0), projectedTarget_.attach(1, projected1);
    projectedTarget_.drawTo(2);
    ++revision_, ++attributesRevision_;
    if (colored && allocated(context_.gl)) return rows_ = rows, Failure{};
    color = {}, projected0 = {}, projected1 = {}, order = {};
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for a view of " + std::to_string(int64_t(rows) * width_) +
                                           " splats, or this GPU cannot render into RGBA32F textures"};
}

Failure DrawList::growAttributes(int layers)
{
    if (attributes && attributes.layers() >= layers) return {};
    if (layers > context_.gl.maxArrayLayers)
        return {NACRE_ERROR_UNSUPPORTED, "a view of so many lights does not fit this GPU's texture arrays (" + std::to_string(context_.gl.maxArrayLayers) + " layers)"};
    clearHostErrors(context_);
    attributes = {};
    attributes = Texture(context_, GL_RGBA16F, width_, rows_, layers);
    if (!attributesTarget_) attributesTarget_ = Framebuffer(context_);
    beginAttributes(0, 1);
    ++attributesRevision_;
    if (allocated(context_.gl)) return {};
    attributes = {};
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for surfaces and " + std::to_string(3 * (layers - 3)) + " lights of a view"};
}

void DrawList::beginAttributes(int first, int layers) const
{
    attributesTarget_.bind();
    for (int k = 0; k < layers; ++k) attributesTarget_.attach(k, attributes, first + k);
    attributesTarget_.drawTo(layers);
}

void DrawList::set(const Program& program, const ListRows& rows) const
{
    program.set("uListWidth", width_);
    program.set("uListRow", rows.first);
}

void DrawList::upload(std::span<const uint32_t> farToNear) const
{
    const Gl& gl = context_.gl;
    const int drawn = int(farToNear.size()), rows = drawn / width_, rest = drawn % width_;
    order.bind(0);
    if (rows > 0) gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width_, rows, GL_RED_INTEGER, GL_UNSIGNED_INT, farToNear.data());
    if (rest > 0)
        gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, rows, rest, 1, GL_RED_INTEGER, GL_UNSIGNED_INT, farToNear.data() + size_t(rows) * size_t(width_));
}

} // namespace nacre
