// MAT and NumPy files spelled out byte by byte: independent witnesses for the readers.
#pragma once

#include "dataset_file_builders.h"
#include "mesh_jpeg_builder.h" // brings stb's compressor along

#include <map>

namespace nacre {

struct MatBuilder {
    bool compressed = false, singleBytes = false; // values stored as uint8
    Bytes bytes;

    MatBuilder()
    {
        std::string header = "MATLAB 5.0 MAT-file";
        header.resize(124, ' ');
        append(bytes, header.data(), header.size());
        appendValue(bytes, uint16_t(0x0100));
        append(bytes, "IM", 2);
    }
    /// `values` row by row.
    void add(const std::string& name, int32_t rows, int32_t columns, const std::vector<double>& values)
    {
        Bytes inside;
        const auto element = [&](uint32_t type, const void* data, size_t size) {
            if (size <= 4) { // in the tag
                appendValue(inside, uint32_t(type | size << 16));
                append(inside, data, size);
                inside.resize(inside.size() + 4 - size);
                return;
            }
            appendValue(inside, type), appendValue(inside, uint32_t(size));
            append(inside, data, size);
            inside.resize((inside.size() + 7) / 8 * 8);
        };
        const uint32_t flags[] = {6, 0};
        const int32_t dimensions[] = {rows, columns};
        element(6, flags, sizeof flags), element(5, dimensions, sizeof dimensions), element(1, name.data(), name.size());
        std::vector<double> columnwise;
        std::vector<uint8_t> narrow;
        for (int32_t c = 0; c < columns; ++c)
            for (int32_t r = 0; r < rows; ++r) columnwise.push_back(values[size_t(r * columns + c)]), narrow.push_back(uint8_t(columnwise.back()));
        if (singleBytes) element(2, narrow.data(), narrow.size());
        else element(9, columnwise.data(), 8 * columnwise.size());
        Bytes matrix;
        appendValue(matrix, uint32_t(14)), appendValue(matrix, uint32_t(inside.size()));
        append(matrix, inside.data(), inside.size());
        if (!compressed) {
            append(bytes, matrix.data(), matrix.size());
            return;
        }
        int size = 0;
        unsigned char* zlib = stbi_zlib_compress(reinterpret_cast<unsigned char*>(matrix.data()), int(matrix.size()), &size, 8);
        appendValue(bytes, uint32_t(15)), appendValue(bytes, uint32_t(size));
        append(bytes, zlib, size_t(size));
        STBIW_FREE(zlib);
    }
};

inline Bytes npyOf(const std::string& kind, const std::string& shape, const std::vector<double>& values, bool columnwise = false)
{
    std::string header = "{'descr': '" + kind + "', 'fortran_order': " + (columnwise ? "True" : "False") + ", 'shape': " + shape + ", }";
    header.resize((header.size() + 10 + 64) / 64 * 64 - 10, ' ');
    Bytes out;
    append(out, "\x93NUMPY\x01\0", 8);
    appendValue(out, uint16_t(header.size()));
    append(out, header.data(), header.size());
    for (double v : values) kind == "<f4" ? appendValue(out, float(v)) : appendValue(out, v);
    return out;
}

} // namespace nacre
