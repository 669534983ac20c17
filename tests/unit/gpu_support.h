// A context of the runtime's own parts, with compute shaders.
#pragma once

#include "context.h"

#include "eval/headless_gl.h"

#include <doctest/doctest.h>

#include <memory>
#include <random>
#include <string>
#include <vector>

namespace nacre {

struct GlContext {
    std::unique_ptr<HeadlessGl> gl;
    std::unique_ptr<Context> context;
    std::string missing;         // not empty: why there is none; the test has said so

    GlContext()
    {
        auto made = HeadlessGl::create();
        if (made) {
            gl = std::move(*made);
            context = std::make_unique<Context>();
            missing = loadGl(HeadlessGl::getProcAddress, nullptr, BackEnd::kGl43, &context->gl);
        } else {
            missing = made.error().message;
        }
        if (!missing.empty()) MESSAGE("SKIPPED: ", missing);
    }
};

} // namespace nacre
