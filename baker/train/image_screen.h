// Which images of a split can be used: one file that was cut off on its way must not end a bake of an hour, nor change its figures without
// a word.
#pragma once

#include "base/result.h"
#include "dataset/olat_dataset.h"

#include <atomic>
#include <functional>
#include <string>
#include <vector>

namespace nacre {

/// An image that is left out.
struct UnusableImage {
    std::string path, why; // why names the path, too
};

/// Tells frames that say nothing: black, although the light stands where the camera would see what it lights; without the object; to train, white.
class ImageFaults {
public:
    explicit ImageFaults(const OlatSplit& split);
    /// What is wrong with the image; empty if nothing is.
    std::string of(const OlatImage& entry, const Image& image) const;

private:
    const OlatSplit& split_;
    glm::dvec3 centre_{0}; // of what the cameras look at
};

/// Error kBadInput if more than a third of `count` images are unusable: then the description is wrong, not a file.
Status fewUnusable(const std::vector<UnusableImage>& unusable, size_t count, const std::string& split);

/// What a bake would stumble over, found before it starts: decodes every image of the split that has a point or directional light, on all
/// threads. The list is in the order of the split. `progress(done, all)` is called at least every second from the calling thread.
Result<std::vector<UnusableImage>> unusableImages(const OlatDataset& dataset, const OlatSplit& split,
                                                  const std::function<void(size_t, size_t)>& progress, const std::atomic<bool>* cancel);

/// The dataset without those images of the split.
OlatDataset without(OlatDataset dataset, const std::string& split, const std::vector<UnusableImage>& unusable);

} // namespace nacre
