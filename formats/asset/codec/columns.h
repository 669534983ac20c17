// Columns of integers as few bytes: the entropy coder of the profile `compact` (SPEC.md, section 8).
//
// An integer becomes a token, which says its magnitude, and raw bits. Tokens are coded by rANS (Duda, "Asymmetric numeral systems", 2013)
// with 12-bit frequencies, after a small context: how large the value above (of the row before) and the value to the left (of the column
// before) are. Splats come along a space-filling curve, so values above resemble; splats that hardly show have zeros in a whole row.
// A column is coded in four runs of consecutive rows, each with a coder state of its own: the processor decodes them side by side.
#pragma once

#include "base/result.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace nacre::codec {

/// Appends one column. `left`: the column before, of as many rows, or empty. Deterministic.
void encodeColumn(std::span<const int32_t> column, std::span<const int32_t> left, std::vector<std::byte>& out);

/// What encodeColumn spends on `column`, in bytes.
size_t encodedBytes(std::span<const int32_t> column, std::span<const int32_t> left);

/// Flags, a table, a state and two counts.
constexpr size_t kLeastColumnBytes = 9;

/// Decodes columns one after the other. Any bytes are safe; memory beyond the caller's own is 40 KiB of tables, kept between columns.
class ColumnDecoder {
public:
    explicit ColumnDecoder(std::span<const std::byte> bytes);
    ~ColumnDecoder();
    /// False for damaged bytes; `column` then holds anything. `left` as in encodeColumn.
    bool next(std::span<int32_t> column, std::span<const int32_t> left);
    /// Bytes not read yet.
    size_t rest() const { return rest_.size(); }

private:
    struct Tables;
    std::span<const std::byte> rest_;
    std::unique_ptr<Tables> tables_;
};

} // namespace nacre::codec
