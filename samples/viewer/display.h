// From linear radiance to the screen: splats -> float target -> exposure, background, sRGB -> frame -> window or file. Call with the GL
// context current.
#pragma once

#include <glm/glm.hpp>

#include <string>

namespace viewer {

struct Target { // a framebuffer with one colour texture
    unsigned framebuffer = 0, texture = 0;
    int width = 0, height = 0;
};

struct Display {
    Target radiance; // linear, premultiplied: what nacreViewDraw wants
    Target frame;    // 8-bit sRGB, as large as the window; a hidden window's own pixels would be undefined
    unsigned program = 0, vertexArray = 0;
};

/// False: the shader does not compile.
bool createDisplay(Display* display);
/// Clears the radiance and leaves it bound, with its viewport.
void beginSplats(Display& display, int width, int height);
/// Puts the radiance into the frame, `left` pixels from its left edge, and leaves the frame bound.
void tonemap(Display& display, int left, int frameWidth, int frameHeight, float exposure, glm::vec3 background);
/// Returns when the GPU is done, so that the time since the frame began is the frame's, without the wait for the screen.
void copyToWindow(const Display& display);
/// False: `path` cannot be written.
bool writePpm(const Display& display, const std::string& path);

} // namespace viewer
