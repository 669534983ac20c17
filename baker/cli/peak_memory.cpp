// VmHWM of /proc/self/status. ru_maxrss of getrusage is not it: a process that fork and exec have made begins with what its parent held,
// and a bake that a large program starts would seem as large.
#include "peak_memory.h"

#include <fstream>
#include <string>

namespace nacre::cli {

size_t peakMemoryBytes()
{
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
        if (line.rfind("VmHWM:", 0) == 0) return size_t(std::stoull(line.substr(6))) * 1024; // "VmHWM:    1234 kB"
    return 0;
}

} // namespace nacre::cli
