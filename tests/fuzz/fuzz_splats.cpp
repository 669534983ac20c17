// Any bytes as .ply and as plain .glb: an error of one line, or splats that survive another round trip.
#include "plain_splats_fixtures.h"

#include "interchange/ply.h"
#include "interchange/splat_glb.h"

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iterator>

using namespace nacre;

namespace {

void check(bool condition)
{
    if (!condition) std::abort();
}

void checkError(const Error& error) { check(!error.message.empty() && error.message.find('\n') == std::string::npos); }

void checkSplats(const PlainSplats& splats)
{
    const SplatCloud& cloud = splats.cloud;
    const size_t functions = size_t(splats.look.shFunctions);
    check(cloud.count > 0 && cloud.positions.size() == cloud.count && cloud.rotations.size() == cloud.count && cloud.scales.size() == cloud.count);
    check(cloud.opacities.size() == cloud.count && splats.look.sh.size() == cloud.count * functions);
    for (size_t i = 0; i < cloud.count; ++i) {
        check(cloud.opacities[i] >= 0 && cloud.opacities[i] <= 1);
        check(std::abs(glm::length(cloud.rotations[i]) - 1) < 1e-3f);
        for (int k = 0; k < 3; ++k) check(cloud.scales[i][k] > 0 && std::isfinite(cloud.scales[i][k]) && std::isfinite(cloud.positions[i][k]));
    }
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    const std::span bytes(reinterpret_cast<const std::byte*>(data), size);
    if (const auto ply = decodePly(bytes)) {
        checkSplats(ply->splats);
        const auto again = decodePly(encodePly(ply->splats));
        check(again && again->splats.cloud.count == ply->splats.cloud.count);
    } else {
        checkError(ply.error());
    }
    if (const auto glb = decodeSplatGlb(bytes, "fuzz")) {
        checkSplats(*glb);
        check(bool(encodeSplatGlb(*glb)));
    } else {
        checkError(glb.error());
    }
    return 0;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    static const test::PlyLayout kLayouts[] = {{"binary_little_endian", "float", 0}, {"binary_big_endian", "double", 5}, {"ascii", "float", 2}};
    std::vector<std::byte> bytes;
    if (i < std::size(kLayouts)) bytes = test::writePly(test::makePlainSplats(2, i == 2 ? 1 : 4), kLayouts[i]);
    else if (i < std::size(kLayouts) + 2) bytes = *encodeSplatGlb(test::makePlainSplats(2, i % 2 ? 1 : 9));
    else return 0;
    check(bytes.size() <= cap);
    std::memcpy(out, bytes.data(), bytes.size());
    return bytes.size();
}
