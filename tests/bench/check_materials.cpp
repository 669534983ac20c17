// How far the materials of a baked sss asset are from those of the mesh that its dataset was rendered from (nacre synth), where every
// material of the mesh is constant: normals, roughness, metalness and base colour per pixel of a split with alpha above 0.9.
//   check_materials ASSET.glb DATASET MESH.glb [SPLIT]
#include "asset/asset_io.h"
#include "dataset/olat_dataset.h"
#include "appearance/reference_model.h"
#include "interchange/gltf.h"
#include "light_stage/placement.h"
#include "light_stage/ray_scene.h"
#include "appearance/sss/sss.h"
#include "render/reference_raster.h"
#include "render/tiles.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>
#include <vector>

using namespace nacre;

template <class T>
static const T& need(const Result<T>& result)
{
    if (result) return *result;
    std::fprintf(stderr, "error: %s\n", result.error().message.c_str());
    std::exit(2);
}

static double mean(const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0) / double(std::max<size_t>(values.size(), 1)); }
static double median(std::vector<double> values)
{
    if (values.empty()) return 0;
    std::nth_element(values.begin(), values.begin() + ptrdiff_t(values.size() / 2), values.end());
    return values[values.size() / 2];
}

int main(int argc, char** argv)
{
    if (argc < 4) {
        std::fprintf(stderr, "usage: check_materials ASSET.glb DATASET MESH.glb [SPLIT]\n");
        return 2;
    }
    const auto asset = readAsset(argv[1]);
    const auto dataset = loadDataset(argv[2]);
    auto mesh = readGltf(argv[3]);
    need(asset), need(dataset), need(mesh);
    const OlatSplit* split = dataset->find(argc > 4 ? argv[4] : "test");
    if (!split || asset->model != "sss") {
        std::fprintf(stderr, "error: the dataset has no such split, or the asset is not of the model sss\n");
        return 2;
    }
    const HairStrands none;
    transformMesh(*mesh, placeMesh(*mesh, none, dataset->up, true));
    const stage::RayScene rays(*mesh, none, 0);
    const auto model = makeReferenceModel(*asset);

    std::vector<GaussianGeometry<float>> geometry;
    const SplatCloud& c = asset->cloud;
    for (size_t i = 0; i < c.count; ++i)
        geometry.push_back({{c.positions[i].x, c.positions[i].y, c.positions[i].z}, {c.scales[i].x, c.scales[i].y, c.scales[i].z},
                            {c.rotations[i].w, c.rotations[i].x, c.rotations[i].y, c.rotations[i].z}, c.opacities[i]});
    std::vector<double> angle, roughness, metalness, base[3], roughnessOff, metalnessOff, baseOff;
    TileBuilder builder;
    for (const Camera& camera : split->cameras) {
        const View<float> view = makeView<float>(camera, asset->lowPassVariance);
        builder.build(view, geometry);
        const size_t channels = size_t(model->channels(0));
        std::vector<float> values(builder.visible.count() * channels), blended(channels);
        for (size_t v = 0; v < builder.visible.count(); ++v) model->shade(builder.visible.splatFromVisible[v], view.eye, {}, &values[channels * v]);
        const TileLists& tiles = builder.tiles;
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
                const size_t tile = size_t(y / kTileSize) * size_t(tiles.tilesX) + size_t(x / kTileSize);
                std::vector<uint32_t> order;
                for (uint32_t e = tiles.tileStart[tile]; e < tiles.tileStart[tile + 1]; ++e) order.push_back(tiles.entries[e].visible);
                const float alpha = blendPixel<float>(order, builder.visible.projected.data(), values.data(), int(channels), float(x) + 0.5f, float(y) + 0.5f, blended.data());
                const glm::vec3 eye(camera.position()), ray(pixelRay(camera, x + 0.5, y + 0.5));
                const stage::RayHit hit = alpha > 0.9f ? rays.intersect(eye, ray) : stage::RayHit{};
                if (!hit.found()) continue;
                const TriangleMesh& m = mesh->meshes[hit.mesh];
                const glm::uvec3 t = m.triangles[hit.primitive];
                const glm::vec3 n = m.normals.empty() ? glm::cross(m.positions[t.y] - m.positions[t.x], m.positions[t.z] - m.positions[t.x])
                                                      : (1 - hit.u - hit.v) * m.normals[t.x] + hit.u * m.normals[t.y] + hit.v * m.normals[t.z];
                const SssPixel<float> pixel = sssPixel(blended.data(), alpha, &eye.x, &ray.x);
                const glm::vec3 found(pixel.surface.normal[0], pixel.surface.normal[1], pixel.surface.normal[2]);
                angle.push_back(std::acos(std::clamp(double(glm::dot(glm::normalize(n), found)), -1.0, 1.0)) * 180 / std::numbers::pi);
                const MeshMaterial& truth = mesh->materials[size_t(m.material)];
                roughness.push_back(pixel.surface.roughness), metalness.push_back(pixel.surface.metalness);
                roughnessOff.push_back(std::abs(pixel.surface.roughness - truth.roughness));
                metalnessOff.push_back(std::abs(pixel.surface.metalness - truth.metallic));
                double off = 0;
                for (int k = 0; k < 3; ++k) base[k].push_back(pixel.surface.base[k]), off += std::abs(pixel.surface.base[k] - truth.baseColor[k]) / 3;
                baseOff.push_back(off);
            }
    }
    std::printf("%zu pixels: normals %.2f degrees off (mean; median %.2f)\n", angle.size(), mean(angle), median(angle));
    std::printf("roughness %.3f (median), off by %.3f (mean); metalness %.3f, off by %.3f; base colour %.3f %.3f %.3f, off by %.3f\n", median(roughness),
                mean(roughnessOff), median(metalness), mean(metalnessOff), median(base[0]), median(base[1]), median(base[2]), mean(baseOff));
    return 0;
}
