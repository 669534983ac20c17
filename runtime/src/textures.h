// Textures and framebuffers that delete themselves, and how numbers per splat lie in textures: slots of a grid, and long rows (layout.glsl
// says where a splat sits in them).
#pragma once

#include "context.h"
#include "program.h"
#include "splats/splat_asset.h"

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

namespace nacre {

void bindTexture(const Gl& gl, int unit, GLenum target, GLuint texture);

/// One level, nearest texel. Counted in context.gpuBytes.
class Texture {
public:
    Texture() = default;
    /// R32UI, RG32UI, R8, RGBA8, RGBA16F or RGBA32F. Leaves it bound to unit 0.
    Texture(Context& context, GLenum format, int width, int height);
    /// An array.
    Texture(Context& context, GLenum format, int width, int height, int layers);
    Texture(Texture&& other) noexcept { swap(other); }
    Texture& operator=(Texture&& other) noexcept { return swap(other), *this; }
    ~Texture();

    explicit operator bool() const { return name_ != 0; }
    GLuint name() const { return name_; }
    GLenum target() const { return target_; }
    GLenum format() const { return format_; }
    int width() const { return width_; }
    int height() const { return height_; }
    int layers() const { return layers_; }
    uint64_t bytes() const;
    void bind(int unit) const;

private:
    void create(Context& context);
    void swap(Texture& other) noexcept;

    Context* context_ = nullptr;
    GLuint name_ = 0;
    GLenum target_ = 0, format_ = 0;
    int width_ = 0, height_ = 0, layers_ = 0;
};

class Framebuffer {
public:
    Framebuffer() = default;
    /// Leaves it bound for drawing.
    explicit Framebuffer(Context& context);
    Framebuffer(Framebuffer&& other) noexcept { swap(other); }
    Framebuffer& operator=(Framebuffer&& other) noexcept { return swap(other), *this; }
    ~Framebuffer();

    explicit operator bool() const { return name_ != 0; }
    GLuint name() const { return name_; }
    void bind() const { context_->gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, name_); }
    /// Bound.
    void attach(int color, const Texture& texture, int layer = 0) const;
    void drawTo(int colors) const;

private:
    void swap(Framebuffer& other) noexcept { std::swap(context_, other.context_), std::swap(name_, other.name_); }

    Context* context_ = nullptr;
    GLuint name_ = 0;
};

/// Before memory is asked for: GL errors that the host had pending are cleared, with a warning, so that those after it are ours. Draws
/// that ask for none never wait for GL.
void clearHostErrors(const Context& context);
/// After it: what was bound can be drawn into and nothing has failed. GL may notice a lack of memory in either way.
bool allocated(const Gl& gl);

/// Where the splats of an asset sit in its textures.
struct SplatGrid {
    uint32_t count = 0;
    int width = 0, rows = 0;  // width: a power of two
    int rowShift = 0;         // layers of the textures that hold one long row are 2^shift texels wide and high

    void set(const Program& program) const;
};

Texture slotTexture(Context& context, const SplatGrid& grid, GLenum format, int slots);

/// A draw over `rows` rows of the bound framebuffer, from `first` on.
void runPass(Context& context, int width, int first, int rows);

/// The columns of lights first .. end - 1 of a light texture (PackedLight).
void uploadLights(const Gl& gl, const Texture& texture, const std::vector<PackedLight>& lights, size_t first, size_t end);

/// The first `rows` rows of one float texture into another.
void copyRows(Context& context, const Texture& from, const Texture& to, int rows);

/// The next passes add to their target, a single one; until GL_BLEND is disabled.
void beginAdding(const Gl& gl);
/// The next passes multiply the first draw buffer by these factors of what they write; until GL_BLEND is disabled.
void beginMultiplying(const Gl& gl, GLenum colorFactor, GLenum alphaFactor);

/// A channel of one long row, `texelsPerSplat` for each of `splats`: its indices must fit an int, its layers the GPU. Makes the layers of
/// the grid as large as that takes and no larger: the last one is allocated whole.
Failure fitLongRow(const Gl& gl, SplatGrid& grid, const char* channel, size_t splats, int64_t texelsPerSplat);
/// Every value must fit a half float: for channels that are stored as such.
Failure checkHalfRange(const Channel& channel);

/// What is to be uploaded, in pieces that are small enough for a frame.
class UploadQueue {
public:
    void add(uint64_t bytes, std::function<void()> upload) { pieces_.push_back({bytes, std::move(upload)}), left_ += bytes; }
    /// Pieces of about so many bytes, at least one.
    void step(uint64_t budget);
    uint64_t left() const { return left_; }
    bool empty() const { return next_ == pieces_.size(); }

private:
    struct Piece {
        uint64_t bytes;
        std::function<void()> upload;
    };
    std::vector<Piece> pieces_;
    size_t next_ = 0;
    uint64_t left_ = 0;
};

/// texel(g, out) for every splat of one slot, now. T is float, uint16_t (half) or uint8_t.
template <class T, class Texel>
void uploadSlot(const Gl& gl, const SplatGrid& grid, const Texture& texture, int slot, Texel texel)
{
    std::vector<T> staging(size_t(4) * size_t(grid.width) * size_t(grid.rows), T(0));
    for (size_t g = 0; g < grid.count; ++g) texel(g, &staging[4 * g]);
    const GLenum type = sizeof(T) == 1 ? GL_UNSIGNED_BYTE : sizeof(T) == 2 ? GL_HALF_FLOAT : GL_FLOAT;
    texture.bind(0);
    gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, slot * grid.rows, grid.width, grid.rows, GL_RGBA, type, staging.data());
}

/// The same as a piece.
template <class T, class Texel>
void queueSlot(UploadQueue& queue, const Gl& gl, const SplatGrid& grid, const Texture& texture, int slot, Texel texel)
{
    queue.add(4 * sizeof(T) * uint64_t(grid.width) * uint64_t(grid.rows),
              [&gl, &grid, &texture, slot, texel] { uploadSlot<T>(gl, grid, texture, slot, texel); });
}

/// Makes the array texture that holds one long row of `texels`, wrapped at its width and then at its height; fill(t, out) writes texel t
/// of `components` numbers.
template <class T, class Fill>
void queueLongRow(UploadQueue& queue, Context& context, const SplatGrid& grid, Texture& texture, GLenum format, size_t components, size_t texels, Fill fill)
{
    const size_t width = size_t(1) << grid.rowShift, rows = (texels + width - 1) / width;
    const size_t layerRows = std::min(rows, width), layers = (rows + layerRows - 1) / layerRows;
    texture = Texture(context, format, int(width), int(layerRows), int(layers));
    constexpr size_t kPieceTexels = 1 << 16;
    const size_t pieceRows = std::max<size_t>(kPieceTexels / width, 1);
    for (size_t row = 0, n = 0; row < rows; row += n) {
        n = std::min({pieceRows, rows - row, layerRows - row % layerRows});
        queue.add(sizeof(T) * components * width * n, [=, &context, &texture] {
            std::vector<T> staging(components * width * n, T(0));
            const size_t first = row * width, last = std::min(first + n * width, texels);
            for (size_t t = first; t < last; ++t) fill(t, &staging[components * (t - first)]);
            texture.bind(0);
            const GLenum layout = components == 1 ? GL_RED : GL_RGBA, type = sizeof(T) == 1 ? GL_UNSIGNED_BYTE : sizeof(T) == 2 ? GL_HALF_FLOAT : GL_FLOAT;
            context.gl.TexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, GLint(row % layerRows), GLint(row / layerRows), GLsizei(width), GLsizei(n), 1, layout, type,
                                     staging.data());
        });
    }
}

/// The maps of appearance/visibility_map.h, as visibilityTexels reads them. `visibility` must stay until the queue is empty.
void queueVisibility(UploadQueue& queue, Context& context, const SplatGrid& grid, Texture& texture, const Channel& visibility);

} // namespace nacre
