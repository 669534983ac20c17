#include "selftest/selftest.h"

#include "selftest/random_scenes.h"
#include "selftest/scalar_image.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre::selftest {

static constexpr double kInfinite = std::numeric_limits<double>::infinity();

std::vector<Column> makeColumns(const Hooks& hooks, bool gl)
{
    std::vector<Column> columns;
    columns.push_back(makeScalarColumn(hooks));
    columns.push_back(makeSimdColumn(hooks));
    if (!gl) return columns;
    columns.push_back(makeGl33Column(hooks));
    columns.push_back(makeGl43Column(hooks));
    return columns;
}

/// Values that a case has in the reference; zero for what should be nothing.
static Values referenceOf(const Case& c, const Scene& scene, const Formulas<double>& formulas)
{
    if (c.kind == Kind::kGradients) return scalarGradients(scene, formulas);
    if (c.kind != Kind::kImage) return {};
    Values image = drawScalar(c.like ? c.like() : scene, formulas);
    if (c.exactColor) image.resize(1), image[0].unit = 1;
    return image;
}

/// Largest error of the reference against what is known of it, in the units of deviations: pixels in closed form, and the scene it has to look like.
static double errorOfReference(const Case& c, const Scene& scene, const Values& reference, const Formulas<double>& formulas)
{
    double most = 0;
    for (const Known& k : c.known) {
        const size_t pixel = size_t(k.y) * size_t(scene.camera.width) + size_t(k.x);
        const double value = k.channel == 3 ? reference[1].values[pixel] : reference[0].values[3 * pixel + size_t(k.channel)];
        const double error = std::abs(value - k.value) / std::max(k.channel == 3 ? 1.0 : std::abs(k.value), 1e-300);
        most = std::isfinite(value) ? std::max(most, k.value == 0 && k.channel != 3 ? std::abs(value) : error) : kInfinite;
    }
    if (c.like) most = std::max(most, deviation(drawScalar(scene, formulas), reference).max);
    return most;
}

static Result<Values> evaluate(const Case& c, const Scene& scene, BackEnd& backEnd)
{
    if (c.kind == Kind::kImage) {
        auto image = backEnd.draw(scene);
        if (image && c.exactColor) image->resize(1);
        return image;
    }
    if (c.kind == Kind::kGradients) return backEnd.gradients(scene);
    if (c.kind == Kind::kTraining) return backEnd.trains() ? c.train() : BackEnd::notHere();
    const auto accepted = c.kind == Kind::kRefusedFile ? backEnd.acceptsFile(scene) : backEnd.accepts(scene);
    if (!accepted) return accepted.error();
    return Values{{"accepted", {*accepted ? 1.0 : 0.0}, 1}};
}

static Values zeros(Values like)
{
    for (ValueGroup& group : like) std::fill(group.values.begin(), group.values.end(), 0.0);
    return like;
}

static Cell measure(const Case& c, const Scene& scene, const Values& reference, const Column& column)
{
    Cell cell;
    if (!column.backEnd) return cell;
    const auto values = evaluate(c, scene, *column.backEnd);
    if (!values) {
        if (values.error().code == ErrorCode::kUnsupported) return cell;
        const bool refused = c.mayRefuse && values.error().code == ErrorCode::kBadInput;
        cell.what = refused ? Cell::What::kRefused : Cell::What::kFailed;
        cell.passes = refused, cell.ofBound = refused ? 0 : kInfinite, cell.message = values.error().message;
        return cell;
    }
    cell.what = Cell::What::kMeasured;
    cell.deviation = deviation(*values, reference.empty() ? zeros(*values) : reference);
    const double bound = column.gl && c.gl.value > 0 ? c.gl.value : c.bound.value;
    cell.passes = cell.deviation.max <= bound;
    cell.ofBound = bound > 0 ? cell.deviation.max / bound : cell.deviation.max > 0 ? kInfinite : 0;
    return cell;
}

static Row runCase(const Case& c, const std::vector<Column>& columns, const Formulas<double>& formulas)
{
    Row row{c.name, c.quantity, c.bound, c.gl, {}};
    const Scene scene = c.scene ? c.scene() : Scene{};
    const Values reference = referenceOf(c, scene, formulas);
    row.hasKnown = !c.known.empty() || c.like;
    row.referenceError = errorOfReference(c, scene, reference, formulas);
    row.passes = row.referenceError <= c.bound.value + 1e-12 && allFinite(reference);
    for (const Column& column : columns) {
        row.cells.push_back(measure(c, scene, reference, column));
        row.passes = row.passes && row.cells.back().passes;
    }
    return row;
}

static int decade(double deviation)
{
    return deviation < 1e-8 ? 0 : std::clamp(int(std::floor(std::log10(deviation))) + 9, 1, kDecades - 1);
}

/// Of the deviations of each scene; negative max: this column did not draw it.
static RandomRow summarise(const std::vector<Deviation>& each)
{
    RandomRow row;
    std::vector<double> largest;
    for (size_t i = 0; i < each.size(); ++i) {
        if (each[i].max < 0) continue;
        ++row.scenes;
        ++row.histogram[size_t(decade(each[i].max))];
        row.notFinite += !std::isfinite(each[i].max);
        if (each[i].max > row.deviation.max || row.scenes == 1) row.deviation.max = each[i].max, row.deviation.worst = each[i].worst, row.worstScene = i;
        row.deviation.mean += each[i].mean;
        largest.push_back(each[i].max);
    }
    if (largest.empty()) return row;
    row.deviation.mean /= double(largest.size());
    std::sort(largest.begin(), largest.end());
    row.median = largest[largest.size() / 2], row.percentile99 = largest[largest.size() * 99 / 100];
    return row;
}

static Result<std::vector<RandomRow>> runRandom(const Options& options, const std::vector<Column>& columns)
{
    constexpr size_t kAtOnce = 500;
    std::vector<std::vector<Deviation>> each(columns.size(), std::vector<Deviation>(options.randomScenes, Deviation{-1, 0, {}}));
    std::vector<std::string> messages(columns.size());
    std::vector<size_t> failed(columns.size());
    for (size_t first = 0; first < options.randomScenes; first += kAtOnce) {
        const size_t end = std::min(first + kAtOnce, options.randomScenes);
        if (options.progress && !options.progress(std::to_string(first) + " of " + std::to_string(options.randomScenes) + " random scenes"))
            return Error{ErrorCode::kCancelled, "stopped"};
        std::vector<Values> references(end - first);
        tbb::parallel_for(first, end, [&](size_t i) { references[i - first] = drawScalar(randomScene(options.seed, i), options.hooks.reference); });
        for (size_t k = 0; k < columns.size(); ++k) {
            if (!columns[k].backEnd) continue;
            for (size_t i = first; i < end; ++i) {
                if (columns[k].gl && i % options.glEvery != 0) continue;
                const auto values = columns[k].backEnd->draw(randomScene(options.seed, i));
                if (values) each[k][i] = deviation(*values, references[i - first]);
                else if (failed[k]++ == 0) messages[k] = "random scene " + std::to_string(i) + ": " + values.error().message;
            }
        }
    }
    std::vector<RandomRow> rows;
    for (size_t k = 0; k < columns.size(); ++k) {
        rows.push_back(summarise(each[k]));
        RandomRow& row = rows.back();
        const bool near = columns[k].gl ? row.median <= kRandomGlBound.value : row.percentile99 <= kRandomBound.value;
        row.failed = failed[k], row.message = messages[k], row.passes = failed[k] == 0 && row.notFinite == 0 && (near || row.scenes < kFewScenes);
    }
    return rows;
}

Result<Report> run(const Options& options)
{
    const std::vector<Column> columns = makeColumns(options.hooks, options.gl);
    Report report;
    report.seed = options.seed;
    for (const Column& c : columns) report.columns.push_back({c.name, c.what, c.skipped});
    for (const Case& c : allCases()) {
        if (c.name.find(options.only) == std::string::npos) continue;
        if (options.progress && !options.progress(c.name)) return Error{ErrorCode::kCancelled, "stopped"};
        report.rows.push_back(runCase(c, columns, options.hooks.reference));
    }
    if (options.randomScenes == 0) return report;
    auto random = runRandom(options, columns);
    if (!random) return random.error();
    report.random = std::move(*random);
    return report;
}

size_t Report::failures() const
{
    size_t count = 0;
    for (const Row& row : rows) count += !row.passes;
    for (const RandomRow& row : random) count += !row.passes;
    return count;
}

const Row* Report::worst(size_t* column) const
{
    const Row* found = nullptr;
    double most = -1;
    for (const Row& row : rows)
        for (size_t k = 0; k < row.cells.size(); ++k)
            if (row.cells[k].ofBound > most) most = row.cells[k].ofBound, found = &row, *column = k;
    return found;
}

} // namespace nacre::selftest
