// Whole files in, atomic files out.
#pragma once

#include "base/result.h"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace nacre {

/// Reads a whole file. Error kBadInput if it cannot be read or exceeds `maxBytes`.
Result<std::vector<std::byte>> readFile(const std::string& path, size_t maxBytes = size_t(1) << 32);

/// The first bytes of a file, at most `count`, and the size of the whole. Error kBadInput if it cannot be read.
struct FileStart {
    std::vector<std::byte> bytes;
    size_t fileSize = 0;
};
Result<FileStart> readFileStart(const std::string& path, size_t count);

/// Writes `path`.tmp-PID in the same folder, syncs, renames over `path`; on failure removes the temporary and returns kIo.
Status writeFileAtomically(const std::string& path, std::span<const std::byte> bytes);

/// Removes temporaries of `path` whose process no longer runs on this machine: it was killed while it wrote.
/// Only for files that no other machine writes at the same time. What cannot be removed stays, without an error.
void removeAbandonedTemporaries(const std::string& path);

} // namespace nacre
