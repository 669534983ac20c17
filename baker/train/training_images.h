// Training images made ready for the loss, loaded on demand or ahead of it, and kept within a memory budget.
#pragma once

#include "dataset/olat_dataset.h"
#include "train/learnt_masks.h"
#include "train/loss.h"

#include <condition_variable>
#include <deque>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <thread>
#include <unordered_map>
#include <unordered_set>

namespace nacre {

/// What is got does not depend on what was expected, nor on the speed of any thread.
class TrainingImages {
public:
    /// Both must outlive this object.
    TrainingImages(const OlatDataset& dataset, const OlatSplit& split, size_t budgetBytes);
    ~TrainingImages();
    /// From one thread at a time.
    Result<std::shared_ptr<const PreparedImage>> get(uint32_t imageIndex);
    /// These will be got next, in this order: threads in the background load them, as far as half of the budget holds them. What was expected
    /// before and not begun is not loaded any more.
    void expect(std::span<const uint32_t> images);
    /// Masks for what is got from here on; must outlive this object.
    void useMasks(const LearntMasks& masks);
    size_t residentBytes() const;

private:
    struct Entry {
        std::shared_ptr<const PreparedImage> image;
        std::list<uint32_t>::iterator use;
    };
    using Loaded = Result<std::shared_ptr<const PreparedImage>>;

    Loaded load(uint32_t imageIndex);
    Loaded loadWhole(uint32_t imageIndex);
    void keep(uint32_t imageIndex, std::shared_ptr<const PreparedImage> image);
    void noLongerAhead(uint32_t imageIndex);
    void loadAhead();

    const OlatDataset& dataset_;
    const OlatSplit& split_;
    ImageCache files_;
    size_t budget_;
    const LearntMasks* masks_ = nullptr; // changes only while nothing is being loaded

    mutable std::mutex mutex_;       // guards everything below
    std::condition_variable changed_;
    size_t resident_ = 0, aheadBytes_ = 0;
    std::list<uint32_t> recent_;     // front = last used or loaded
    std::unordered_map<uint32_t, Entry> entries_;
    std::unordered_set<uint32_t> ahead_; // entries that are expected and not got yet: aheadBytes_
    std::deque<uint32_t> expected_;
    std::unordered_set<uint32_t> loading_;
    std::unordered_map<uint32_t, Error> failed_; // ahead; until they are got
    bool ends_ = false;
    std::vector<std::thread> threads_; // started by the first expect()
};

} // namespace nacre
