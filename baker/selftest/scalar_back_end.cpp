// The scalar formulas in float32, as the reference renderer draws.
#include "asset/asset_io.h"
#include "selftest/back_end.h"
#include "selftest/scalar_image.h"

#include <algorithm>

namespace nacre::selftest {

namespace {

class ScalarBackEnd final : public BackEnd {
public:
    explicit ScalarBackEnd(const Formulas<float>& formulas) : formulas_(formulas) {}
    Result<Values> draw(const Scene& scene) override { return drawScalar(scene, formulas_); }
    Result<Values> gradients(const Scene& scene) override { return scalarGradients(scene, formulas_); }
    Result<bool> acceptsFile(const Scene& scene) override
    {
        const auto file = assetFile(scene);
        if (!file && file.error().code == ErrorCode::kIo) return file.error();
        return file && decodeAsset(*file);
    }

private:
    Formulas<float> formulas_;
};

} // namespace

Column makeScalarColumn(const Hooks& hooks) { return {"scalar", "float32, scalar", std::make_unique<ScalarBackEnd>(hooks.scalar)}; }

Result<std::vector<std::byte>> assetFile(const Scene& scene)
{
    auto file = encodeAsset(scene.asset);
    if (!file || scene.spoilt.empty()) return file;
    const auto find = std::as_bytes(std::span(scene.spoilt)), replacement = std::as_bytes(std::span(scene.spoiltWith));
    const auto at = std::search(file->begin(), file->end(), find.begin(), find.end());
    if (at == file->end() || find.size() != replacement.size()) return Error{ErrorCode::kIo, "the file does not hold what was to be spoilt"};
    std::copy(replacement.begin(), replacement.end(), at);
    return file;
}

} // namespace nacre::selftest
