// What a case measures, and how far one column is from another.
#pragma once

#include <string>
#include <vector>

namespace nacre::selftest {

/// Numbers of one kind, which are compared in units of the largest of the reference, or of `unit` if that is not 0.
struct ValueGroup {
    std::string name; // "colour", "alpha", ...
    std::vector<double> values;
    double unit = 0;
};
using Values = std::vector<ValueGroup>;

struct Deviation {
    double max = 0, mean = 0;  // infinite where a value is NaN or infinite and its reference is not
    std::string worst;         // the group of the largest
};

/// Of equal shapes.
Deviation deviation(const Values& values, const Values& reference);
bool allFinite(const Values& values);

} // namespace nacre::selftest
