// Skins: the joints' matrices.
#include "interchange/gltf_skin.h"

#include "interchange/gltf_accessor.h"

#include <cmath>

namespace nacre::gltf {
namespace {

bool isFinite(const glm::dmat4& m)
{
    for (int i = 0; i < 16; ++i)
        if (!std::isfinite(m[i / 4][i % 4])) return false;
    return true;
}

bool isAffine(const glm::mat4& m)
{
    constexpr float kRounding = 1e-3f; // of inverses computed in float
    return std::fabs(m[0][3]) <= kRounding && std::fabs(m[1][3]) <= kRounding && std::fabs(m[2][3]) <= kRounding && std::fabs(m[3][3] - 1.0f) <= kRounding;
}

/// Relative to the lengths of its columns, so that a small joint is not a flat one.
bool flattens(const glm::dmat4& m)
{
    constexpr double kFlat = 1e-9; // below what inverse bind matrices, which are float, can tell from 0
    const glm::dmat3 linear(m);
    return !(std::fabs(glm::determinant(linear)) > kFlat * glm::length(linear[0]) * glm::length(linear[1]) * glm::length(linear[2]));
}

} // namespace

std::vector<glm::dmat4> readJointMatrices(File& file, const JsonNode& skinIndex, const Nodes& nodes)
{
    const JsonNode& skin = file.at(file.skins, skinIndex);
    const std::vector<JsonNode> joints = skin["joints"].items();
    file.take(joints.size(), sizeof(glm::dmat4), skin.where());
    std::vector<glm::mat4> inverseBind;
    if (const JsonNode matrices = skin["inverseBindMatrices"]; matrices.exists()) {
        inverseBind = readMatrices(file, readAccessor(file, matrices));
        if (inverseBind.size() < joints.size())
            bad(skin.where() + " has " + std::to_string(joints.size()) + " joints, but " + std::to_string(inverseBind.size()) + " inverse bind matrices");
    }
    std::vector<glm::dmat4> out;
    size_t flat = 0, firstFlat = 0;
    for (size_t j = 0; j < joints.size(); ++j) {
        const size_t node = file.index(file.nodes, joints[j]);
        if (!inverseBind.empty() && !isAffine(inverseBind[j]))
            bad(skin.where() + ": inverse bind matrix " + std::to_string(j) + " is not affine (last row 0 0 0 1); glTF stores columns, not rows");
        glm::dmat4 m = nodes.worldFromLocal[node] * (inverseBind.empty() ? glm::dmat4(1.0) : glm::dmat4(inverseBind[j]));
        for (int i = 0; i < 4; ++i) m[i][3] = i == 3 ? 1.0 : 0.0; // affine, but for the rounding of the bind matrices
        if (!isFinite(m)) bad(skin.where() + ": the matrix of joint " + std::to_string(j) + " is not finite");
        if (flattens(m) && flat++ == 0) firstFlat = j;
        out.push_back(m);
    }
    file.check();
    if (flat > 0)
        file.warn(skin.where() + ": " + std::to_string(flat) + " joints flatten what they move (scale 0), the first is joints[" + std::to_string(firstFlat) +
                  "]; the mesh may be crumpled there");
    return out;
}

} // namespace nacre::gltf
