// The global operator new and delete of this executable, which note what one module has allocated (tests of leaks are
// exact, whatever the driver keeps) and fail where a test asks them to.
#include "own_heap.h"

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <link.h>
#include <mutex>
#include <new>
#include <unordered_map>

namespace {

struct Module {
    uintptr_t code, begin = 0, end = 0;
};

Module moduleOf(const void* code)
{
    Module module{uintptr_t(code)};
    dl_iterate_phdr(
        [](dl_phdr_info* info, size_t, void* data) {
            Module& m = *static_cast<Module*>(data);
            for (int i = 0; i < info->dlpi_phnum; ++i) {
                const uintptr_t begin = info->dlpi_addr + info->dlpi_phdr[i].p_vaddr, end = begin + info->dlpi_phdr[i].p_memsz;
                if (info->dlpi_phdr[i].p_type == PT_LOAD && m.code >= begin && m.code < end) m.begin = begin, m.end = end;
            }
            return int(m.end > 0);
        },
        &module);
    return module;
}

// The notes themselves must not come from operator new.
template <typename T> struct Malloc {
    using value_type = T;
    Malloc() = default;
    template <typename U> Malloc(const Malloc<U>&) {}
    T* allocate(size_t n)
    {
        if (void* p = std::malloc(n * sizeof(T))) return static_cast<T*>(p);
        throw std::bad_alloc();
    }
    void deallocate(T* p, size_t) { std::free(p); }
    bool operator==(const Malloc&) const { return true; }
};

struct Notes {
    std::mutex mutex;
    std::unordered_map<void*, size_t, std::hash<void*>, std::equal_to<void*>, Malloc<std::pair<void* const, size_t>>> sizes;
    size_t sum = 0;
};

std::atomic<uintptr_t> moduleBegin{0}, moduleEnd{0};

Notes& notes()
{
    static Notes& n = *new (std::malloc(sizeof(Notes))) Notes; // outlives whatever is deleted at exit
    return n;
}

void* take(size_t size, const void* caller)
{
    void* p = size <= nacre::test::largestAllocation ? std::malloc(size ? size : 1) : nullptr;
    if (p && uintptr_t(caller) >= moduleBegin && uintptr_t(caller) < moduleEnd) {
        const std::scoped_lock lock(notes().mutex);
        notes().sizes[p] = size;
        notes().sum += size;
    }
    return p;
}

void* takeOrThrow(size_t size, const void* caller)
{
    if (void* p = take(size, caller)) return p;
    throw std::bad_alloc();
}

void giveBack(void* p)
{
    if (p && moduleEnd > 0) {
        const std::scoped_lock lock(notes().mutex);
        if (const auto found = notes().sizes.find(p); found != notes().sizes.end()) {
            notes().sum -= found->second;
            notes().sizes.erase(found);
        }
    }
    std::free(p);
}

} // namespace

thread_local size_t nacre::test::largestAllocation = ~size_t(0);

size_t nacre::test::ownHeapBytes(const void* code)
{
    if (moduleEnd == 0) {
        const Module module = moduleOf(code);
        moduleBegin = module.begin, moduleEnd = module.end;
    }
    const std::scoped_lock lock(notes().mutex);
    return notes().sum;
}

// Inlined, new and delete would look mismatched to the compiler. The forms for over-aligned types stay the library's.
[[gnu::noinline]] void* operator new(size_t n) { return takeOrThrow(n, __builtin_return_address(0)); }
[[gnu::noinline]] void* operator new[](size_t n) { return takeOrThrow(n, __builtin_return_address(0)); }
[[gnu::noinline]] void* operator new(size_t n, const std::nothrow_t&) noexcept { return take(n, __builtin_return_address(0)); }
[[gnu::noinline]] void* operator new[](size_t n, const std::nothrow_t&) noexcept { return take(n, __builtin_return_address(0)); }
[[gnu::noinline]] void operator delete(void* p) noexcept { giveBack(p); }
[[gnu::noinline]] void operator delete[](void* p) noexcept { giveBack(p); }
[[gnu::noinline]] void operator delete(void* p, size_t) noexcept { giveBack(p); }
[[gnu::noinline]] void operator delete[](void* p, size_t) noexcept { giveBack(p); }
[[gnu::noinline]] void operator delete(void* p, const std::nothrow_t&) noexcept { giveBack(p); }
[[gnu::noinline]] void operator delete[](void* p, const std::nothrow_t&) noexcept { giveBack(p); }
