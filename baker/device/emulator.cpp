#include "device/device.h"

#include "base/random.h"

#include <boost/context/fiber.hpp>
#include <boost/context/protected_fixedsize_stack.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <numeric>
#include <vector>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/common_interface_defs.h>
#endif

namespace nacre::emulated {

namespace {

namespace ctx = boost::context;
constexpr size_t kStackBytes = 256 << 10;

/// Stacks that remember where they are: the address sanitizer has to be told.
struct Stack {
    ctx::stack_context* last;
    ctx::protected_fixedsize_stack allocator{kStackBytes};
    ctx::stack_context allocate() { return *last = allocator.allocate(); }
    void deallocate(ctx::stack_context& s) { allocator.deallocate(s); }
};

} // namespace

/// Runs blocks one after the other, on one thread of the process. Fibers outlive the threads they run: their stacks are made once.
class BlockRun {
public:
    ~BlockRun();
    void run(const Emulation& emulation, const KernelCall& call, uint32_t block);

    // Of the running fiber.
    void* shared() { return shared_.data(); }
    void barrier(uint32_t thread, int line)
    {
        lanes_[thread].line = line;
        suspend(thread, State::kAtBarrier);
    }
    uint64_t exchange(uint32_t thread, uint32_t mask, uint64_t value, uint32_t from, int line)
    {
        Lane& lane = lanes_[thread];
        if (!(mask >> (thread % 32) & 1)) fail(call_, block_, "line " + std::to_string(line) + ": a lane is not in its own mask");
        lane.mask = mask, lane.value = value, lane.from = from, lane.line = line;
        lane.state = State::kAtWarp;
        if (!tryExchange(thread)) suspend(thread, State::kAtWarp);
        lane.state = State::kReady;
        return lane.result;
    }
    uint32_t ballot(uint32_t thread, uint32_t mask, bool value, int line)
    {
        exchange(thread, mask, value, thread % 32, line);
        return lanes_[thread].ballot;
    }

private:
    enum class State : uint8_t { kFresh, kReady, kAtBarrier, kAtWarp, kDone };
    struct Ended {}; // thrown where a thread waits for what will not come
    struct Worker {
        ctx::stack_context stack{};
        ctx::fiber self, main;
        uint32_t thread = 0;
        void* fake = nullptr;  // of the address sanitizer
    };
    struct Lane {
        State state = State::kFresh;
        Worker* worker = nullptr;
        int line = 0;
        uint32_t mask = 0, from = 0, ballot = 0;
        uint64_t value = 0, result = 0;
    };

    [[noreturn]] static void fail(const KernelCall& call, uint32_t block, const std::string& what)
    {
        throw KernelFault(std::string("kernel ") + call.name + ", block " + std::to_string(block) + ": " + what);
    }

    bool tryExchange(uint32_t thread)
    {
        const Lane& own = lanes_[thread];
        const uint32_t first = thread / 32 * 32;
        uint32_t votes = 0;
        for (uint32_t l = 0; l < 32; ++l) {
            if (!(own.mask >> l & 1)) continue;
            const Lane& other = lanes_[first + l];
            if (other.state != State::kAtWarp || other.mask != own.mask || other.line != own.line) return false;
            votes |= uint32_t(other.value & 1) << l;
        }
        for (uint32_t l = 0; l < 32; ++l) {
            if (!(own.mask >> l & 1)) continue;
            Lane& other = lanes_[first + l];
            if (!(own.mask >> other.from & 1)) fail(call_, block_, "line " + std::to_string(own.line) + ": a shuffle from a lane that is not in the mask");
            other.result = lanes_[first + other.from].value, other.ballot = votes;
        }
        for (uint32_t l = 0; l < 32; ++l)
            if (own.mask >> l & 1) lanes_[first + l].state = State::kReady;
        return true;
    }

    void suspend(uint32_t thread, State state)
    {
        Lane& lane = lanes_[thread];
        lane.state = state;
        toMain(*lane.worker);
        if (ends_) throw Ended{};
    }

    void toMain(Worker& w)
    {
#ifdef __SANITIZE_ADDRESS__
        __sanitizer_start_switch_fiber(&w.fake, mainStack_, mainStackBytes_);
#endif
        w.main = std::move(w.main).resume();
#ifdef __SANITIZE_ADDRESS__
        __sanitizer_finish_switch_fiber(w.fake, &mainStack_, &mainStackBytes_);
#endif
    }

    void toWorker(Worker& w)
    {
#ifdef __SANITIZE_ADDRESS__
        void* fake = nullptr;
        __sanitizer_start_switch_fiber(&fake, static_cast<char*>(w.stack.sp) - w.stack.size, w.stack.size);
#endif
        w.self = std::move(w.self).resume();
#ifdef __SANITIZE_ADDRESS__
        __sanitizer_finish_switch_fiber(fake, nullptr, nullptr);
#endif
        if (fault_ && !ends_) std::rethrow_exception(std::exchange(fault_, nullptr));
    }

    Worker* idleWorker()
    {
        if (idle_.empty()) {
            workers_.push_back(std::make_unique<Worker>());
            Worker* w = workers_.back().get();
            w->self = ctx::fiber(std::allocator_arg, Stack{&w->stack}, [this, w](ctx::fiber&& main) {
                w->main = std::move(main);
#ifdef __SANITIZE_ADDRESS__
                __sanitizer_finish_switch_fiber(nullptr, &mainStack_, &mainStackBytes_);
#endif
                for (;;) {
                    try {
                        call_.call(call_.kernel, Thread(*this, w->thread, call_.threads, block_, call_.blocks));
                    } catch (const Ended&) {
                    } catch (const KernelFault&) {
                        fault_ = std::current_exception();
                    }
                    lanes_[w->thread].state = State::kDone;
                    idle_.push_back(w);
                    toMain(*w);
                    if (ends_) break;
                }
#ifdef __SANITIZE_ADDRESS__
                __sanitizer_start_switch_fiber(nullptr, mainStack_, mainStackBytes_);
#endif
                return std::move(w->main);
            });
            idle_.push_back(w);
        }
        Worker* w = idle_.back();
        idle_.pop_back();
        return w;
    }

    void resume(uint32_t thread)
    {
        Lane& lane = lanes_[thread];
        if (lane.state == State::kFresh) lane.worker = idleWorker(), lane.worker->thread = thread;
        toWorker(*lane.worker);
    }

    bool releaseBarrier();
    std::string whoWaits() const;

    KernelCall call_{};
    uint32_t block_ = 0;
    std::vector<Lane> lanes_;
    std::vector<std::unique_ptr<Worker>> workers_;
    std::vector<Worker*> idle_;
    std::vector<std::max_align_t> shared_;
    std::exception_ptr fault_;
    bool ends_ = false;
    const void* mainStack_ = nullptr;
    size_t mainStackBytes_ = 0;
};

// Leaves each fiber by its own frames: first the threads that still wait, then the loops around them.
BlockRun::~BlockRun()
{
    ends_ = true;
    for (uint32_t thread = 0; thread < lanes_.size(); ++thread)
        if (lanes_[thread].state != State::kFresh && lanes_[thread].state != State::kDone) toWorker(*lanes_[thread].worker);
    for (const std::unique_ptr<Worker>& w : workers_)
        if (w->self) toWorker(*w);
}

// Once nobody can go on: all threads wait at the same barrier, or the kernel is faulty.
bool BlockRun::releaseBarrier()
{
    for (const Lane& lane : lanes_)
        if (lane.state != State::kAtBarrier || lane.line != lanes_[0].line) return false;
    for (Lane& lane : lanes_) lane.state = State::kReady;
    return true;
}

std::string BlockRun::whoWaits() const
{
    size_t done = 0, barrier = 0, warp = 0;
    int line = 0;
    for (const Lane& lane : lanes_) {
        done += lane.state == State::kDone, barrier += lane.state == State::kAtBarrier, warp += lane.state == State::kAtWarp;
        if (lane.state == State::kAtBarrier || lane.state == State::kAtWarp) line = lane.line;
    }
    return std::to_string(barrier) + " of " + std::to_string(lanes_.size()) + " threads wait at a barrier and " + std::to_string(warp) +
           " at a warp operation (line " + std::to_string(line) + ") that the others, " + std::to_string(done) + " of them ended, do not reach";
}

void BlockRun::run(const Emulation& emulation, const KernelCall& call, uint32_t block)
{
    call_ = call, block_ = block;
    lanes_.assign(call.threads, {});
    shared_.resize(call.sharedBytes / sizeof(std::max_align_t) + 1);
    std::memset(shared_.data(), 0xff, shared_.size() * sizeof(std::max_align_t));
    std::vector<uint32_t> order(call.threads);
    std::iota(order.begin(), order.end(), 0u);
    if (emulation.order == ThreadOrder::kReverse) std::reverse(order.begin(), order.end());
    Random random(emulation.seed, block);
    for (;;) {
        if (emulation.order == ThreadOrder::kRandom)
            for (uint32_t i = call.threads; i > 1; --i) std::swap(order[i - 1], order[std::min(i - 1, uint32_t(random.uniform() * float(i)))]);
        bool moved = false, ended = true;
        for (uint32_t thread : order) {
            const State state = lanes_[thread].state;
            if (state == State::kFresh || state == State::kReady) resume(thread), moved = true;
            ended = ended && lanes_[thread].state == State::kDone;
        }
        if (ended) return;
        if (!moved && !releaseBarrier()) fail(call_, block_, whoWaits());
    }
}

void Thread::sync(int line) const { run_->barrier(thread_, line); }
void* Thread::sharedMemory() const { return run_->shared(); }
uint64_t Thread::exchange(uint32_t mask, uint64_t value, uint32_t from, int line) const { return run_->exchange(thread_, mask, value, from, line); }
uint32_t Thread::ballot(uint32_t mask, bool value, int line) const { return run_->ballot(thread_, mask, value, line); }

void runBlocks(const Emulation& emulation, const KernelCall& call)
{
    const uint32_t grain = 8;
    tbb::parallel_for(uint32_t(0), (call.blocks + grain - 1) / grain, [&](uint32_t chunk) {
        thread_local std::unique_ptr<BlockRun> run;
        if (!run) run = std::make_unique<BlockRun>();
        try {
            for (uint32_t b = chunk * grain; b < std::min(call.blocks, (chunk + 1) * grain); ++b)
                run->run(emulation, call, emulation.order == ThreadOrder::kReverse ? call.blocks - 1 - b : b);
        } catch (...) {
            run.reset(); // fibers that still wait end here
            throw;
        }
    });
}

void* Device::allocate(size_t bytes)
{
    while (bytes > freeBytes())
        if (!makeRoom_ || !makeRoom_())
            throw DeviceError("the card's memory is full: " + std::to_string(bytes >> 20) + " MiB more were needed, " + std::to_string(bytes_ >> 20) + " of " +
                              std::to_string(emulation_.memoryBytes >> 20) + " MiB are in use by this bake; fewer splats or smaller images need less");
    void* p = ::operator new(bytes, std::align_val_t(256));
    std::memset(p, 0xff, bytes);
    bytes_ += bytes;
    return p;
}

void Device::free(void* p, size_t bytes) noexcept
{
    ::operator delete(p, std::align_val_t(256));
    bytes_ -= bytes;
}

} // namespace nacre::emulated
