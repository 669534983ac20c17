#include "selftest/values.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace nacre::selftest {

static double unitOf(const ValueGroup& reference)
{
    if (reference.unit > 0) return reference.unit;
    double largest = 0;
    for (const double v : reference.values) largest = std::max(largest, std::abs(v));
    return largest > 0 ? largest : 1;
}

Deviation deviation(const Values& values, const Values& reference)
{
    assert(values.size() == reference.size());
    Deviation out;
    size_t count = 0;
    for (size_t g = 0; g < reference.size(); ++g) {
        const std::vector<double>&a = values[g].values, &b = reference[g].values;
        assert(a.size() == b.size());
        const double unit = unitOf(reference[g]);
        for (size_t i = 0; i < b.size(); ++i, ++count) {
            const double d = std::isfinite(a[i]) && std::isfinite(b[i]) ? std::abs(a[i] - b[i]) / unit : std::numeric_limits<double>::infinity();
            if (d > out.max) out.max = d, out.worst = reference[g].name;
            out.mean += d;
        }
    }
    out.mean /= double(std::max<size_t>(count, 1));
    return out;
}

bool allFinite(const Values& values)
{
    for (const ValueGroup& group : values)
        for (const double v : group.values)
            if (!std::isfinite(v)) return false;
    return true;
}

} // namespace nacre::selftest
