// Base64 (RFC 4648, with padding): bytes as text of JSON.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace nacre {

constexpr char kBase64[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

inline std::string toBase64(const void* data, size_t size)
{
    const auto* bytes = static_cast<const unsigned char*>(data);
    std::string text;
    text.reserve((size + 2) / 3 * 4);
    for (size_t i = 0; i < size; i += 3) {
        const uint32_t word = uint32_t(bytes[i]) << 16 | (i + 1 < size ? uint32_t(bytes[i + 1]) << 8 : 0) | (i + 2 < size ? bytes[i + 2] : 0);
        for (size_t k = 0; k < 4; ++k) text += i + k <= size ? kBase64[word >> (18 - 6 * k) & 63] : '=';
    }
    return text;
}

/// False if the text is not exactly so; then `bytes` is undefined.
inline bool fromBase64(std::string_view text, std::vector<unsigned char>& bytes)
{
    static const std::array<int8_t, 256> digits = [] {
        std::array<int8_t, 256> table;
        table.fill(-1);
        for (int i = 0; i < 64; ++i) table[size_t(static_cast<unsigned char>(kBase64[i]))] = int8_t(i);
        return table;
    }();
    bytes.clear();
    if (text.size() % 4 != 0) return false;
    const size_t padding = text.ends_with("==") ? 2 : text.ends_with("=") ? 1 : 0;
    bytes.reserve(text.size() / 4 * 3);
    for (size_t i = 0; i < text.size(); i += 4) {
        uint32_t word = 0;
        for (size_t k = 0; k < 4; ++k) {
            const int digit = i + k >= text.size() - padding ? 0 : digits[static_cast<unsigned char>(text[i + k])];
            if (digit < 0) return false;
            word = word << 6 | uint32_t(digit);
        }
        for (int shift : {16, 8, 0}) bytes.push_back(static_cast<unsigned char>(word >> shift));
    }
    bytes.resize(bytes.size() - padding);
    return true;
}

} // namespace nacre
