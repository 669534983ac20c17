#include "report/report_files.h"

#include "base/file.h"
#include "base/text.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <filesystem>
#include <limits>
#include <span>

namespace nacre::report {

namespace {

using Json = nlohmann::ordered_json;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// Of times and sizes, where 0 stands for what was not measured.
double measured(double x) { return x > 0 ? x : kNone; }
double share(const TimedFrame& t, double ms) { return t.ms > 0 ? ms : kNone; }

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }
Json textOrNull(const std::string& text) { return text.empty() ? Json(nullptr) : Json(text); }

Json timeJson(const TimedFrame& t)
{
    return {{"ms", number(measured(t.ms))},          {"ms_low", number(measured(t.low))},
            {"ms_high", number(measured(t.high))},   {"relight_ms", number(share(t, t.relightMs))},
            {"sort_ms", number(share(t, t.sortMs))}, {"raster_ms", number(share(t, t.rasterMs))}};
}

Json pointsJson(const std::vector<FrontPoint>& points)
{
    Json out = Json::array();
    for (const FrontPoint& p : points) {
        Json point = timeJson(p.time);
        point["bytes"] = number(measured(p.bytes)), point["psnr_masked"] = number(p.psnrMasked), point["settings"] = p.settings;
        point["preset"] = textOrNull(p.preset), point["dominated"] = p.dominated;
        out.push_back(std::move(point));
    }
    return out;
}

/// Rows of one CSV file.
class Table {
public:
    explicit Table(std::initializer_list<std::string> names)
    {
        for (const std::string& name : names) *this << name;
        end();
    }
    Table& operator<<(const std::string& text)
    {
        const bool quoted = text.find_first_of(",\"\r\n") != std::string::npos;
        text_ += first_ ? "" : ",";
        first_ = false;
        if (!quoted) return text_ += text, *this;
        text_ += '"';
        for (const char c : text) text_.append(c == '"' ? 2 : 1, c);
        text_ += '"';
        return *this;
    }
    Table& operator<<(const char* text) { return *this << std::string(text); }
    Table& operator<<(double x) { return *this << (std::isfinite(x) ? numberText(x) : std::string()); }
    Table& operator<<(size_t x) { return *this << std::to_string(x); }
    Table& operator<<(bool x) { return *this << (x ? "1" : "0"); }
    void end() { text_ += '\n', first_ = true; }
    Status write(const std::string& folder, const std::string& name) const
    {
        return writeFileAtomically((std::filesystem::path(folder) / (name + ".csv")).string(), std::as_bytes(std::span(text_)));
    }

private:
    std::string text_;
    bool first_ = true;
};

Table pointsTable(const std::vector<FrontPoint>& points)
{
    Table table{"settings", "preset", "ms", "ms_low", "ms_high", "relight_ms", "sort_ms", "raster_ms", "bytes", "psnr_masked", "dominated"};
    for (const FrontPoint& p : points) {
        const TimedFrame& t = p.time;
        table << p.settings << p.preset << measured(t.ms) << measured(t.low) << measured(t.high) << share(t, t.relightMs) << share(t, t.sortMs)
              << share(t, t.rasterMs) << measured(p.bytes) << p.psnrMasked << p.dominated;
        table.end();
    }
    return table;
}

} // namespace

Json reportJson(const ReportData& d)
{
    Json splits = Json::object(), history = Json::array(), ledger = Json::array(), scalings = Json::array(), images = Json::array(),
         stability = Json::array(), memory = Json::array();
    for (const SplitFigures& s : d.splits)
        splits[s.split] = {{"images", s.images},
                           {"psnr", number(s.psnr)},
                           {"psnr_masked", number(s.psnrMasked)},
                           {"psnr_highlight", number(s.psnrHighlight)},
                           {"highlight_missing", number(s.highlightMissing)},
                           {"highlight_false", number(s.highlightFalse)},
                           {"ssim", number(s.ssim)},
                           {"flip", number(s.flip)},
                           {"rel_mse_linear", number(s.relMseLinear)},
                           {"noise_floor", number(s.noiseFloor)}};
    for (const HistoryPoint& h : d.history)
        history.push_back({{"seconds", number(h.seconds)}, {"psnr", number(h.psnr)}, {"splats", h.splats}, {"held_out", h.heldOut}});
    for (const LedgerRow& r : d.ledger)
        ledger.push_back({{"part", r.part},
                          {"left_out", r.leftOut},
                          {"bytes", number(r.bytes)},
                          {"ms", number(r.ms)},
                          {"loss_db", number(r.lossDecibel)},
                          {"note", textOrNull(r.note)}});
    for (const Scaling& s : d.scalings) {
        Json points = Json::array();
        for (size_t i = 0; i < std::min(s.x.size(), s.ms.size()); ++i) points.push_back({{"x", number(s.x[i])}, {"ms", number(s.ms[i])}});
        scalings.push_back({{"quantity", s.quantity},
                            {"slope_ms", number(s.slope)},
                            {"offset_ms", number(s.offset)},
                            {"residual", number(s.residual)},
                            {"points", points}});
    }
    for (const ReportImage& i : d.images) images.push_back(i.caption);
    for (const StabilityRow& r : d.stability)
        stability.push_back({{"name", r.name},
                             {"quantity", r.quantity},
                             {"bound", number(r.bound)},
                             {"reason", r.reason},
                             {"max", number(r.largest)},
                             {"back_end", r.backEnd},
                             {"ok", r.ok}});
    for (const MemoryRow& r : d.memory) memory.push_back({{"what", r.what}, {"bytes", number(r.bytes)}});
    return {{"asset", d.asset},
            {"dataset", d.dataset},
            {"model", d.model},
            {"baked_with", textOrNull(d.bakedWith)},
            {"splats", d.splats},
            {"width", d.width},
            {"height", d.height},
            {"splits", splits},
            {"full_frame", timeJson(d.fullFrame)},
            {"front_time", pointsJson(d.frontTime)},
            {"front_bytes", pointsJson(d.frontBytes)},
            {"levels", pointsJson(d.levels)},
            {"ledger", ledger},
            {"never_pays", d.neverPays},
            {"history", history},
            {"scalings", scalings},
            {"images", images},
            {"stability", {{"summary", textOrNull(d.stabilityNote)}, {"cases", stability}}},
            {"memory", memory},
            {"notes", d.notes},
            {"command", d.command},
            {"machine", d.machine},
            {"renderer", d.renderer},
            {"version", d.version},
            {"date", d.date},
            {"seconds", number(d.seconds)}};
}

Status writeReportTables(const ReportData& d, const std::string& folder)
{
    std::error_code failed;
    std::filesystem::create_directories(folder, failed);
    if (failed) return Error{ErrorCode::kIo, "cannot make the folder '" + folder + "': " + failed.message()};

    Table about{"name", "value"};
    for (const auto& [name, value] : {std::pair<const char*, std::string>{"asset", d.asset},
                                      {"dataset", d.dataset},
                                      {"model", d.model},
                                      {"baked_with", d.bakedWith},
                                      {"splats", std::to_string(d.splats)},
                                      {"width", std::to_string(d.width)},
                                      {"height", std::to_string(d.height)},
                                      {"command", d.command},
                                      {"machine", d.machine},
                                      {"renderer", d.renderer},
                                      {"version", d.version},
                                      {"date", d.date},
                                      {"seconds", numberText(d.seconds)},
                                      {"stability", d.stabilityNote}})
        (about << name << value).end();
    for (const std::string& line : d.neverPays) (about << "never_pays" << line).end();
    for (const std::string& line : d.notes) (about << "note" << line).end();

    Table splits{"split",           "images", "psnr", "psnr_masked",    "psnr_highlight", "highlight_missing",
                 "highlight_false", "ssim",   "flip", "rel_mse_linear", "noise_floor"};
    for (const SplitFigures& s : d.splits)
        (splits << s.split << s.images << s.psnr << s.psnrMasked << s.psnrHighlight << s.highlightMissing << s.highlightFalse << s.ssim << s.flip
                << s.relMseLinear << s.noiseFloor)
            .end();
    Table history{"seconds", "psnr", "splats", "held_out"};
    for (const HistoryPoint& h : d.history) (history << h.seconds << h.psnr << h.splats << h.heldOut).end();
    Table ledger{"part", "left_out", "bytes", "ms", "loss_db", "note"};
    for (const LedgerRow& r : d.ledger) (ledger << r.part << r.leftOut << r.bytes << r.ms << r.lossDecibel << r.note).end();
    Table scalings{"quantity", "x", "ms", "fitted_ms"};
    for (const Scaling& s : d.scalings)
        for (size_t i = 0; i < std::min(s.x.size(), s.ms.size()); ++i)
            (scalings << s.quantity << s.x[i] << s.ms[i] << s.offset + s.slope * s.x[i]).end();
    Table stability{"name", "quantity", "bound", "reason", "max", "back_end", "ok"};
    for (const StabilityRow& r : d.stability) (stability << r.name << r.quantity << r.bound << r.reason << r.largest << r.backEnd << r.ok).end();
    Table memory{"what", "bytes"};
    for (const MemoryRow& r : d.memory) (memory << r.what << r.bytes).end();

    const Table frontTime = pointsTable(d.frontTime), frontBytes = pointsTable(d.frontBytes), levels = pointsTable(d.levels);
    for (const auto& [name, table] : {std::pair<const char*, const Table*>{"about", &about},
                                      {"splits", &splits},
                                      {"front_time", &frontTime},
                                      {"front_bytes", &frontBytes},
                                      {"levels", &levels},
                                      {"history", &history},
                                      {"ledger", &ledger},
                                      {"scalings", &scalings},
                                      {"stability", &stability},
                                      {"memory", &memory}})
        if (Status s = table->write(folder, name); !s) return s;
    return ok();
}

} // namespace nacre::report
