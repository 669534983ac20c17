// COLMAP's sparse models: cameras and images, as text or binary. Points are passed over.
#pragma once

#include "base/result.h"
#include "dataset/loader.h"

#include <cstddef>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace nacre {

/// A camera as COLMAP states it: pixels from the top-left corner, so the middle of the first pixel is (0.5, 0.5), as for Camera.
struct ColmapCamera {
    int width = 0, height = 0;
    const CameraModel* model = nullptr; // null: one that is no pinhole with OpenCV's lens, of the name
    std::string modelName;
    std::vector<double> parameters;
};

struct ColmapImage {
    std::string name;
    uint32_t camera = 0;
    glm::dmat4 worldFromCamera{1.0}; // OpenGL camera axes
};

struct ColmapModel {
    std::map<uint32_t, ColmapCamera> cameras;
    std::vector<ColmapImage> images;
};

/// Any bytes are safe. Errors kBadInput: a file that is cut off or broken, an image without its camera, a rotation that is none. `cameras` and
/// `images` in names stand for the files in messages.
Result<ColmapModel> readColmapText(std::span<const std::byte> cameras, std::span<const std::byte> images, const std::string& camerasName, const std::string& imagesName);
Result<ColmapModel> readColmapBinary(std::span<const std::byte> cameras, std::span<const std::byte> images, const std::string& camerasName, const std::string& imagesName);

} // namespace nacre
