// Small plain splats, and .ply files of them in any layout.
#pragma once

#include "splats/plain_splats.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>
#include <string>
#include <vector>

namespace nacre::test {

/// Every number a multiple of 1/64, a power of two or a simple unit quaternion.
inline PlainSplats makePlainSplats(size_t count, int functions)
{
    const auto value = [](size_t i) { return float(int(i * 37 % 129) - 64) / 64.0f; };
    PlainSplats splats;
    splats.cloud.count = count;
    for (size_t i = 0; i < count; ++i) {
        splats.cloud.positions.emplace_back(value(3 * i), value(3 * i + 1), value(3 * i + 2));
        splats.cloud.rotations.push_back(i % 2 ? glm::quat(0.6f, 0.0f, -0.8f, 0.0f) : glm::quat(0.5f, 0.5f, -0.5f, 0.5f));
        splats.cloud.scales.emplace_back(float(i + 1) / 64.0f, 0.25f, 1.0f / 1024.0f);
        splats.cloud.opacities.push_back(float(i % 63 + 1) / 64.0f);
    }
    splats.look.shFunctions = functions;
    for (size_t k = 0; k < count * size_t(functions); ++k) splats.look.sh.emplace_back(value(k), value(k + 5), value(k + 11));
    return splats;
}

struct PlyLayout {
    std::string format, type;
    unsigned shuffle = 0;           // order of the properties; 0: as trainers write them
    bool before = false, after = false; // another element
    std::string property{}, value{};    // of splat 1, as text
};

inline std::vector<std::byte> writePly(const PlainSplats& splats, const PlyLayout& layout)
{
    const size_t functions = size_t(splats.look.shFunctions), rest = 3 * (functions - 1);
    std::vector<std::string> names{"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"};
    for (size_t k = 0; k < rest; ++k) names.push_back("f_rest_" + std::to_string(k));
    names.push_back("confidence"); // which nobody knows
    std::vector<size_t> order(names.size());
    std::iota(order.begin(), order.end(), 0);
    for (size_t k = order.size(); layout.shuffle && k > 1; --k) std::swap(order[k - 1], order[k * layout.shuffle * 2654435761u % k]);

    const bool text = layout.format == "ascii", wide = layout.type != "float", big = layout.format == "binary_big_endian";
    std::string out = "ply\nformat " + layout.format + " 1.0\ncomment any\n";
    if (layout.before) out += "element camera 2\nproperty uchar id\nproperty short at\n";
    out += "element vertex " + std::to_string(splats.cloud.count) + "\n";
    for (size_t k : order) out += "property " + std::string(names[k] == "confidence" ? "uchar" : layout.type) + " " + names[k] + "\n";
    if (layout.after) out += "element face 1\nproperty list uchar int vertex_indices\n";
    out += "end_header\n";

    const auto put = [&](auto number) {
        char bytes[sizeof number];
        std::memcpy(bytes, &number, sizeof number);
        if (big) std::reverse(bytes, bytes + sizeof number);
        out.append(bytes, sizeof number);
    };
    if (layout.before) out += text ? "1 2\r\n3\t4\n" : std::string("\1\0\2\3\0\4", 6);
    for (size_t i = 0; i < splats.cloud.count; ++i) {
        const SplatCloud& c = splats.cloud;
        const glm::quat& q = c.rotations[i];
        std::vector<double> values;
        for (int k = 0; k < 3; ++k) values.push_back(c.positions[i][k]);
        for (int k = 0; k < 3; ++k) values.push_back(splats.look.sh[i * functions][k]);
        values.push_back(std::log(double(c.opacities[i]) / (1 - double(c.opacities[i]))));
        for (int k = 0; k < 3; ++k) values.push_back(std::log(double(c.scales[i][k])));
        for (float x : {q.w, q.x, q.y, q.z}) values.push_back(3 * double(x)); // of any length
        for (int k = 0; k < 3; ++k)
            for (size_t f = 1; f < functions; ++f) values.push_back(splats.look.sh[i * functions + f][k]);
        values.push_back(200);
        for (size_t k : order) {
            if (text) out += (i == 1 && names[k] == layout.property ? layout.value : std::to_string(values[k])) + " ";
            else if (names[k] == "confidence") put(uint8_t(values[k]));
            else if (wide) put(values[k]);
            else put(float(values[k]));
        }
        if (text) out += "\n";
    }
    if (layout.after) out += text ? "3 0 0 0\n" : std::string("\3\0\0\0\0\0\0\0\0\0\0\0\0", 13);
    std::vector<std::byte> bytes(out.size());
    std::memcpy(bytes.data(), out.data(), out.size());
    return bytes;
}

/// The first `from` made `to`.
inline std::vector<std::byte> replaced(const std::vector<std::byte>& bytes, const std::string& from, const std::string& to)
{
    std::string text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const size_t at = text.find(from);
    if (at == std::string::npos) return {};
    text.replace(at, from.size(), to);
    std::vector<std::byte> out(text.size());
    std::memcpy(out.data(), text.data(), text.size());
    return out;
}

} // namespace nacre::test
