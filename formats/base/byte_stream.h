// Little-endian reading and writing of plain values in memory. The reader never goes past the end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace nacre {

class ByteWriter {
public:
    template <class T>
    void value(const T& x)
    {
        static_assert(std::is_trivially_copyable_v<T>);
        append(&x, sizeof(T));
    }
    template <class Vector>
    void array(const Vector& v) // a contiguous container of trivially copyable values, with its length in front
    {
        value(uint64_t(v.size()));
        append(v.data(), v.size() * sizeof(v[0]));
    }
    std::vector<std::byte> bytes;

private:
    void append(const void* data, size_t size)
    {
        const size_t at = bytes.size();
        bytes.resize(at + size);
        if (size) std::memcpy(bytes.data() + at, data, size);
    }
};

/// After any failed read `failed` stays true and every value reads as zero.
class ByteReader {
public:
    explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}
    template <class T>
    T value()
    {
        static_assert(std::is_trivially_copyable_v<T>);
        T x{};
        if (failed || remaining() < sizeof(T) || (std::is_same_v<T, bool> && std::to_integer<int>(bytes_[offset_]) > 1)) {
            failed = true;
            return x;
        }
        std::memcpy(&x, bytes_.data() + offset_, sizeof(T));
        offset_ += sizeof(T);
        return x;
    }
    template <class Vector>
    void array(Vector& v)
    {
        const uint64_t count = value<uint64_t>();
        if (failed || count > remaining() / sizeof(v[0])) { // before allocating
            failed = true;
            return;
        }
        v.resize(count);
        if (count) std::memcpy(v.data(), bytes_.data() + offset_, count * sizeof(v[0]));
        offset_ += count * sizeof(v[0]);
    }
    size_t remaining() const { return bytes_.size() - offset_; }
    bool failed = false;

private:
    std::span<const std::byte> bytes_;
    size_t offset_ = 0;
};

} // namespace nacre
