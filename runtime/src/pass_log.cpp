#include "pass_log.h"

namespace nacre {

// Counts under a failed condition nothing, whatever tests and masks say, and hosts rarely have one running.
static constexpr GLenum kCounter = GL_PRIMITIVES_GENERATED;

void PassLog::destroyQueries()
{
    for (const Run& run : runs_) gl_.DeleteQueries(1, &run.query); // GL ignores 0
    runs_ = {};
}

void PassLog::begin()
{
    ++now_;
    counting_ = false;
    for (Run& run : runs_) {
        if (!run.pending) continue;
        GLuint available = 0, drawn = 0;
        gl_.GetQueryObjectuiv(run.query, GL_QUERY_RESULT_AVAILABLE, &available);
        if (!available) continue;
        gl_.GetQueryObjectuiv(run.query, GL_QUERY_RESULT, &drawn);
        run.pending = false;
        if (drawn) unsure_.erase(run.draw);
    }
}

void PassLog::pass()
{
    if (counting_ || gl_.es) return; // ES has neither conditional rendering nor, before 3.2, this counter
    GLint hosts = 0;
    gl_.GetQueryiv(kCounter, GL_CURRENT_QUERY, &hosts);
    if (hosts) return; // one at a time: under such a query of the host passes are believed
    Run& run = runs_[next_];
    if (run.pending) unsure_.erase(run.draw); // a driver that does not tell for so long is not asked further
    if (!run.query) gl_.GenQueries(1, &run.query);
    gl_.BeginQuery(kCounter, run.query);
    run.draw = now_, run.pending = true;
    unsure_.insert(now_);
    counting_ = true;
}

void PassLog::end()
{
    if (!counting_) return;
    gl_.EndQuery(kCounter);
    counting_ = false;
    next_ = (next_ + 1) % runs_.size();
}

} // namespace nacre
