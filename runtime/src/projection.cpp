#include "projection.h"

#include "instance.h"
#include "shader_sources.h"
#include "splats/blend.h"

namespace nacre {

Failure projectionProgram(Context& context, const Program** program)
{
    return findProgram(context, {"projection", shaders::kFullscreenVertGlsl, std::string(shaders::kPassGlsl) + shaders::kProjectFragGlsl, {"uGeometry"}}, program);
}

void beginProjection(const Program& program, const ViewFrame& frame, bool casters)
{
    program.use();
    program.set("uTowardsEye", glm::vec4(frame.towardsEye, frame.orthographic ? 1 : 0));
    program.set("uClipFromView", frame.clipFromView);
    program.set("uViewport", frame.viewport);
    program.set("uJacobianLimit", 1.0f + kJacobianMargin);
    program.set("uNear", frame.nearW);
    program.set("uNearPlane", frame.nearPlane);
    program.set("uCompensate", int(!casters));
}

void projectInstance(const Program& program, const Instance& instance, const InstanceFrame& frame, bool lit, const DrawList& list, const ListRows& rows)
{
    const Asset& asset = *instance.asset;
    asset.grid.set(program);
    list.set(program, rows);
    program.set("uViewFromAsset", frame.viewFromAsset);
    program.set("uViewTranslation", frame.viewTranslation);
    program.set("uWorldFromAsset", frame.worldFromAsset);
    program.set("uFromEye", frame.fromEye);
    program.set("uLowPass", asset.lowPassVariance);
    program.set("uLit", int(lit));
    instance.model->geometry().bind(0);
    runPass(instance.context, list.width(), rows.first, rows.count);
}

} // namespace nacre
