// Which draws' passes have results worth keeping. Conditional rendering, about which GL cannot be asked, drops draws and dispatches
// without a word, and what was never written must not be taken for a result. So a query around the passes of a draw counts whether
// anything was drawn, and until it has told, a frame or two later, what was made in that draw is not sure and is made again. Nothing waits
// for the GPU; at rest nothing is asked.
#pragma once

#include "gl_api.h"

#include <array>
#include <cstdint>
#include <set>

namespace nacre {

class PassLog {
public:
    explicit PassLog(const Gl& gl) : gl_(gl) {}
    void destroyQueries();
    PassLog(const PassLog&) = delete;
    PassLog& operator=(const PassLog&) = delete;

    /// A draw begins: reads what queries have told.
    void begin();
    /// A pass is about to draw. (Dispatches draw nothing that could be counted: a draw that does nothing else is believed.)
    void pass();
    void end();

    /// Number of the draw that runs.
    uint64_t now() const { return now_; }
    /// Whether the passes of that draw are known to have been drawn.
    bool sure(uint64_t draw) const { return !unsure_.contains(draw); }

private:
    struct Run {
        GLuint query = 0;
        uint64_t draw = 0;
        bool pending = false;
    };

    const Gl& gl_;
    uint64_t now_ = 0;
    std::set<uint64_t> unsure_;   // pending or known to have been dropped
    std::array<Run, 8> runs_;     // more than drivers queue frames
    size_t next_ = 0;
    bool counting_ = false;
};

} // namespace nacre
