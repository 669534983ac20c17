// device.h without a card: runs kernels on the CPU, each thread of a block as a fiber, so that barriers, shuffles and shared memory mean what
// they mean on a card. The order in which threads run can be chosen: a kernel that lacks a barrier gives different results in some of
// them. A barrier that not all threads of a block reach, and a warp operation that not all lanes of its mask reach, are errors here. Memory
// that nothing was written to holds NaN. What it cannot show: races that need two threads at once, limits of registers, speed.
#pragma once

#include <atomic>
#include <cstring>
#include <functional>
#include <memory>
#include <type_traits>
#include <typeinfo>

#define NACRE_DEVICE
#define NACRE_UNROLL

namespace nacre::emulated {

enum class ThreadOrder { kForward, kReverse, kRandom };

struct Emulation {
    ThreadOrder order = ThreadOrder::kForward;
    uint64_t seed = 1;                    // of the random order
    size_t memoryBytes = size_t(8) << 30; // of the card
};

/// A faulty kernel: says which and why.
struct KernelFault : std::logic_error {
    using std::logic_error::logic_error;
};

class BlockRun;

/// The running thread of a kernel.
class Thread {
public:
    Thread(BlockRun& run, uint32_t thread, uint32_t threads, uint32_t block, uint32_t blocks)
        : run_(&run), thread_(thread), threads_(threads), block_(block), blocks_(blocks)
    {
    }
    uint32_t thread() const { return thread_; }
    uint32_t block() const { return block_; }
    uint32_t blocks() const { return blocks_; }
    uint32_t lane() const { return thread_ % 32; }
    uint32_t warp() const { return thread_ / 32; }
    size_t index() const { return size_t(block_) * threads_ + thread_; }

    template <class S>
    S& shared() const { return *static_cast<S*>(sharedMemory()); }
    void sync(int line = __builtin_LINE()) const;
    void syncWarp(uint32_t mask, int line = __builtin_LINE()) const { exchange(mask, 0, lane(), line); }
    uint32_t ballot(uint32_t mask, bool value, int line = __builtin_LINE()) const;
    template <class T>
    T shuffle(uint32_t mask, T value, uint32_t from, int line = __builtin_LINE()) const { return exchangeAs(mask, value, from % 32, line); }
    template <class T>
    T shuffleUp(uint32_t mask, T value, uint32_t delta, int line = __builtin_LINE()) const
    {
        return exchangeAs(mask, value, lane() < delta ? lane() : lane() - delta, line);
    }
    template <class T>
    T shuffleDown(uint32_t mask, T value, uint32_t delta, int line = __builtin_LINE()) const
    {
        return exchangeAs(mask, value, lane() + delta > 31 ? lane() : lane() + delta, line);
    }
    template <class T>
    T shuffleXor(uint32_t mask, T value, uint32_t bits, int line = __builtin_LINE()) const { return exchangeAs(mask, value, lane() ^ bits, line); }

private:
    void* sharedMemory() const;
    /// The value of lane `from`, once all lanes of `mask` have come.
    uint64_t exchange(uint32_t mask, uint64_t value, uint32_t from, int line) const;
    template <class T>
    T exchangeAs(uint32_t mask, T value, uint32_t from, int line) const
    {
        static_assert(sizeof(T) <= 8 && std::is_trivially_copyable_v<T>);
        uint64_t bits = 0;
        std::memcpy(&bits, &value, sizeof(T));
        bits = exchange(mask, bits, from, line);
        std::memcpy(&value, &bits, sizeof(T));
        return value;
    }

    BlockRun* run_;
    uint32_t thread_, threads_, block_, blocks_;
};

template <class T>
T deviceAdd(T* p, T value) { return std::atomic_ref<T>(*p).fetch_add(value); }
template <class T>
T deviceOr(T* p, T value) { return std::atomic_ref<T>(*p).fetch_or(value); }
template <class T>
T deviceMax(T* p, T value)
{
    std::atomic_ref<T> ref(*p);
    T old = ref.load();
    while (old < value && !ref.compare_exchange_weak(old, value)) {}
    return old;
}

class Device {
public:
    explicit Device(const Emulation& emulation = {}) : emulation_(emulation) {}
    Device(const Device&) = delete;

    std::string name() const { return "emulated"; }
    size_t bytes() const { return bytes_; }
    size_t freeBytes() const { return emulation_.memoryBytes - bytes_; }
    const Emulation& emulation() const { return emulation_; }
    void synchronize() {}

    /// Who gives memory back when there is too little: false if nothing is left.
    void whenFull(std::function<bool()> makeRoom) { makeRoom_ = std::move(makeRoom); }
    void* allocate(size_t bytes);
    void free(void* p, size_t bytes) noexcept;
    void copyIn(void* to, const void* from, size_t bytes) { copy(to, from, bytes); }
    void copyWithin(void* to, const void* from, size_t bytes) { copy(to, from, bytes); }
    void copyOut(void* to, const void* from, size_t bytes) { copy(to, from, bytes); }
    void zero(void* p, size_t bytes)
    {
        if (bytes) std::memset(p, 0, bytes);
    }

private:
    static void copy(void* to, const void* from, size_t bytes)
    {
        if (bytes) std::memcpy(to, from, bytes);
    }
    Emulation emulation_;
    std::function<bool()> makeRoom_;
    size_t bytes_ = 0;
};

struct KernelCall {
    const char* name;
    const void* kernel;
    void (*call)(const void* kernel, const Thread& thread);
    uint32_t blocks, threads;
    size_t sharedBytes;
};
/// Blocks run on all threads of the process. Throws KernelFault.
void runBlocks(const Emulation& emulation, const KernelCall& call);

/// In the order of launching. No blocks: nothing.
template <class Kernel>
void launch(Device& device, uint32_t blocks, const Kernel& kernel)
{
    static_assert(Kernel::kThreads % 32 == 0 && Kernel::kThreads <= 1024);
    size_t shared = 0;
    if constexpr (requires { typename Kernel::Shared; }) shared = sizeof(typename Kernel::Shared);
    runBlocks(device.emulation(), {typeid(Kernel).name(), &kernel, [](const void* k, const Thread& t) { (*static_cast<const Kernel*>(k))(t); },
                                   blocks, Kernel::kThreads, shared});
}

} // namespace nacre::emulated
