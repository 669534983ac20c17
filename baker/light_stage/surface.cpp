// Specular layer over a random walk: light enters with 1 - F(N.V), leaves with 1 - F(N.L), and 1 / (1 - Favg) stands for what the
// layer sends back down (Favg: cosine-weighted mean of Schlick's F; Shirley et al. 1997, Ashikhmin and Shirley 2000). This is
// reciprocal, and a walk that loses nothing makes a surface that loses nothing.
#include "light_stage/surface.h"

#include "light_stage/texture_sampling.h"
#include "mesh/closed_surface.h"
#include "mesh/material_names.h"

#include <algorithm>

namespace nacre::stage {

namespace {

/// Interpolates the vertices of one hit triangle.
struct Corner {
    const TriangleMesh& mesh;
    glm::uvec3 index;
    glm::vec3 weight;

    Corner(const TriangleMesh& m, const RayHit& hit) : mesh(m), index(m.triangles[hit.primitive]), weight(1.0f - hit.u - hit.v, hit.u, hit.v) {}
    template <class T>
    T at(const std::vector<T>& rows) const
    {
        return rows[index.x] * weight.x + rows[index.y] * weight.y + rows[index.z] * weight.z;
    }
    glm::vec4 texture(const MeshScene& scene, const TextureSlot& slot, bool srgb = false) const
    {
        if (!slot) return glm::vec4(1.0f);
        const auto& coordinates = mesh.texcoords[slot.texcoord];
        const glm::vec2 uv = coordinates.empty() ? glm::vec2(0.0f) : at(coordinates);
        return sampleTexture(scene.textures[size_t(slot.texture)], slot.uvScaleRotate * uv + slot.uvOffset, srgb);
    }
    glm::vec4 baseColor(const MeshScene& scene, const MeshMaterial& m) const
    {
        glm::vec4 c = m.baseColor * texture(scene, m.baseColorTexture, true);
        if (!mesh.colors.empty()) c *= at(mesh.colors);
        return glm::clamp(c, 0.0f, 1.0f);
    }
};

/// From the point on the flat triangle to the curved surface that the vertex normals describe, where it lies outside (Hanika, "Hacking the
/// Shadow Terminator", Ray Tracing Gems II, 2021): the point is projected onto the tangent planes of the vertices, and the three projections
/// are averaged with its barycentric weights. Zero where the surface is hollow, and where a normal points behind the triangle.
/// `side`: -1 seen from inside, where the hollow is on the other side.
glm::vec3 liftOf(const Corner& corner, const glm::vec3& point, const glm::vec3& outward, float side)
{
    glm::vec3 lift(0.0f);
    for (int k = 0; k < 3; ++k) {
        const glm::vec3 n = side * corner.mesh.normals[corner.index[k]];
        if (!(glm::dot(n, outward) > 0.0f)) return glm::vec3(0.0f);
        lift -= corner.weight[k] * std::min(0.0f, glm::dot(point - corner.mesh.positions[corner.index[k]], n)) * n;
    }
    return lift;
}

float opacityOf(const MeshMaterial& m, float alpha)
{
    if (m.alphaMode == AlphaMode::kOpaque) return 1.0f;
    if (m.alphaMode == AlphaMode::kMask) return alpha >= m.alphaCutoff ? 1.0f : 0.0f;
    return alpha;
}

/// A normal-map normal in world space, around the interpolated frame; the interpolated normal if there is no tangent.
glm::vec3 mappedNormal(const MeshScene& scene, const Corner& corner, const TextureSlot& slot, float scale, const glm::vec3& normal)
{
    if (!slot || corner.mesh.tangents.empty()) return normal;
    const glm::vec4 tangent = corner.at(corner.mesh.tangents);
    const glm::vec3 t = glm::vec3(tangent) - normal * glm::dot(normal, glm::vec3(tangent));
    if (!(glm::dot(t, t) > 1e-12f)) return normal;
    const glm::vec3 tn = glm::normalize(t), b = glm::cross(normal, tn) * (tangent.w < 0.0f ? -1.0f : 1.0f);
    const glm::vec3 m = glm::vec3(corner.texture(scene, slot)) * 2.0f - 1.0f;
    const glm::vec3 n = tn * (m.x * scale) + b * (m.y * scale) + normal * m.z;
    return glm::dot(n, n) > 1e-12f ? glm::normalize(n) : normal;
}

/// The frame's tangent along the anisotropy direction.
Frame shadingFrame(const Corner& corner, const glm::vec3& n, const glm::vec2& direction)
{
    if (corner.mesh.tangents.empty()) return Frame::around(n);
    const glm::vec4 tangent = corner.at(corner.mesh.tangents);
    const glm::vec3 t0 = glm::vec3(tangent) - n * glm::dot(n, glm::vec3(tangent));
    if (!(glm::dot(t0, t0) > 1e-12f)) return Frame::around(n);
    const glm::vec3 tn = glm::normalize(t0), bn = glm::cross(n, tn) * (tangent.w < 0.0f ? -1.0f : 1.0f);
    const glm::vec3 t = glm::normalize(direction.x * tn + direction.y * bn);
    return {t, glm::cross(n, t), n};
}

/// Directions almost behind the shading normal count as grazing.
glm::vec3 grazingAtLeast(glm::vec3 w)
{
    w.z = std::max(w.z, 1e-3f);
    return glm::normalize(w);
}

/// Times the object's size: steps much shorter would drown in the rounding of positions.
constexpr float kShortestFreePath = 2e-5f;

/// Times the object's size: vertices nearer to each other are one. The rounding of exporters (sin 2 pi is not sin 0) and of positions.
constexpr float kWeld = 1e-6f;

// ---- bodies: which meshes bound a medium, and whether they can ---------------------------------------------------------------

glm::vec3 clampAlbedo(const glm::vec3& a) { return glm::clamp(a, 0.0f, 1.0f); }

void setMedium(Body& body, const glm::vec3& sigmaT, const glm::vec3& alpha, float g)
{
    body.medium.sigmaT = glm::max(sigmaT, 0.0f);
    body.medium.albedo = clampAlbedo(alpha);
    body.medium.g = glm::clamp(g, -0.99f, 0.99f);
    for (int c = 0; c < 3; ++c) body.diffuseAlbedo[c] = diffuseAlbedoFromSingleScatter(body.medium.albedo[c], body.medium.g);
}

glm::vec3 singleScatterOf(const glm::vec3& diffuseAlbedo, float g)
{
    return {singleScatterFromDiffuseAlbedo(diffuseAlbedo.x, g), singleScatterFromDiffuseAlbedo(diffuseAlbedo.y, g),
            singleScatterFromDiffuseAlbedo(diffuseAlbedo.z, g)};
}

/// KHR_materials_volume and KHR_materials_volume_scatter.
Body bodyFromFile(const MeshMaterial& m, float unitsPerMetre)
{
    Body body;
    if (!(m.thickness > 0.0f)) return body;
    glm::vec3 sigmaT(0.0f);
    if (std::isfinite(m.attenuationDistance) && m.attenuationDistance > 0.0f)
        sigmaT = -glm::log(glm::clamp(m.attenuationColor, 1e-4f, 1.0f)) / (m.attenuationDistance * unitsPerMetre);
    const glm::vec3 alpha = m.hasVolumeScatter ? singleScatterOf(m.multiscatterColor, m.scatterAnisotropy) : glm::vec3(0.0f);
    setMedium(body, sigmaT, alpha, m.scatterAnisotropy);
    body.boundary = m.transmission > 0.0f;
    body.scatters = !body.boundary && m.hasVolumeScatter && maxOf(sigmaT) > 0.0f;
    if (m.diffuseTransmission > 0.0f) body.walkShare = m.diffuseTransmission;
    body.invisible = body.boundary && std::fabs(m.ior - 1.0f) < 1e-4f;
    return body;
}

Body bodyFromOverride(const SubsurfaceOverride& o, float unitsPerMetre)
{
    Body body;
    const glm::vec3 sigmaT = 1.0f / glm::max(o.meanFreePath * unitsPerMetre, 1e-12f);
    body.albedoFromBaseColor = o.albedo.x < 0.0f && o.singleScatterAlbedo.x < 0.0f;
    setMedium(body, sigmaT, o.singleScatterAlbedo.x >= 0.0f ? o.singleScatterAlbedo : singleScatterOf(glm::max(o.albedo, 0.0f), o.anisotropy),
              o.anisotropy);
    body.scatters = o.boundary == SubsurfaceBoundary::kDiffuse;
    body.boundary = !body.scatters;
    body.invisible = o.boundary == SubsurfaceBoundary::kNone;
    return body;
}

} // namespace

Result<SurfaceTable> SurfaceTable::create(StageScene& scene, std::vector<std::string>& warnings)
{
    SurfaceTable table;
    MeshScene& mesh = scene.mesh;
    for (const MeshMaterial& m : mesh.materials) table.bodies_.push_back(bodyFromFile(m, scene.unitsPerMetre));
    for (const SubsurfaceOverride& o : scene.subsurface) {
        bool found = false;
        for (size_t i = 0; i < mesh.materials.size(); ++i) {
            if (!namesMaterial(o.material, mesh, i)) continue;
            found = true;
            table.bodies_[i] = bodyFromOverride(o, scene.unitsPerMetre);
            MeshMaterial& m = mesh.materials[i];
            if (o.boundary == SubsurfaceBoundary::kDielectric && std::fabs(m.ior - 1.0f) < 1e-4f) table.bodies_[i].invisible = true;
            m.metallic = 0.0f;
            m.transmissionTexture.texture = -1;
            m.transmission = o.boundary == SubsurfaceBoundary::kDielectric ? 1.0f : 0.0f;
            if (m.transmission > 0.0f) { // the colour comes from the medium
                m.baseColor = {1, 1, 1, m.baseColor.a};
                m.baseColorTexture.texture = -1;
                m.thickness = 1.0f;
            }
        }
        if (!found)
            return Error{ErrorCode::kBadInput, "subsurface scattering is asked for material " + inQuotes(o.material) +
                                                   ", which the mesh does not have; it has: " + listMaterials(mesh)};
    }

    float size = 0.0f;
    for (const TriangleMesh& m : mesh.meshes)
        for (const glm::vec3& p : m.positions) size = std::max({size, std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
    const float mostSigma = 1.0f / std::max(1e-20f, kShortestFreePath * size);

    for (size_t i = 0; i < mesh.materials.size(); ++i) {
        const MeshMaterial& m = mesh.materials[i];
        Body& body = table.bodies_[i];
        const bool used = std::any_of(mesh.meshes.begin(), mesh.meshes.end(), [&](const TriangleMesh& t) { return t.material == int(i); });
        if (!used) continue;
        const std::string name = "material " + inQuotes(m.name);
        table.seeThrough_ = table.seeThrough_ || m.alphaMode != AlphaMode::kOpaque || body.invisible;
        if (!body.scatters && !body.boundary) continue;
        mesh.materials[i].doubleSided = true; // the boundary of a volume is there from both sides
        if (maxOf(body.medium.sigmaT) > mostSigma) {
            body.medium.sigmaT = glm::min(body.medium.sigmaT, mostSigma);
            warnings.push_back(name + ": its mean free path is below 1/50000 of the object's size and was raised to that (the eye sees an "
                                      "opaque surface either way; leave the scattering out to save time)");
        }
        if (signedVolume(mesh, int(i)) < 0.0) {
            warnings.push_back(name + ": its surface is inside out (negative volume), which matters for a volume: turned round");
            turnInsideOut(mesh, int(i));
        }
        if (const size_t open = countOpenEdges(mesh, int(i), kWeld * size); open > 0)
            warnings.push_back(name + ": used as a volume, but its surface is open along " + std::to_string(open) +
                               " edges; light leaks there and is lost (close the mesh, or expect dark places)");
        if (body.boundary && !body.invisible && m.roughness * m.roughness < kMinAlpha)
            warnings.push_back(name + ": a smooth boundary of a volume lets no light of a lamp without size through; rendered with roughness 0.03");
        if (body.scatters && m.hasVolumeScatter && m.diffuseTransmission == 0.0f)
            warnings.push_back(name + ": KHR_materials_volume_scatter without transmission: light enters and leaves diffusely, as with KHR_materials_diffuse_transmission");
    }
    return table;
}

SurfacePoint SurfaceTable::evaluate(const MeshScene& scene, const RayHit& hit, const glm::vec3& wo, float leastAlpha) const
{
    const TriangleMesh& mesh = scene.meshes[hit.mesh];
    const MeshMaterial& m = scene.materials[size_t(mesh.material)];
    const Body& body = bodies_[size_t(mesh.material)];
    const Corner corner(mesh, hit);
    if (body.boundary) leastAlpha = kMinAlpha;
    SurfacePoint s;
    s.material = mesh.material;
    s.position = corner.at(mesh.positions);
    const glm::vec3 p0 = mesh.positions[corner.index.x];
    const glm::dvec3 area = glm::cross(glm::dvec3(mesh.positions[corner.index.y] - p0), glm::dvec3(mesh.positions[corner.index.z] - p0));
    s.geometricNormal = area == glm::dvec3(0.0) ? wo : glm::vec3(glm::normalize(area)); // float would underflow for tiny triangles
    s.fromInside = glm::dot(wo, s.geometricNormal) < 0.0f;

    glm::vec3 smooth = s.geometricNormal;
    if (!mesh.normals.empty()) {
        const glm::vec3 n = corner.at(mesh.normals);
        if (glm::dot(n, s.geometricNormal) > 0.0f) smooth = glm::normalize(n);
    }
    const float side = s.fromInside ? -1.0f : 1.0f;

    const glm::vec4 color = corner.baseColor(scene, m);
    s.opacity = opacityOf(m, color.a);
    SurfaceBsdf& b = s.bsdf;
    b.ng = side * s.geometricNormal;
    b.above = b.ng;
    if (!mesh.normals.empty() && !body.boundary) { // through a boundary, rays keep to the triangles: they count who is inside
        s.lift = liftOf(corner, s.position, b.ng, side);
        if (s.lift != glm::vec3(0.0f)) b.above = side * smooth;
    }
    b.baseColor = glm::vec3(color);
    const glm::vec4 mr = corner.texture(scene, m.metallicRoughnessTexture);
    b.metallic = glm::clamp(m.metallic * mr.b, 0.0f, 1.0f);
    const float alpha = std::max(leastAlpha, sqr(glm::clamp(m.roughness * mr.g, 0.0f, 1.0f)));
    b.transmission = glm::clamp(m.transmission * corner.texture(scene, m.transmissionTexture).r, 0.0f, 1.0f);
    b.specular = m.specular * corner.texture(scene, m.specularTexture).a;
    const float f0 = m.ior > 0.0f ? sqr((m.ior - 1.0f) / (m.ior + 1.0f)) : 1.0f;
    b.f0 = glm::min(f0 * m.specularColor * glm::vec3(corner.texture(scene, m.specularColorTexture, true)), glm::vec3(1.0f));
    if (body.boundary && m.ior > 0.0f && std::fabs(m.ior - 1.0f) > 1e-4f) b.eta = s.fromInside ? 1.0f / m.ior : m.ior;

    // KHR_materials_iridescence: a film fades away towards thickness 0 as the extension proposes, within 0.03 nm.
    b.filmIor = m.iridescenceIor;
    b.filmThickness = glm::mix(m.iridescenceThicknessMinimum, m.iridescenceThicknessMaximum, corner.texture(scene, m.iridescenceThicknessTexture).g);
    b.film = glm::clamp(m.iridescence * corner.texture(scene, m.iridescenceTexture).r, 0.0f, 1.0f) * glm::smoothstep(0.0f, 0.03f, b.filmThickness);

    // KHR_materials_anisotropy: the texture turns and scales; alpha along the direction is mix(alpha, 1, strength^2).
    glm::vec2 direction(std::cos(m.anisotropyRotation), std::sin(m.anisotropyRotation));
    float strength = m.anisotropy;
    if (m.anisotropyTexture) {
        const glm::vec4 a = corner.texture(scene, m.anisotropyTexture);
        const glm::vec2 d = glm::vec2(a) * 2.0f - 1.0f;
        direction = {direction.x * d.x - direction.y * d.y, direction.y * d.x + direction.x * d.y};
        strength *= a.b;
        if (!(glm::dot(direction, direction) > 1e-8f)) direction = {1, 0};
    }
    b.alphaX = glm::mix(alpha, 1.0f, sqr(glm::clamp(strength, 0.0f, 1.0f)));
    b.alphaY = alpha;

    const glm::vec3 n = side * mappedNormal(scene, corner, m.normalTexture, m.normalScale, smooth);
    b.frame = strength > 0.0f ? shadingFrame(corner, n, direction) : Frame::around(n);
    b.wo = grazingAtLeast(b.frame.toLocal(wo));

    b.coat = glm::clamp(m.clearcoat * corner.texture(scene, m.clearcoatTexture).r, 0.0f, 1.0f);
    if (b.coat > 0.0f) {
        b.coatAlpha = std::max(leastAlpha, sqr(glm::clamp(m.clearcoatRoughness * corner.texture(scene, m.clearcoatRoughnessTexture).g, 0.0f, 1.0f)));
        b.coatFrame = Frame::around(side * mappedNormal(scene, corner, m.clearcoatNormalTexture, m.clearcoatNormalScale, smooth));
        b.coatWo = grazingAtLeast(b.coatFrame.toLocal(wo));
    }

    glm::vec3 walkAlbedo(0.0f);
    if (body.scatters && !s.fromInside) {
        s.walk = body.medium;
        walkAlbedo = body.diffuseAlbedo;
        if (body.albedoFromBaseColor) {
            walkAlbedo = b.baseColor;
            s.walk.albedo = singleScatterOf(b.baseColor, body.medium.g);
        }
        float mean = maxOf(b.specular * (b.f0 + (1.0f - b.f0) / 21.0f));
        if (b.film > 0.0f) { // no closed form: the midpoint rule in cosine^2
            constexpr int kSteps = 8;
            mean = 0.0f;
            for (int i = 0; i < kSteps; ++i) mean += (1.0f - walkExitFactor(b, std::sqrt((float(i) + 0.5f) / kSteps))) / kSteps;
        }
        walkAlbedo *= body.walkShare;
        const float enter = body.walkShare * (1.0f - b.metallic) * (1.0f - b.transmission) * walkExitFactor(b, b.wo.z) / std::max(1e-3f, 1.0f - mean);
        s.walkWeight = glm::vec3(enter);
    }
    b.diffuse = (1.0f - b.transmission) * (body.scatters ? 1.0f - body.walkShare : 1.0f) * b.baseColor; // evaluate() applies 1 - metallic
    b.finish(walkAlbedo, &s.chanceSubsurface);
    s.walkWeight *= 1.0f - b.coatShare;
    return s;
}

} // namespace nacre::stage
