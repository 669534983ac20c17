// What a step on a device is written against, in one source for two back ends: nvcc compiles it for a card (NACRE_BACKEND is cuda), g++ for
// the emulator, which runs the same kernels as fibers (emulated). Everything in this folder that launches kernels lives in namespace
// nacre::NACRE_BACKEND and is included by one translation unit per back end.
//
//   struct MyKernel {                             // plain data
//       static constexpr uint32_t kThreads = 256; // of a block
//       static constexpr uint32_t kBlocksAtOnce = 2; // optional: of a multiprocessor; that many have to find room for their registers
//       struct Shared { float sum[256]; };        // optional: memory that a block shares, not initialised
//       const float* in;
//       float* out;
//       NACRE_DEVICE void operator()(const Thread& t) const;
//   };
//   launch(device, blocksFor(count, MyKernel::kThreads), MyKernel{in, out});
//
// Kernels sum floats in a fixed order, never by atomics: the same bake gives the same bytes.
#pragma once

#include "device/device_error.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

#ifdef __CUDACC__
#define NACRE_BACKEND cuda
#include "device/cuda_device.h"
#else
#define NACRE_BACKEND emulated
#include "device/emulator.h"
#endif

namespace nacre::NACRE_BACKEND {

constexpr uint32_t kWarp = 32, kFullWarp = ~0u;

inline uint32_t blocksFor(size_t count, uint32_t threads) { return uint32_t((count + threads - 1) / threads); }

/// Memory of the device for plain values. What it holds after it has been made or has grown is undefined.
template <class T>
class Buffer {
    static_assert(std::is_trivially_copyable_v<T>);

public:
    Buffer() = default;
    Buffer(Buffer&& other) noexcept { *this = std::move(other); }
    Buffer& operator=(Buffer&& other) noexcept
    {
        std::swap(device_, other.device_), std::swap(data_, other.data_), std::swap(size_, other.size_), std::swap(capacity_, other.capacity_);
        return *this;
    }
    ~Buffer() { release(); }

    T* data() const { return data_; }
    size_t size() const { return size_; }

    /// Room for `count` values; what was there is lost if it has to grow, to half as much again.
    void reserve(Device& device, size_t count)
    {
        if (count > capacity_) {
            const size_t grown = capacity_ == 0 ? count : count + capacity_ / 2;
            release();
            data_ = static_cast<T*>(device.allocate(grown * sizeof(T)));
            device_ = &device, capacity_ = grown;
        }
        size_ = count;
    }
    /// As reserve, but keeps the values there are.
    void resize(Device& device, size_t count)
    {
        if (count > capacity_) {
            Buffer larger = Buffer();
            larger.reserve(device, count);
            device.copyWithin(larger.data_, data_, size_ * sizeof(T));
            *this = std::move(larger);
        }
        size_ = count;
    }
    void upload(Device& device, std::span<const T> values)
    {
        reserve(device, values.size());
        device.copyIn(data_, values.data(), values.size_bytes());
    }
    /// Waits for all that has been launched. values.size() <= size().
    void download(Device& device, std::span<T> values) const { device.copyOut(values.data(), data_, values.size_bytes()); }
    void zero(Device& device) { device.zero(data_, size_ * sizeof(T)); }

private:
    void release()
    {
        if (device_) device_->free(data_, capacity_ * sizeof(T));
        device_ = nullptr, data_ = nullptr, size_ = capacity_ = 0;
    }

    Device* device_ = nullptr;
    T* data_ = nullptr;
    size_t size_ = 0, capacity_ = 0;
};

} // namespace nacre::NACRE_BACKEND
