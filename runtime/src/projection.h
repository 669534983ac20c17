// The pass that projects splats into a draw list (project.frag.glsl), for views and for the maps of lights.
#pragma once

#include "draw_list.h"
#include "frame.h"

namespace nacre {

struct Instance;

Failure projectionProgram(Context& context, const Program** program);
/// What all instances share. Casters keep their opacity however small they are in the picture.
void beginProjection(const Program& program, const ViewFrame& frame, bool casters);
/// Into its rows of the list, whose projected targets are bound. One that is not lit is not drawn.
void projectInstance(const Program& program, const Instance& instance, const InstanceFrame& frame, bool lit, const DrawList& list, const ListRows& rows);

} // namespace nacre
