#include "cli/peak_memory.h"

#include <doctest/doctest.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <sys/wait.h>
#include <unistd.h>

using namespace nacre::cli;

namespace {
constexpr size_t kMuch = size_t(192) << 20; // more than this test program ever needs
constexpr const char* kChild = "NACRE_TEST_FRESH_PROCESS";
} // namespace

// The child is this very program again, told by the environment to look at itself only.
TEST_CASE("peak memory: what is held counts, what the parent of the process held does not")
{
    if (std::getenv(kChild)) {
        REQUIRE(peakMemoryBytes() < kMuch);
        return;
    }
    const size_t before = peakMemoryBytes();
    if (before == 0) {
        MESSAGE("SKIPPED: the system does not say how much memory a process has held");
        return;
    }
    const auto held = std::make_unique<char[]>(kMuch);
    std::memset(held.get(), 1, kMuch);
    CHECK(peakMemoryBytes() >= before + kMuch / 2);

    const pid_t child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
        setenv(kChild, "1", 1);
        execl("/proc/self/exe", "test_cli", "-tc=peak memory*", "--no-run=false", static_cast<char*>(nullptr));
        _exit(127);
    }
    int status = 0;
    REQUIRE(waitpid(child, &status, 0) == child);
    CHECK(WIFEXITED(status));
    CHECK(WEXITSTATUS(status) == 0);
}
