// An OpenGL context without a window, and a linear float frame to draw into. For the command line and the tests; the runtime itself never
// makes a context.
#pragma once

#include "base/image.h"
#include "base/result.h"

#include <memory>
#include <string>

namespace nacre {

enum class HeadlessKind {
    kEgl,    // OpenGL 3.3 core or newer
    kEglEs,  // OpenGL ES 3.0 or newer
    kOsMesa  // OpenGL 3.3 core or newer, in software, by the library OSMesa, which need not be there
};

class HeadlessGl {
public:
    /// Makes a context and makes it current on this thread: on a GPU if there is one, else in software. Error kGpu says what is missing.
    static Result<std::unique_ptr<HeadlessGl>> create(HeadlessKind kind = HeadlessKind::kEgl);
    ~HeadlessGl();
    HeadlessGl(const HeadlessGl&) = delete;
    HeadlessGl& operator=(const HeadlessGl&) = delete;

    void makeCurrent();
    /// Binds an RGBA32F framebuffer, or one of another `format` of GL, with depth, of this size; sets the viewport, clears colour to 0 and
    /// depth to 1.
    Status beginFrame(int width, int height, unsigned format = 0);
    /// The frame, rows top to bottom.
    Image readFrame();
    /// Median time of enlarging the frame to this size with a linear filter.
    double enlargedSeconds(int width, int height);
    /// e.g. "llvmpipe (LLVM 15.0.6, 256 bits), GL 4.5"
    const std::string& description() const { return description_; }
    bool isSoftware() const;

    /// For NacreContextDesc: functions of the context that was made current last on this thread; `user` is unused.
    static void* getProcAddress(const char* name, void* user);

private:
    struct Impl;
    HeadlessGl();
    std::unique_ptr<Impl> impl_;
    std::string description_;
};

/// Median time of enlarging a float frame with a linear filter, as a host does that draws splats at fewer pixels than its own [ms]. Made and
/// measured in a context of its own.
Result<double> enlargingMilliseconds(int fromWidth, int fromHeight, int width, int height);

} // namespace nacre
