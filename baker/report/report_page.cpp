// Sections in the order in which a reader asks: how good, what does time and memory buy, what was left out, where does it fail, how was it measured.
#include "report/report_page.h"

#include "base/base64.h"
#include "base/file.h"
#include "interchange/png.h"
#include "eval/report_text.h"
#include "eval/svg_plot.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <span>

namespace nacre::report {

namespace {

using Texts = std::vector<std::string>;

// Kept small: no fonts, no colours that say something alone, nothing that needs a script.
constexpr const char* kCss = R"(
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.2rem 1rem 3rem; max-width: 66rem; font: 16px/1.5 system-ui, "Segoe UI", Helvetica, Arial, sans-serif; color: #1c1c1c; background: #fff; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; overflow-wrap: anywhere; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .5rem; padding-top: .5rem; border-top: 2px solid #1c1c1c; }
h3 { font-size: 1.02rem; margin: 1.4rem 0 .3rem; }
p { margin: .4rem 0 .8rem; max-width: 52rem; }
a { color: #0b4f85; }
nav ul { list-style: none; margin: 1rem 0 0; padding: 0; display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; font-size: .92rem; }
.quiet, .absent, figcaption, caption { color: #555; }
.absent { font-style: italic; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .8rem; margin: 1.2rem 0; padding: 0; }
.cards div { border: 1px solid #bbb; border-left: 5px solid #0072B2; border-radius: 4px; padding: .6rem .8rem; }
.cards dt { font-size: .85rem; color: #555; }
.cards dd { margin: 0; }
.cards .value { font-size: clamp(1.35rem, 5vw, 1.7rem); font-weight: 650; line-height: 1.25; font-variant-numeric: tabular-nums; white-space: nowrap; }
.cards .more { font-size: .85rem; color: #555; line-height: 1.35; }
.wide { overflow-x: auto; margin: .6rem 0 1rem; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding-bottom: .3rem; }
caption span { display: inline-block; max-width: calc(100vw - 2rem); } /* a table may be wider than the screen, what it says of itself not */
th, td { padding: .28rem .7rem .28rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid #ddd; }
th:not(:last-child), td:not(:last-child) { padding-right: 1.1rem; }
thead th { border-bottom: 1.5px solid #1c1c1c; vertical-align: bottom; line-height: 1.25; }
tbody th { font-weight: 400; }
tbody th:not(.number) { min-width: 8rem; }
tbody th.number + td { min-width: 17rem; }
.number { text-align: right; }
td.number { white-space: nowrap; }
tbody tr.strong > * { font-weight: 650; }
.bad { font-weight: 700; }
figure { margin: .8rem 0; }
figcaption { font-size: .92rem; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 20rem), 1fr)); gap: .4rem 1.2rem; align-items: start; }
.plot { margin: .4rem 0; }
.plot svg { display: block; height: auto; width: min(100%, 45rem); }
.plots .plot svg { width: min(100%, 22rem); }
img { display: block; max-width: 100%; height: auto; background: #000; }
.channels { display: grid; grid-template-columns: repeat(auto-fill, minmax(9.5rem, 1fr)); gap: .7rem; }
.channels figure { margin: 0; }
.channels img { width: 100%; }
dl.facts { display: grid; grid-template-columns: max-content 1fr; gap: .2rem 1.2rem; }
dl.facts dt { color: #555; }
dl.facts dd { margin: 0; overflow-wrap: anywhere; }
code { font: .92em ui-monospace, Consolas, monospace; overflow-wrap: anywhere; }
@media (max-width: 34rem) { dl.facts { grid-template-columns: 1fr; gap: 0; } dl.facts dd { margin-bottom: .5rem; } }
@media print {
  @page { margin: 14mm; }
  body { font-size: 10.5pt; padding: 0; max-width: none; }
  nav { display: none; }
  h2, h3, section > p { break-after: avoid; }
  figure, tr, .cards, .plot, .short { break-inside: avoid; }
  thead { display: table-header-group; }
  .wide { overflow: visible; }
  .plots { grid-template-columns: repeat(3, 1fr); }
  .plot svg { width: 130mm; }
  .plots .plot svg { width: 100%; }
  .channels { grid-template-columns: repeat(6, 1fr); }
  * { print-color-adjust: exact; }
}
)";

// ---- Pieces of a page. What they take is text as it is, except where it says HTML.

std::string paragraph(const std::string& text) { return "<p>" + escaped(text) + "</p>\n"; }
std::string absent(const std::string& why) { return "<p class=\"absent\">" + escaped(why) + "</p>\n"; }
std::string heading(const std::string& text) { return "<h3>" + escaped(text) + "</h3>\n"; }

std::string list(const Texts& lines)
{
    std::string out = "<ul>\n";
    for (const std::string& line : lines) out += "<li>" + escaped(line) + "</li>\n";
    return out + "</ul>\n";
}

struct Column {
    std::string name;
    bool number = true;
};

struct Row {
    Texts cells; // the first names the row
    bool strong = false;
};

constexpr size_t kShortTable = 12; // rows that one sheet of paper keeps together

std::string table(const std::string& caption, const std::vector<Column>& columns, const std::vector<Row>& rows)
{
    const auto kind = [&](size_t column) { return columns[column].number ? " class=\"number\"" : ""; };
    std::string out = std::string("<div class=\"wide") + (rows.size() <= kShortTable ? " short" : "") + "\"><table>\n<caption><span>" +
                      escaped(caption) + "</span></caption>\n<thead><tr>";
    for (size_t i = 0; i < columns.size(); ++i) out += std::string("<th scope=\"col\"") + kind(i) + ">" + escaped(columns[i].name) + "</th>";
    out += "</tr></thead>\n<tbody>\n";
    for (const Row& row : rows) {
        out += row.strong ? "<tr class=\"strong\">" : "<tr>";
        for (size_t i = 0; i < row.cells.size(); ++i) {
            const std::string name = i == 0 ? "th" : "td";
            out += "<" + name + (i == 0 ? " scope=\"row\"" : "") + kind(i) + ">" + escaped(row.cells[i]) + "</" + name + ">";
        }
        out += "</tr>\n";
    }
    return out + "</tbody></table></div>\n";
}

std::string figure(const Plot& plot, const std::string& caption)
{
    const std::string below = caption.empty() ? "" : "<figcaption>" + escaped(caption) + "</figcaption>";
    return "<figure><div class=\"plot\">" + svgPlot(plot) + "</div>" + below + "</figure>\n";
}

/// With its caption. Where there is room it is shown larger, up to `zoom` times.
std::string image(const Picture& p, const std::string& caption, const std::string& alt, double zoom)
{
    const Result<std::vector<std::byte>> png = encodePng("this picture", p.width, p.height, 3, p.rgb);
    const std::string below = "<figcaption>" + escaped(caption) + "</figcaption></figure>\n", width = std::to_string(p.width);
    if (!png) return "<figure>" + absent(png.error().message) + below;
    return "<figure><img alt=\"" + escaped(alt) + "\" width=\"" + width + "\" height=\"" + std::to_string(p.height) +
           "\" style=\"width: " + std::to_string(int(zoom * p.width)) + "px\" src=\"data:image/png;base64," + toBase64(png->data(), png->size()) + "\" />" +
           below;
}

// ---- What can be said of the figures

const SplitFigures* mainSplit(const ReportData& d)
{
    for (const SplitFigures& s : d.splits)
        if (s.split == "test") return &s;
    for (const SplitFigures& s : d.splits)
        if (s.split != "train") return &s;
    return nullptr;
}

double fileBytes(const ReportData& d)
{
    for (const MemoryRow& row : d.memory)
        if (row.what == "file") return row.bytes;
    return 0;
}

std::string decibel(double x) { return std::isfinite(x) ? fixedText(x, 2) + " dB" : fixedText(x, 2); }
/// To hundredths or thousandths: what a clock tells.
std::string msText(double x)
{
    const double size = std::abs(x);
    return size >= 10 || size < 0.001 ? figureText(x) : fixedText(x, size >= 0.1 ? 2 : 3);
}
std::string measuredText(double x, std::string (*text)(double)) { return x > 0 ? text(x) : fixedText(NAN, 0); }
std::string rangeText(double low, double high) { return low > 0 && high > 0 ? msText(low) + " to " + msText(high) : fixedText(NAN, 0); }
std::string percent(double share)
{
    const double size = std::abs(100 * share);
    return std::isfinite(share) ? fixedText(100 * share, size >= 10 ? 0 : size >= 1 ? 1 : 2) + " %" : fixedText(share, 0);
}
std::string pixelsText(const ReportData& d) { return std::to_string(d.width) + " × " + std::to_string(d.height) + " pixels"; }

using Quantity = double (*)(const FrontPoint&);
double timeOf(const FrontPoint& p) { return p.time.ms; }
double bytesOf(const FrontPoint& p) { return p.bytes; }

std::vector<FrontPoint> sortedFront(const std::vector<FrontPoint>& points, Quantity quantity)
{
    std::vector<FrontPoint> front;
    for (const FrontPoint& p : points)
        if (!p.dominated && quantity(p) > 0 && std::isfinite(quantity(p)) && std::isfinite(p.psnrMasked)) front.push_back(p);
    std::stable_sort(front.begin(), front.end(), [&](const FrontPoint& a, const FrontPoint& b) { return quantity(a) < quantity(b); });
    return front;
}

/// "Half the frame time costs 0.84 dB (50 % of the splats)." Empty if nothing on the front is that cheap. `whole`: what everything takes and has.
std::string price(const std::vector<FrontPoint>& front, Quantity quantity, double whole, double wholePsnr, double share, const std::string& what)
{
    const FrontPoint* cheap = nullptr;
    for (const FrontPoint& p : front)
        if (quantity(p) <= share * whole && (!cheap || p.psnrMasked > cheap->psnrMasked)) cheap = &p;
    if (!cheap || !std::isfinite(wholePsnr)) return "";
    const double lost = wholePsnr - cheap->psnrMasked;
    return what + (lost > 0.005 ? " costs " + decibel(lost) : std::string(" costs nothing")) + " (" + cheap->settings + ").";
}

// ---- Sections

std::string cards(const ReportData& d)
{
    std::string out = "<dl class=\"cards\">\n";
    const auto card = [&](const std::string& name, const std::string& value, const std::string& more) {
        out +=
            "<div><dt>" + escaped(name) + "</dt><dd class=\"value\">" + escaped(value) + "</dd><dd class=\"more\">" + escaped(more) + "</dd></div>\n";
    };
    if (const SplitFigures* s = mainSplit(d))
        card("Held-out images, masked PSNR", decibel(s->psnrMasked),
             countText(double(s->images)) + " images of split " + s->split +
                 (std::isfinite(s->noiseFloor) ? "; noise floor " + decibel(s->noiseFloor) : "; noise floor not stated"));
    else
        card("Held-out images, masked PSNR", fixedText(NAN, 0), "not measured: no split but the training images");
    const TimedFrame& t = d.fullFrame;
    if (t.ms > 0)
        card("Frame time, everything on", msText(t.ms) + " ms",
             "re-runs " + rangeText(t.low, t.high) + "; relight " + msText(t.relightMs) + ", sort " + msText(t.sortMs) + ", raster " +
                 msText(t.rasterMs));
    else
        card("Frame time, everything on", fixedText(NAN, 0), "not measured");
    const double bytes = fileBytes(d);
    card("File", measuredText(bytes, bytesText), bytes > 0 && d.splats > 0 ? figureText(bytes / double(d.splats)) + " bytes a splat" : "");
    card("Splats", countText(double(d.splats)), "model " + d.model);
    return out + "</dl>\n";
}

std::string summary(const ReportData& d)
{
    const std::vector<FrontPoint> time = sortedFront(d.frontTime, timeOf), bytes = sortedFront(d.frontBytes, bytesOf);
    std::vector<FrontPoint> whole; // pixels
    for (const FrontPoint& p : time)
        if (!p.scaled) whole.push_back(p);
    const double psnr = d.frontTime.empty() ? NAN : d.frontTime[0].psnrMasked, ms = d.fullFrame.ms, size = fileBytes(d); // the first is everything
    Texts lines;
    for (const std::string& line : {price(whole, timeOf, ms, psnr, 0.5, "Half the frame time"), price(whole, timeOf, ms, psnr, 0.25, "A quarter of the frame time"),
                                    price(time, timeOf, ms, psnr, 0.25, "A quarter of the frame time, drawn at fewer pixels where that helps,"),
                                    price(bytes, bytesOf, size, psnr, 0.5, "Half the bytes"), price(bytes, bytesOf, size, psnr, 0.25, "A quarter of the bytes")})
        if (!line.empty()) lines.push_back(line);
    return lines.empty() ? "" : list(lines);
}

std::string splitsSection(const ReportData& d)
{
    if (d.splits.empty()) return absent("No split of the dataset was measured.");
    std::vector<Row> rows;
    for (const SplitFigures& s : d.splits)
        rows.push_back({{s.split, countText(double(s.images)), fixedText(s.psnrMasked, 2), fixedText(s.noiseFloor, 2), fixedText(s.psnr, 2),
                         fixedText(s.psnrHighlight, 2), percent(s.highlightMissing), percent(s.highlightFalse), fixedText(s.ssim, 4),
                         fixedText(s.flip, 4), figureText(s.relMseLinear)},
                        &s == mainSplit(d)});
    return paragraph("Masked PSNR counts the pixels of the object only. The noise floor is the PSNR between two independent renders or photographs "
                     "of the same frames: against noisy references "
                     "a perfect model scores 3 dB above it, and figures of training images beyond that are learnt noise.") +
           table("The whole asset at the pixels of the dataset; means over images.",
                 {{"split", false},
                  {"images"},
                  {"PSNR masked [dB]"},
                  {"noise floor [dB]"},
                  {"PSNR [dB]"},
                  {"PSNR of highlights [dB]"},
                  {"highlights missing"},
                  {"highlights invented"},
                  {"SSIM"},
                  {"FLIP"},
                  {"relative MSE, linear"}},
                 rows);
}

/// Both fronts. `scale`: of the axis.
std::string frontSection(const std::vector<FrontPoint>& points, Quantity quantity, double scale, const std::string& what, const std::string& axis)
{
    if (points.empty()) return absent("Not measured: no settings were tried.");
    const std::vector<FrontPoint> front = sortedFront(points, quantity);
    const auto plotPoint = [&](const FrontPoint& p, const std::string& label) {
        PlotPoint out{quantity(p) / scale, p.psnrMasked};
        if (quantity == timeOf && p.time.low > 0 && p.time.high > 0) out.low = p.time.low, out.high = p.time.high;
        out.label = p.preset.empty() ? label : label.empty() ? p.preset : label + " " + p.preset;
        out.marked = !p.preset.empty();
        out.hint = p.settings + ": " + (quantity == timeOf ? msText(p.time.ms) + " ms" : bytesText(p.bytes)) + ", " + decibel(p.psnrMasked);
        return out;
    };
    PlotSeries dominated, best, scaled;
    dominated.name = "dominated", dominated.grey = true;
    best.name = "front", best.line = PlotSeries::Line::kSteps;
    scaled.name = "front at fewer pixels", scaled.line = PlotSeries::Line::kSteps;
    for (const FrontPoint& p : points)
        if (p.dominated) dominated.points.push_back(plotPoint(p, ""));
    for (size_t i = 0; i < front.size(); ++i) (front[i].scaled ? scaled : best).points.push_back(plotPoint(front[i], std::to_string(i + 1)));
    const bool presets = std::any_of(points.begin(), points.end(), [](const FrontPoint& p) { return !p.preset.empty(); });

    std::string out;
    if (front.empty()) return out + absent("None of the settings could be measured; the notes say why.");
    const double low = quantity(front.front()), high = quantity(front.back());
    double most = -INFINITY;
    for (const FrontPoint& p : front) most = std::max(most, p.psnrMasked);
    const auto text = [&](double x) { return quantity == timeOf ? msText(x) + " ms" : bytesText(x); };
    out += paragraph(std::to_string(points.size()) + " settings measured, " + std::to_string(front.size()) + " of them on the front: from " +
                     text(low) + " to " + text(high) + ", a range of " + fixedText(high / low, 1) + " times, at " +
                     fixedText(front.front().psnrMasked, 2) + " to " + decibel(most) + ".");
    Plot plot{"Masked PSNR against " + what, {axis, high / low > 4}, {"masked PSNR [dB]"}, {}, {}, 600, 380};
    if (!dominated.points.empty()) plot.series.push_back(dominated);
    plot.series.push_back(best);
    if (!scaled.points.empty()) plot.series.push_back(scaled);
    out +=
        figure(plot, "Up and to the left is better. Numbers are those of the table" + std::string(presets ? "; rings are presets of the asset" : "") +
                         (quantity == timeOf ? "; bars hold the medians of nine re-runs in ten." : "."));
    const auto any = [&](auto has) { return std::any_of(front.begin(), front.end(), has); };
    const bool times = any([](const FrontPoint&p) { return p.time.ms > 0; }), sizes = any([](const FrontPoint&p) { return p.bytes > 0; });
    std::vector<Column> columns = {{"no."}, {"settings", false}};
    if (presets) columns.push_back({"preset", false});
    if (times) columns.insert(columns.end(), {{"frame [ms]"}, {"re-runs [ms]"}});
    if (sizes) columns.push_back({"file"});
    columns.insert(columns.end(), {{"PSNR masked [dB]"}, {"below the best [dB]"}});
    std::vector<Row> rows;
    for (size_t i = 0; i < front.size(); ++i) {
        const FrontPoint& p = front[i];
        Row row{{std::to_string(i + 1), p.settings}, !p.preset.empty()};
        if (presets) row.cells.push_back(p.preset);
        if (times) row.cells.insert(row.cells.end(), {measuredText(p.time.ms, msText), rangeText(p.time.low, p.time.high)});
        if (sizes) row.cells.push_back(measuredText(p.bytes, bytesText));
        row.cells.insert(row.cells.end(), {fixedText(p.psnrMasked, 2), fixedText(most - p.psnrMasked, 2)});
        rows.push_back(std::move(row));
    }
    return out + table("The front: no other setting is at least as good in both and better in one.", columns, rows);
}

std::string levelsSection(const ReportData& d)
{
    if (d.levels.empty()) return absent("Not measured: the asset's splats are in no order of importance, so a prefix of them is no smaller asset.");
    std::vector<Row> rows;
    PlotSeries series;
    series.line = PlotSeries::Line::kStraight;
    double best = -1e300;
    for (const FrontPoint& p : d.levels)
        if (std::isfinite(p.psnrMasked)) best = std::max(best, p.psnrMasked);
    for (const FrontPoint& p : d.levels) {
        rows.push_back({{p.settings, measuredText(p.time.ms, msText), rangeText(p.time.low, p.time.high), measuredText(p.bytes, bytesText),
                         fixedText(p.psnrMasked, 2), fixedText(best - p.psnrMasked, 2)},
                        !p.preset.empty()});
        series.points.push_back({p.time.ms, p.psnrMasked, p.time.low, p.time.high, p.settings, p.settings, false});
    }
    std::stable_sort(series.points.begin(), series.points.end(), [](const PlotPoint& a, const PlotPoint& b) { return a.x < b.x; });
    const bool timed = std::any_of(d.levels.begin(), d.levels.end(), [](const FrontPoint& p) { return p.time.ms > 0; });
    return paragraph("The splats are stored in an order of importance: the first so many of them are the asset at less detail.") +
           (timed ? figure({"Masked PSNR of the levels against frame time", {"frame time [ms]"}, {"masked PSNR [dB]"}, {series}, {}, 600, 340},
                           "Every level, all else on.")
                  : "") +
           table("Levels of detail.", {{"level", false}, {"frame [ms]"}, {"re-runs [ms]"}, {"file"}, {"PSNR masked [dB]"}, {"below the best [dB]"}},
                 rows);
}

std::string historySection(const ReportData& d)
{
    if (d.history.empty()) return absent("The bake's history is not there: nacre bake --track --json FILE keeps it, nacre report --bake FILE shows it.");
    double end = 0, best = -1e300;
    const bool heldOut = std::any_of(d.history.begin(), d.history.end(), [](const HistoryPoint& h) { return h.heldOut; });
    for (const HistoryPoint& h : d.history) {
        if (std::isfinite(h.seconds)) end = std::max(end, h.seconds);
        if (h.heldOut == heldOut && std::isfinite(h.psnr)) best = std::max(best, h.psnr);
    }
    double near = end;
    for (const HistoryPoint& h : d.history)
        if (h.heldOut == heldOut && h.psnr >= best - 0.5) near = std::min(near, h.seconds);
    const double unit = end > 300 ? 60 : 1;
    Plot plot{"PSNR against bake time", {unit > 1 ? "bake time [min]" : "bake time [s]", false, true}, {"PSNR [dB]"}, {}, {}, 600, 340};
    for (const bool held : {true, false}) {
        PlotSeries series;
        series.name = held ? "held-out images" : "training images", series.line = PlotSeries::Line::kStraight;
        for (const HistoryPoint& h : d.history)
            if (h.heldOut == held)
                series.points.push_back({h.seconds / unit, h.psnr, NAN, NAN, "",
                                         durationText(h.seconds) + ": " + decibel(h.psnr) + ", " + countText(double(h.splats)) + " splats", false});
        series.markers = series.points.size() <= 60;
        if (!series.points.empty()) plot.series.push_back(std::move(series));
    }
    std::string text = "Baked in " + durationText(end) + ".";
    if (best > -1e300 && end > 0)
        text += " On the " + std::string(heldOut ? "held-out" : "training") + " images it was within 0.5 dB of its best after " + durationText(near) +
                ", " + percent(near / end) + " of that.";
    return paragraph(text) + figure(plot, heldOut ? "" : "No cameras were held out of this bake: the curve is of training images.");
}

std::string ledgerSection(const ReportData& d)
{
    std::string out;
    if (d.ledger.empty()) out += absent("No part was switched off or on.");
    for (const bool leftOut : {false, true}) {
        std::vector<Row> rows;
        for (const LedgerRow& r : d.ledger)
            if (r.leftOut == leftOut) rows.push_back({{r.part, bytesText(r.bytes), msText(r.ms), fixedText(r.lossDecibel, 2), r.note}});
        if (rows.empty()) continue;
        out += heading(leftOut ? "Left out of this asset" : "In this asset");
        out += table(leftOut ? "Measured by switching each back on: what leaving it out saves, and what it loses."
                             : "Measured by switching each off: what that saves, and what it loses.",
                     {{"part", false}, {"bytes saved"}, {"ms saved"}, {"dB lost"}, {"how it was measured", false}}, rows);
    }
    if (!d.neverPays.empty())
        out += heading("Knobs that never pay here") + paragraph("No setting of these lies on a front, so they are not offered.") + list(d.neverPays);
    return out;
}

std::string scalingsSection(const ReportData& d)
{
    if (d.scalings.empty()) return absent("Frame time was not measured against lights, splats and pixels.");
    std::string out = "<div class=\"plots\">\n";
    for (const Scaling& s : d.scalings) {
        const double most = s.x.empty() ? 0 : *std::max_element(s.x.begin(), s.x.end());
        const double unit = most >= 1e6 ? 1e6 : most >= 1e4 ? 1e3 : 1;
        const std::string per = unit == 1e6 ? "million " : unit == 1e3 ? "thousand " : "";
        PlotSeries series;
        series.name = "measured";
        for (size_t i = 0; i < std::min(s.x.size(), s.ms.size()); ++i) series.points.push_back({s.x[i] / unit, s.ms[i]});
        const Plot plot{"Frame time against " + s.quantity,
                        {per.empty() ? s.quantity : s.quantity + " [" + per.substr(0, per.size() - 1) + "]", false, true},
                        {"frame time [ms]", false, true},
                        {series},
                        {{"fitted", s.slope * unit, s.offset}},
                        330,
                        260};
        const std::string one = unit == 1 && s.quantity.ends_with('s') ? s.quantity.substr(0, s.quantity.size() - 1) : s.quantity;
        out += figure(plot, msText(s.offset) + " ms and " + figureText(s.slope * unit) + " ms for each " + per + one + "; the line is at most " +
                                percent(s.residual) + " off.");
    }
    return out + "</div>\n";
}

std::string imagesSection(const ReportData& d)
{
    if (d.images.empty()) return absent("No images were kept.");
    std::string out = paragraph("From left to right: reference, render, four times their difference.");
    for (const ReportImage& i : d.images) out += image(i.picture, i.caption, i.caption + ": reference, render, error", 2);
    return out;
}

std::string channelsSection(const ReportData& d)
{
    if (d.channels.empty()) return absent("The channels were not drawn.");
    std::string out;
    for (const ChannelSheet& sheet : d.channels) {
        out += heading(sheet.caption) + "<div class=\"channels\">\n";
        for (const NamedPicture& channel : sheet.channels) out += image(channel.picture, channel.name, channel.name + ", " + sheet.caption, 1);
        out += "</div>\n";
    }
    return out;
}

std::string stabilitySection(const ReportData& d)
{
    std::string out = d.stabilityNote.empty() ? "" : paragraph(d.stabilityNote);
    if (d.stability.empty()) return out + absent("The stability suite did not run with this report: nacre selftest runs it.");
    const auto share = [](const StabilityRow& r) { return r.bound > 0 ? r.largest / r.bound : NAN; };
    const StabilityRow& worst = d.stability.front();
    out += paragraph("Worst case: " + worst.name + " in " + worst.backEnd + ", " + figureText(worst.largest) + " of " + worst.quantity +
                     (std::isfinite(share(worst)) ? ", " + percent(share(worst)) + " of its bound." : ".") + (worst.ok ? "" : " It FAILED."));
    std::vector<Row> rows;
    for (const StabilityRow& r : d.stability)
        rows.push_back(
            {{r.name, r.quantity, r.backEnd, figureText(r.largest), figureText(r.bound), percent(share(r)), r.ok ? "ok" : "FAILED", r.reason},
             !r.ok});
    return out + table("Largest deviation from float64: the cases nearest to their bounds.",
                       {{"case", false},
                        {"quantity", false},
                        {"back end", false},
                        {"deviation"},
                        {"bound"},
                        {"of the bound"},
                        {"", false},
                        {"why this bound", false}},
                       rows);
}

std::string memorySection(const ReportData& d)
{
    if (d.memory.empty()) return absent("Memory was not measured.");
    std::vector<Row> rows;
    for (const MemoryRow& r : d.memory) rows.push_back({{r.what, bytesText(r.bytes), d.splats > 0 ? figureText(r.bytes / double(d.splats)) : ""}});
    return table("1 MB is a million bytes.", {{"where", false}, {"size"}, {"bytes a splat"}}, rows);
}

std::string aboutSection(const ReportData& d)
{
    std::string out = "<dl class=\"facts\">\n";
    const auto fact = [&](const char* name, const std::string& value, bool code = false) {
        if (!value.empty())
            out += std::string("<dt>") + name + "</dt><dd>" + (code ? "<code>" : "") + escaped(value) + (code ? "</code>" : "") + "</dd>\n";
    };
    fact("Asset", d.asset), fact("Dataset", d.dataset), fact("Model", d.model), fact("Baked with", d.bakedWith);
    fact("Images", d.width > 0 && d.height > 0 ? pixelsText(d) : "");
    fact("Machine", d.machine), fact("Renderer", d.renderer), fact("Nacre", d.version), fact("Command", d.command, true);
    fact("Made", d.date), fact("Took", d.seconds > 0 ? durationText(d.seconds) : "");
    out += "</dl>\n";
    return d.notes.empty() ? out : out + heading("Notes: what was skipped, and why") + list(d.notes);
}

} // namespace

std::string reportPage(const ReportData& d)
{
    struct Section {
        const char *id, *title;
        std::string html;
    };
    const Section sections[] = {
        {"splits", "Held-out error", splitsSection(d)},
        {"front-time", "Error against frame time", frontSection(d.frontTime, timeOf, 1, "frame time", "frame time [ms]")},
        {"front-bytes", "Error against bytes", frontSection(d.frontBytes, bytesOf, 1e6, "size of the file", "size of the file [MB]")},
        {"levels", "Levels of detail", levelsSection(d)},
        {"history", "Error against bake time", historySection(d)},
        {"ledger", "What each part is worth, and what was left out", ledgerSection(d)},
        {"scalings", "Frame time against lights, splats and pixels", scalingsSection(d)},
        {"images", "Worst and median images", imagesSection(d)},
        {"channels", "Channels", channelsSection(d)},
        {"stability", "Stability", stabilitySection(d)},
        {"memory", "Memory", memorySection(d)},
        {"about", "How this was measured", aboutSection(d)},
    };
    const std::string title = "Nacre report: " + d.asset;
    std::string out = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n<meta name=\"viewport\" "
                      "content=\"width=device-width, initial-scale=1\" />\n"
                      // Whatever a text should smuggle in, nothing is loaded and no script runs.
                      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\" />\n";
    out += "<title>" + escaped(title) + "</title>\n<style>" + kCss + "</style>\n</head>\n<body>\n<header>\n<h1>" + escaped(d.asset) + "</h1>\n";
    out += "<p class=\"quiet\">Against " + escaped(d.dataset) + (d.width > 0 ? ", " + pixelsText(d) : "") +
           (d.renderer.empty() ? "" : ", drawn by " + escaped(d.renderer)) + (d.date.empty() ? "" : ", " + escaped(d.date)) + "</p>\n";
    out += cards(d) + summary(d) + "<nav aria-label=\"Contents\"><ul>\n";
    for (const Section& s : sections) out += std::string("<li><a href=\"#") + s.id + "\">" + escaped(s.title) + "</a></li>\n";
    out += "</ul></nav>\n</header>\n<main>\n";
    for (const Section& s : sections)
        out += std::string("<section id=\"") + s.id + "\">\n<h2>" + escaped(s.title) + "</h2>\n" + s.html + "</section>\n";
    return out + "</main>\n</body>\n</html>\n";
}

Status writeReportPage(const ReportData& data, const std::string& path)
{
    const std::string page = reportPage(data);
    return writeFileAtomically(path, std::as_bytes(std::span(page)));
}

} // namespace nacre::report
