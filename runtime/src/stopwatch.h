// Laps of a draw.
#pragma once

#include "context.h"

#include <chrono>

namespace nacre {

/// Seconds since the last lap; with profiling on, GPU work up to here included.
class Stopwatch {
public:
    explicit Stopwatch(const Context& context) : context_(context) { lap(); }
    double lap()
    {
        if (context_.profiling) context_.gl.Finish();
        const auto now = std::chrono::steady_clock::now();
        const double seconds = std::chrono::duration<double>(now - last_).count();
        last_ = now;
        return seconds;
    }

private:
    const Context& context_;
    std::chrono::steady_clock::time_point last_{};
};

} // namespace nacre
