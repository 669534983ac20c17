// Fields and numbers of text files: what is left of plain formats that programs for calibration and reconstruction write.
#pragma once

#include <charconv>
#include <cmath>
#include <optional>
#include <span>
#include <string_view>
#include <system_error>
#include <vector>

namespace nacre {

inline std::string_view asText(std::span<const std::byte> bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

inline std::string_view trimmed(std::string_view text)
{
    constexpr std::string_view kSpace = " \t\r\n";
    const size_t first = text.find_first_not_of(kSpace);
    return first == std::string_view::npos ? std::string_view() : text.substr(first, text.find_last_not_of(kSpace) - first + 1);
}

/// Takes the next line off the front of `text`, without its end; false at the end of the text.
inline bool nextLine(std::string_view& text, std::string_view& line)
{
    if (text.empty()) return false;
    const size_t end = text.find('\n');
    line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (line.ends_with('\r')) line.remove_suffix(1);
    return true;
}

/// Takes the next word off the front of `line`; empty if there is none.
inline std::string_view nextWord(std::string_view& line)
{
    line = trimmed(line);
    const size_t end = line.find_first_of(" \t");
    const std::string_view word = line.substr(0, end);
    line.remove_prefix(word.size());
    return word;
}

/// A finite number that takes up the whole text.
inline std::optional<double> numberOf(std::string_view text)
{
    if (text.starts_with('+')) text.remove_prefix(1);
    double x = 0;
    const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), x);
    if (status != std::errc() || end != text.data() + text.size() || !std::isfinite(x)) return std::nullopt;
    return x;
}

/// A whole number that takes up the whole text.
template <class Integer>
std::optional<Integer> integerOf(std::string_view text)
{
    Integer x = 0;
    const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), x);
    if (status != std::errc() || end != text.data() + text.size()) return std::nullopt;
    return x;
}

/// All numbers of a text, separated by spaces, commas, semicolons, brackets or line ends; nothing if anything else is there.
inline std::optional<std::vector<double>> numbersOf(std::string_view text)
{
    constexpr std::string_view kBetween = " \t\r\n,;[]()";
    std::vector<double> out;
    for (size_t at = 0; (at = text.find_first_not_of(kBetween, at)) != std::string_view::npos;) {
        const size_t end = std::min(text.find_first_of(kBetween, at), text.size());
        const std::optional<double> x = numberOf(text.substr(at, end - at));
        if (!x) return std::nullopt;
        out.push_back(*x);
        at = end;
    }
    return out;
}

} // namespace nacre
