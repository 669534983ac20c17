#include "appearance/shown_part.h"

#include "appearance/sss/sss_asset.h"

namespace nacre {

std::vector<PartInfo> partsOf(const SplatAsset& asset)
{
    std::vector<PartInfo> parts;
    const auto add = [&](bool has, ShownPart part, const char* name, PartRange range, bool radiance = false) {
        if (has) parts.push_back({part, name, range, radiance});
    };
    const auto has = [&](const char* channel) { return asset.find(channel) != nullptr; };
    using enum PartRange;
    parts.emplace_back(); // the image
    if (asset.model == "bigs") {
        add(true, ShownPart::kDirect, "direct", kColor, true);
        add(true, ShownPart::kIndirect, "indirect", kColor, true);
        add(has("lobe"), ShownPart::kLobe, "lobe", kColor, true);
        add(has("forward"), ShownPart::kForward, "forward", kColor, true);
        add(true, ShownPart::kTDir, "T_dir", kLargest);
        add(true, ShownPart::kTInd, "T_ind", kLargest);
        add(true, ShownPart::kRho, "rho", kColor);
        add(has("s"), ShownPart::kS, "s", kSigned);
        add(has("visibility"), ShownPart::kVisibility, "visibility", kUnit);
    } else if (asset.model == "sss") {
        const bool scatters = SssChannels(asset).scatters();
        add(true, ShownPart::kSpecular, "specular", kColor, true);
        add(true, ShownPart::kDiffuse, "diffuse", kColor, true);
        add(scatters, ShownPart::kScattered, "scattered", kColor, true);
        add(true, ShownPart::kBaseColor, "basecolor", kColor);
        add(true, ShownPart::kRoughness, "roughness", kUnit);
        add(true, ShownPart::kMetalness, "metalness", kUnit);
        add(scatters, ShownPart::kSubsurfaceness, "subsurfaceness", kUnit);
        add(scatters, ShownPart::kResidual, "residual", kLargest);
        add(has("network") || has("visibility"), ShownPart::kIncident, "incident", kLargest);
    }
    add(true, ShownPart::kNormal, "normal", kDirection);
    add(true, ShownPart::kDepth, "depth", kDistance);
    add(true, ShownPart::kOverdraw, "overdraw", kLargest);
    return parts;
}

Result<PartInfo> findPart(const SplatAsset& asset, const std::string& name)
{
    std::string known;
    for (const PartInfo& part : partsOf(asset)) {
        if (name == part.name) return part;
        known += (known.empty() ? "" : ", ") + std::string(part.name);
    }
    return Error{ErrorCode::kBadInput, "this asset (model '" + asset.model + "') has no channel '" + name + "' to show; it has " + known};
}

} // namespace nacre
