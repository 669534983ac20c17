// A column of the table: something that draws. A new one (CUDA, ...) is one file and one line in makeColumns.
#pragma once

#include "base/result.h"
#include "selftest/formulas.h"
#include "selftest/scene.h"
#include "selftest/values.h"

#include <functional>
#include <memory>
#include <vector>

namespace nacre::selftest {

class BackEnd {
public:
    virtual ~BackEnd() = default;
    /// Groups "colour" (premultiplied radiance, [height][width][3]) and "alpha". Error kBadInput: the scene is refused.
    virtual Result<Values> draw(const Scene& scene) = 0;
    /// Of lossWeight's loss, as scalarGradients has them; kUnsupported: this one only draws.
    virtual Result<Values> gradients(const Scene&) { return notHere(); }
    /// Whether it takes the scene's file, or its lights and camera; kUnsupported: that is not for it to say.
    virtual Result<bool> acceptsFile(const Scene&) { return notHere(); }
    virtual Result<bool> accepts(const Scene&) { return notHere(); }
    /// Whether bakes run on it.
    virtual bool trains() const { return false; }

    static Error notHere() { return {ErrorCode::kUnsupported, "not in this column"}; }
};

struct Column {
    std::string name;     // "scalar", "SIMD", "GL 3.3", ...
    std::string what;     // e.g. "llvmpipe (LLVM 15.0.6, 256 bits), GL 4.5"
    std::unique_ptr<BackEnd> backEnd; // null: skipped
    std::string skipped{}; // why
    bool gl = false;  // by OpenGL, which keeps some numbers in half floats: Case::gl is its bound
};

/// What a test may replace. Products leave it alone.
struct Hooks {
    Formulas<float> scalar;     // of the column "scalar"
    Formulas<double> reference; // of the reference
    void* (*getProcAddress)(const char* name, void* user) = nullptr; // of OpenGL
};

Column makeScalarColumn(const Hooks& hooks);
Column makeSimdColumn(const Hooks& hooks);
Column makeGl33Column(const Hooks& hooks);
Column makeGl43Column(const Hooks& hooks);

/// All, in the order of the table. Without `gl` those are left out that need a context.
std::vector<Column> makeColumns(const Hooks& hooks, bool gl = true);

/// The file of a scene's asset, spoilt as the scene says. Error: refused when it is written.
Result<std::vector<std::byte>> assetFile(const Scene& scene);

} // namespace nacre::selftest
