// Programs compiled for one asset: sizes and channels are #defines, so what an asset lacks is not in its code.
#pragma once

#include "asset.h"

#include <initializer_list>
#include <string>

namespace nacre {

/// A program and the uniforms that change per draw (-1 where a program has no such uniform).
struct Program {
    GLuint name = 0;
    GLint lightCount = -1, lanes = -1, oneLoop = -1, firstLight = -1, worldScale2 = -1, cameraAsset = -1;
    GLint viewFromAsset = -1, viewTranslation = -1, clipFromView = -1, viewport = -1, jacobianLimit = -1, nearW = -1, lowPass = -1,
          nearPlane = -1, maxColor = -1, depthOrigin = -1, depthUnit = -1, layerMax = -1, inverseSize = -1, eye = -1, rayOrigin = -1, rayRight = -1, rayUp = -1;
};

/// #version and what every program of this asset knows: where splats sit, how they blend.
std::string commonDefines(const NacreAssetImpl& asset, int glslVersion = 330);
/// One more #define.
std::string define(const char* name, int value);
std::string define(const char* name, float value);

/// Sampler `samplers[i]` reads texture unit i.
Failure compile(const Gl& gl, const char* what, const std::string& vertexSource, const std::string& fragmentSource,
                std::initializer_list<const char*> samplers, Program* program);
/// The same of a compute shader; only if gl.hasCompute().
Failure compileCompute(const Gl& gl, const char* what, const std::string& source, std::initializer_list<const char*> samplers, Program* program);

/// Uniforms of splat.vert.glsl.
void setSplatUniforms(const NacreAssetImpl& asset, const Program& program, const DrawFrame& frame);

} // namespace nacre
