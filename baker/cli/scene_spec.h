// The texts by which `nacre render` takes lights and cameras, e.g. "point:1,2,3:40" or "30,20,3.2". All in the asset's own axes,
// those of the dataset it was baked from.
#pragma once

#include "appearance/sss/sss_edit.h"
#include "base/camera.h"
#include "base/light.h"
#include "base/result.h"
#include "splats/splat_asset.h"

#include <string>

namespace nacre::cli {

/// point:X,Y,Z:I  directional:X,Y,Z:E  environment:FILE.exr, with I and E a number or r,g,b. The direction points to the light.
Result<Light> parseLight(const std::string& text);

/// TARGET=VALUE or TARGET=xFACTOR, then perhaps @sphere:X,Y,Z,R or @box:X,Y,Z,X,Y,Z. Targets: basecolor, roughness, metalness, subsurface,
/// residual (or tint), opacity; values a number or r,g,b.
Result<SplatEdit> parseEdit(const std::string& text);

/// "640x480", each 1 to 8192.
struct PixelSize { int width = 0, height = 0; };
Result<PixelSize> parseSize(const std::string& text);

/// DATASET:SPLIT:INDEX. The dataset's path may contain colons.
struct ImageReference { std::string dataset, split; size_t index = 0; };
Result<ImageReference> parseImageReference(const std::string& text);

/// AZ,EL,DIST: degrees, degrees, units of the dataset. Azimuth 0 is the front (+Z of the glTF scene), growing counter-clockwise seen from
/// above; DIST may be left out (0): then the camera keeps the whole object in view.
struct Orbit { double azimuth = 30, elevation = 20, distance = 0; };
Result<Orbit> parseOrbit(const std::string& text);

/// Where the object is in the dataset: the median of the splat centres, and the distance from there that 98 % of them do not exceed.
struct Subject { glm::dvec3 center{0}; double radius = 1; glm::dvec3 up{0, 1, 0}; };
Subject findSubject(const SplatAsset& asset);

/// A camera on the orbit that looks at the subject's centre.
Camera orbitCamera(const Orbit& orbit, const Subject& subject, const glm::quat& yUpFromAsset, double fovYDegrees, PixelSize size);

/// The same view in an image of another size: scaled until it fits, centred.
Camera resized(const Camera& camera, PixelSize size);

/// Turns about the subject's up axis.
glm::dmat4 spinMatrix(const Subject& subject, double radians);
Camera spun(Camera camera, const glm::dmat4& spin);
Light spun(Light light, const glm::dmat4& spin);

} // namespace nacre::cli
