// XYZ = M rgb, where the columns of M are the primaries (x, y, 1 - x - y), scaled so that rgb (1, 1, 1) is the white with Y = 1.
// Bradford: in the cone space B XYZ each channel is scaled by the ratio of the two whites.
#include "interchange/primaries.h"

#include <algorithm>
#include <cmath>

namespace nacre {
namespace {

constexpr double kSame = 2e-3;         // headers round to three digits: D65 as 0.313, 0.329
constexpr double kLargest = 16;        // imaginary primaries reach 1; beyond is damage
constexpr double kSmallestArea = 1e-4; // of the triangle, twice; that of Rec.709 is 0.22

glm::dvec3 xyz(const glm::dvec2& c) { return {c.x, c.y, 1 - c.x - c.y}; }
glm::dvec3 whiteXyz(const Primaries& p) { return xyz(p.white) / p.white.y; }

glm::dmat3 xyzFromRgb(const Primaries& p)
{
    const glm::dmat3 columns(xyz(p.red), xyz(p.green), xyz(p.blue));
    const glm::dvec3 scale = glm::inverse(columns) * whiteXyz(p);
    return {columns[0] * scale[0], columns[1] * scale[1], columns[2] * scale[2]};
}

} // namespace

bool areRec709(const Primaries& p)
{
    const Primaries r;
    const auto same = [](const glm::dvec2& a, const glm::dvec2& b) { return std::fabs(a.x - b.x) <= kSame && std::fabs(a.y - b.y) <= kSame; };
    return same(p.red, r.red) && same(p.green, r.green) && same(p.blue, r.blue) && same(p.white, r.white);
}

std::optional<glm::dmat3> rec709From(const Primaries& p)
{
    for (const glm::dvec2& c : {p.red, p.green, p.blue, p.white})
        if (!(std::fabs(c.x) < kLargest && std::fabs(c.y) < kLargest)) return std::nullopt;
    if (!(p.white.x > 0.01 && p.white.y > 0.01 && p.white.x + p.white.y < 0.99)) return std::nullopt;
    const glm::dvec2 a = p.green - p.red, b = p.blue - p.red;
    if (!(std::fabs(a.x * b.y - a.y * b.x) > kSmallestArea)) return std::nullopt;

    const glm::dmat3 bradford(0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296); // columns
    const Primaries rec709;
    const glm::dvec3 ratio = (bradford * whiteXyz(rec709)) / (bradford * whiteXyz(p));
    const glm::dmat3 adapt = glm::inverse(bradford) * glm::dmat3(ratio.x, 0, 0, 0, ratio.y, 0, 0, 0, ratio.z) * bradford;
    const glm::dmat3 out = glm::inverse(xyzFromRgb(rec709)) * adapt * xyzFromRgb(p);
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r)
            if (!(std::fabs(out[c][r]) < 1e3)) return std::nullopt; // positive test, so NaN fails
    return out;
}

} // namespace nacre
