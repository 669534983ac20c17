// Structs and enums as a C host hands them over: perhaps an older host's, whose missing fields are zero.
#pragma once

#include "failure.h"

#include <cstddef>
#include <cstring>

namespace nacre {

/// A C host can store any int in an enum, and C++ must not read such a value as one.
template <class Enum>
int rawEnum(const Enum& value)
{
    int raw = 0;
    static_assert(sizeof raw == sizeof value);
    std::memcpy(&raw, &value, sizeof raw);
    return raw;
}

inline Failure checkSize(const char* type, size_t found, size_t expected)
{
    if (found >= sizeof(size_t) && found <= expected) return {};
    return invalid(std::string(type) + ".structSize is " + std::to_string(found) + ", expected " + std::to_string(expected) +
                   (found > expected ? "; the library is older than the header" : "; set it to sizeof(" + std::string(type) + ")"));
}

/// A copy of the library's size.
template <class Desc>
Failure read(const char* type, const Desc* given, Desc* copy)
{
    if (Failure f = checkSize(type, given->structSize, sizeof(Desc))) return f;
    *copy = {};
    std::memcpy(copy, given, given->structSize);
    return {};
}

} // namespace nacre
