// A stable radix sort, least significant digit first, eight digits of four bits (order_*.glsl). For each digit: tiles count its values, one
// workgroup turns the counts into where each tile's share of a value begins, tiles move their pairs there. The last move writes the
// order. Passes read through samplers and write through image unit 0, so that little of the host's state is touched; all limits are
// those that GL 4.3 guarantees. A dispatch covers at most kSliceTiles, work of less than a millisecond on the slowest GPU that has 4.3.
#include "gpu_order.h"

#include "gl_state.h"
#include "shader_sources.h"

namespace nacre {

constexpr int kDigitBits = 4, kDigits = 1 << kDigitBits, kKeyBits = 32;
constexpr int kGroup = 256, kEach = 8, kTile = kGroup * kEach; // invocations of a workgroup, pairs of one and of all
constexpr int kSliceTiles = 128;
constexpr int kCountWidth = 1024;                              // texels in a row of counts

static int tilesOf(uint32_t count) { return int((count + kTile - 1) / kTile); }

static std::string withDefines(const char* source, bool last = false)
{
    return define("GROUP", kGroup) + define("EACH", kEach) + define("DIGITS", kDigits) + define("COUNT_WIDTH", kCountWidth) + define("LAST", last ? 1 : 0) +
           shaders::kOrderGlsl + source;
}

Failure GpuOrder::compile()
{
    const auto find = [&](const char* source, bool last, std::initializer_list<const char*> samplers, const Program** program) {
        return *program ? Failure{} : findComputeProgram(context_, "order", withDefines(source, last), samplers, program);
    };
    if (Failure f = find(shaders::kOrderKeysCompGlsl, false, {"uGeometry"}, &keysProgram_)) return f;
    if (Failure f = find(shaders::kOrderCountCompGlsl, false, {"uPairs"}, &countProgram_)) return f;
    if (Failure f = find(shaders::kOrderScanCompGlsl, false, {"uCounts"}, &scanProgram_)) return f;
    if (Failure f = find(shaders::kOrderMoveCompGlsl, false, {"uPairs", "uOffsets"}, &moveProgram_)) return f;
    return find(shaders::kOrderMoveCompGlsl, true, {"uPairs", "uOffsets"}, &lastProgram_);
}

/// Room for count_ pairs.
Failure GpuOrder::allocate(int width)
{
    const int rows = int((count_ + uint32_t(width) - 1) / uint32_t(width));
    const int countRows = (kDigits * tilesOf(count_) + kCountWidth - 1) / kCountWidth;
    if (pairs_[0].width() == width && pairs_[0].height() >= rows && counts_.height() >= countRows) return {};
    clearHostErrors(context_);
    for (Texture& pairs : pairs_) pairs = {}, pairs = Texture(context_, GL_RG32UI, width, rows);
    counts_ = {}, counts_ = Texture(context_, GL_R32UI, kCountWidth, countRows);
    offsets_ = {}, offsets_ = Texture(context_, GL_R32UI, kCountWidth, countRows);
    if (takeGlError(context_.gl) == GL_NO_ERROR) return {};
    for (Texture& pairs : pairs_) pairs = {};
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory to sort " + std::to_string(count_) + " splats"};
}

static void writeTo(const Gl& gl, const Texture& texture) { gl.BindImageTexture(0, texture.name(), 0, GL_FALSE, 0, GL_WRITE_ONLY, texture.format()); }

/// What the dispatches before have written can be fetched afterwards.
static void finishWrites(const Gl& gl) { gl.MemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_SHADER_IMAGE_ACCESS_BARRIER_BIT); }

/// The program in use over so many workgroups, in slices.
static void dispatch(const Gl& gl, const Program& program, int groups)
{
    for (int first = 0; first < groups; first += kSliceTiles) {
        program.set("uFirstTile", first);
        gl.DispatchCompute(GLuint(std::min(kSliceTiles, groups - first)), 1, 1);
    }
}

void GpuOrder::writeKeys(std::span<const OrderInstance> instances, std::span<const OrderGeometry> geometry)
{
    const Program& program = *keysProgram_;
    program.use();
    writeTo(context_.gl, pairs_[0]);
    program.set("uListWidth", pairs_[0].width());
    program.set("uTotal", int(count_));
    program.set("uTowardsEye", glm::vec4(source_.towardsEye, source_.orthographic ? 1 : 0));
    uint32_t before = 0;
    for (size_t n = 0; n < instances.size(); ++n) {
        const OrderInstance& i = instances[n];
        if (i.count == 0) continue;
        geometry[n].texture->bind(0);
        geometry[n].grid->set(program);
        program.set("uBefore", int(before));
        program.set("uFirst", int(i.first));
        program.set("uWorldFromAsset", i.worldFromAsset);
        program.set("uFromEye", i.fromEye);
        dispatch(context_.gl, program, tilesOf(i.count));
        before += i.count;
    }
}

void GpuOrder::sortDigit(int shift, const Texture& from, const Texture& to)
{
    const Gl& gl = context_.gl;
    const int tiles = tilesOf(count_);
    const auto begin = [&](const Program& program, const Texture& written) {
        finishWrites(gl);
        program.use();
        writeTo(gl, written);
        program.set("uListWidth", pairs_[0].width());
        program.set("uTotal", int(count_));
        program.set("uTiles", tiles);
        program.set("uShift", shift);
    };
    from.bind(0);
    begin(*countProgram_, counts_);
    dispatch(gl, *countProgram_, tiles);
    counts_.bind(0);
    begin(*scanProgram_, offsets_);
    dispatch(gl, *scanProgram_, 1);
    from.bind(0), offsets_.bind(1);
    const Program& move = shift + kDigitBits == kKeyBits ? *lastProgram_ : *moveProgram_;
    begin(move, to);
    dispatch(gl, move, tiles);
}

Failure GpuOrder::update(std::span<const OrderInstance> instances, std::span<const OrderGeometry> geometry, const OrderCamera& camera, const Texture& order, bool lost)
{
    hasSorted_ = lost || source_.differs(instances, camera) || !context_.passes.sure(sortedIn_);
    if (!hasSorted_) return {};
    source_.remember(instances, camera);
    sortedIn_ = context_.passes.now();
    count_ = 0;
    for (const OrderInstance& i : instances) count_ += i.count;
    if (count_ == 0) return {};
    if (Failure f = compile()) return f;
    if (Failure f = allocate(order.width())) return f;

    const Gl& gl = context_.gl;
    const ImageUnitGuard hosts(gl, context_.hostState);
    gl.MemoryBarrier(GL_SHADER_IMAGE_ACCESS_BARRIER_BIT); // the frame before has read what is overwritten
    writeKeys(instances, geometry);
    const Texture *from = &pairs_[0], *to = &pairs_[1];
    for (int shift = 0; shift < kKeyBits; shift += kDigitBits, std::swap(from, to)) sortDigit(shift, *from, shift + kDigitBits == kKeyBits ? order : *to);
    finishWrites(gl);
    gl.UseProgram(0); // Mesa holds on to a program that comes right after one of compute, even if it is deleted
    return {};
}

} // namespace nacre
