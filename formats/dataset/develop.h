// From the pixels of a file to those of the dataset's camera: what photographs need and renders do not.
#pragma once

#include "base/image.h"
#include "base/result.h"
#include "dataset/olat_dataset.h"

namespace nacre {

/// Where the file shows what `camera` sees at (x, y), pixels of both from their top-left corners. NaN where the lens bends light back, beyond the
/// range of its polynomial.
glm::dvec2 positionInFile(const FileCamera& file, const Camera& camera, double x, double y);

/// The image that the pinhole `camera` would have taken. A part of the file at whole pixels is copied exactly; else cubic interpolation of
/// premultiplied linear values (Catmull-Rom). What the file does not show is unknown. `image` has the file's size.
Image resampled(const Image& image, const FileCamera& file, const Camera& camera);

/// image -= ambient, in linear light.
void subtractAmbient(Image& image, const Image& ambient);

/// Multiplies colours and alpha by the coverage that `mask` shows: its alpha, or else its brightness (0 to 1, or 0 to 1/255: masks of zeros and ones).
void applyMask(Image& image, const Image& mask);

} // namespace nacre
