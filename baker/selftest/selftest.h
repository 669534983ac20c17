// The stability suite: every case in every column against a float64 reference, and random extreme scenes.
#pragma once

#include "selftest/back_end.h"
#include "selftest/cases.h"

#include <array>
#include <functional>
#include <string>
#include <vector>

namespace nacre::selftest {

/// What a column made of a case.
struct Cell {
    enum class What { kEmpty, kMeasured, kRefused, kFailed } what = What::kEmpty;
    Deviation deviation;
    std::string message; // of a failure
    bool passes = true;
    double ofBound = 0;  // deviation in units of its bound
};

struct Row {
    std::string name, quantity;
    Bound bound, gl;
    std::vector<Cell> cells;  // of each column
    double referenceError = 0; // of the float64 reference, from what is known in closed form
    bool hasKnown = false, passes = true;
};

/// Decades of deviations: below 1e-8, 1e-8 to 1e-7, ..., 0.1 to 1, from 1 on.
constexpr int kDecades = 10;

/// What a column made of random scenes.
struct RandomRow {
    size_t scenes = 0, notFinite = 0, failed = 0;
    Deviation deviation;           // the largest, and the mean of means
    double median = 0, percentile99 = 0; // of the largest deviation of each scene
    std::array<size_t, kDecades> histogram{};
    uint64_t worstScene = 0;
    std::string message;           // of the first failure
    bool passes = true;
};

struct ColumnInfo { std::string name, what, skipped; };

struct Report {
    std::vector<ColumnInfo> columns;
    std::vector<Row> rows;
    std::vector<RandomRow> random; // of each column
    uint64_t seed = 1;
    size_t failures() const;
    /// The row whose deviation is the largest part of its bound, and where; null: no rows.
    const Row* worst(size_t* column) const;
};

struct Options {
    std::string only;           // cases whose names hold this; empty: all
    size_t randomScenes = 300;
    size_t glEvery = 10;        // one random scene in so many is drawn by columns of OpenGL, which take some 1,000 times as long
    uint64_t seed = 1;
    bool gl = true;
    Hooks hooks;
    std::function<bool(const std::string&)> progress; // what is done next; false: stop
};

/// Of the largest deviations of a scene; all have to be finite.
constexpr Bound kRandomBound{1e-2, "99 in 100 are smaller: a splat at the threshold of 1/255 may be counted or not"};
constexpr size_t kFewScenes = 50; // are judged only by whether they are finite: medians of few say nothing
constexpr Bound kRandomGlBound{1e-2, "half of them are smaller: sss keeps its G-buffer in halves, and where a light stands in the cloud the place of a pixel's surface decides"};

/// Error kCancelled: `progress` said so.
Result<Report> run(const Options& options);

} // namespace nacre::selftest
