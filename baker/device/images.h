// Reference images on the device: each stays from the first step that needs it until the memory is needed for something else.
#pragma once

#include "device/device.h"
#include "device/loss.h"

#include <list>
#include <unordered_map>
#include <vector>

namespace nacre::NACRE_BACKEND {

class DeviceImages {
public:
    explicit DeviceImages(Device& device) : device_(device)
    {
        device.whenFull([this] { return dropOldest(); });
    }
    ~DeviceImages() { device_.whenFull({}); }

    /// What has been got since can be dropped from here on.
    void beginStep() { ++step_; }
    DeviceImage get(const PreparedImage& image)
    {
        if (const auto found = entries_.find(image.id); found != entries_.end()) {
            Entry& e = *found->second;
            e.step = step_;
            recent_.splice(recent_.begin(), recent_, found->second);
            return e.view;
        }
        Entry e;
        e.id = image.id, e.step = step_;
        e.numbers.reserve(device_, image.planes.size() + image.linear.size() + image.known.size()); // may drop others
        uint16_t* to = e.numbers.data();
        const auto put = [&](const std::vector<uint16_t>& from) {
            const uint16_t* at = from.empty() ? nullptr : to;
            device_.copyIn(to, from.data(), from.size() * sizeof(uint16_t));
            to += from.size();
            return at;
        };
        e.view.planes = put(image.planes), e.view.linear = put(image.linear), e.view.known = put(image.known);
        e.view.width = image.width, e.view.height = image.height, e.view.unknown = image.unknown;
        recent_.push_front(std::move(e));
        entries_[image.id] = recent_.begin();
        return recent_.front().view;
    }
    size_t count() const { return entries_.size(); }

private:
    struct Entry {
        uint64_t id = 0, step = 0;
        Buffer<uint16_t> numbers;
        DeviceImage view{};
    };

    /// False if all that is left is in use.
    bool dropOldest()
    {
        if (recent_.empty() || recent_.back().step == step_) return false;
        entries_.erase(recent_.back().id);
        recent_.pop_back();
        return true;
    }

    Device& device_;
    uint64_t step_ = 0;
    std::list<Entry> recent_; // front = used last
    std::unordered_map<uint64_t, std::list<Entry>::iterator> entries_;
};

} // namespace nacre::NACRE_BACKEND
