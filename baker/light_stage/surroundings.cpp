#include "light_stage/surroundings.h"

#include "base/color.h"
#include "base/random.h"

#include <algorithm>
#include <cmath>

namespace nacre {
namespace {

// In radii of the object. Rays between a table and what stands on it need more room than rounding takes.
constexpr float kTableHalf = 2.3f, kTableThickness = 0.15f, kGap = 1e-3f;
constexpr float kRoomHalf = 10.0f, kFloorBelow = 5.0f, kWallTop = 5.0f;

float lowestPoint(const StageScene& scene)
{
    float lowest = 1.0f;
    for (const TriangleMesh& mesh : scene.mesh.meshes)
        for (const glm::vec3& p : mesh.positions) lowest = std::min(lowest, p.z);
    for (const glm::vec4& p : scene.hair.controlPoints) lowest = std::min(lowest, p.z - p.w);
    return lowest;
}

uint8_t byteOf(float linear) { return uint8_t(std::lround(255.0f * srgbFromLinear(std::clamp(linear, 0.0f, 1.0f)))); }

/// Smooth noise between 0 and 1, `cells` to the picture.
float noiseAt(float u, float v, int cells, uint64_t seed)
{
    const float x = u * float(cells), y = v * float(cells);
    const int x0 = int(x), y0 = int(y);
    const auto corner = [&](int i, int j) { return Random(seed, uint64_t(i % cells) * 4096 + uint64_t(j % cells)).uniform(); };
    const auto smooth = [](float t) { return t * t * (3.0f - 2.0f * t); };
    const float tx = smooth(x - float(x0)), ty = smooth(y - float(y0));
    return (1 - ty) * ((1 - tx) * corner(x0, y0) + tx * corner(x0 + 1, y0)) + ty * ((1 - tx) * corner(x0, y0 + 1) + tx * corner(x0 + 1, y0 + 1));
}

template <class Color>
MeshTexture paint(const std::string& name, int size, Color color)
{
    MeshTexture t;
    t.name = name;
    t.width = t.height = size;
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            const glm::vec3 c = color((float(x) + 0.5f) / float(size), (float(y) + 0.5f) / float(size));
            t.rgba.insert(t.rgba.end(), {byteOf(c.r), byteOf(c.g), byteOf(c.b), 255});
        }
    return t;
}

/// Boards with grain.
glm::vec3 wood(float u, float v)
{
    const int board = int(v * 7.0f);
    const float tone = Random(11, uint64_t(board)).uniform(), shift = 0.37f * float(board);
    const float grain = noiseAt(std::fmod(u * 0.25f + shift, 1.0f), v, 64, 12), blotch = noiseAt(u, v, 9, 13);
    const float seam = std::fabs(v * 7.0f - std::round(v * 7.0f)) < 0.03f ? 0.5f : 1.0f;
    return seam * (0.6f + 0.4f * tone) * (0.55f + 0.5f * grain) * (0.7f + 0.5f * blotch) * glm::vec3(0.34f, 0.21f, 0.12f);
}

/// Tiles of several muted colours with blotches.
glm::vec3 wallpaper(float u, float v)
{
    Random random(21, uint64_t(u * 16.0f) * 64 + uint64_t(v * 16.0f));
    const glm::vec3 tile(0.25f + 0.35f * random.uniform(), 0.25f + 0.3f * random.uniform(), 0.22f + 0.3f * random.uniform());
    return tile * (0.6f + 0.6f * noiseAt(u, v, 48, 22));
}

/// Two triangles, seen from where the corners run counter-clockwise.
void addQuad(TriangleMesh& mesh, const glm::vec3 (&corners)[4])
{
    const unsigned first = unsigned(mesh.positions.size());
    constexpr glm::vec2 kTexcoords[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    for (int i = 0; i < 4; ++i) mesh.positions.push_back(corners[i]), mesh.texcoords[0].push_back(kTexcoords[i]);
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.triangles.push_back({first, first + 2, first + 3});
}

int addMaterial(MeshScene& scene, MeshTexture texture)
{
    MeshMaterial m;
    m.name = texture.name;
    m.metallic = 0.0f;
    m.roughness = 0.6f;
    m.specular = 0.5f;
    m.doubleSided = true;
    m.baseColorTexture.texture = int(scene.textures.size());
    scene.textures.push_back(std::move(texture));
    scene.materials.push_back(std::move(m));
    return int(scene.materials.size()) - 1;
}

} // namespace

void addSurroundings(StageScene& scene)
{
    const float top = lowestPoint(scene) - kGap, bottom = top - kTableThickness, h = kTableHalf;
    TriangleMesh table;
    table.name = "table";
    table.material = addMaterial(scene.mesh, paint("table", 512, wood));
    for (const float z : {top, bottom}) addQuad(table, {{-h, -h, z}, {h, -h, z}, {h, h, z}, {-h, h, z}});
    for (int side = 0; side < 4; ++side) {
        const glm::vec2 a[4] = {{-h, -h}, {h, -h}, {h, h}, {-h, h}}, from = a[side], to = a[(side + 1) % 4];
        addQuad(table, {{from, bottom}, {to, bottom}, {to, top}, {from, top}});
    }
    TriangleMesh room;
    room.name = "room";
    room.material = addMaterial(scene.mesh, paint("room", 512, wallpaper));
    const float r = kRoomHalf, floor = bottom - kFloorBelow;
    addQuad(room, {{-r, -r, floor}, {r, -r, floor}, {r, r, floor}, {-r, r, floor}});
    for (int side = 0; side < 4; ++side) {
        const glm::vec2 a[4] = {{-r, -r}, {-r, r}, {r, r}, {r, -r}}, from = a[side], to = a[(side + 1) % 4];
        addQuad(room, {{from, floor}, {to, floor}, {to, kWallTop}, {from, kWallTop}});
    }
    scene.mesh.meshes.push_back(std::move(table));
    scene.mesh.meshes.push_back(std::move(room));
}

} // namespace nacre
