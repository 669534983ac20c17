#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include "display.h"

#include <fstream>
#include <utility>
#include <vector>

namespace viewer {

static const char* const kTriangle = R"(#version 330 core
void main() { gl_Position = vec4(4 * (gl_VertexID & 1) - 1, 4 * (gl_VertexID >> 1) - 1, 0, 1); })";

static const char* const kTonemap = R"(#version 330 core
uniform sampler2D uRadiance;
uniform float uExposure;
uniform vec3 uBackground; // sRGB
uniform int uLeft;
out vec4 color;
vec3 fromSrgb(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 toSrgb(vec3 c) { return mix(12.92 * c, 1.055 * pow(c, vec3(1 / 2.4)) - 0.055, step(0.0031308, c)); }
void main()
{
    vec4 radiance = texelFetch(uRadiance, ivec2(gl_FragCoord.xy) - ivec2(uLeft, 0), 0);
    vec3 shown = uExposure * radiance.rgb + (1 - radiance.a) * fromSrgb(uBackground);
    color = vec4(toSrgb(clamp(shown, 0, 1)), 1);
})";

bool createDisplay(Display* display)
{
    display->program = glCreateProgram();
    for (const auto& [type, source] : {std::pair(GL_VERTEX_SHADER, kTriangle), std::pair(GL_FRAGMENT_SHADER, kTonemap)}) {
        const GLuint shader = glCreateShader(GLenum(type));
        glShaderSource(shader, 1, &source, nullptr);
        glCompileShader(shader);
        glAttachShader(display->program, shader);
        glDeleteShader(shader);
    }
    glLinkProgram(display->program);
    glGenVertexArrays(1, &display->vertexArray); // core GL draws nothing without one
    GLint linked = 0;
    glGetProgramiv(display->program, GL_LINK_STATUS, &linked);
    return linked != 0;
}

static void bindTarget(Target& target, GLint format, int width, int height)
{
    if (!target.framebuffer) {
        glGenFramebuffers(1, &target.framebuffer);
        glGenTextures(1, &target.texture);
    }
    glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer);
    glViewport(0, 0, width, height);
    if (target.width == width && target.height == height) return;
    target.width = width, target.height = height;
    glBindTexture(GL_TEXTURE_2D, target.texture);
    glTexImage2D(GL_TEXTURE_2D, 0, format, width, height, 0, GL_RGBA, GL_UNSIGNED_BYTE, nullptr);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST); // there are no mipmaps
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, target.texture, 0);
}

void beginSplats(Display& display, int width, int height)
{
    bindTarget(display.radiance, GL_RGBA16F, width, height);
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT);
}

void tonemap(Display& display, int left, int frameWidth, int frameHeight, float exposure, glm::vec3 background)
{
    bindTarget(display.frame, GL_RGBA8, frameWidth, frameHeight);
    glClearColor(0, 0, 0, 1);
    glClear(GL_COLOR_BUFFER_BIT);
    glViewport(left, 0, display.radiance.width, display.radiance.height);
    glUseProgram(display.program);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, display.radiance.texture);
    glUniform1f(glGetUniformLocation(display.program, "uExposure"), exposure);
    glUniform3f(glGetUniformLocation(display.program, "uBackground"), background.x, background.y, background.z);
    glUniform1i(glGetUniformLocation(display.program, "uLeft"), left);
    glBindVertexArray(display.vertexArray);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glViewport(0, 0, frameWidth, frameHeight);
}

void copyToWindow(const Display& display)
{
    const int width = display.frame.width, height = display.frame.height;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, display.frame.framebuffer);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
    glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glFinish();
}

bool writePpm(const Display& display, const std::string& path)
{
    const int width = display.frame.width, height = display.frame.height;
    std::vector<char> rgb(size_t(3) * size_t(width) * size_t(height));
    glBindFramebuffer(GL_READ_FRAMEBUFFER, display.frame.framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, rgb.data());
    std::ofstream out(path, std::ios::binary);
    out << "P6\n" << width << " " << height << "\n255\n";
    for (int y = height - 1; y >= 0; --y) // GL rows run bottom to top
        out.write(&rgb[size_t(3) * size_t(width) * size_t(y)], std::streamsize(3) * width);
    return bool(out.flush());
}

} // namespace viewer
