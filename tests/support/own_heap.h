#pragma once
#include <cstddef>

namespace nacre::test {

/// Bytes that the code of the module (executable or shared library) that holds `code` has taken with operator new and not given back. What a driver takes,
/// which comes and goes as it likes, is not in it. Strings that the standard library's own code allocates are not either.
/// The first call, made while little else runs, sets the module; later ones must name the same one.
size_t ownHeapBytes(const void* code);

/// Larger allocations of this thread fail.
extern thread_local size_t largestAllocation;

} // namespace nacre::test
