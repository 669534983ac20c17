#include "eval/headless_gl.h"

#include <GL/glcorearb.h>
#include <doctest/doctest.h>

#include <cstring>

using namespace nacre;

TEST_CASE("headless contexts of every library and API live side by side, each with its own frame and functions")
{
    std::vector<std::pair<HeadlessKind, std::unique_ptr<HeadlessGl>>> contexts;
    for (const HeadlessKind kind : {HeadlessKind::kEgl, HeadlessKind::kEglEs, HeadlessKind::kOsMesa}) {
        auto made = HeadlessGl::create(kind);
        if (made) contexts.emplace_back(kind, std::move(*made));
        else MESSAGE("SKIPPED: ", made.error().message);
    }
    for (int round = 0; round < 3; ++round)
        for (size_t i = 0; i < contexts.size(); ++i) {
            auto& [kind, gl] = contexts[i];
            CAPTURE(gl->description());
            const auto function = [](const char* name) { return HeadlessGl::getProcAddress(name, nullptr); };
            const int width = 3 + int(i) + round, height = 5;
            gl->makeCurrent();
            REQUIRE(gl->beginFrame(width, height));
            const auto version = reinterpret_cast<const char*>(reinterpret_cast<PFNGLGETSTRINGPROC>(function("glGetString"))(GL_VERSION));
            REQUIRE(version);
            CHECK((std::strncmp(version, "OpenGL ES 3", 11) == 0) == (kind == HeadlessKind::kEglEs));
            CHECK((gl->description().find("GL ES") != std::string::npos) == (kind == HeadlessKind::kEglEs));

            // one pixel of a colour of its own, in the upper row
            reinterpret_cast<PFNGLENABLEPROC>(function("glEnable"))(GL_SCISSOR_TEST);
            reinterpret_cast<PFNGLSCISSORPROC>(function("glScissor"))(1, height - 1, 1, 1);
            const float color[4] = {float(i + 1), 0.25f, float(round), 1};
            reinterpret_cast<PFNGLCLEARBUFFERFVPROC>(function("glClearBufferfv"))(GL_COLOR, 0, color);
            reinterpret_cast<PFNGLDISABLEPROC>(function("glDisable"))(GL_SCISSOR_TEST);
            const Image image = gl->readFrame();
            REQUIRE(image.width == width);
            for (int y = 0; y < height; ++y)
                for (int x = 0; x < width; ++x)
                    for (int c = 0; c < 4; ++c) CHECK(image.pixel(x, y)[c] == (x == 1 && y == 0 ? color[c] : 0.0f));
            CHECK(reinterpret_cast<PFNGLGETERRORPROC>(function("glGetError"))() == GL_NO_ERROR);
        }
}
