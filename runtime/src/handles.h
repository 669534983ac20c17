// Ids of the C API. An id names a slot of a table and carries the serial number of what was put there, which never comes again: a stale
// id finds another serial, a foreign one another kind or context, and nothing is ever dereferenced that does not live.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

namespace nacre {

enum class HandleKind : uint64_t { kContext = 1, kAsset, kInstance, kView };

struct Handle {
    static constexpr int kKindBits = 4, kContextBits = 8, kIndexBits = 20;
    static constexpr uint32_t kMostContexts = 1u << kContextBits, kMostObjects = 1u << kIndexBits;

    uint32_t serial = 0, index = 0, context = 0;
    HandleKind kind = HandleKind::kContext;

    bool operator==(const Handle&) const = default;
    uint64_t id() const
    {
        return uint64_t(serial) << 32 | uint64_t(index) << (kContextBits + kKindBits) | uint64_t(context) << kKindBits | uint64_t(kind);
    }
    static Handle of(uint64_t id)
    {
        return {uint32_t(id >> 32), uint32_t(id >> (kContextBits + kKindBits)) & (kMostObjects - 1), uint32_t(id >> kKindBits) & (kMostContexts - 1),
                HandleKind(id & ((1u << kKindBits) - 1))};
    }
};

/// Of this process, from 1.
inline uint32_t nextSerial()
{
    static std::atomic<uint32_t> last{0};
    return ++last;
}

/// Objects of one kind. Safe to use from several threads; what is found lives as long as it is held.
template <class T>
class HandleTable {
public:
    explicit HandleTable(HandleKind kind) : kind_(kind) {}

    /// 0 if the table is full. Sets object->handle.
    uint64_t add(uint32_t context, std::shared_ptr<T> object)
    {
        const std::lock_guard lock(mutex_);
        uint32_t index = uint32_t(slots_.size());
        if (!free_.empty()) index = free_.back(), free_.pop_back();
        else if (index == Handle::kMostObjects) return 0;
        else slots_.emplace_back();
        const Handle handle{nextSerial(), index, context, kind_};
        object->handle = handle;
        slots_[index] = {handle.serial, std::move(object)};
        return handle.id();
    }
    std::shared_ptr<T> find(const Handle& h) const
    {
        const std::lock_guard lock(mutex_);
        const bool found = h.kind == kind_ && h.index < slots_.size() && slots_[h.index].serial == h.serial;
        return found ? slots_[h.index].object : nullptr;
    }
    /// What it was, or null.
    std::shared_ptr<T> remove(const Handle& h)
    {
        const std::lock_guard lock(mutex_);
        if (h.kind != kind_ || h.index >= slots_.size() || slots_[h.index].serial != h.serial) return nullptr;
        std::shared_ptr<T> object = std::move(slots_[h.index].object);
        slots_[h.index] = {};
        free_.push_back(h.index);
        return object;
    }
    /// Those that live, by slot.
    std::vector<std::shared_ptr<T>> all() const
    {
        const std::lock_guard lock(mutex_);
        std::vector<std::shared_ptr<T>> objects;
        for (const Slot& s : slots_)
            if (s.object) objects.push_back(s.object);
        return objects;
    }

private:
    struct Slot {
        uint32_t serial = 0;
        std::shared_ptr<T> object;
    };
    const HandleKind kind_;
    mutable std::mutex mutex_;
    std::vector<Slot> slots_;
    std::vector<uint32_t> free_;
};

} // namespace nacre
