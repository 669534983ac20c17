// How a camera turns light into a file: lens, sensor, noise, eight bits. Pure functions of their arguments.
#pragma once

#include "base/camera.h"
#include "base/image.h"
#include "dataset/olat_dataset.h"

#include <cstdint>
#include <vector>

namespace nacre {

/// Where, on the plane z = -1 of the camera (x right, y up), the file's position (x, y) looks: the inverse of positionInFile. NaN where the
/// polynomial of the lens does not reach.
glm::dvec2 lookedAt(const FileCamera& file, double x, double y);

/// A lens as they are: a barrel that `strength` scales (1: 3 % at the corners of a picture 40 degrees wide), a little decentred, its axis off the middle.
FileCamera plausibleLens(const Camera& camera, double strength);

struct SensorNoise {
    double electrons = 0;     // of a pixel at value 1: shot noise; 0: none
    double readElectrons = 0; // rms
};

/// Adds noise to linear values, 1 being where the sensor saturates; nothing is clipped, so that the mean is the signal. A pixel's noise is a
/// function of the seed and its place. Alpha stays.
void addNoise(Image& image, const SensorNoise& noise, uint64_t seed);

/// sRGB bytes, RGB, clipped to [0, 1].
std::vector<uint8_t> displayRgb(const Image& image);

/// What segmentation makes of the coverage (alpha) of the object: an edge `spill` pixels too far out, as soft as that, and round holes.
/// One byte a pixel.
std::vector<uint8_t> imperfectMatte(const Image& image, double spill, int holes, uint64_t seed);

} // namespace nacre
