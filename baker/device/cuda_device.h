// device.h on a card. Only nvcc compiles this.
#pragma once

#include <cuda_runtime.h>

#include <cstring>
#include <functional>
#include <type_traits>

#define NACRE_DEVICE __device__
#define NACRE_UNROLL _Pragma("unroll") // before a loop over an array that has to be in registers

namespace nacre::cuda {

/// The running thread of a kernel.
struct Thread {
    __device__ uint32_t thread() const { return threadIdx.x; }
    __device__ uint32_t block() const { return blockIdx.x; }
    __device__ uint32_t blocks() const { return gridDim.x; }
    __device__ uint32_t lane() const { return threadIdx.x % 32; }
    __device__ uint32_t warp() const { return threadIdx.x / 32; }
    __device__ size_t index() const { return size_t(blockIdx.x) * blockDim.x + threadIdx.x; }

    template <class S>
    __device__ S& shared() const
    {
        extern __shared__ __align__(16) unsigned char memory[];
        return *reinterpret_cast<S*>(memory);
    }
    __device__ void sync() const { __syncthreads(); }
    __device__ void syncWarp(uint32_t mask) const { __syncwarp(mask); }
    __device__ uint32_t ballot(uint32_t mask, bool value) const { return __ballot_sync(mask, value); }
    template <class T>
    __device__ T shuffle(uint32_t mask, T value, uint32_t lane) const { return __shfl_sync(mask, value, int(lane)); }
    template <class T>
    __device__ T shuffleUp(uint32_t mask, T value, uint32_t delta) const { return __shfl_up_sync(mask, value, delta); }
    template <class T>
    __device__ T shuffleDown(uint32_t mask, T value, uint32_t delta) const { return __shfl_down_sync(mask, value, delta); }
    template <class T>
    __device__ T shuffleXor(uint32_t mask, T value, uint32_t delta) const { return __shfl_xor_sync(mask, value, int(delta)); }
};

template <class T>
__device__ T deviceAdd(T* p, T value) { return atomicAdd(p, value); }
template <class T>
__device__ T deviceMax(T* p, T value) { return atomicMax(p, value); }
template <class T>
__device__ T deviceOr(T* p, T value) { return atomicOr(p, value); }

/// The card, and the stream on which everything runs in order.
class Device {
public:
    /// The first card. Throws DeviceError where there is no driver or no card that this program was compiled for.
    Device()
    {
        int count = 0, driver = 0;
        const cudaError_t status = cudaGetDeviceCount(&count);
        if (status == cudaErrorInsufficientDriver || status == cudaErrorStubLibrary) {
            if (cudaDriverGetVersion(&driver) != cudaSuccess || driver == 0) throw DeviceError("there is no driver of a CUDA card in this machine");
            throw DeviceError("the driver of the card is of CUDA " + std::to_string(driver / 1000) + ", this nacre needs " + std::to_string(CUDART_VERSION / 1000));
        }
        if (status == cudaErrorNoDevice || (status == cudaSuccess && count == 0)) throw DeviceError("there is no CUDA card in this machine");
        check(status, "finding a card");
        check(cudaSetDevice(0), "opening the card");
        check(cudaGetDeviceProperties(&properties_, 0), "opening the card");
        if (properties_.major < 8)
            throw DeviceError(name() + " is too old: it has compute capability " + std::to_string(properties_.major) + "." + std::to_string(properties_.minor) + ", 8.0 is needed");
        check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "opening the card");
    }
    Device(const Device&) = delete;
    ~Device() { cudaStreamDestroy(stream_); }

    std::string name() const { return properties_.name; }
    size_t bytes() const { return bytes_; }
    size_t freeBytes() const
    {
        size_t free = 0, total = 0;
        check(cudaMemGetInfo(&free, &total), "asking for the memory of the card");
        return free;
    }
    cudaStream_t stream() const { return stream_; }
    void synchronize() { check(cudaStreamSynchronize(stream_), "a step"); }

    /// Who gives memory back when there is too little: false if nothing is left.
    void whenFull(std::function<bool()> makeRoom) { makeRoom_ = std::move(makeRoom); }
    void* allocate(size_t bytes)
    {
        void* p = nullptr;
        cudaError_t status = cudaMallocAsync(&p, bytes, stream_);
        while (status == cudaErrorMemoryAllocation && makeRoom_ && makeRoom_()) {
            cudaGetLastError(); // it would be reported again
            status = cudaMallocAsync(&p, bytes, stream_);
        }
        if (status == cudaErrorMemoryAllocation) {
            cudaGetLastError();
            throw DeviceError("the card's memory is full: " + std::to_string(bytes >> 20) + " MiB more were needed, " + std::to_string(bytes_ >> 20) + " of " +
                              std::to_string(properties_.totalGlobalMem >> 20) + " MiB are in use by this bake; fewer splats or smaller images need less");
        }
        check(status, "allocating memory on the card");
        bytes_ += bytes;
        return p;
    }
    void free(void* p, size_t bytes) noexcept { cudaFreeAsync(p, stream_), bytes_ -= bytes; }
    void copyIn(void* to, const void* from, size_t bytes) { copy(to, from, bytes, cudaMemcpyHostToDevice); }
    void copyWithin(void* to, const void* from, size_t bytes) { copy(to, from, bytes, cudaMemcpyDeviceToDevice); }
    void copyOut(void* to, const void* from, size_t bytes) { copy(to, from, bytes, cudaMemcpyDeviceToHost), synchronize(); }
    void zero(void* p, size_t bytes)
    {
        if (bytes) check(cudaMemsetAsync(p, 0, bytes, stream_), "clearing memory of the card");
    }

    static void check(cudaError_t status, const char* doing)
    {
        if (status != cudaSuccess) throw DeviceError(std::string("CUDA, ") + doing + ": " + cudaGetErrorString(status));
    }

private:
    void copy(void* to, const void* from, size_t bytes, cudaMemcpyKind kind)
    {
        if (bytes) check(cudaMemcpyAsync(to, from, bytes, kind, stream_), "copying");
    }

    cudaDeviceProp properties_{};
    cudaStream_t stream_{};
    std::function<bool()> makeRoom_;
    size_t bytes_ = 0;
};

/// 0: nothing is promised, nvcc decides.
template <class Kernel>
constexpr uint32_t blocksAtOnce()
{
    if constexpr (requires { Kernel::kBlocksAtOnce; }) return Kernel::kBlocksAtOnce;
    else return 0;
}

template <class Kernel>
__global__ void __launch_bounds__(Kernel::kThreads, blocksAtOnce<Kernel>()) run(const Kernel kernel) { kernel(Thread{}); }

template <class Kernel>
constexpr size_t sharedBytes()
{
    if constexpr (requires { typename Kernel::Shared; }) return sizeof(typename Kernel::Shared);
    else return 0;
}

/// Asynchronous, in the order of launching. No blocks: nothing.
template <class Kernel>
void launch(Device& device, uint32_t blocks, const Kernel& kernel)
{
    constexpr size_t kShared = sharedBytes<Kernel>();
    if (blocks == 0) return;
    if constexpr (kShared > 48 * 1024)
        Device::check(cudaFuncSetAttribute(run<Kernel>, cudaFuncAttributeMaxDynamicSharedMemorySize, int(kShared)), "asking for shared memory");
    run<Kernel><<<blocks, Kernel::kThreads, kShared, device.stream()>>>(kernel);
    Device::check(cudaGetLastError(), "starting a kernel");
}

} // namespace nacre::cuda
