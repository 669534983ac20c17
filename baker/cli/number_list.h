// Numbers of command line options.
#pragma once

#include <cmath>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

namespace nacre::cli {

/// "1,2,3" -> numbers; nothing for anything that is not finite numbers between commas.
inline std::optional<std::vector<double>> numbersIn(const std::string& text)
{
    std::vector<double> out;
    const char* at = text.c_str();
    for (;;) {
        char* end = nullptr;
        out.push_back(std::strtod(at, &end));
        if (end == at || !std::isfinite(float(out.back()))) return std::nullopt;
        if (*end == '\0') return out;
        if (*end != ',') return std::nullopt;
        at = end + 1;
    }
}

} // namespace nacre::cli
