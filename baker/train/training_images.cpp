#include "train/training_images.h"

#include "train/packed_reference.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <new>

namespace nacre {

constexpr int kMostThreads = 16; // in the background; more than a disk can feed

// The prepared images are what is read again and again; of the files only the one being read needs room.
TrainingImages::TrainingImages(const OlatDataset& dataset, const OlatSplit& split, size_t budgetBytes)
    : dataset_(dataset), split_(split), files_(dataset, 1), budget_(budgetBytes)
{
}

TrainingImages::~TrainingImages()
{
    {
        const std::lock_guard lock(mutex_);
        ends_ = true;
    }
    changed_.notify_all();
    for (std::thread& t : threads_) t.join();
}

TrainingImages::Loaded TrainingImages::load(uint32_t imageIndex)
{
    Loaded image = loadWhole(imageIndex);
    if (!image || !masks_) return image;
    return Loaded(std::make_shared<const PreparedImage>(masks_->applied(**image, split_.images[imageIndex].camera)));
}

void TrainingImages::useMasks(const LearntMasks& masks)
{
    std::unique_lock lock(mutex_);
    expected_.clear();
    changed_.wait(lock, [&] { return loading_.empty(); });
    masks_ = &masks;
    entries_.clear(), recent_.clear(), ahead_.clear(), failed_.clear();
    resident_ = aheadBytes_ = 0;
}

TrainingImages::Loaded TrainingImages::loadWhole(uint32_t imageIndex)
{
    try {
        if (dataset_.packed && dataset_.shrink == 1) {
            const size_t block = split_.images[imageIndex].packedBlock;
            const auto bytes = dataset_.packed->read(block);
            if (!bytes) return bytes.error();
            return Loaded(std::make_shared<const PreparedImage>(preparePacked(dataset_.packed->blocks[block], *bytes)));
        }
        const auto file = files_.load(split_, imageIndex);
        if (!file) return file.error();
        return Loaded(std::make_shared<const PreparedImage>(prepareImage(**file)));
    } catch (const std::bad_alloc&) { // also in threads, where nobody else would catch it
        return Error{ErrorCode::kIo, split_.images[imageIndex].path + ": no memory is left for it"};
    }
}

// Evicts what was used longest ago. What is ahead is the most recent there is, and at most half of the budget, so it stays until it is got.
void TrainingImages::keep(uint32_t imageIndex, std::shared_ptr<const PreparedImage> image)
{
    const size_t bytes = image->bytes();
    resident_ += bytes;
    while (resident_ > budget_ && !recent_.empty()) {
        const auto oldest = entries_.find(recent_.back());
        noLongerAhead(oldest->first);
        resident_ -= oldest->second.image->bytes();
        entries_.erase(oldest);
        recent_.pop_back();
    }
    recent_.push_front(imageIndex);
    entries_[imageIndex] = {std::move(image), recent_.begin()};
}

void TrainingImages::noLongerAhead(uint32_t imageIndex)
{
    if (ahead_.erase(imageIndex)) aheadBytes_ -= entries_.at(imageIndex).image->bytes();
}

TrainingImages::Loaded TrainingImages::get(uint32_t imageIndex)
{
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !loading_.count(imageIndex); });
    if (const auto found = entries_.find(imageIndex); found != entries_.end()) {
        recent_.splice(recent_.begin(), recent_, found->second.use);
        noLongerAhead(imageIndex);
        changed_.notify_all(); // there is room for more
        return found->second.image;
    }
    if (const auto failed = failed_.find(imageIndex); failed != failed_.end()) {
        const Error error = std::move(failed->second);
        failed_.erase(failed);
        return error;
    }
    loading_.insert(imageIndex); // so that nobody else begins it
    lock.unlock();
    Loaded loaded = load(imageIndex);
    lock.lock();
    loading_.erase(imageIndex);
    if (loaded) keep(imageIndex, *loaded);
    changed_.notify_all();
    return loaded;
}

void TrainingImages::expect(std::span<const uint32_t> images)
{
    const std::lock_guard lock(mutex_);
    expected_.clear();
    const std::unordered_set<uint32_t> before = ahead_;
    for (const uint32_t i : before)
        if (std::find(images.begin(), images.end(), i) == images.end()) noLongerAhead(i);
    for (const uint32_t i : images) {
        const auto found = entries_.find(i);
        if (found == entries_.end()) expected_.push_back(i);
        else recent_.splice(recent_.begin(), recent_, found->second.use); // not to be evicted for those that are loaded
    }
    if (expected_.empty()) return;
    if (threads_.empty())
        for (int t = 0; t < std::clamp(tbb::this_task_arena::max_concurrency(), 1, kMostThreads); ++t) threads_.emplace_back([this] { loadAhead(); });
    changed_.notify_all();
}

void TrainingImages::loadAhead()
{
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [&] { return ends_ || (!expected_.empty() && aheadBytes_ < budget_ / 2); });
        if (ends_) return;
        const uint32_t next = expected_.front();
        expected_.pop_front();
        if (entries_.count(next) || loading_.count(next) || failed_.count(next)) continue;
        loading_.insert(next);
        lock.unlock();
        Loaded loaded = load(next);
        lock.lock();
        loading_.erase(next);
        if (loaded) {
            aheadBytes_ += (*loaded)->bytes();
            keep(next, std::move(*loaded));
            ahead_.insert(next);
        } else {
            failed_.emplace(next, loaded.error());
        }
        changed_.notify_all();
    }
}

size_t TrainingImages::residentBytes() const
{
    const std::lock_guard lock(mutex_);
    return resident_;
}

} // namespace nacre
