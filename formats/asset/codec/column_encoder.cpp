#include "asset/codec/column_format.h"
#include "asset/codec/columns.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nacre::codec {

namespace {

using Counts = std::array<uint32_t, kTokens>;

void putNumber(uint64_t n, std::vector<std::byte>& out)
{
    for (; n >= 128; n >>= 7) out.push_back(std::byte((n & 127) | 128));
    out.push_back(std::byte(n));
}

/// What is coded: zigzagged values, or differences from the row above within a run.
std::vector<uint32_t> codedNumbers(std::span<const int32_t> column, int flags)
{
    const size_t runs = runsOf(column.size()), rows = (column.size() + runs - 1) / runs;
    std::vector<uint32_t> coded(column.size());
    for (size_t i = 0; i < column.size(); ++i) {
        const uint32_t above = flags & kDifference && i % rows != 0 ? uint32_t(column[i - 1]) : 0;
        coded[i] = zigzag(int32_t(uint32_t(column[i]) - above));
    }
    return coded;
}

std::vector<uint8_t> contexts(std::span<const uint32_t> coded, std::span<const int32_t> left, int flags)
{
    const size_t runs = runsOf(coded.size()), rows = (coded.size() + runs - 1) / runs;
    std::vector<uint8_t> context(coded.size());
    for (size_t i = 0; i < coded.size(); ++i)
        context[i] = uint8_t(contextOf(flags, i % rows == 0 ? 0 : coded[i - 1], flags & kSeesLeft ? zigzag(left[i]) : 0));
    return context;
}

/// Frequencies that add up to one: every token that occurs has at least 1. Largest counts give or take what rounding left.
Counts normalised(const Counts& counts)
{
    Counts frequencies{};
    uint64_t total = 0;
    for (const uint32_t c : counts) total += c;
    if (total == 0) { // never met; still a table
        frequencies[0] = kProbabilityOne;
        return frequencies;
    }
    int64_t left = kProbabilityOne;
    for (int t = 0; t < kTokens; ++t) {
        if (counts[t] == 0) continue;
        frequencies[t] = uint32_t(std::max<uint64_t>(1, (counts[t] * uint64_t(kProbabilityOne) + total / 2) / total));
        left -= frequencies[t];
    }
    while (left != 0) {
        const auto most = std::max_element(frequencies.begin(), frequencies.end());
        const int64_t change = left > 0 ? left : std::max<int64_t>(left, -int64_t(*most / 2));
        *most = uint32_t(int64_t(*most) + change), left -= change;
    }
    return frequencies;
}

size_t tableBytes(const Counts& frequencies)
{
    size_t bytes = 0;
    uint32_t sum = 0;
    for (int t = 0; sum < kProbabilityOne; ++t) {
        if (frequencies[t] > 0) {
            bytes += frequencies[t] < 128 ? 1 : 2, sum += frequencies[t];
            continue;
        }
        while (t + 1 < kTokens && frequencies[t + 1] == 0) ++t;
        bytes += 2;
    }
    return bytes;
}

void putTable(const Counts& frequencies, std::vector<std::byte>& out)
{
    uint32_t sum = 0;
    for (int t = 0; sum < kProbabilityOne; ++t) {
        putNumber(frequencies[t], out);
        sum += frequencies[t];
        if (frequencies[t] > 0) continue;
        const int first = t;
        while (frequencies[t + 1] == 0) ++t;
        out.push_back(std::byte(t - first));
    }
}

struct Plan {
    int flags = 0;
    double bytes = 0;
    std::vector<uint32_t> coded;
    std::vector<uint8_t> context;
    std::vector<Counts> frequencies;
};

Plan planFor(std::span<const int32_t> column, std::span<const int32_t> left, int flags)
{
    Plan plan;
    plan.flags = flags;
    plan.coded = codedNumbers(column, flags);
    plan.context = contexts(plan.coded, left, flags);
    std::vector<Counts> counts(size_t(contextsOf(flags)), Counts{});
    for (size_t i = 0; i < column.size(); ++i) ++counts[plan.context[i]][tokenOf(plan.coded[i]).token];
    double bits = 0;
    for (const Counts& c : counts) {
        plan.frequencies.push_back(normalised(c));
        const Counts& f = plan.frequencies.back();
        bits += 8 * double(tableBytes(f));
        for (int t = 0; t < kTokens; ++t)
            if (c[t] > 0) bits += c[t] * (kProbabilityBits - std::log2(double(f[t])) + extraBitsOf(uint32_t(t)));
    }
    plan.bytes = bits / 8 + 4.0 * double(runsOf(column.size())) + 5;
    return plan;
}

Plan bestPlan(std::span<const int32_t> column, std::span<const int32_t> left)
{
    Plan best;
    for (int flags = 0; flags <= kAllFlags; ++flags) {
        if ((flags & kSeesLeft) && (left.empty() || left.size() != column.size())) continue;
        Plan plan = planFor(column, left, flags);
        if (flags == 0 || plan.bytes < best.bytes) best = std::move(plan);
    }
    return best;
}

class BitWriter {
public:
    void put(uint32_t value, int n)
    {
        bits_ |= uint64_t(value) << count_, count_ += n;
        for (; count_ >= 8; bits_ >>= 8, count_ -= 8) bytes.push_back(std::byte(bits_ & 255));
    }
    void end() { if (count_ > 0) put(0, 8 - count_); }
    std::vector<std::byte> bytes;

private:
    uint64_t bits_ = 0;
    int count_ = 0;
};

} // namespace

size_t encodedBytes(std::span<const int32_t> column, std::span<const int32_t> left) { return size_t(bestPlan(column, left).bytes); }

void encodeColumn(std::span<const int32_t> column, std::span<const int32_t> left, std::vector<std::byte>& out)
{
    const Plan plan = bestPlan(column, left);
    const size_t runs = runsOf(column.size()), rows = (column.size() + runs - 1) / runs;
    std::vector<Counts> starts(plan.frequencies.size(), Counts{});
    for (size_t c = 0; c < starts.size(); ++c)
        for (int t = 1; t < kTokens; ++t) starts[c][t] = starts[c][t - 1] + plan.frequencies[c][t - 1];

    // rANS is a stack: coded from the last to the first, decoded the other way round.
    std::vector<uint16_t> words;
    std::array<uint32_t, kRuns> states;
    states.fill(kLowestState);
    BitWriter extra;
    const auto inOrder = [&](auto&& visit, bool backwards) {
        for (size_t k = 0; k < rows; ++k)
            for (size_t l = 0; l < runs; ++l) {
                const size_t i = backwards ? rows - 1 - k : k, r = backwards ? runs - 1 - l : l, at = r * rows + i;
                if (at < column.size()) visit(at, r);
            }
    };
    inOrder([&](size_t at, size_t r) {
        const Token token = tokenOf(plan.coded[at]);
        const uint32_t frequency = plan.frequencies[plan.context[at]][token.token], start = starts[plan.context[at]][token.token];
        uint32_t& x = states[r];
        if (uint64_t(x) >= uint64_t(frequency) << (32 - kProbabilityBits)) words.push_back(uint16_t(x)), x >>= 16;
        x = (x / frequency << kProbabilityBits) + x % frequency + start;
    }, true);
    inOrder([&](size_t at, size_t) {
        const Token token = tokenOf(plan.coded[at]);
        if (token.extraBits > 0) extra.put(token.extra, token.extraBits);
    }, false);
    extra.end();

    out.push_back(std::byte(plan.flags));
    for (const Counts& f : plan.frequencies) putTable(f, out);
    for (size_t r = 0; r < runs; ++r)
        for (int b = 0; b < 4; ++b) out.push_back(std::byte(states[r] >> (8 * b) & 255));
    putNumber(words.size(), out);
    for (size_t w = words.size(); w-- > 0;) out.push_back(std::byte(words[w] & 255)), out.push_back(std::byte(words[w] >> 8));
    putNumber(extra.bytes.size(), out);
    out.insert(out.end(), extra.bytes.begin(), extra.bytes.end());
}

} // namespace nacre::codec
