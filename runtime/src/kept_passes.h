// Which relighting passes have results worth keeping. Conditional rendering, about which GL cannot be asked, drops draws and dispatches
// without a word, and what was never written must not be taken for a result. So a query around the passes of a draw counts whether
// anything was drawn, and until it has told, a frame or two later, they run again. Nothing waits for the GPU; at rest nothing is asked.
#pragma once

#include "gl_api.h"

#include <array>
#include <cstdint>

namespace nacre {

class KeptPasses {
public:
    static constexpr int kMostPasses = 3;

    explicit KeptPasses(const Gl& gl) : gl_(gl) {}
    ~KeptPasses();
    KeptPasses(const KeptPasses&) = delete;
    KeptPasses& operator=(const KeptPasses&) = delete;

    /// The inputs of a pass have changed.
    void outdate(int pass) { ++inputs_[size_t(pass)], kept_[size_t(pass)] = false; }
    /// Reads what queries have told.
    void update();
    bool has(int pass) const { return kept_[size_t(pass)]; }

    /// Around passes that are run, at least one of which draws; `passes` has a bit for each.
    void begin();
    void end(unsigned passes);

private:
    struct Run {
        GLuint query = 0;
        bool pending = false;
        unsigned passes = 0;
        std::array<uint32_t, kMostPasses> inputs{}; // as of this run
    };
    void believe(const Run& run);

    const Gl& gl_;
    std::array<uint32_t, kMostPasses> inputs_{};
    std::array<bool, kMostPasses> kept_{};
    std::array<Run, 8> runs_; // more than drivers queue frames
    size_t next_ = 0;
    bool asking_ = false;
};

} // namespace nacre
