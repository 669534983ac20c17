#include "pack/principal_axes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nacre {

namespace {

using Rows = std::vector<std::vector<double>>;

/// Gram-Schmidt, twice for the digits that cancel.
void orthonormalise(Rows& v)
{
    for (size_t k = 0; k < v.size(); ++k) {
        for (int pass = 0; pass < 2; ++pass)
            for (size_t j = 0; j < k; ++j) {
                const double along = std::inner_product(v[k].begin(), v[k].end(), v[j].begin(), 0.0);
                for (size_t d = 0; d < v[k].size(); ++d) v[k][d] -= along * v[j][d];
            }
        const double length = std::sqrt(std::inner_product(v[k].begin(), v[k].end(), v[k].begin(), 0.0));
        for (double& x : v[k]) x = length > 1e-12 ? x / length : 0.0;
    }
}

} // namespace

PrincipalAxes principalAxes(const std::vector<std::vector<float>>& numbers, std::span<const float> weights, size_t count)
{
    const size_t n = numbers.size(), rows = weights.size();
    PrincipalAxes out;
    out.count = std::min(count, n);
    const double total = std::max(1e-30, std::accumulate(weights.begin(), weights.end(), 0.0));
    for (const std::vector<float>& column : numbers) out.mean.push_back(float(std::inner_product(column.begin(), column.end(), weights.begin(), 0.0) / total));

    // Covariance; of many numbers from some of the rows.
    constexpr size_t kWork = 400'000'000;
    const size_t stride = std::max<size_t>(1, n * n * rows / kWork);
    Rows covariance(n, std::vector<double>(n));
    tbb::parallel_for(size_t(0), n, [&](size_t d) {
        std::vector<float> scaled;
        for (size_t i = 0; i < rows; i += stride) scaled.push_back(weights[i] * (numbers[d][i] - out.mean[d]));
        for (size_t e = 0; e <= d; ++e) {
            double sum = 0;
            size_t k = 0;
            for (size_t i = 0; i < rows; i += stride) sum += double(scaled[k++] * (numbers[e][i] - out.mean[e]));
            covariance[d][e] = sum;
        }
    });
    for (size_t d = 0; d < n; ++d)
        for (size_t e = 0; e < d; ++e) covariance[e][d] = covariance[d][e];

    Rows v(out.count, std::vector<double>(n));
    for (size_t k = 0; k < out.count; ++k)
        for (size_t d = 0; d < n; ++d) v[k][d] = std::cos(double((k + 1) * (2 * d + 1)) * 1.5707963 / double(n)) + (k == d ? 0.5 : 0.0);
    orthonormalise(v);
    constexpr int kIterations = 60;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
        Rows next(out.count, std::vector<double>(n));
        tbb::parallel_for(size_t(0), out.count, [&](size_t k) {
            for (size_t d = 0; d < n; ++d) next[k][d] = std::inner_product(v[k].begin(), v[k].end(), covariance[d].begin(), 0.0);
        });
        v = std::move(next);
        orthonormalise(v);
    }
    for (const std::vector<double>& axis : v) out.axes.insert(out.axes.end(), axis.begin(), axis.end());
    return out;
}

} // namespace nacre
