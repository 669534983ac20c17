// An OpenGL 3.3 core context without a window (EGL), and a linear float frame to draw into. For the command line and the tests;
// the runtime itself never makes a context.
#pragma once

#include "base/image.h"
#include "base/result.h"

#include <memory>
#include <string>

namespace nacre {

class HeadlessGl {
public:
    /// Makes a context and makes it current on this thread: on a GPU if there is one, else in software. Error kGpu says what is missing.
    static Result<std::unique_ptr<HeadlessGl>> create();
    ~HeadlessGl();
    HeadlessGl(const HeadlessGl&) = delete;
    HeadlessGl& operator=(const HeadlessGl&) = delete;

    void makeCurrent();
    /// Binds an RGBA32F framebuffer with depth of this size, sets the viewport, clears colour to 0 and depth to 1.
    Status beginFrame(int width, int height);
    /// The frame, rows top to bottom.
    Image readFrame();
    /// e.g. "llvmpipe (LLVM 15.0.6, 256 bits), GL 4.5"
    const std::string& description() const { return description_; }
    bool isSoftware() const { return software_; }

    /// For NacreContextDesc; `user` is unused.
    static void* getProcAddress(const char* name, void* user);

private:
    struct Impl;
    HeadlessGl();
    std::unique_ptr<Impl> impl_;
    std::string description_;
    bool software_ = false;
};

} // namespace nacre
