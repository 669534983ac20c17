#include "selftest/print.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

namespace nacre::selftest {

static std::string format(const char* pattern, ...) __attribute__((format(printf, 1, 2)));
static std::string format(const char* pattern, ...)
{
    char text[512];
    va_list args;
    va_start(args, pattern);
    std::vsnprintf(text, sizeof text, pattern, args);
    va_end(args);
    return text;
}

static std::string figure(double x) { return x == 0 ? "0" : std::isfinite(x) ? format("%.1e", x) : "not finite"; }

static std::string cellText(const Cell& cell)
{
    switch (cell.what) {
    case Cell::What::kEmpty: return "-";
    case Cell::What::kRefused: return "refused";
    case Cell::What::kFailed: return "FAILED";
    default: break;
    }
    return (cell.passes ? "" : "!") + figure(cell.deviation.max) + " (" + figure(cell.deviation.mean) + ")";
}

static std::string boundText(const Row& row)
{
    const std::string own = row.bound.value == 0 ? "0: " : format("%.0e: ", row.bound.value);
    return own + row.bound.reason + (row.gl.value > 0 ? format("; GL %.0e: ", row.gl.value) + row.gl.reason : "");
}

static std::string knownText(const Row& row) { return row.hasKnown ? figure(row.referenceError) : "-"; }

/// What went wrong, a line each.
static std::string failuresText(const Report& report)
{
    std::string text;
    for (const Row& row : report.rows) {
        for (size_t k = 0; k < row.cells.size(); ++k)
            if (!row.cells[k].passes)
                text += "FAILED: " + row.name + ", " + report.columns[k].name + ": " +
                        (row.cells[k].message.empty() ? row.cells[k].deviation.worst + " is off by " + figure(row.cells[k].deviation.max) + ", bound " + boundText(row) : row.cells[k].message) + "\n";
        if (!row.passes && std::all_of(row.cells.begin(), row.cells.end(), [](const Cell& c) { return c.passes; }))
            text += "FAILED: " + row.name + ": the float64 reference is not what is known in closed form, off by " + figure(row.referenceError) + "\n";
    }
    for (size_t k = 0; k < report.random.size(); ++k) {
        const RandomRow& row = report.random[k];
        if (row.passes) continue;
        text += format("FAILED: random scenes, %s: %zu not finite, %zu failed; the worst is number %llu of seed %llu%s%s\n", report.columns[k].name.c_str(), row.notFinite, row.failed,
                       static_cast<unsigned long long>(row.worstScene), static_cast<unsigned long long>(report.seed), row.message.empty() ? "" : "; ", row.message.c_str());
    }
    return text;
}

static std::string worstText(const Report& report)
{
    size_t column = 0;
    const Row* worst = report.worst(&column);
    if (!worst) return "";
    const Cell& cell = worst->cells[column];
    return format("worst case: %s, %s: %s, %.0f %% of its bound\n", worst->name.c_str(), report.columns[column].name.c_str(), cellText(cell).c_str(), 100 * cell.ofBound);
}

static const char* decadeName(int d)
{
    static constexpr const char* kNames[kDecades] = {"< 1e-8", "1e-8", "1e-7", "1e-6", "1e-5", "1e-4", "1e-3", "0.01", "0.1", ">= 1"};
    return kNames[d];
}

static std::string randomBoundText()
{
    return format("\nbound %.0e: ", kRandomBound.value) + kRandomBound.reason + format("; GL %.0e: ", kRandomGlBound.value) + kRandomGlBound.reason + "\n";
}

std::string asText(const Report& report)
{
    std::string text;
    for (const ColumnInfo& c : report.columns) text += c.skipped.empty() ? format("%-8s %s\n", c.name.c_str(), c.what.c_str()) : format("%-8s SKIPPED: %s\n", c.name.c_str(), c.skipped.c_str());
    text += "\nLargest (mean) deviation from float64, in units of the largest value of its kind; known: the float64 reference from closed forms.\n\n";
    size_t width = 4;
    for (const Row& row : report.rows) width = std::max(width, row.name.size());
    text += format("%-*s", int(width), "case");
    for (const ColumnInfo& c : report.columns) text += format("  %-18s", c.name.c_str());
    text += "  known    bound\n";
    for (const Row& row : report.rows) {
        text += format("%-*s", int(width), row.name.c_str());
        for (const Cell& cell : row.cells) text += format("  %-18s", cellText(cell).c_str());
        text += format("  %-7s  ", knownText(row).c_str()) + boundText(row) + "\n";
    }
    if (!report.random.empty()) {
        text += format("\n%-22s", format("random scenes, seed %llu", static_cast<unsigned long long>(report.seed)).c_str());
        for (const ColumnInfo& c : report.columns) text += format("  %12s", c.name.c_str());
        const auto line = [&](const char* name, auto value) {
            text += format("\n%-22s", name);
            for (const RandomRow& row : report.random) text += format("  %12s", row.scenes ? value(row).c_str() : "-");
        };
        line("scenes", [](const RandomRow& r) { return std::to_string(r.scenes); });
        line("not finite", [](const RandomRow& r) { return std::to_string(r.notFinite); });
        line("median", [](const RandomRow& r) { return figure(r.median); });
        line("99 %", [](const RandomRow& r) { return figure(r.percentile99); });
        line("largest", [](const RandomRow& r) { return figure(r.deviation.max); });
        for (int d = 0; d < kDecades; ++d) line(d == 0 || d == kDecades - 1 ? decadeName(d) : format("from %s", decadeName(d)).c_str(), [d](const RandomRow& r) { return std::to_string(r.histogram[size_t(d)]); });
        text += randomBoundText();
    }
    text += "\n" + worstText(report) + failuresText(report);
    const size_t failures = report.failures();
    return text + (failures ? format("%zu of %zu rows fail\n", failures, report.rows.size() + report.random.size()) : format("all %zu cases are within their bounds\n", report.rows.size()));
}

std::string asMarkdown(const Report& report, const std::string& command, const std::string& machine)
{
    std::string text = "# Stability\n\nGenerated by `";
    text.append(command).append("` on ").append(machine).append("; nothing here is written by hand.\n\n");
    for (const ColumnInfo& c : report.columns) text += "* " + c.name + ": " + (c.skipped.empty() ? c.what : "SKIPPED: " + c.skipped) + "\n";
    text += "\nLargest (mean) deviation from a float64 reference, in units of the largest value of its kind (alpha: of 1). `known`: of that reference, from what is known in closed form or "
            "from another scene that must look the same. `-`: there is no such thing in this column; `refused`: an asset like this does not come in.\n\n";
    text += "| case | quantity |";
    std::string rule = "|---|---|";
    for (const ColumnInfo& c : report.columns) text += " " + c.name + " |", rule += "---|";
    text += " known | bound and its reason |\n" + rule + "---|---|\n";
    for (const Row& row : report.rows) {
        text += "| " + row.name + " | " + row.quantity + " |";
        for (const Cell& cell : row.cells) text.append(" ").append(cellText(cell)).append(" |");
        text += " " + knownText(row) + " | " + boundText(row) + " |\n";
    }
    if (!report.random.empty()) {
        text += format("\n## Random extreme scenes, seed %llu\n\nHow many scenes have their largest deviation in which decade.\n\n| column | scenes | not finite | median | 99 %% | largest | in scene |",
                       static_cast<unsigned long long>(report.seed));
        rule = "|---|---|---|---|---|---|---|";
        for (int d = 0; d < kDecades; ++d) text += format(" %s |", decadeName(d)), rule += "---|";
        text += "\n" + rule + "\n";
        for (size_t k = 0; k < report.random.size(); ++k) {
            const RandomRow& r = report.random[k];
            if (r.scenes == 0) continue;
            text += format("| %s | %zu | %zu | %s | %s | %s | %llu |", report.columns[k].name.c_str(), r.scenes, r.notFinite, figure(r.median).c_str(), figure(r.percentile99).c_str(),
                           figure(r.deviation.max).c_str(), static_cast<unsigned long long>(r.worstScene));
            for (const size_t n : r.histogram) text += format(" %zu |", n);
            text += "\n";
        }
        text += randomBoundText();
    }
    const std::string failures = failuresText(report);
    text += "\n" + worstText(report);
    return failures.empty() ? text : text + "\n```\n" + failures + "```\n";
}

std::string asJson(const Report& report, const std::string& command, const std::string& machine)
{
    using Json = nlohmann::ordered_json;
    const auto number = [](double x) { return std::isfinite(x) ? Json(x) : Json("not finite"); };
    Json columns = Json::array(), cases = Json::array(), random = Json::array();
    for (const ColumnInfo& c : report.columns) columns.push_back({{"name", c.name}, {"what", c.what}, {"skipped", c.skipped.empty() ? Json(nullptr) : Json(c.skipped)}});
    for (const Row& row : report.rows) {
        Json cells = Json::object();
        for (size_t k = 0; k < row.cells.size(); ++k) {
            const Cell& cell = row.cells[k];
            if (cell.what == Cell::What::kEmpty) continue;
            Json& out = cells[report.columns[k].name];
            if (cell.what == Cell::What::kMeasured) out = {{"max", number(cell.deviation.max)}, {"mean", number(cell.deviation.mean)}, {"of", cell.deviation.worst}};
            else out = {{cell.what == Cell::What::kRefused ? "refused" : "failed", cell.message}};
            out["passes"] = cell.passes;
        }
        cases.push_back({{"name", row.name}, {"quantity", row.quantity}, {"bound", row.bound.value}, {"reason", row.bound.reason},
                         {"bound_gl", row.gl.value > 0 ? Json(row.gl.value) : Json(nullptr)}, {"reason_gl", row.gl.value > 0 ? Json(row.gl.reason) : Json(nullptr)},
                         {"known", row.hasKnown ? number(row.referenceError) : Json(nullptr)}, {"columns", cells}, {"passes", row.passes}});
    }
    for (size_t k = 0; k < report.random.size(); ++k) {
        const RandomRow& r = report.random[k];
        if (r.scenes == 0 && r.failed == 0) continue;
        random.push_back({{"column", report.columns[k].name}, {"scenes", r.scenes}, {"not_finite", r.notFinite}, {"failed", r.failed}, {"median", number(r.median)}, {"percentile_99", number(r.percentile99)},
                          {"max", number(r.deviation.max)}, {"mean", number(r.deviation.mean)}, {"worst_scene", r.worstScene}, {"histogram", r.histogram}, {"passes", r.passes}});
    }
    size_t column = 0;
    const Row* worst = report.worst(&column);
    const Json out = {{"command", command}, {"machine", machine}, {"columns", columns}, {"cases", cases}, {"random_seed", report.seed}, {"random_scenes", random},
                      {"worst_case", worst ? Json{{"name", worst->name}, {"column", report.columns[column].name}, {"of_bound", number(worst->cells[column].ofBound)}} : Json(nullptr)},
                      {"failures", report.failures()}};
    return out.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

} // namespace nacre::selftest
