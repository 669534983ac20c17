// Any bytes into the decoder of integer columns: false, or columns that come back the same when they are encoded again.
#include "asset/codec/columns.h"

#include <cstdlib>
#include <cstring>

using namespace nacre;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    if (size < 3) return 0;
    const size_t rows = data[0] + 256 * size_t(data[1] % 8), columns = 1 + data[2] % 4;
    codec::ColumnDecoder decoder(std::as_bytes(std::span(data + 3, size - 3)));
    std::vector<std::vector<int32_t>> decoded;
    for (size_t k = 0; k < columns; ++k) {
        std::vector<int32_t> column(rows);
        if (!decoder.next(column, k > 0 ? std::span<const int32_t>(decoded.back()) : std::span<const int32_t>())) return 0;
        decoded.push_back(std::move(column));
    }
    std::vector<std::byte> bytes;
    for (size_t k = 0; k < columns; ++k) codec::encodeColumn(decoded[k], k > 0 ? std::span<const int32_t>(decoded[k - 1]) : std::span<const int32_t>(), bytes);
    codec::ColumnDecoder again(bytes);
    for (size_t k = 0; k < columns; ++k) {
        std::vector<int32_t> column(rows);
        if (!again.next(column, k > 0 ? std::span<const int32_t>(decoded[k - 1]) : std::span<const int32_t>()) || column != decoded[k]) std::abort();
    }
    if (again.rest() != 0) std::abort();
    return 0;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    if (i >= 4) return 0;
    const size_t rows = i == 0 ? 1 : i == 1 ? 40 : 300, columns = 1 + i;
    std::vector<std::byte> bytes = {std::byte(rows % 256), std::byte(rows / 256), std::byte(columns - 1)};
    std::vector<int32_t> left, column;
    for (size_t k = 0; k < columns; ++k) {
        column.resize(rows);
        for (size_t r = 0; r < rows; ++r) column[r] = int32_t(r * r * 2654435761u >> (k == 2 ? 8 : 28)) - 7;
        codec::encodeColumn(column, k > 0 ? std::span<const int32_t>(left) : std::span<const int32_t>(), bytes);
        left = column;
    }
    if (bytes.size() > cap) std::abort();
    std::memcpy(out, bytes.data(), bytes.size());
    return bytes.size();
}
