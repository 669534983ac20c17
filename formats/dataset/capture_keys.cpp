// What a description says of photographs: masks, ambient light, exposure, levels, background and what the lights are fixed to.
#include "dataset/loader.h"

#include <cmath>

namespace nacre {
namespace {

JsonNode ofFrame(const JsonNode& frame, const JsonNode& top, const char* key) { return frame[key].exists() ? frame[key] : top[key]; }

/// A file value from 0 to 1.
void readLevel(const JsonNode& node, float& out, bool& isSet)
{
    if (!node.exists()) return;
    const double x = node.number();
    if (!(x >= 0 && x <= 1)) node.fail("a file value from 0 to 1", std::to_string(x) + "; divide by the largest value of the file, 255 or 65535");
    if (isSet && float(x) != out) node.fail("the same level in every split", "another one");
    out = float(x), isSet = true;
}

} // namespace

void readPhotograph(const DatasetSource& source, const std::string& folder, const JsonNode& frame, const JsonNode& top, OlatImage& image)
{
    for (const char* key : {"black_level", "white_level", "background", "light_rig"})
        if (frame[key].exists()) frame[key].fail("this key at the top level, for all frames", "it in a frame, where it says nothing");
    for (const char* key : {"mask_path", "obj_mask_path"})
        if (const JsonNode mask = frame[key]; mask.exists()) image.maskPath = findImage(source, folder, mask.string(), mask, ".png");
    if (const JsonNode ambient = frame["ambient_path"]; ambient.exists()) image.ambientPath = findImage(source, folder, ambient.string(), ambient);
    constexpr double kMostStops = 64;
    if (const JsonNode ev = ofFrame(frame, top, "exposure_ev"); ev.exists()) {
        const double stops = ev.number();
        if (!(std::fabs(stops) <= kMostStops)) ev.fail("an exposure in stops, -64 to 64", std::to_string(stops));
        else image.gain *= float(std::exp2(-stops));
    }
    if (const JsonNode gain = ofFrame(frame, top, "gain"); gain.exists()) {
        const glm::vec3 g = readIntensity(gain);
        if (!(g.r > 1e-9f && g.g > 1e-9f && g.b > 1e-9f)) gain.fail("a gain above 0", "one that makes every pixel black");
        else image.gain /= g;
    }
}

void readCapture(const DatasetSource& source, OlatDataset& out)
{
    bool hasBlack = false, hasWhite = false, hasRig = false;
    for (const Description* description : source.topLevels()) {
        const JsonNode top = description->json.root(), background = top["background"], rig = top["light_rig"];
        for (const char* key : {"mask_path", "obj_mask_path", "ambient_path"})
            if (top[key].exists()) top[key].fail("this key in each frame", "it at the top level, where it says nothing");
        readLevel(top["black_level"], out.blackLevel, hasBlack);
        readLevel(top["white_level"], out.whiteLevel, hasWhite);
        if (hasBlack && !(out.blackLevel < 0.9f)) top["black_level"].fail("a level below 0.9", std::to_string(out.blackLevel));
        if (hasWhite && !(out.whiteLevel > out.blackLevel)) top["white_level"].fail("a level above black_level", std::to_string(out.whiteLevel));
        if (background.exists()) {
            const std::string name = background.string();
            if (name != "black" && name != "in_view")
                background.fail("\"black\" or \"in_view\"", inQuotes(name) + "; composite the images over black, keep straight alpha and say \"alpha\": "
                                                                              "\"straight\", or say \"in_view\" if they show the surroundings");
            if (description->split == "train") out.backgroundInView = name == "in_view";
        }
        if (rig.exists()) {
            const std::string name = rig.string();
            if (name != "fixed" && name != "camera" && name != "stage") rig.fail("\"fixed\", \"camera\" or \"stage\"", inQuotes(name));
            const LightRig here = name == "camera" ? LightRig::kCamera : name == "stage" ? LightRig::kStage : LightRig::kFixed;
            if (description->split == "train" || !hasRig) out.rig = here;
            hasRig = true;
        }
    }
}

} // namespace nacre
