// Writes assets for tests that look at programs from outside: one small asset of each model, FOLDER/bigs.glb and FOLDER/sss.glb, and the same
// white matte ball as either, FOLDER/bigs_ball.glb and FOLDER/sss_ball.glb.
#include "formats_fixtures.h"

#include "base/fibonacci_sphere.h"
#include "base/spherical_harmonics.h"

#include <cstdio>

// Radius 1, albedo 0.8, turned +Z up; the lower half reflects no blue. Flat splats that overlap so much that light does not pass.
static nacre::SplatAsset makeBall(const std::string& model)
{
    using namespace nacre;
    constexpr int kCount = 4000;
    const float spacing = 3.5449077f / std::sqrt(float(kCount)); // side of a splat's share of the sphere
    SplatAsset ball;
    ball.model = model;
    ball.yUpFromAsset = glm::quat(0.70710678f, -0.70710678f, 0, 0);
    ball.cloud.count = kCount;
    Channel tDir{"tDir", 25, {}}, tInd{"tInd", 75, std::vector<float>(75 * kCount)}, rho{"rho", 3, {}};
    Channel baseColor{"baseColor", 3, {}}, material{"material", 2, {}}, normal{"normal", 3, {}};
    for (int i = 0; i < kCount; ++i) {
        const glm::vec3 n = fibonacciDirection(i, kCount);
        ball.cloud.positions.push_back(n);
        ball.cloud.rotations.push_back(glm::normalize(glm::quat(1 + n.z, -n.y, n.x, 0))); // n from z
        ball.cloud.scales.emplace_back(0.72f * spacing, 0.72f * spacing, 0.05f * spacing);
        ball.cloud.opacities.push_back(0.99f);
        float y[25];
        shBasis(25, n.x, n.y, n.z, y);
        const float cosine[5] = {3.14159265f, 2.0943951f, 0.78539816f, 0, -0.13089969f}; // of bands, times y: max(dot(n, light), 0)
        for (int f = 0; f < 25; ++f) tDir.values.push_back(cosine[f < 1 ? 0 : f < 4 ? 1 : f < 9 ? 2 : f < 16 ? 3 : 4] * y[f]);
        for (const float c : {0.8f, 0.8f, n.z < 0 ? 0.0f : 0.8f}) rho.values.push_back(c / 3.14159265f), baseColor.values.push_back(c);
        material.values.insert(material.values.end(), {1.0f, 0.0f}); // rough, no metal
        normal.values.insert(normal.values.end(), {n.x, n.y, n.z});
    }
    ball.channels = model == "bigs" ? std::vector{tDir, tInd, rho} : std::vector{baseColor, material, normal};
    return ball;
}

int main(int argc, char** argv)
{
    using namespace nacre;
    if (argc != 2) return 2;
    const auto write = [&](const SplatAsset& asset, const char* suffix) {
        const Status s = writeAsset(asset, std::string(argv[1]) + "/" + asset.model + suffix + ".glb");
        if (!s) std::fprintf(stderr, "write_assets: %s\n", s.error().message.c_str());
        return bool(s);
    };
    const bool all = write(test::makeAsset(40, 4, 4), "") && write(test::makeSss(40, /*all*/ true), "") && write(makeBall("bigs"), "_ball") &&
                     write(makeBall("sss"), "_ball");
    return all ? 0 : 1;
}
