#include "pack/quantise.h"

#include "base/octahedral.h"
#include "pack/leading_rows.h"
#include "pack/principal_axes.h"
#include "splats/morton.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace nacre {

namespace {

// ---- Making ready

/// Of the 24 rotations that give the same splat with its axes renamed, the one nearest to none: small numbers, and one hemisphere.
void canonicalRotation(glm::quat& rotation, glm::vec3& scale)
{
    const glm::mat3 axes = glm::mat3_cast(glm::normalize(rotation));
    glm::quat best(1, 0, 0, 0);
    glm::vec3 bestScale = scale;
    float most = -1;
    constexpr int kOrders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    for (const auto& order : kOrders)
        for (int signs = 0; signs < 4; ++signs) {
            glm::mat3 m(axes[order[0]] * (signs & 1 ? -1.0f : 1.0f), axes[order[1]] * (signs & 2 ? -1.0f : 1.0f), glm::vec3(0));
            m[2] = glm::cross(m[0], m[1]);
            glm::quat q = glm::quat_cast(m);
            if (q.w < 0) q = -q;
            if (q.w > most) most = q.w, best = q, bestScale = {scale[order[0]], scale[order[1]], scale[order[2]]};
        }
    rotation = glm::normalize(best), scale = bestScale;
}

/// An axis this much thinner than the splat is wide does not show: bits must not tell how thin.
constexpr float kThinnest = 1.0f / 32;

double deviation(const float* values, size_t rows, size_t stride, size_t components)
{
    double sum = 0;
    for (size_t c = 0; c < components; ++c) {
        double mean = 0, square = 0;
        for (size_t i = 0; i < rows; ++i) mean += values[i * stride + c], square += double(values[i * stride + c]) * values[i * stride + c];
        mean /= double(rows);
        sum += std::max(0.0, square / double(rows) - mean * mean);
    }
    return std::sqrt(sum / double(components));
}

std::vector<QuantGroup> groupsOf(const SplatAsset& asset)
{
    std::vector<float> sizes;
    for (const glm::vec3& s : asset.cloud.scales) sizes.push_back(std::max({s.x, s.y, s.z}));
    std::nth_element(sizes.begin(), sizes.begin() + ptrdiff_t(sizes.size() / 2), sizes.end());
    std::vector<QuantGroup> groups = {{"position", {{"POSITION", 0, 3}}, BlockTransform::kLinear, "", 3, 0.1 * sizes[sizes.size() / 2]},
                                      {"rotation", {{"ROTATION", 0, 4}}, BlockTransform::kRotation, "", 3, 0.03},
                                      {"scale", {{"SCALE", 0, 3}}, BlockTransform::kExp, "", 3, 0.15},
                                      {"opacity", {{"OPACITY", 0, 1}}, BlockTransform::kLinear, "", 1, 0.03}};
    for (const Channel& c : asset.channels) {
        if (c.name == "visibility" && asset.drawnVisibility > 0) continue;
        const size_t rows = c.rows(asset.cloud.count);
        const auto group = [&](const std::string& suffix, uint32_t first, uint32_t count, BlockTransform transform, const std::string& basis, double active, double step) {
            groups.push_back({c.name + suffix, {{c.name, first, count}}, transform, basis, active, step});
        };
        const auto exact = [&](double step) { // not by what shows: nothing does until splats are left out
            groups.push_back({c.name, {{c.name, 0, c.components}}, BlockTransform::kLinear, "", 0, step, true});
        };
        const auto spread = [&](uint32_t first, uint32_t count) {
            return c.values.empty() ? 40.0 : std::max(1e-9, deviation(&c.values[first], rows, c.components, count));
        };
        const uint32_t n = c.components;
        if (c.name == "importance") exact(1); // a factor of two
        else if (c.name == "growth") exact(1e-4);
        else if (c.perAsset && c.name == "network") { // weights; then where the object is, which has to be right
            group(".weights", 0, n - 4, BlockTransform::kLinear, "", 0.2, 0.02 * deviation(c.values.data(), n - 4, 1, 1));
            group(".frame", n - 4, 4, BlockTransform::kLinear, "", 0.001, 1e-6);
        } else if (c.perAsset) group("", 0, n, BlockTransform::kLinear, "", 0.2, 0.02 * deviation(c.values.data(), n, 1, 1));
        else if (c.name == "normal") group("", 0, 3, BlockTransform::kDirection, "", 2, 0.03);
        else if (c.name == "lobe") {
            group(".normal", 0, 3, BlockTransform::kDirection, "", 2, 0.03);
            group(".sharpness", 3, 1, BlockTransform::kExp, "", 1, 0.2);
            group(".color", 4, 3, BlockTransform::kLinear, "", 3, 0.1 * spread(4, 3));
        } else if (c.name == "forward") {
            group(".sharpness", 0, 1, BlockTransform::kExp, "", 1, 0.2);
            group(".color", 1, 3, BlockTransform::kLinear, "", 3, 0.1 * spread(1, 3));
        } else if (n == 1 || c.name == "material") group("", 0, n, BlockTransform::kLinear, "", n, 0.1 * spread(0, n));
        else {
            const bool transport = c.name == "tDir" || c.name == "tInd";
            group("", 0, n, BlockTransform::kLinear, transport ? "transport" : c.name, c.bytes.empty() ? std::min(16u, n) : 64, 0.4 * spread(0, n));
        }
    }
    return groups;
}

// ---- Choosing integers

/// What a value of a column costs, in bits: from how often it and its neighbours occur.
class Costs {
public:
    explicit Costs(std::span<const int32_t> codes)
    {
        for (const int32_t c : codes) ++counts_[c];
        total_ = double(codes.size());
    }
    double bits(int32_t code) const
    {
        const auto it = counts_.find(code);
        return std::log2((total_ + 1) / (it == counts_.end() ? 0.5 : double(it->second)));
    }

private:
    std::map<int32_t, uint32_t> counts_;
    double total_ = 0;
};

/// Rounds x (in steps), or takes a cheaper integer next to it where the splat shows so little, or the integer is so dear, that it pays. At one
/// step and high rate a bit is worth 2 ln 2 / 12 of a squared step.
void chooseIntegers(std::span<const float> x, std::span<const float> importance, int32_t most, std::span<int32_t> codes)
{
    constexpr double kBit = 0.1155;
    const auto rounded = [&](float v) { return int32_t(std::lround(std::clamp(double(v), -double(most), double(most)))); };
    for (size_t i = 0; i < x.size(); ++i) codes[i] = rounded(x[i]);
    if (importance.empty()) return;
    for (int pass = 0; pass < 2; ++pass) {
        const Costs costs(codes);
        std::map<int32_t, double> bits; // of those that occur
        const auto bitsOf = [&](int32_t c) {
            const auto [it, fresh] = bits.try_emplace(c, 0.0);
            if (fresh) it->second = costs.bits(c);
            return it->second;
        };
        for (size_t i = 0; i < x.size(); ++i) {
            const double w = std::max(1e-4, double(importance[i]));
            const int32_t near = rounded(x[i]), far = int32_t(std::sqrt(kBit * 12 / w)) + 1; // nothing farther can pay
            int32_t best = near;
            double least = 1e30;
            for (int32_t c = std::max(-most, near - std::min(far, 8)); c <= std::min(most, near + std::min(far, 8)); ++c) {
                const double d = double(x[i]) - c, cost = w * d * d + kBit * bitsOf(c);
                if (cost < least) least = cost, best = c;
            }
            if (w < 0.02 && w * double(x[i]) * double(x[i]) + kBit * bitsOf(0) < least) best = 0;
            codes[i] = best;
        }
    }
}

// ---- Blocks

/// The numbers of a group before quantising, [number][row].
std::vector<std::vector<float>> transformed(const SplatAsset& asset, const QuantGroup& group)
{
    const BlockTarget& target = group.targets[0];
    const SplatCloud& cloud = asset.cloud;
    const size_t n = cloud.count;
    std::vector<std::vector<float>> out;
    if (target.name == "ROTATION") {
        out.assign(3, std::vector<float>(n));
        for (size_t i = 0; i < n; ++i) out[0][i] = cloud.rotations[i].x, out[1][i] = cloud.rotations[i].y, out[2][i] = cloud.rotations[i].z;
        return out;
    }
    if (target.name == "POSITION" || target.name == "SCALE") {
        out.assign(3, std::vector<float>(n));
        for (size_t i = 0; i < n; ++i)
            for (int c = 0; c < 3; ++c) out[size_t(c)][i] = target.name == "SCALE" ? std::log(cloud.scales[i][c]) : cloud.positions[i][c];
        return out;
    }
    if (target.name == "OPACITY") return {cloud.opacities};
    const Channel& channel = *asset.find(target.name.c_str());
    if (channel.perAsset) return {std::vector<float>(channel.values.begin() + target.first, channel.values.begin() + target.first + target.count)};
    const size_t rows = channel.rows(n);
    const auto at = [&](size_t i, uint32_t c) {
        const size_t k = i * channel.components + target.first + c;
        return channel.bytes.empty() ? channel.values[k] : float(channel.bytes[k]);
    };
    const bool direction = group.transform == BlockTransform::kDirection;
    out.assign(direction ? 2 : target.count, std::vector<float>(rows));
    for (size_t i = 0; i < rows; ++i) {
        if (direction) {
            const glm::vec2 uv = octahedralCoordinates(glm::vec3(at(i, 0), at(i, 1), at(i, 2)));
            out[0][i] = uv.x, out[1][i] = uv.y;
            continue;
        }
        for (uint32_t c = 0; c < target.count; ++c) out[c][i] = group.transform == BlockTransform::kExp ? std::log(std::max(at(i, c), 0.05f)) : at(i, c);
    }
    return out;
}

Block plainBlock(const QuantSource& source, const QuantGroup& group, double step)
{
    const std::vector<std::vector<float>> numbers = transformed(source.asset, group);
    Block block;
    block.targets = group.targets, block.transform = group.transform;
    block.numbers = block.columns = uint32_t(numbers.size());
    const size_t rows = numbers[0].size();
    block.codes.resize(rows * block.columns);
    for (uint32_t k = 0; k < block.columns; ++k) {
        const auto [low, high] = std::minmax_element(numbers[k].begin(), numbers[k].end());
        const double used = std::max(step, double(*high - *low) / double(1 << 24)); // floats have no more bits
        // Positions start at their corner; other numbers around zero, so that what is zero stays zero.
        const float offset = group.name == "position" || group.transform == BlockTransform::kExp ? *low : 0.0f;
        block.offset.push_back(offset), block.step.push_back(float(used));
        std::vector<float> x(rows);
        for (size_t i = 0; i < rows; ++i) x[i] = float((double(numbers[k][i]) - offset) / used);
        const bool free = group.name != "position" && !group.exact && rows == source.importance.size(); // differences of positions are coded, not they
        chooseIntegers(x, free ? std::span<const float>(source.importance) : std::span<const float>(), 1 << 25, std::span(block.codes).subspan(k * rows, rows));
    }
    return block;
}

/// Groups that share a basis, each with its step.
Block basisBlock(const QuantSource& source, const std::vector<const QuantGroup*>& groups, const std::vector<double>& steps)
{
    Block block;
    std::vector<std::vector<float>> numbers;
    for (size_t g = 0; g < groups.size(); ++g) {
        block.targets.push_back(groups[g]->targets[0]);
        for (std::vector<float>& column : transformed(source.asset, *groups[g])) {
            for (float& x : column) x /= float(steps[g]);
            numbers.push_back(std::move(column)), block.scale.push_back(float(steps[g]));
        }
    }
    const size_t rows = numbers[0].size(), n = numbers.size();
    const std::span<const float> weights = std::span<const float>(source.importance).first(rows);
    const size_t mostAxes = n > 256 ? 32 : 100; // more of many numbers take minutes to find
    const PrincipalAxes axes = principalAxes(numbers, weights, std::min(n, mostAxes));
    block.numbers = uint32_t(n);
    for (size_t d = 0; d < n; ++d) block.offset.push_back(axes.mean[d] * block.scale[d]);

    // An axis that reaches farther than a byte gets two columns, of whole steps and of kCoarse steps each.
    constexpr float kCoarse = 64;
    struct Axis {
        std::vector<int8_t> bytes;
        float unit = 0; // of the bytes
        std::vector<std::pair<float, std::vector<int32_t>>> columns; // step and codes
    };
    std::vector<Axis> coded(axes.count);
    tbb::parallel_for(size_t(0), axes.count, [&](size_t k) {
        const float* axis = &axes.axes[k * n];
        float largest = 0, reach = 0;
        for (size_t d = 0; d < n; ++d) largest = std::max(largest, std::abs(axis[d]));
        if (largest == 0) return; // fewer axes than asked for
        for (size_t d = 0; d < n; ++d) coded[k].bytes.push_back(int8_t(std::lround(127 * axis[d] / largest)));
        coded[k].unit = largest / 127;
        std::vector<float> x(rows);
        for (size_t d = 0; d < n; ++d)
            for (size_t i = 0; i < rows; ++i) x[i] += axis[d] * (numbers[d][i] - axes.mean[d]);
        for (const float v : x) reach = std::max(reach, std::abs(v));
        const auto add = [&](float step, std::span<const float> chosenBy) {
            std::vector<float> inSteps(x);
            for (float& v : inSteps) v /= step;
            std::vector<int32_t> codes(rows);
            chooseIntegers(inSteps, chosenBy, 127, codes);
            for (size_t i = 0; i < rows; ++i) x[i] -= step * float(codes[i]);
            if (std::any_of(codes.begin(), codes.end(), [](int32_t c) { return c != 0; })) coded[k].columns.push_back({step, std::move(codes)});
        };
        if (reach > 127) add(std::max(kCoarse, reach / 127), {});
        add(std::max(1.0f, std::min(reach, kCoarse) / 127), weights);
    });
    for (const Axis& axis : coded)
        for (const auto& [step, codes] : axis.columns) {
            ++block.columns;
            block.step.push_back(step * axis.unit);
            block.basis.insert(block.basis.end(), axis.bytes.begin(), axis.bytes.end());
            block.codes.insert(block.codes.end(), codes.begin(), codes.end());
        }
    if (block.columns == 0) block.columns = 1, block.step = {0}, block.basis.assign(n, 0), block.codes.assign(rows, 0); // all splats are the same
    return block;
}

} // namespace

QuantSource prepareForQuantising(SplatAsset asset, std::vector<float> importance, int drawnVisibility)
{
    QuantSource source;
    const size_t n = asset.cloud.count;
    const std::vector<uint32_t> curve = mortonOrder(n, [&](size_t i) { return &asset.cloud.positions[i].x; });
    std::vector<uint32_t> order;
    const Channel* s = asset.find("s");
    const size_t leading = s ? s->leading : 0;
    for (const bool first : {true, false}) // those with rows that others lack stay first
        for (const uint32_t i : curve)
            if ((i < leading) == first && importance[i] > 0) order.push_back(i);
    if (order.empty()) order = curve;
    reorderSplats(asset, order);
    double mean = 0;
    for (const uint32_t i : order) source.importance.push_back(importance[i]), mean += importance[i] / double(order.size());
    for (float& w : source.importance) w = float(w / std::max(mean, 1e-30));
    for (size_t i = 0; i < order.size(); ++i) {
        canonicalRotation(asset.cloud.rotations[i], asset.cloud.scales[i]);
        glm::vec3& scale = asset.cloud.scales[i];
        scale = glm::max(scale, kThinnest * std::max({scale.x, scale.y, scale.z}));
    }
    asset.neutral = {};
    if (asset.find("visibility")) asset.drawnVisibility = drawnVisibility;
    source.asset = std::move(asset);
    source.groups = groupsOf(source.asset);
    return source;
}

QuantisedAsset quantise(const QuantSource& source, const std::vector<double>& steps)
{
    QuantisedAsset out;
    const SplatAsset& asset = source.asset;
    out.frame.model = asset.model, out.frame.cloud.count = asset.cloud.count;
    out.frame.lowPassVariance = asset.lowPassVariance, out.frame.yUpFromAsset = asset.yUpFromAsset;
    out.frame.frame = asset.frame, out.frame.bakedWith = asset.bakedWith, out.frame.drawnVisibility = asset.drawnVisibility, out.frame.presets = asset.presets;
    for (const Channel& c : asset.channels) {
        if (c.name == "visibility" && asset.drawnVisibility > 0) continue;
        Channel channel;
        channel.name = c.name, channel.components = c.components, channel.perAsset = c.perAsset, channel.leading = c.leading;
        out.frame.channels.push_back(std::move(channel));
    }
    std::vector<std::string> done;
    for (size_t g = 0; g < source.groups.size(); ++g) {
        const QuantGroup& group = source.groups[g];
        if (group.basis.empty()) {
            out.blocks.push_back(plainBlock(source, group, steps[g]));
            continue;
        }
        if (std::find(done.begin(), done.end(), group.basis) != done.end()) continue;
        done.push_back(group.basis);
        std::vector<const QuantGroup*> joined;
        std::vector<double> joinedSteps;
        for (size_t h = g; h < source.groups.size(); ++h)
            if (source.groups[h].basis == group.basis) joined.push_back(&source.groups[h]), joinedSteps.push_back(steps[h]);
        out.blocks.push_back(basisBlock(source, joined, joinedSteps));
    }
    return out;
}

} // namespace nacre
