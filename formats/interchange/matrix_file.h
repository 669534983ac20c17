// Matrices of numbers in files: MATLAB (.mat, version 5), NumPy (.npy), OpenCV's YAML and plain text. What calibrations come in.
#pragma once

#include "base/result.h"

#include <cstddef>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace nacre {

struct Matrix {
    size_t rows = 0, columns = 0;
    std::vector<double> values; // row by row
    double at(size_t row, size_t column) const { return values[row * columns + column]; }
};

/// The real, two-dimensional number matrices of at most 64 KiB by name; other variables are passed over. Any bytes are safe. Errors kBadInput: not
/// such a file, cut off, broken (checksums of compressed variables are verified); kUnsupported: version 4 or 7.3, big-endian.
Result<std::map<std::string, Matrix>> decodeMat(std::span<const std::byte> bytes, const std::string& name);

/// One array of at most two dimensions of float32, float64, int32 or int64, little-endian. Any bytes are safe.
Result<Matrix> decodeNpy(std::span<const std::byte> bytes, const std::string& name);

/// Every key of a YAML file that has numbers behind it, as OpenCV's FileStorage or others write them: scalars, lists in brackets, lists of lines that
/// begin with "-", and !!opencv-matrix. Numbers are in one row, whatever their nesting. Other values are passed over. Any bytes are safe.
Result<std::map<std::string, std::vector<double>>> decodeYamlNumbers(std::span<const std::byte> bytes, const std::string& name);

/// Numbers in lines of equal length, separated by spaces or commas; # begins a comment. Any bytes are safe.
Result<Matrix> decodeTextMatrix(std::span<const std::byte> bytes, const std::string& name);

} // namespace nacre
