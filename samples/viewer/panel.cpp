// The panel: one function per section, top to bottom.
#include "scene.h"

#include <glm/gtc/type_ptr.hpp>
#include <imgui.h>

#include <cmath>
#include <numbers>

namespace viewer {

constexpr size_t kMostGroups = NACRE_MAX_EDITS / kEditTargets;
constexpr ImGuiSliderFlags kClamp = ImGuiSliderFlags_AlwaysClamp; // also numbers that are typed (Ctrl-click)
constexpr ImGuiSliderFlags kLogClamp = kClamp | ImGuiSliderFlags_Logarithmic;

static void drawStatus(const Status& s, PanelState& panel)
{
    ImGui::TextWrapped("%s", s.asset.c_str());
    ImGui::Text("model %s, %.1f MiB on the GPU", s.info.model, double(s.info.gpuBytes) / 1048576);
    ImGui::Text("%u splats, %u of them drawn", s.info.splatCount, s.draw.splatsDrawn);
    ImGui::Text("frame %.1f ms, mean %.1f ms (of 60)", double(s.lastMs), double(s.meanMs));
    ImGui::Text("passes run: light %u, view %u, combine %u, sort %u", s.draw.lightPassesRun, s.draw.viewPassesRun,
                s.draw.combinePassesRun, s.draw.sorted);
    ImGui::Checkbox("time the passes", &panel.profiling);
    if (panel.profiling)
        ImGui::Text("relight %.1f, sort %.1f, raster %.1f ms", 1e3 * s.draw.relightSeconds, 1e3 * s.draw.sortSeconds, 1e3 * s.draw.rasterSeconds);
    if (!s.trouble.empty()) ImGui::TextColored({1, 0.4f, 0.3f, 1}, "%s", s.trouble.c_str());
}

static void drawView(Scene& scene, PanelState& panel)
{
    ImGui::TextDisabled("drag: turn; wheel: closer; R: camera home\nright drag: move the light; H: hide the panel");
    ImGui::SliderFloat("exposure", &scene.exposureStops, -6, 6, "%.1f stops", kClamp);
    ImGui::ColorEdit3("background", glm::value_ptr(scene.background));
    ImGui::SliderFloat("distance", &scene.camera.distance, 0.3f * scene.subject.radius, 30 * scene.subject.radius, "%.3g", kLogClamp);
    if (ImGui::Button("camera home (R)")) panel.reset = true;
}

/// Keeps the irradiance at the object when the kind of light changes.
static void changeType(Lamp& lamp, NacreLightType type)
{
    const float distance2 = lamp.distance * lamp.distance;
    if (type != lamp.type) lamp.intensity *= type == NACRE_LIGHT_POINT ? distance2 : 1 / distance2;
    lamp.type = type;
}

/// Keeps the light where it is when it begins or ceases to follow the camera.
static void changeHeadlight(Lamp& lamp, const Orbit& camera)
{
    const float sign = lamp.headlight ? -1.0f : 1.0f;
    lamp.azimuth = std::remainder(lamp.azimuth + sign * camera.azimuth, 360.0f);
    lamp.elevation = glm::clamp(lamp.elevation + sign * camera.elevation, -90.0f, 90.0f);
}

static void drawLamp(Lamp& lamp, const Scene& scene)
{
    constexpr float kBrightest = 100 * std::numbers::pi_v<float>;
    int type = lamp.type;
    ImGui::RadioButton("point", &type, NACRE_LIGHT_POINT);
    ImGui::SameLine();
    ImGui::RadioButton("directional", &type, NACRE_LIGHT_DIRECTIONAL);
    changeType(lamp, NacreLightType(type));
    ImGui::SameLine();
    if (ImGui::Checkbox("headlight", &lamp.headlight)) changeHeadlight(lamp, scene.camera);
    ImGui::SliderFloat("azimuth", &lamp.azimuth, -180, 180, "%.0f deg", kClamp);
    ImGui::SliderFloat("elevation", &lamp.elevation, -90, 90, "%.0f deg", kClamp);
    const bool point = lamp.type == NACRE_LIGHT_POINT;
    const float r = scene.subject.radius;
    if (point) ImGui::SliderFloat("distance", &lamp.distance, 0.2f * r, 50 * r, "%.3g", kLogClamp);
    ImGui::SliderFloat(point ? "intensity" : "irradiance", &lamp.intensity, 0, point ? kBrightest * 10 * r * r : kBrightest, "%.3g", kLogClamp);
    ImGui::ColorEdit3("colour (linear)", glm::value_ptr(lamp.color), ImGuiColorEditFlags_Float);
}

static void drawLamps(Scene& scene, PanelState& panel)
{
    std::vector<Lamp>& lamps = scene.lamps;
    if (ImGui::Button("add light")) {
        lamps.push_back(lamps.empty() ? defaultLamps(homeOrbit(scene.subject, 1))[0] : lamps[panel.lamp]);
        lamps.back().azimuth = std::remainder(lamps.back().azimuth + 60.0f, 360.0f);
        panel.lamp = lamps.size() - 1;
    }
    ImGui::SameLine();
    ImGui::BeginDisabled(lamps.empty());
    if (ImGui::Button("remove light")) lamps.erase(lamps.begin() + std::ptrdiff_t(panel.lamp));
    ImGui::EndDisabled();
    panel.lamp = std::min(panel.lamp, lamps.size() - size_t(!lamps.empty()));
    for (size_t i = 0; i < lamps.size(); ++i) {
        if (i % 8) ImGui::SameLine();
        if (ImGui::RadioButton(std::to_string(i + 1).c_str(), panel.lamp == i)) panel.lamp = i;
    }
    if (!lamps.empty()) drawLamp(lamps[panel.lamp], scene);
}

static void drawRegion(EditGroup& group, const Subject& subject)
{
    int region = group.region;
    ImGui::Combo("region", &region, "everywhere\0box\0sphere\0");
    if (group.region == NACRE_REGION_EVERYWHERE && region != group.region)
        group.center = subject.center, group.halfSize = glm::vec3(0.6f * subject.radius); // reaches the surface
    group.region = NacreEditRegion(region);
    if (region == NACRE_REGION_EVERYWHERE) return;
    const char* const axes[3] = {"centre x", "centre y", "centre z"};
    for (int k = 0; k < 3; ++k) ImGui::SliderFloat(axes[k], &group.center[k], subject.boundsMin[k], subject.boundsMax[k], "%.3g");
    const float most = 2 * subject.radius;
    if (region == NACRE_REGION_SPHERE) ImGui::SliderFloat("radius", &group.halfSize.x, 0, most, "%.3g", kClamp);
    else ImGui::SliderFloat3("half size", glm::value_ptr(group.halfSize), 0, most, "%.3g", kClamp);
}

static void drawRow(EditRow& row, const EditTargetInfo& info)
{
    ImGui::PushID(info.name);
    ImGui::Checkbox(info.label, &row.on);
    ImGui::SameLine(ImGui::GetFontSize() * 10);
    bool changed = false;
    const bool multiply = row.operation == NACRE_EDIT_MULTIPLY;
    if (ImGui::Button(multiply ? "times" : "set to", {ImGui::GetFontSize() * 4, 0})) {
        row.operation = multiply ? NACRE_EDIT_SET : NACRE_EDIT_MULTIPLY;
        if (row.operation == NACRE_EDIT_SET) row.amount = std::min(row.amount, info.most);
        changed = true;
    }
    ImGui::SameLine();
    ImGui::SetNextItemWidth(ImGui::GetFontSize() * 9);
    changed |= ImGui::SliderFloat("##amount", &row.amount, 0, multiply || info.most > 1 ? 4.0f : 1.0f, "%.2f", kClamp);
    if (info.hasColor) {
        ImGui::SameLine();
        changed |= ImGui::ColorEdit3("##color", glm::value_ptr(row.color), ImGuiColorEditFlags_NoInputs | ImGuiColorEditFlags_Float);
    }
    row.on |= changed;
    ImGui::PopID();
}

static void drawEdits(Scene& scene, const Status& status)
{
    std::vector<EditGroup>& groups = scene.edits;
    if (!status.noEdits.empty()) ImGui::TextWrapped("%s", status.noEdits.c_str());
    ImGui::BeginDisabled(!status.noEdits.empty());
    size_t remove = groups.size();
    for (size_t i = 0; i < groups.size(); ++i) {
        ImGui::PushID(int(i));
        drawRegion(groups[i], scene.subject);
        for (int target = 0; target < kEditTargets; ++target) drawRow(groups[i].rows[target], kEditTargetInfos[target]);
        if (groups.size() > 1 && ImGui::Button("remove region")) remove = i;
        ImGui::Separator();
        ImGui::PopID();
    }
    if (remove < groups.size()) groups.erase(groups.begin() + std::ptrdiff_t(remove));
    if (ImGui::Button("reset edits")) groups.assign(1, {});
    ImGui::SameLine();
    if (groups.size() < kMostGroups && ImGui::Button("add region"))
        groups.push_back({groups.back().region, groups.back().center, groups.back().halfSize, {}}); // beside the last, changing nothing yet
    ImGui::EndDisabled();
}

static void drawCommand(const Scene& scene)
{
    std::string options;
    for (const Lamp& lamp : scene.lamps) options += "--light " + lightText(inDataset(scene.subject, toNacre(lamp, scene.camera, scene.subject))) + " ";
    for (const NacreEdit& edit : toNacre(scene.edits)) options += "--edit " + editText(inDataset(scene.subject, edit)) + " ";
    if (ImGui::Button("copy")) ImGui::SetClipboardText(options.c_str());
    ImGui::SameLine();
    ImGui::TextDisabled("lights and edits for `nacre render`:");
    ImGui::TextWrapped("%s", options.c_str());
}

/// A curve in the picture, from points in asset space; parts behind the camera are left out.
template <class Point>
static void drawCurve(const glm::mat4& clipFromWorld, glm::vec2 origin, glm::vec2 size, int segments, Point point)
{
    ImVec2 last;
    bool haveLast = false;
    for (int i = 0; i <= segments; ++i) {
        const glm::vec4 clip = clipFromWorld * glm::vec4(point(float(i) / float(segments)), 1);
        const bool inFront = clip.w > 1e-6f;
        const glm::vec2 at = origin + size * (0.5f + glm::vec2(0.5f, -0.5f) * glm::vec2(clip) / (inFront ? clip.w : 1));
        if (inFront && haveLast) ImGui::GetBackgroundDrawList()->AddLine(last, {at.x, at.y}, IM_COL32(255, 200, 60, 160), 1.5f);
        last = {at.x, at.y}, haveLast = inFront;
    }
}

static void outlineRegions(const Scene& scene, float left)
{
    const ImVec2 window = ImGui::GetIO().DisplaySize;
    const glm::vec2 origin(left, 0), size(window.x - left, window.y);
    if (!(size.x >= 1 && size.y >= 1)) return;
    const NacreDrawDesc desc = drawDesc(scene.subject, scene.camera, int(size.x), int(size.y));
    const glm::mat4 clipFromWorld = glm::make_mat4(desc.clipFromView) * glm::make_mat4(desc.viewFromWorld);
    for (const EditGroup& group : scene.edits)
        for (int axis = 0; axis < 3 && group.region != NACRE_REGION_EVERYWHERE; ++axis) {
            const int next = (axis + 1) % 3, third = (axis + 2) % 3;
            if (group.region == NACRE_REGION_SPHERE) // a great circle about each axis
                drawCurve(clipFromWorld, origin, size, 64, [&](float t) {
                    const float angle = 2 * std::numbers::pi_v<float> * t;
                    glm::vec3 p = group.center;
                    p[next] += group.halfSize.x * std::cos(angle), p[third] += group.halfSize.x * std::sin(angle);
                    return p;
                });
            else // the four edges along each axis
                for (int corner = 0; corner < 4; ++corner)
                    drawCurve(clipFromWorld, origin, size, 16, [&](float t) {
                        glm::vec3 sign(0);
                        sign[axis] = 2 * t - 1, sign[next] = corner & 1 ? 1.0f : -1.0f, sign[third] = corner & 2 ? 1.0f : -1.0f;
                        return group.center + sign * group.halfSize;
                    });
        }
}

void drawPanel(Scene& scene, const Status& status, PanelState& panel, float width)
{
    outlineRegions(scene, width);
    ImGui::SetNextWindowPos({0, 0});
    ImGui::SetNextWindowSize({width, ImGui::GetIO().DisplaySize.y});
    ImGui::Begin("viewer", nullptr, ImGuiWindowFlags_NoTitleBar | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove);
    ImGui::PushItemWidth(ImGui::GetFontSize() * 15);
    drawStatus(status, panel);
    const auto section = [](const char* name) { return ImGui::CollapsingHeader(name, ImGuiTreeNodeFlags_DefaultOpen); };
    ImGui::PushID("view"); // sections use the same words
    if (section("View")) drawView(scene, panel);
    ImGui::PopID(), ImGui::PushID("lights");
    if (section("Lights")) drawLamps(scene, panel);
    ImGui::PopID(), ImGui::PushID("materials");
    if (section("Materials")) drawEdits(scene, status);
    ImGui::PopID(), ImGui::PushID("command");
    if (section("Command line")) drawCommand(scene);
    ImGui::PopID();
    ImGui::PopItemWidth();
    ImGui::End();
}

} // namespace viewer
