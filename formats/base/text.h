// Text from outside (files, other libraries) made fit for one line of a message or a terminal.
#pragma once

#include <charconv>
#include <string>
#include <string_view>

namespace nacre {

/// Control characters, escape sequences of terminals among them, become '?', line breaks and tabs a space; white space at the end goes.
/// A text of more than `maxBytes` loses its middle. UTF-8 passes.
inline std::string oneLine(std::string_view text, size_t maxBytes = std::string_view::npos)
{
    while (!text.empty() && std::string_view(" \t\r\n").find(text.back()) != std::string_view::npos) text.remove_suffix(1);
    std::string line(text);
    if (line.size() > maxBytes) line = line.substr(0, maxBytes / 2) + "..." + line.substr(line.size() - maxBytes / 2);
    for (size_t i = 0; i < line.size(); ++i) {
        const auto c = static_cast<unsigned char>(line[i]);
        if (c == '\n' || c == '\r' || c == '\t')
            line[i] = ' ';
        else if (c < 0x20 || c == 0x7f)
            line[i] = '?';
        else if (c == 0xc2 && i + 1 < line.size() && (static_cast<unsigned char>(line[i + 1]) & 0xe0) == 0x80) // U+0080 to U+009F
            line.replace(i, 2, "?");
    }
    return line;
}

/// The shortest text that reads back as `value`, whatever the locale: printf and std::to_string follow the host's decimal comma.
template <class Float>
std::string numberText(Float value)
{
    char text[64];
    return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

/// oneLine with quotes around it: what a message quotes from a file.
inline std::string inQuotes(std::string_view text) { return std::string(1, '\'').append(oneLine(text, 200)).append(1, '\''); }

} // namespace nacre
