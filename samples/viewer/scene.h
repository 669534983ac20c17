// What the viewer shows: camera, lights and material edits as the plain numbers that sliders change, and what those mean to the runtime.
// World space is asset space (the instance stands where the asset does), so that coordinates are those of `nacre render`. Angles are degrees about the
// asset's up axis: azimuth 0 is the front, growing counter-clockwise seen from above.
#pragma once

#include <nacre/nacre.h>

#include <glm/glm.hpp>

#include <string>
#include <vector>

namespace viewer {

struct Subject { // where the object is, in asset space
    glm::vec3 boundsMin{0}, boundsMax{0}, center{0};
    float radius = 1;
    glm::mat3 assetFromYUp{1};
    double datasetScale = 1, datasetLightGain = 1; // NacreAssetInfo: to what `nacre render` takes
    glm::dvec3 datasetTranslation{0};
};
Subject findSubject(const NacreAssetInfo& info);

struct Orbit { float azimuth = 30, elevation = 20, distance = 1; };
constexpr float kFovYDegrees = 40;
/// All of the object in view, in a picture of any shape.
Orbit homeOrbit(const Subject& subject, float aspect);
glm::vec3 directionAt(const Subject& subject, float azimuth, float elevation);
NacreDrawDesc drawDesc(const Subject& subject, const Orbit& camera, int width, int height);

struct Lamp {
    NacreLightType type = NACRE_LIGHT_POINT;
    bool headlight = false; // its angles count from the camera's
    float azimuth = 0, elevation = 0;
    float distance = 1;  // point: from the object's centre
    glm::vec3 color{1};  // linear
    float intensity = 1; // point: radiant intensity; directional: irradiance
};
/// A point light from the upper left and a weak headlight from the right. Irradiance pi would show a white diffuse surface as radiance 1.
std::vector<Lamp> defaultLamps(const Orbit& camera);
NacreLight toNacre(const Lamp& lamp, const Orbit& camera, const Subject& subject);

constexpr int kEditTargets = NACRE_EDIT_OPACITY + 1;
struct EditRow {
    bool on = false;
    NacreEditOperation operation = NACRE_EDIT_MULTIPLY;
    glm::vec3 color{1}; // only of targets that have one; the value is color * amount
    float amount = 1;
};
struct EditGroup { // the edits of one region
    NacreEditRegion region = NACRE_REGION_EVERYWHERE;
    glm::vec3 center{0}, halfSize{1}; // asset space; sphere: halfSize.x is the radius
    EditRow rows[kEditTargets];
};
struct EditTargetInfo {
    const char *name, *label; // as --edit spells it; as people do
    bool hasColor;
    float most; // of a value that is set
};
extern const EditTargetInfo kEditTargetInfos[kEditTargets];

/// TARGET=VALUE or TARGET=xFACTOR[@sphere:X,Y,Z,R|@box:X,Y,Z,X,Y,Z], as `nacre render --edit` takes it. False: not such a text.
bool parseEdit(const std::string& text, NacreEdit* edit);
/// Puts an edit behind those that are there: they apply in order.
void addEdit(const NacreEdit& edit, std::vector<EditGroup>* groups);
std::vector<NacreEdit> toNacre(const std::vector<EditGroup>& groups);
std::string editText(const NacreEdit& edit);   // the inverse of parseEdit
std::string lightText(const NacreLight& light); // as `nacre render --light` takes it
/// `nacre render` takes lights and edits in the units of the dataset that the asset was baked from.
NacreLight inDataset(const Subject& subject, NacreLight light);
NacreEdit inDataset(const Subject& subject, NacreEdit edit);
NacreEdit inAsset(const Subject& subject, NacreEdit edit);

struct Scene {
    Subject subject;
    Orbit camera;
    std::vector<Lamp> lamps;
    std::vector<EditGroup> edits{1};
    float exposureStops = 0;
    glm::vec3 background{0.16f, 0.17f, 0.19f}; // sRGB: what the screen shows
};

/// What the panel shows and cannot change.
struct Status {
    std::string asset;
    NacreAssetInfo info{};
    NacreDrawStats draw{};
    float lastMs = 0, meanMs = 0;
    std::string noEdits;  // why the asset takes no edits; empty: it does
    std::string trouble;  // what the runtime refused in this frame
};

struct PanelState {
    size_t lamp = 0;        // the one that the right mouse button moves
    bool profiling = false; // true times of the passes
    bool reset = false;     // the camera goes home
};
/// Draws the panel, `width` pixels at the left edge, and outlines the regions of edits in the rest of the window.
void drawPanel(Scene& scene, const Status& status, PanelState& panel, float width);

} // namespace viewer
