#include "train/training_images.h"

namespace nacre {

// The prepared images are what is read again and again; of the files only the one being read needs room.
TrainingImages::TrainingImages(const OlatDataset& dataset, const OlatSplit& split, size_t budgetBytes)
    : files_(dataset, 1), split_(split), budget_(budgetBytes)
{
}

Result<std::shared_ptr<const PreparedImage>> TrainingImages::get(uint32_t imageIndex)
{
    if (auto found = entries_.find(imageIndex); found != entries_.end()) {
        recent_.splice(recent_.begin(), recent_, found->second.use);
        return found->second.image;
    }
    auto file = files_.load(split_, imageIndex);
    if (!file) return file.error();
    auto prepared = std::make_shared<const PreparedImage>(prepareImage(**file));
    resident_ += prepared->bytes();
    while (resident_ > budget_ && !recent_.empty()) {
        auto oldest = entries_.find(recent_.back());
        resident_ -= oldest->second.image->bytes();
        entries_.erase(oldest);
        recent_.pop_back();
    }
    recent_.push_front(imageIndex);
    entries_[imageIndex] = {prepared, recent_.begin()};
    return std::shared_ptr<const PreparedImage>(prepared);
}

} // namespace nacre
