#include "eval/report_text.h"

#include "base/text.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>

namespace nacre {

namespace {

constexpr const char* kDash = "\u2013";

/// Bytes of the character that starts the text, 0 if it is not UTF-8 or not a character of XML.
size_t characterBytes(std::string_view text)
{
    const auto byte = [&](size_t i) { return uint32_t(static_cast<unsigned char>(text[i])); };
    const uint32_t first = byte(0);
    const size_t size = first < 0x80                    ? 1
                        : first >= 0xc2 && first < 0xe0 ? 2
                        : first >= 0xe0 && first < 0xf0 ? 3
                        : first >= 0xf0 && first < 0xf5 ? 4
                                                        : 0;
    if (size == 0 || size > text.size()) return 0;
    uint32_t code = size == 1 ? first : first & (0xffu >> (size + 1));
    for (size_t i = 1; i < size; ++i) {
        if ((byte(i) & 0xc0) != 0x80) return 0;
        code = code << 6 | (byte(i) & 0x3f);
    }
    const bool overlong = (size == 3 && code < 0x800) || (size == 4 && code < 0x10000);
    return overlong || (code >= 0xd800 && code < 0xe000) || code == 0xfffe || code == 0xffff || code > 0x10ffff ? 0 : size;
}

std::string withCommas(std::string digits)
{
    const size_t start = digits.starts_with('-') ? 1 : 0;
    for (size_t at = std::min(digits.find('.'), digits.size()); at > start + 3;) digits.insert(at -= 3, 1, ',');
    return digits;
}

} // namespace

std::string escaped(std::string_view text)
{
    const std::string line = oneLine(text);
    std::string out;
    for (size_t i = 0; i < line.size();) {
        const size_t size = characterBytes(std::string_view(line).substr(i));
        switch (line[i]) {
        case '<': out += "&lt;"; break;
        case '>': out += "&gt;"; break;
        case '&': out += "&amp;"; break;
        case '"': out += "&quot;"; break;
        case '\'': out += "&#39;"; break;
        default: out += size ? line.substr(i, size) : "\ufffd";
        }
        i += std::max<size_t>(size, 1);
    }
    return out;
}

std::string shortened(std::string_view text, size_t most)
{
    const auto starts = [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; };
    if (size_t(std::count_if(text.begin(), text.end(), starts)) <= most) return std::string(text);
    size_t at = 0;
    for (size_t characters = 0; at < text.size(); ++at)
        if (starts(text[at]) && ++characters == std::max<size_t>(most, 1)) break; // the place of the last that may stay
    return std::string(text.substr(0, at)) + "…";
}

std::string shortExponent(std::string number)
{
    const size_t e = number.find('e');
    if (e == std::string::npos) return number;
    const size_t digits = std::min(number.find_first_not_of("+-0", e + 1), number.size() - 1);
    return number.substr(0, e) + (number[e + 1] == '-' ? "e-" : "e") + number.substr(digits);
}

std::string fixedText(double x, int decimals)
{
    if (!std::isfinite(x)) return kDash;
    char text[64];
    const bool huge = std::abs(x) >= 1e15;
    std::string out(
        text, std::to_chars(text, text + sizeof text, x, huge ? std::chars_format::scientific : std::chars_format::fixed, huge ? 2 : decimals).ptr);
    if (out.starts_with('-') && out.find_first_not_of("-0.") == std::string::npos) out.erase(0, 1); // no -0.00
    return huge ? shortExponent(out) : withCommas(out);
}

std::string figureText(double x)
{
    if (!std::isfinite(x)) return kDash;
    if (x == 0) return "0";
    if (std::abs(x) < 1e-3 || std::abs(x) >= 1e6) {
        char text[64];
        return shortExponent({text, std::to_chars(text, text + sizeof text, x, std::chars_format::scientific, 1).ptr});
    }
    return fixedText(x, std::clamp(2 - int(std::floor(std::log10(std::abs(x)))), 0, 5));
}

std::string countText(double x) { return fixedText(x, 0); }

std::string bytesText(double bytes)
{
    if (std::abs(bytes) < 1000 || !std::isfinite(bytes))
        return countText(bytes) + (std::isfinite(bytes) ? std::abs(bytes) == 1 ? " byte" : " bytes" : "");
    const int power = std::clamp(int(std::floor(std::log10(std::abs(bytes)) / 3)), 1, 4);
    static constexpr const char* kUnits[] = {"", " kB", " MB", " GB", " TB"};
    return figureText(bytes / std::pow(1000.0, power)) + kUnits[power];
}

std::string durationText(double seconds)
{
    if (!std::isfinite(seconds) || seconds < 0) return kDash;
    if (seconds < 60 || seconds > 1e9) return figureText(seconds) + " s";
    const auto whole = static_cast<long long>(std::llround(seconds));
    const auto two = [](long long v) { return std::string(v < 10 ? "0" : "").append(std::to_string(v)); };
    if (whole < 3600) return std::to_string(whole / 60) + " min " + two(whole % 60) + " s";
    return std::to_string(whole / 3600) + " h " + two(whole / 60 % 60) + " min";
}

} // namespace nacre
