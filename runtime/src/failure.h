// How work inside the runtime fails.
#pragma once

#include "nacre/nacre.h"

#include <string>

namespace nacre {

/// Empty text: success.
struct Failure {
    NacreResult code = NACRE_OK;
    std::string text;
    explicit operator bool() const { return code != NACRE_OK; }
};

inline Failure invalid(std::string text) { return {NACRE_ERROR_INVALID_ARGUMENT, std::move(text)}; }

} // namespace nacre
