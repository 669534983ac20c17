// Text of reports: numbers with the digits that mean something, and foreign text that may stand in HTML, SVG and CSV.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace nacre {

/// For HTML and SVG, between tags and in quoted attributes: < > & " ' as entities, control characters gone (oneLine), and what is not UTF-8, or
/// not allowed in XML, as U+FFFD.
std::string escaped(std::string_view text);

/// At most `most` characters (not bytes), the last of them "…" where some are missing.
std::string shortened(std::string_view text, size_t most);

/// 8.3e-06 as 8.3e-6
std::string shortExponent(std::string number);
/// A dash where `x` is not finite. Never depends on the locale.
std::string fixedText(double x, int decimals);
/// Three significant digits, without an exponent from 0.001 to a million: 0.0123, 1.23, 12.3, 1,235.
std::string figureText(double x);
/// 41,688
std::string countText(double x);
/// 812 bytes, 1.24 MB (1 MB = 10^6 bytes).
std::string bytesText(double bytes);
/// 48 s, 3 min 20 s, 1 h 05 min.
std::string durationText(double seconds);

} // namespace nacre
