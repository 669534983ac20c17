#include "asset/codec/column_format.h"
#include "asset/codec/columns.h"

#include <algorithm>
#include <cstring>

namespace nacre::codec {

namespace {

/// Bytes from the front; once they end, `good` is false and zeros come.
struct Bytes {
    std::span<const std::byte> rest;
    bool good = true;

    uint8_t byte()
    {
        if (rest.empty()) return good = false, 0;
        const auto b = uint8_t(rest[0]);
        rest = rest.subspan(1);
        return b;
    }
    uint64_t number() // LEB128
    {
        uint64_t n = 0;
        for (int shift = 0; shift < 35; shift += 7) {
            const uint8_t b = byte();
            n |= uint64_t(b & 127) << shift;
            if (b < 128) return n;
        }
        return good = false, 0;
    }
    std::span<const std::byte> take(uint64_t size)
    {
        if (size > rest.size()) return good = false, std::span<const std::byte>();
        const auto taken = rest.first(size_t(size));
        rest = rest.subspan(size_t(size));
        return taken;
    }
};

/// One context's symbols by the low bits of the state. Small, so that all of them lie in the nearest cache.
struct Table {
    struct Symbol {
        uint16_t frequency, start;
    };
    std::array<uint8_t, kProbabilityOne> slots; // the token
    std::array<Symbol, kTokens> symbols;

    bool read(Bytes& bytes)
    {
        uint32_t next = 0;
        for (uint32_t token = 0; next < kProbabilityOne; ++token) {
            if (token >= uint32_t(kTokens)) return false;
            uint32_t frequency = uint32_t(bytes.number());
            if (!bytes.good || frequency > kProbabilityOne - next) return false;
            if (frequency == 0) { // and so many more tokens do not occur
                token += bytes.byte();
                continue;
            }
            std::memset(&slots[next], int(token), frequency);
            symbols[token] = {uint16_t(frequency), uint16_t(next)};
            next += frequency;
        }
        return bytes.good;
    }
};

struct BitReader {
    std::span<const std::byte> bytes;
    size_t at = 0;
    uint64_t bits = 0;
    int count = 0;
    bool good = true;

    uint32_t take(int n)
    {
        while (count < n) {
            if (at >= bytes.size()) return good = false, 0;
            bits |= uint64_t(bytes[at++]) << count, count += 8;
        }
        const auto value = uint32_t(bits & ((uint64_t(1) << n) - 1));
        bits >>= n, count -= n;
        return value;
    }
};

struct Streams {
    const std::byte* words;
    size_t wordCount, word = 0;
    BitReader extra;

    /// Takes a word where the state has become small. Without a branch, which would be mispredicted; past the end come zeros.
    void refill(uint32_t& state)
    {
        static constexpr std::byte kNone[2] = {};
        uint16_t w;
        std::memcpy(&w, word < wordCount ? words + 2 * word : kNone, 2);
        const bool small = state < kLowestState;
        const uint32_t shift = 16 * uint32_t(small);
        state = state << shift | (w & (0u - uint32_t(small)));
        word += small;
    }
};

/// One run's coder.
struct Run {
    uint32_t state = 0, above = 0;
    int32_t value = 0;
    size_t row = 0;
};

inline void decodeRow(Run& run, const Table* tables, int flags, Streams& streams, std::span<int32_t> column, std::span<const int32_t> left)
{
    const uint32_t leftSize = flags & kSeesLeft ? zigzag(left[run.row]) : 0;
    const Table& table = tables[contextOf(flags, run.above, leftSize)];
    const uint32_t slot = run.state & (kProbabilityOne - 1), token = table.slots[slot];
    const Table::Symbol symbol = table.symbols[token];
    run.state = symbol.frequency * (run.state >> kProbabilityBits) + slot - symbol.start;
    streams.refill(run.state);
    const uint32_t coded = token < 16 ? token : firstOfToken(token) + streams.extra.take(extraBitsOf(token));
    run.above = coded;
    const int32_t v = unzigzag(coded);
    run.value = flags & kDifference ? int32_t(uint32_t(run.value) + uint32_t(v)) : v;
    column[run.row++] = run.value;
}

} // namespace

struct ColumnDecoder::Tables {
    std::array<Table, kMostContexts> of;
};

// Not zeroed: a table that is read has all of its slots, and of symbols those that they name.
ColumnDecoder::ColumnDecoder(std::span<const std::byte> bytes) : rest_(bytes), tables_(new Tables) {}
ColumnDecoder::~ColumnDecoder() = default;

bool ColumnDecoder::next(std::span<int32_t> column, std::span<const int32_t> left)
{
    Bytes bytes{rest_};
    const int flags = bytes.byte();
    if ((flags & ~kAllFlags) != 0 || ((flags & kSeesLeft) && left.size() != column.size())) return false;
    Table* const tables = tables_->of.data();
    for (int c = 0; c < contextsOf(flags); ++c)
        if (!tables[c].read(bytes)) return false;

    const size_t runs = runsOf(column.size()), rows = (column.size() + runs - 1) / runs;
    std::array<Run, kRuns> run;
    for (size_t r = 0; r < runs; ++r) {
        const auto state = bytes.take(4);
        if (!bytes.good) return false;
        std::memcpy(&run[r].state, state.data(), 4);
        if (run[r].state < kLowestState) return false;
        run[r].row = r * rows;
    }
    const auto words = bytes.take(2 * bytes.number());
    const auto extra = bytes.take(bytes.number());
    if (!bytes.good) return false;
    Streams streams{words.data(), words.size() / 2, 0, {extra}};
    const size_t shortest = column.size() - (runs - 1) * rows; // the last run
    if (runs == kRuns) // a count that the compiler knows: the states stay in registers
        for (size_t i = 0; i < shortest; ++i)
            for (size_t r = 0; r < kRuns; ++r) decodeRow(run[r], tables, flags, streams, column, left);
    else
        for (size_t i = 0; i < shortest; ++i) decodeRow(run[0], tables, flags, streams, column, left);
    for (size_t i = shortest; i < rows; ++i)
        for (size_t r = 0; r + 1 < runs; ++r) decodeRow(run[r], tables, flags, streams, column, left);
    bool ended = streams.word == streams.wordCount && streams.extra.good && streams.extra.at == extra.size();
    for (size_t r = 0; r < runs; ++r) ended &= run[r].state == kLowestState;
    rest_ = bytes.rest;
    return ended;
}

} // namespace nacre::codec
