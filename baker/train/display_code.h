// Γ of a linear value as 16-bit unorm, from tables: about 3 ns where pow takes 20.
#pragma once

#include <cstdint>
#include <vector>

namespace nacre {

class DisplayCodes {
public:
    static const DisplayCodes& table();
    /// lround(65535 Γ(x)), x from 0 to 1; at most 1 beside it where pow is not monotonic to its last bit.
    uint16_t operator()(float x) const;

private:
    DisplayCodes();
    struct Cell { float code, perStep; }; // of its first float, and to add for each of the others
    std::vector<Cell> cells_;             // each a 256th of an octave
    std::vector<float> least_;            // the first float of each code
};

} // namespace nacre
