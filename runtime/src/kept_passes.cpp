#include "kept_passes.h"

namespace nacre {

// Counts under a failed condition nothing, whatever tests and masks say, and hosts rarely have one running.
static constexpr GLenum kCounter = GL_PRIMITIVES_GENERATED;

KeptPasses::~KeptPasses()
{
    for (const Run& run : runs_) gl_.DeleteQueries(1, &run.query); // GL ignores 0
}

/// A run speaks for the passes whose inputs are still the same.
void KeptPasses::believe(const Run& run)
{
    for (size_t p = 0; p < kMostPasses; ++p)
        if ((run.passes >> p & 1) && run.inputs[p] == inputs_[p]) kept_[p] = true;
}

void KeptPasses::update()
{
    for (Run& run : runs_) {
        if (!run.pending) continue;
        GLuint available = 0, drawn = 0;
        gl_.GetQueryObjectuiv(run.query, GL_QUERY_RESULT_AVAILABLE, &available);
        if (!available) continue;
        gl_.GetQueryObjectuiv(run.query, GL_QUERY_RESULT, &drawn);
        run.pending = false;
        if (drawn) believe(run);
    }
}

void KeptPasses::begin()
{
    asking_ = false;
    if (gl_.es) return; // has neither conditional rendering nor, before 3.2, this counter: passes are believed
    Run& run = runs_[next_];
    if (run.pending) believe(run); // a driver that does not tell for so long is not asked further
    run.pending = false;
    GLint hosts = 0;
    gl_.GetQueryiv(kCounter, GL_CURRENT_QUERY, &hosts);
    asking_ = hosts == 0; // one at a time: under such a query of the host passes are believed
    if (!asking_) return;
    if (!run.query) gl_.GenQueries(1, &run.query);
    gl_.BeginQuery(kCounter, run.query);
}

void KeptPasses::end(unsigned passes)
{
    Run& run = runs_[next_];
    run.passes = passes;
    run.inputs = inputs_;
    if (!asking_) return believe(run);
    gl_.EndQuery(kCounter);
    run.pending = true;
    next_ = (next_ + 1) % runs_.size();
}

} // namespace nacre
