#include "train/memory.h"

#include "appearance/trainable.h"
#include "base/text.h"
#include "train/preparation.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <unistd.h>

namespace nacre {

namespace {

constexpr size_t kPreparedBytesPerPixel = 14;          // PreparedImage
constexpr size_t kBytesPerSplat = 12000;               // sss: parameters, gradients, moments, activations and maps
constexpr size_t kBytesPerDescription = 2000;          // of an image: the dataset in files, in its frame and under its gain, and its JSON while it is read
constexpr size_t kElse = size_t(320) << 20;            // program, libraries, checks, masks of the hull
constexpr size_t kLeastImages = 4 * kMaxLightsPerStep; // ready at once: a step, the next, and what is read for them

} // namespace

size_t machineMemory()
{
    const long pages = sysconf(_SC_PHYS_PAGES), pageBytes = sysconf(_SC_PAGESIZE);
    size_t bytes = pages > 0 && pageBytes > 0 ? size_t(pages) * size_t(pageBytes) : std::numeric_limits<size_t>::max();
    std::ifstream container("/sys/fs/cgroup/memory.max"); // a number, or "max"
    if (size_t limit = 0; container >> limit && limit > 0) bytes = std::min(bytes, limit);
    return bytes;
}

size_t preparedBytes(const OlatSplit& split)
{
    size_t bytes = 0;
    for (const OlatImage& image : split.images)
        bytes += kPreparedBytesPerPixel * size_t(split.cameras[image.camera].width) * size_t(split.cameras[image.camera].height);
    return bytes;
}

Result<size_t> imageBudget(size_t memoryBytes, const OlatDataset& dataset, const BakeOptions& options)
{
    size_t step = 0, image = 0, images = 0;
    for (const OlatSplit& split : dataset.splits) {
        images += split.images.size();
        for (const Camera& c : split.cameras)
            step = std::max(step, stepBytes(c)), image = std::max(image, kPreparedBytesPerPixel * size_t(c.width) * size_t(c.height));
    }
    const size_t other = kElse + step + kBytesPerSplat * size_t(bakeSplats(options)) + kBytesPerDescription * images;
    const size_t needed = other + kLeastImages * image;
    if (memoryBytes < needed) {
        return Error{ErrorCode::kBadInput, "a memory of " + numberText(double(memoryBytes) / 1e9) + " GB is too little for images of this size and number, which need " +
                                               numberText(std::ceil(double(needed) / 1e7) / 100) +
                                               " GB (--memory, --max-splats, or smaller images)"};
    }
    const double share = options.track == BakeOptions::Track::kNever ? 1.0 : 0.8; // measureHeldOut has a quarter as much
    return size_t(share * double(memoryBytes - other));
}

} // namespace nacre
