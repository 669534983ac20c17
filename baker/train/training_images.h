// Training images made ready for the loss, loaded on demand and kept within a memory budget.
#pragma once

#include "dataset/olat_dataset.h"
#include "train/loss.h"

#include <list>
#include <memory>
#include <unordered_map>

namespace nacre {

class TrainingImages {
public:
    /// Both must outlive this object.
    TrainingImages(const OlatDataset& dataset, const OlatSplit& split, size_t budgetBytes);
    Result<std::shared_ptr<const PreparedImage>> get(uint32_t imageIndex);

private:
    struct Entry { std::shared_ptr<const PreparedImage> image; std::list<uint32_t>::iterator use; };
    ImageCache files_;
    const OlatSplit& split_;
    size_t budget_, resident_ = 0;
    std::list<uint32_t> recent_; // front = last used
    std::unordered_map<uint32_t, Entry> entries_;
};

} // namespace nacre
