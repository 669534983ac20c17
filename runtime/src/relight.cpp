// Radiance of every splat towards the camera, in three passes over small float textures (bigs.h has the equation):
//   light    direct_t = falloff v_t max(T_dir, 0), v_t and sum_t I falloff max(T_ind, 0)                   depends on lights
//   view     a_i = sum_j c_ij y_j(w_o)                                                                     depends on the camera position
//   combine  indirect + sum_t I_t (direct_t max(rho + sum_i a_i y_i(w_t), 0) + falloff v_t k lobe_t(w_o))  depends on both
// All of it in asset space. Without s there is no view pass; without s and lobe nothing depends on the camera. Each pass runs only when
// its inputs differ in any bit from those of its last run.
#include "asset.h"

#include "base/light.h"
#include "gl_state.h"

#include <algorithm>
#include <cstring>

namespace nacre {

static PackedLights packLights(const std::vector<NacreLight>& lights, const DrawFrame& frame)
{
    PackedLights packed{};
    packed.count = int(lights.size());
    packed.worldScale2 = frame.worldScale * frame.worldScale;
    for (size_t i = 0; i < lights.size(); ++i) {
        const NacreLight& light = lights[i];
        const glm::dvec3 v(light.vector[0], light.vector[1], light.vector[2]);
        const float radius = std::max(light.radius, kMinLightRadius);
        packed.shape[i] = light.type == NACRE_LIGHT_POINT
                              ? glm::vec4(glm::vec3(frame.assetFromWorld * glm::dvec4(v, 1.0)), radius * radius)
                              : glm::vec4(glm::vec3(glm::normalize(glm::dmat3(frame.assetFromWorld) * v)), -1.0f);
        packed.intensity[i] = glm::vec4(light.intensity[0], light.intensity[1], light.intensity[2], 0.0f);
    }
    return packed;
}

static void freeLightTargets(NacreAssetImpl& asset)
{
    const GLuint old[] = {asset.direct, asset.indirect, asset.visible};
    asset.context->gl.DeleteTextures(3, old);
    const uint64_t texelBytes = 2 * 16 + (asset.visible ? 8 : 0);
    asset.gpuBytes -= texelBytes * uint64_t(asset.groupCapacity) * uint64_t(asset.width) * uint64_t(asset.rows);
    asset.direct = asset.indirect = asset.visible = 0;
    asset.groupCapacity = 0;
}

/// Room for `groups` groups of four lights. Storage that GL could not allocate shows as an incomplete framebuffer.
static Failure growLightTargets(NacreAssetImpl& asset, int groups)
{
    if (groups <= asset.groupCapacity) return {};
    const Gl& gl = asset.context->gl;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, asset.lightFramebuffer); // deletion detaches, and so frees, only while bound
    freeLightTargets(asset);
    asset.groupCapacity = groups;
    asset.direct = createSlotTexture(asset, GL_RGBA32F, groups);
    asset.indirect = createSlotTexture(asset, GL_RGBA32F, groups);
    if (asset.hasLobe && asset.visibilitySize > 0) asset.visible = createSlotTexture(asset, GL_RGBA16F, groups);
    const GLuint targets[] = {asset.direct, asset.indirect, asset.visible};
    const GLenum attachments[] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1, GL_COLOR_ATTACHMENT2};
    const int count = asset.visible ? 3 : 2;
    for (int i = 0; i < count; ++i) gl.FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, attachments[i], GL_TEXTURE_2D, targets[i], 0);
    gl.DrawBuffers(count, attachments);
    if (gl.CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE) return {};
    freeLightTargets(asset);
    const GLenum error = takeGlError(gl); // ours, unless the host had one pending: asked only now, so that drawing never waits for it
    if (error != GL_NO_ERROR && error != GL_OUT_OF_MEMORY)
        asset.context->report(NACRE_WARNING, "the host had a pending GL error " + std::to_string(error) + "; it was cleared");
    return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for " + std::to_string(4 * groups) + " lights; use fewer"};
}

static void runPass(const NacreAssetImpl& asset, GLuint framebuffer, int slots)
{
    const Gl& gl = asset.context->gl;
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    const float box[4] = {0, 0, float(asset.width), float(asset.rows * slots)};
    setViewport(gl, box);
    gl.DrawArrays(GL_TRIANGLES, 0, 3);
}

static void runLightPass(NacreAssetImpl& asset, const PackedLights& lights)
{
    const Gl& gl = asset.context->gl;
    bindTexture(gl, 0, GL_TEXTURE_2D, asset.lights);
    gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, NACRE_MAX_LIGHTS, 2, GL_RGBA, GL_FLOAT, lights.shape); // shape and intensity: one block
    static_assert(offsetof(PackedLights, intensity) == sizeof(PackedLights::shape));
    if (lights.count == 0) return;
    gl.UseProgram(asset.lightPass.name);
    bindTexture(gl, 0, GL_TEXTURE_2D, asset.geometry);
    bindTexture(gl, 1, GL_TEXTURE_2D, asset.transport);
    bindTexture(gl, 2, GL_TEXTURE_2D, asset.lights);
    if (asset.visibilitySize > 0) bindTexture(gl, 3, GL_TEXTURE_2D_ARRAY, asset.visibility);
    gl.Uniform1i(asset.lightPass.lightCount, lights.count);
    gl.Uniform1f(asset.lightPass.worldScale2, lights.worldScale2);
    runPass(asset, asset.lightFramebuffer, (lights.count + 3) / 4);
}

static void runViewPass(const NacreAssetImpl& asset, const glm::vec3& camera)
{
    const Gl& gl = asset.context->gl;
    gl.UseProgram(asset.viewPass.name);
    bindTexture(gl, 0, GL_TEXTURE_2D, asset.geometry);
    bindTexture(gl, 1, GL_TEXTURE_2D_ARRAY, asset.scatter);
    gl.Uniform3f(asset.viewPass.cameraAsset, camera.x, camera.y, camera.z);
    runPass(asset, asset.viewFramebuffer, asset.sFunctions);
}

static void runCombinePass(const NacreAssetImpl& asset, const PackedLights& lights, const glm::vec3& camera)
{
    const Gl& gl = asset.context->gl;
    gl.UseProgram(asset.combinePass.name);
    bindTexture(gl, 0, GL_TEXTURE_2D, asset.geometry);
    bindTexture(gl, 1, GL_TEXTURE_2D, asset.direct);
    bindTexture(gl, 2, GL_TEXTURE_2D, asset.indirect);
    bindTexture(gl, 3, GL_TEXTURE_2D, asset.contracted);
    bindTexture(gl, 4, GL_TEXTURE_2D, asset.lights);
    if (asset.visible) bindTexture(gl, 5, GL_TEXTURE_2D, asset.visible);
    gl.Uniform1i(asset.combinePass.lightCount, lights.count);
    gl.Uniform1f(asset.combinePass.worldScale2, lights.worldScale2);
    gl.Uniform3f(asset.combinePass.cameraAsset, camera.x, camera.y, camera.z);
    runPass(asset, asset.combineFramebuffer, 1);
}

Failure relight(NacreAssetImpl& asset, const DrawFrame& frame)
{
    asset.packed = packLights(asset.hostLights, frame);
    const bool lightsChanged = !asset.relit || std::memcmp(&asset.packed, &asset.relitWith, sizeof asset.packed) != 0;
    const bool viewChanged = (asset.sFunctions > 0 || asset.hasLobe) && (!asset.seen || asset.seenFrom != frame.cameraAsset);
    const bool contract = viewChanged && asset.sFunctions > 0;
    if (lightsChanged) {
        asset.relit = false;
        if (Failure f = growLightTargets(asset, (asset.packed.count + 3) / 4)) return f;
        runLightPass(asset, asset.packed);
        asset.relitWith = asset.packed;
        asset.relit = true;
    }
    if (contract) runViewPass(asset, frame.cameraAsset);
    if (lightsChanged || viewChanged) runCombinePass(asset, asset.packed, frame.cameraAsset);
    asset.seenFrom = frame.cameraAsset;
    asset.seen = true;
    asset.stats.lightPassesRun = lightsChanged;
    asset.stats.viewPassesRun = contract;
    asset.stats.combinePassesRun = lightsChanged || viewChanged;
    return {};
}

} // namespace nacre
