// Regions are split in two, the worst first, until there are enough. How bad a region is: luminance x spread of its directions, which is
// what one direction in its place errs by where light is received smoothly. It is cut across the direction in which it spreads most, where
// the two halves are least bad. Then, a few times, each cell goes over to the direction that is nearest to it (Lloyd), among those around
// its own. All sums are over cells in their order: the same map gives the same directions everywhere.
#include "appearance/environment_directions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <numeric>
#include <queue>

namespace nacre {

namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kCellsPerDirection = 64;    // at least, in the mean
constexpr int kMostColumns = 256;         // of cells, unless that is less
constexpr int kBins = 256;                // places where a region can be cut
constexpr int kRounds = 5;                // of Lloyd's
constexpr size_t kNeighbours = 12;        // that a cell can go over to

double luminance(const glm::dvec3& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; }

struct Sums {
    glm::dvec3 power{0}, moment{0};
    void add(const EnvironmentCell& c) { power += c.power, moment += c.moment; }
    void add(const Sums& s) { power += s.power, moment += s.moment; }
    double badness() const { return std::max(luminance(power) - glm::length(moment), 0.0); }
};

struct Region {
    size_t first, last;    // of the list of cells
    Sums sums;
    double badness;
    bool operator<(const Region& other) const { return badness != other.badness ? badness < other.badness : first > other.first; }
};

/// Where the directions of the region spread most: the first axis of their covariance.
glm::dvec3 widestAxis(std::span<const EnvironmentCell> cells, std::span<const uint32_t> list, const Sums& sums)
{
    const glm::dvec3 mean = sums.moment / luminance(sums.power);
    glm::dmat3 covariance(0.0);
    for (const uint32_t i : list) {
        const double weight = luminance(cells[i].power);
        const glm::dvec3 d = cells[i].moment / weight - mean;
        covariance += glm::outerProduct(weight * d, d);
    }
    glm::dvec3 axis(0.0);
    for (int c = 0; c < 3; ++c)
        if (glm::length(covariance[c]) > glm::length(axis)) axis = covariance[c];
    for (int i = 0; i < 32 && glm::length(axis) > 0; ++i) axis = covariance * glm::normalize(axis);
    return glm::length(axis) > 0 ? glm::normalize(axis) : glm::dvec3(0, 0, 1);
}

/// Parts list[first..last) in two; returns where the second begins, or `first` if there is nothing to part.
size_t cut(std::span<const EnvironmentCell> cells, std::vector<uint32_t>& list, const Region& region)
{
    const std::span<uint32_t> part(list.data() + region.first, region.last - region.first);
    const glm::dvec3 axis = widestAxis(cells, part, region.sums);
    const auto at = [&](uint32_t i) { return glm::dot(cells[i].moment, axis) / luminance(cells[i].power); };
    double low = 2, high = -2;
    for (const uint32_t i : part) low = std::min(low, at(i)), high = std::max(high, at(i));
    if (!(high > low)) return region.first;
    const auto bin = [&](uint32_t i) { return std::min(int((at(i) - low) / (high - low) * kBins), kBins - 1); };

    std::array<Sums, kBins> bins{}, after{};
    for (const uint32_t i : part) bins[size_t(bin(i))].add(cells[i]);
    Sums sums;
    for (size_t b = kBins; b-- > 0;) sums.add(bins[b]), after[b] = sums;
    sums = {};
    int best = 1;
    double least = std::numeric_limits<double>::infinity();
    for (size_t b = 1; b < kBins; ++b) { // cut before bin b; the first and the last are never empty
        sums.add(bins[b - 1]);
        if (const double badness = sums.badness() + after[b].badness(); badness < least) least = badness, best = int(b);
    }
    const auto second = std::stable_partition(part.begin(), part.end(), [&](uint32_t i) { return bin(i) < best; });
    return region.first + size_t(second - part.begin());
}

Region makeRegion(std::span<const EnvironmentCell> cells, const std::vector<uint32_t>& list, size_t first, size_t last)
{
    Region region{first, last, {}, 0};
    for (size_t k = first; k < last; ++k) region.sums.add(cells[list[k]]);
    region.badness = region.sums.badness();
    return region;
}

/// Each cell to the nearest mean; the regions' sums become those of the cells that come to it.
void settle(std::span<const EnvironmentCell> cells, const std::vector<uint32_t>& list, std::vector<Region>& regions)
{
    const size_t count = regions.size(), near = std::min(kNeighbours + 1, count); // itself among them
    std::vector<uint32_t> home(cells.size());
    for (size_t r = 0; r < count; ++r)
        for (size_t k = regions[r].first; k < regions[r].last; ++k) home[list[k]] = uint32_t(r);
    std::vector<glm::dvec3> means(count);
    std::vector<uint32_t> around(count), neighbours(count * near);
    for (int round = 0; round < kRounds; ++round) {
        for (size_t r = 0; r < count; ++r) means[r] = glm::length(regions[r].sums.moment) > 0 ? glm::normalize(regions[r].sums.moment) : means[r];
        for (size_t r = 0; r < count; ++r) {
            std::iota(around.begin(), around.end(), 0u);
            const auto nearer = [&](uint32_t a, uint32_t b) {
                const double toA = glm::dot(means[a], means[r]), toB = glm::dot(means[b], means[r]);
                return toA != toB ? toA > toB : a < b;
            };
            std::partial_sort(around.begin(), around.begin() + ptrdiff_t(near), around.end(), nearer);
            std::copy_n(around.begin(), near, neighbours.begin() + ptrdiff_t(r * near));
        }
        for (Region& r : regions) r.sums = {};
        for (const uint32_t i : list) {
            const uint32_t* to = &neighbours[home[i] * near];
            uint32_t best = home[i];
            for (size_t k = 0; k < near; ++k)
                if (glm::dot(cells[i].moment, means[to[k]]) > glm::dot(cells[i].moment, means[best])) best = to[k];
            home[i] = best;
            regions[best].sums.add(cells[i]);
        }
    }
    std::erase_if(regions, [](const Region& r) { return luminance(r.sums.power) == 0; });
}

EnvironmentDirection directionOf(const Sums& sums)
{
    const double length = glm::length(sums.moment), agreement = length / luminance(sums.power); // of a disc: (1 + cos radius) / 2
    return {length > 0 ? sums.moment / length : glm::dvec3(0, 0, 1), sums.power, std::acos(std::clamp(2 * agreement - 1, -1.0, 1.0))};
}

} // namespace

std::vector<EnvironmentCell> environmentCells(const float* pixels, int width, int height, int stride, int count)
{
    // A pixel that is large next to a region is shared out through smaller ones of the same radiance; small pixels are joined.
    const int sub = int(std::clamp(std::ceil(std::sqrt(double(kCellsPerDirection) * count / (double(width) * height))), 1.0, 256.0));
    const int join = std::max(1, width / std::max(kMostColumns, int(std::sqrt(2.0 * kCellsPerDirection * count))));
    const int rows = height * sub, columns = width * sub;
    const int cellRows = (rows + join - 1) / join, cellColumns = (columns + join - 1) / join;
    std::vector<EnvironmentCell> cells(size_t(cellRows) * size_t(cellColumns));
    std::vector<glm::dvec2> azimuths;
    for (int x = 0; x < columns; ++x) {
        const double phi = kPi - 2.0 * kPi * (x + 0.5) / columns;
        azimuths.emplace_back(std::cos(phi), std::sin(phi));
    }
    for (int y = 0; y < rows; ++y) {
        const double theta = kPi * (y + 0.5) / rows, sinTheta = std::sin(theta), cosTheta = std::cos(theta);
        const double solidAngle = 2.0 * kPi / columns * (std::cos(kPi * y / rows) - std::cos(kPi * (y + 1) / rows));
        for (int x = 0; x < columns; ++x) {
            const float* p = pixels + (size_t(y / sub) * size_t(width) + size_t(x / sub)) * size_t(stride);
            const glm::dvec3 power = glm::max(glm::dvec3(p[0], p[1], p[2]), 0.0) * solidAngle;
            EnvironmentCell& cell = cells[size_t(y / join) * size_t(cellColumns) + size_t(x / join)];
            cell.power += power;
            cell.moment += luminance(power) * glm::dvec3(sinTheta * azimuths[size_t(x)], cosTheta);
        }
    }
    return cells;
}

std::vector<EnvironmentDirection> environmentDirections(std::span<const EnvironmentCell> cells, int count)
{
    std::vector<uint32_t> list;
    for (size_t i = 0; i < cells.size(); ++i)
        if (luminance(cells[i].power) > 0) list.push_back(uint32_t(i));
    std::priority_queue<Region> open; // the worst first
    std::vector<Region> done;
    if (!list.empty()) open.push(makeRegion(cells, list, 0, list.size()));
    while (!open.empty() && open.size() + done.size() < size_t(count)) {
        const Region region = open.top();
        open.pop();
        const size_t middle = cut(cells, list, region);
        if (middle == region.first) {
            done.push_back(region);
            continue;
        }
        open.push(makeRegion(cells, list, region.first, middle));
        open.push(makeRegion(cells, list, middle, region.last));
    }
    for (; !open.empty(); open.pop()) done.push_back(open.top());
    std::sort(done.begin(), done.end(), [](const Region& a, const Region& b) { return a.first < b.first; });
    settle(cells, list, done);
    std::vector<EnvironmentDirection> directions;
    for (const Region& region : done) directions.push_back(directionOf(region.sums));
    return directions;
}

} // namespace nacre
