// Spherical harmonics of one degree only mix with each other when they are turned: sh'_i = sum_j M_ij sh_j, where
//     M_ij = integral over the sphere of y_i(d) y_j(R⁻¹ d)
// A product of 4 Gauss-Legendre nodes in z and 8 azimuths integrates polynomials up to degree 7 exactly; these have degree 6 at most.
#include "interchange/rotate_splats.h"

#include "base/spherical_harmonics.h"

#include <array>
#include <cmath>
#include <numbers>

namespace nacre {

constexpr size_t kFunctions = 16;
using Matrix = std::array<std::array<double, kFunctions>, kFunctions>;

static Matrix rotationOfHarmonics(const glm::dquat& rotation)
{
    constexpr double kNodes[] = {-0.86113631159405258, -0.33998104358485626, 0.33998104358485626, 0.86113631159405258};
    constexpr double kWeights[] = {0.34785484513745386, 0.65214515486254614, 0.65214515486254614, 0.34785484513745386};
    constexpr int kAzimuths = 8;
    const glm::dmat3 back = glm::transpose(glm::mat3_cast(rotation));
    Matrix m{};
    for (int k = 0; k < 4; ++k)
        for (int a = 0; a < kAzimuths; ++a) {
            const double phi = 2 * std::numbers::pi * a / kAzimuths, r = std::sqrt(1 - kNodes[k] * kNodes[k]);
            const glm::dvec3 d(r * std::cos(phi), r * std::sin(phi), kNodes[k]), turned = back * d;
            double y[kFunctions], yTurned[kFunctions];
            shBasis(int(kFunctions), d.x, d.y, d.z, y);
            shBasis(int(kFunctions), turned.x, turned.y, turned.z, yTurned);
            for (size_t i = 0; i < kFunctions; ++i)
                for (size_t j = 0; j < kFunctions; ++j) m[i][j] += kWeights[k] * 2 * std::numbers::pi / kAzimuths * y[i] * yTurned[j];
        }
    return m;
}

void rotateSplats(const glm::dquat& rotation, PlainSplats& splats)
{
    const Matrix m = rotationOfHarmonics(rotation);
    const size_t functions = size_t(splats.look.shFunctions);
    for (size_t i = 0; i < splats.cloud.count; ++i) {
        splats.cloud.positions[i] = glm::vec3(rotation * glm::dvec3(splats.cloud.positions[i]));
        splats.cloud.rotations[i] = glm::quat(glm::normalize(rotation * glm::dquat(splats.cloud.rotations[i])));
        glm::vec3* sh = &splats.look.sh[i * functions];
        for (size_t first = 1, size = 3; first < functions; first += size, size += 2) { // degree by degree
            std::array<glm::dvec3, 7> turned{};
            for (size_t a = 0; a < size; ++a)
                for (size_t b = 0; b < size; ++b) turned[a] += m[first + a][first + b] * glm::dvec3(sh[first + b]);
            for (size_t a = 0; a < size; ++a) sh[first + a] = glm::vec3(turned[a]);
        }
    }
}

void placeInDataset(const AssetFrame& frame, SplatCloud& cloud)
{
    for (glm::vec3& p : cloud.positions) p = glm::vec3(frame.positionInDataset(glm::dvec3(p)));
    for (glm::vec3& s : cloud.scales) s = glm::vec3(frame.scale * glm::dvec3(s));
}

} // namespace nacre
