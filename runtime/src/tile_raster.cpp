// In batches of the order, nearest first: every splat sets its bit in the masks of the bins that it may touch, then each tile of a bin goes
// through the bits, which are in order, and blends what touches it front to back. No splat is copied and nothing sorted again, no
// count comes back to the CPU, and memory and the length of a dispatch are bounded however large splats are.
//   alpha = min(kMaxAlpha, opacity exp(-|u|^2 / 2)), sum += T alpha colour, T *= 1 - alpha, until T < kMinTransmittance
#include "tile_raster.h"

#include "gl_state.h"
#include "host_depth.h"
#include "shader_sources.h"
#include "splats/blend.h"
#include "target.h"

#include <algorithm>
#include <limits>

namespace nacre {

constexpr int kTile = 16, kBin = 128;       // pixels
constexpr int kGroup = kTile * kTile;       // invocations of a workgroup
constexpr int kSliceTiles = 1024;           // of one dispatch

static std::string withDefines(const std::string& source)
{
    return define("TILE", kTile) + define("BIN", kBin) + define("GROUP", kGroup) + define("MIN_TRANSMITTANCE", kMinTransmittance) + source;
}

Failure TileRaster::compile()
{
    if (composeProgram_) return {};
    const std::string tiles = shaders::kTilesGlsl;
    if (Failure f = findComputeProgram(context_, "tile", withDefines(shaders::kTilesClearCompGlsl), {}, &clearProgram_)) return f;
    if (Failure f = findComputeProgram(context_, "tile", withDefines(tiles + shaders::kTilesBinCompGlsl), {"uProjected0", "uProjected1", "uOrder"}, &binProgram_)) return f;
    if (Failure f = findComputeProgram(context_, "tile", withDefines(tiles + shaders::kTilesBlendCompGlsl),
                                       {"uProjected0", "uProjected1", "uOrder", "uColor", "uMasks", "uHostDepth"}, &blendProgram_))
        return f;
    return findProgram(context_, {"tile", shaders::kTilesComposeVertGlsl, shaders::kTilesComposeFragGlsl, {"uImage"}}, &composeProgram_);
}

static int binsAlong(int pixels) { return (pixels + kBin - 1) / kBin; }
static int tilesAlong(int pixels) { return (pixels + kTile - 1) / kTile; }

Failure TileRaster::allocate(uint32_t splats, int width, int height)
{
    const int words = int((std::min(splats, batch_) + 31) / 32), bins = binsAlong(width) * binsAlong(height);
    const bool sized = image_.width() == width && image_.height() == height, roomy = masks_.width() >= words && masks_.height() >= bins;
    if (sized && roomy) return {};
    clearHostErrors(context_);
    if (!sized) image_ = {}, image_ = Texture(context_, GL_RGBA32F, width, height);
    if (!roomy) masks_ = {}, masks_ = Texture(context_, GL_R32UI, words, bins);
    if (takeGlError(context_.gl) == GL_NO_ERROR) return {};
    image_ = {}, masks_ = {};
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory to draw " + std::to_string(width) + " x " + std::to_string(height) + " pixels by tiles; draw into a smaller viewport"};
}

void TileRaster::set(const Program& program, const ViewFrame& frame, const DrawList& list, uint32_t splats) const
{
    const Gl& gl = context_.gl;
    const bool clamped = gl.IsEnabled(GL_DEPTH_CLAMP); // then GL clips no quad at its depth
    const float least = clamped ? -std::numeric_limits<float>::max() : frame.clip.zeroToOne ? 0.0f : -1.0f;
    program.use();
    program.set("uListWidth", list.width());
    program.set("uViewport", frame.viewport);
    program.set("uDepthRange", glm::vec2(least, clamped ? std::numeric_limits<float>::max() : 1.0f));
    program.set("uSplats", int(splats));
    program.set("uBinsX", binsAlong(image_.width()));
    program.set("uBinsY", binsAlong(image_.height()));
    program.set("uTilesX", tilesAlong(image_.width()));
}

/// Of the blend program, which is in use: how a splat's depth in the window compares with the host's.
void TileRaster::setDepthTest(const float viewport[4], bool upperLeft, bool zeroToOne, bool tested) const
{
    const Gl& gl = context_.gl;
    GLint function = GL_ALWAYS;
    float range[2] = {0, 1};
    if (tested) gl.GetIntegerv(GL_DEPTH_FUNC, &function), gl.GetFloatv(GL_DEPTH_RANGE, range);
    const auto passes = [&](std::initializer_list<GLint> functions) { return std::find(functions.begin(), functions.end(), function) != functions.end() ? 1.0f : 0.0f; };
    blendProgram_->set("uTested", int(tested));
    blendProgram_->set("uPasses", glm::vec3(passes({GL_LESS, GL_LEQUAL, GL_NOTEQUAL, GL_ALWAYS}), passes({GL_EQUAL, GL_LEQUAL, GL_GEQUAL, GL_ALWAYS}),
                                            passes({GL_GREATER, GL_GEQUAL, GL_NOTEQUAL, GL_ALWAYS})));
    const float perClip = zeroToOne ? range[1] - range[0] : 0.5f * (range[1] - range[0]);
    blendProgram_->set("uDepth", glm::vec4(perClip, zeroToOne ? range[0] : 0.5f * (range[0] + range[1]), std::min(range[0], range[1]), std::max(range[0], range[1])));
    blendProgram_->set("uWindow", upperLeft ? glm::vec4(viewport[0], viewport[1] + viewport[3], 1, -1) : glm::vec4(viewport[0], viewport[1], 1, 1));
}

Failure TileRaster::draw(const ViewFrame& frame, const DrawList& list, uint32_t splats, bool depthTest, GlStateGuard& state, bool* drawn)
{
    const Gl& gl = context_.gl;
    const int width = int(frame.viewport.x), height = int(frame.viewport.y);
    const float* viewport = state.viewport();
    *drawn = frame.viewport == glm::vec2(viewport[2], viewport[3]) && std::max(width, height) <= gl.maxTextureSize;
    if (!*drawn) return {};
    const HostDepth hostDepth = depthTest ? copyHostDepth(context_, state.hostFramebuffer(), viewport) : HostDepth::kNone;
    *drawn = hostDepth != HostDepth::kCannot;
    if (!*drawn) return {};
    if (Failure f = compile()) return f;
    if (Failure f = allocate(splats, width, height)) return f;
    state.beginDraw(false);
    const float maxColor = largestColor(gl);
    const int bins = binsAlong(width) * binsAlong(height), tiles = tilesAlong(width) * tilesAlong(height);
    {
        const ImageUnitGuard hosts(gl, context_.hostState);
        const auto barrier = [&] { gl.MemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_SHADER_IMAGE_ACCESS_BARRIER_BIT); };
        set(*binProgram_, frame, list, splats);
        set(*blendProgram_, frame, list, splats);
        blendProgram_->set("uMaxColor", maxColor);
        setDepthTest(viewport, frame.clip.upperLeft, frame.clip.zeroToOne, hostDepth == HostDepth::kCopied);
        list.projected0.bind(0), list.projected1.bind(1), list.order.bind(2), list.color.bind(3), masks_.bind(4);
        bindTexture(gl, 5, GL_TEXTURE_2D, hostDepth == HostDepth::kCopied ? context_.depthCopy.texture : masks_.name());
        for (uint32_t first = 0; first < splats; first += batch_) {
            const uint32_t count = std::min(batch_, splats - first), words = (count + 31) / 32;
            barrier();
            gl.BindImageTexture(0, masks_.name(), 0, GL_FALSE, 0, GL_READ_WRITE, GL_R32UI);
            clearProgram_->use();
            clearProgram_->set("uWords", int(words));
            gl.DispatchCompute((words + kGroup - 1) / kGroup, GLuint(bins), 1);
            barrier();
            binProgram_->use();
            binProgram_->set("uFirstRank", int(first)), binProgram_->set("uRanks", int(count));
            gl.DispatchCompute((count + kGroup - 1) / kGroup, 1, 1);
            barrier();
            gl.BindImageTexture(0, image_.name(), 0, GL_FALSE, 0, GL_READ_WRITE, GL_RGBA32F);
            blendProgram_->use();
            blendProgram_->set("uFirstRank", int(first)), blendProgram_->set("uRanks", int(count));
            for (int tile = 0; tile < tiles; tile += kSliceTiles) {
                blendProgram_->set("uFirstTile", tile);
                gl.DispatchCompute(GLuint(std::min(kSliceTiles, tiles - tile)), 1, 1);
            }
        }
        barrier();
    }
    gl.UseProgram(0); // Mesa holds on to a program that comes right after one of compute, even if it is deleted
    composeProgram_->use();
    composeProgram_->set("uViewport", frame.viewport);
    image_.bind(0);
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
    return {};
}

} // namespace nacre
