// Initial splats from silhouettes: carve a voxel grid with the alphas of all training cameras and sample the surface that is left.
#pragma once

#include "base/camera.h"

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

struct OrientedPoint {
    float position[3];
    float normal[3]; // unit, outwards
};

struct VisualHull {
    float center[3] = {0, 0, 0};
    float halfSize = 0;               // of the carved cube
    int resolution = 0;               // voxels per side
    std::vector<uint8_t> inside;      // [z][y][x]
    double surfaceArea = 0;           // estimate
    std::vector<OrientedPoint> surface; // one per boundary voxel
};

/// The cube that every camera frames: centre nearest to all optical axes, half-size what the widest camera sees there.
void frameCube(std::span<const Camera> cameras, float center[3], float* halfSize);

/// What a camera sees in a pixel.
enum MaskValue : uint8_t { kMaskBackground, kMaskObject, kMaskUnknown };

/// masks[i]: width*height of MaskValue, of cameras[i]. A voxel survives if no camera that frames it sees it outside; but of masks that contradict the
/// others altogether (`wrong`, if given, gets their indices) nothing is believed, and where masks have holes, one in twenty is outvoted.
VisualHull carveVisualHull(std::span<const Camera> cameras, std::span<const std::vector<uint8_t>> masks, int resolution, std::vector<size_t>* wrong = nullptr);

/// True if the hull reaches the border of the cube: the cameras do not enclose the object.
bool touchesBorder(const VisualHull& hull);

/// `count` points, evenly and with jitter over the surface; random in the cube if the hull is empty. In Morton order.
std::vector<OrientedPoint> sampleHull(const VisualHull& hull, size_t count, uint64_t seed);

} // namespace nacre
