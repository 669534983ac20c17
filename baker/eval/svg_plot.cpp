// From top to bottom: legend, plot area, numbers of the x axis, its label, what was left out. The sizes of texts are estimated: fonts are not known.
#include "eval/svg_plot.h"

#include "eval/report_text.h"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace nacre {

namespace {

constexpr double kFont = 14, kSmall = 12, kLine = 18; // text and its rows
constexpr double kMarker = 4.5;                       // half the size of one
constexpr double kGreatest = 1e300, kLeast = 1e-300;  // sums and ratios stay finite
constexpr double kEqual = 1e-8;                       // values this near, of their size, are drawn as one

struct Style {
    const char *color, *dash;
};
// Okabe and Ito without their yellow, which paper swallows. Shapes go with them: drawMarker.
constexpr Style kStyles[] = {{"#0072B2", ""},    {"#D55E00", "7 3"}, {"#009E73", "2 3"}, {"#CC79A7", "9 3 2 3"},
                             {"#E69F00", "4 2"}, {"#56B4E9", "1 2"}, {"#000000", "12 4"}};
constexpr Style kGrey = {"#8c8c8c", ""};

/// Two colours of lines and texts.
constexpr const char *kInk = "#222", *kGrid = "#e2e2e2";

std::string at(double x)
{
    char text[40];
    return {text, std::to_chars(text, text + sizeof text, std::clamp(x, -1e5, 1e5), std::chars_format::fixed, 1).ptr};
}

/// Up to ten digits.
std::string tickText(double x)
{
    char text[40];
    const bool plain = x == 0 || (std::abs(x) >= 1e-4 && std::abs(x) < 1e7);
    std::string out(
        text, std::to_chars(text, text + sizeof text, x, plain ? std::chars_format::general : std::chars_format::scientific, plain ? 10 : 9).ptr);
    if (plain) return out;
    const size_t e = out.find('e'), last = out.find_last_not_of('0', e - 1), end = out[last] == '.' ? last : last + 1;
    return shortExponent(out.erase(end, e - end));
}

double textWidth(const std::string& text, double font)
{
    return 0.56 * font * double(std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}

std::string textAt(double x, double y, const std::string& text, const char* anchor, double font = kFont, const std::string& more = "")
{
    return "<text x=\"" + at(x) + "\" y=\"" + at(y) + "\" text-anchor=\"" + anchor + "\" font-size=\"" + at(font) + "\" fill=\"" + kInk + "\"" +
           more + ">" + escaped(text) + "</text>\n";
}

std::string lineFrom(double x0, double y0, double x1, double y1, const std::string& stroke)
{
    return "<line x1=\"" + at(x0) + "\" y1=\"" + at(y0) + "\" x2=\"" + at(x1) + "\" y2=\"" + at(y1) + "\" " + stroke + "/>\n";
}

std::string strokeOf(const Style& style, double width)
{
    std::string out = std::string("stroke=\"") + style.color + "\" stroke-width=\"" + at(width) + "\"";
    return *style.dash ? out + " stroke-dasharray=\"" + style.dash + "\"" : out;
}

/// Of about the same area each. Points in the background are hollow.
std::string marker(size_t shape, double x, double y, double r, const Style& style, bool hollow, const std::string& hint)
{
    const std::string inside = hint.empty() ? "/>\n" : "><title>" + escaped(hint) + "</title>";
    const std::string look =
        std::string(" fill=\"") + (hollow ? "#fff" : style.color) + "\" stroke=\"" + style.color + "\" stroke-width=\"1.2\"" + inside;
    const auto polygon = [&](std::initializer_list<std::pair<double, double>> corners) {
        std::string out = "<polygon points=\"";
        for (const auto& [dx, dy] : corners) out.append(at(x + r * dx)).append(",").append(at(y + r * dy)).append(" ");
        out.back() = '"';
        return out + look + (hint.empty() ? "" : "</polygon>\n");
    };
    switch (shape % 7) {
    case 1: return polygon({{-0.9, -0.9}, {0.9, -0.9}, {0.9, 0.9}, {-0.9, 0.9}});
    case 2: return polygon({{0, -1.2}, {1.15, 0.85}, {-1.15, 0.85}});
    case 3: return polygon({{0, -1.35}, {1.35, 0}, {0, 1.35}, {-1.35, 0}});
    case 4: return polygon({{0, 1.2}, {1.15, -0.85}, {-1.15, -0.85}});
    case 5:
        return polygon({{-1.2, -0.4},
                        {-0.4, -0.4},
                        {-0.4, -1.2},
                        {0.4, -1.2},
                        {0.4, -0.4},
                        {1.2, -0.4},
                        {1.2, 0.4},
                        {0.4, 0.4},
                        {0.4, 1.2},
                        {-0.4, 1.2},
                        {-0.4, 0.4},
                        {-1.2, 0.4}});
    case 6: return polygon({{-1.3, -0.6}, {1.3, -0.6}, {1.3, 0.6}, {-1.3, 0.6}});
    default: return "<circle cx=\"" + at(x) + "\" cy=\"" + at(y) + "\" r=\"" + at(r) + "\"" + look + (hint.empty() ? "" : "</circle>\n");
    }
}

bool drawable(double x, bool logarithmic) { return std::isfinite(x) && std::abs(x) <= kGreatest && (!logarithmic || x >= kLeast); }

/// Values to pixels.
struct Scale {
    bool logarithmic = false;
    double low = 0, high = 1; // log10 where logarithmic
    double from = 0, to = 1;  // pixels
    double operator()(double value) const
    {
        return from + (to - from) * (((logarithmic ? std::log10(std::max(value, kLeast)) : value) - low) / (high - low));
    }
};

Scale scaleOf(std::vector<double> values, const PlotAxis& axis)
{
    std::erase_if(values, [&](double v) { return !drawable(v, axis.logarithmic); });
    if (axis.logarithmic)
        for (double& v : values) v = std::log10(v);
    if (values.empty()) values = {0.0, 1.0};
    if (axis.fromZero && !axis.logarithmic) values.push_back(0);
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    Scale s{axis.logarithmic, *low, *high};
    const double size = std::max(std::abs(s.low), std::abs(s.high));
    double room = 0.06 * (s.high - s.low);
    if (s.high - s.low <= std::max(kEqual * size, kLeast)) room = axis.logarithmic ? 0.3 : size > kLeast ? 0.1 * size : 1; // one value, in the middle
    if (!axis.fromZero || axis.logarithmic || s.low < 0) s.low -= room;
    s.high += room;
    if (axis.logarithmic) s.low = std::max(s.low, -305.0), s.high = std::min(s.high, 305.0); // still numbers that are not denormal
    return s;
}

std::vector<double> roundNumbers(double low, double high, int about)
{
    const double rough = (high - low) / about, power = std::pow(10.0, std::floor(std::log10(rough)));
    const double step = power * (rough <= 1.0001 * power ? 1 : rough <= 2.0001 * power ? 2 : rough <= 5.0001 * power ? 5 : 10);
    std::vector<double> out;
    for (double i = std::ceil(low / step - 1e-9); i <= high / step + 1e-9 && out.size() < 100; ++i) out.push_back(i == 0 ? 0.0 : i * step);
    return out;
}

struct Box {
    double left = 0, top = 0, right = 0, bottom = 0;
    double overlap(const Box& b) const
    {
        return std::max(0.0, std::min(right, b.right) - std::max(left, b.left)) * std::max(0.0, std::min(bottom, b.bottom) - std::max(top, b.top));
    }
};

/// Labels where they hide neither a point nor each other, and lines as little as can be.
class Labels {
public:
    explicit Labels(const Box& area) : area_(area) {}
    void keepFree(double x, double y, double half) { taken_.push_back({x - half, y - half, x + half, y + half}); }
    void avoidLine(double x0, double y0, double x1, double y1)
    {
        const int steps = int(std::hypot(x1 - x0, y1 - y0) / 4) + 1;
        for (int i = 0; i <= steps; ++i) {
            const double x = x0 + (x1 - x0) * i / steps, y = y0 + (y1 - y0) * i / steps;
            lines_.push_back({x - 2, y - 2, x + 2, y + 2});
        }
    }

    std::string place(const PlotPoint& point, double x, double y)
    {
        const double font = point.marked ? kFont : kSmall, width = textWidth(point.label, font) * (point.marked ? 1.08 : 1) + 4, height = font,
                     gap = kMarker + (point.marked ? 6 : 4);
        // Nearest first.
        const std::pair<double, double> middles[] = {{gap + width / 2, 0},
                                                     {gap + width / 2, -gap - 2},
                                                     {gap + width / 2, gap + 2},
                                                     {0, -gap - height / 2},
                                                     {0, gap + height / 2},
                                                     {-gap - width / 2, 0},
                                                     {-gap - width / 2, -gap - 2},
                                                     {-gap - width / 2, gap + 2},
                                                     {0, -gap - 1.6 * height},
                                                     {0, gap + 1.6 * height},
                                                     {gap + width / 2, -2.2 * height},
                                                     {gap + width / 2, 2.2 * height},
                                                     {-gap - width / 2, -2.2 * height},
                                                     {-gap - width / 2, 2.2 * height}};
        Box best;
        double least = std::numeric_limits<double>::infinity(), leastHidden = 0;
        for (const auto& [dx, dy] : middles) {
            const Box box = {x + dx - width / 2, y + dy - height / 2, x + dx + width / 2, y + dy + height / 2};
            double hidden = width * height - box.overlap(area_); // what would lie outside
            for (const Box& other : taken_) hidden += box.overlap(other);
            double cost = 20 * hidden;
            for (const Box& line : lines_) cost += box.overlap(line);
            if (cost < least - 1e-6) least = cost, leastHidden = hidden, best = box;
        }
        if (leastHidden > 1 && !point.marked) return "";
        taken_.push_back(best);
        // White around the letters keeps them readable on lines.
        return textAt((best.left + best.right) / 2, best.bottom - 0.18 * font, point.label, "middle", font,
                      std::string(" paint-order=\"stroke\" stroke=\"#fff\" stroke-width=\"3\"") + (point.marked ? " font-weight=\"bold\"" : ""));
    }

private:
    Box area_;
    std::vector<Box> taken_, lines_;
};

struct LegendEntry {
    std::string name, sample; // SVG around (0, 0), 28 wide
};

/// Rows of entries from (left, 0) down; `height` is that of all rows.
std::string legend(const std::vector<LegendEntry>& entries, double left, double right, double* height)
{
    std::string out;
    double x = left, y = 0;
    for (const LegendEntry& entry : entries) {
        const std::string name = shortened(entry.name, size_t((right - left - 40) / (0.56 * kFont)));
        const double width = 34 + textWidth(name, kFont) + 18;
        if (x > left && x + width - 18 > right) x = left, y += kLine + 2;
        out += "<g transform=\"translate(" + at(x) + " " + at(y + kLine / 2) + ")\">\n" + entry.sample + textAt(34, 5, name, "start") + "</g>\n";
        x += width;
    }
    *height = entries.empty() ? 0 : y + kLine + 10;
    return out;
}

} // namespace

std::vector<double> plotTicks(double low, double high, bool logarithmic)
{
    if (!logarithmic) return roundNumbers(low, high, 6);
    const double first = std::log10(low), last = std::log10(high), decades = last - first;
    const int every = std::max(1, int(std::ceil(decades / 8)));
    std::vector<double> out;
    for (int d = int(std::floor(first / every)) * every; d <= last; d += every)
        for (const double m : decades > 4.5 ? std::vector{1.0} : decades > 2.5 ? std::vector{1.0, 3.0} : decades > 1.5 ? std::vector{1.0, 2.0, 5.0} : std::vector{1.0, 2.0, 3.0, 5.0, 7.0}) {
            const double value = d < 0 ? m / std::pow(10.0, -d) : m * std::pow(10.0, d); // 10^-1 is not exact, 1 / 10 as near as can be
            if (value >= low * (1 - 1e-9) && value <= high * (1 + 1e-9)) out.push_back(value);
        }
    return out.size() < 3 ? roundNumbers(low, high, 5) : out;
}

std::string svgPlot(const Plot& plot)
{
    // What is there.
    std::vector<double> xs, ys, ends; // of the points; of their ranges as well
    size_t omitted = 0, all = 0;
    for (const PlotSeries& series : plot.series)
        for (const PlotPoint& p : series.points) {
            ++all;
            if (!drawable(p.x, plot.x.logarithmic) || !drawable(p.y, plot.y.logarithmic)) {
                ++omitted;
                continue;
            }
            xs.push_back(p.x), ys.push_back(p.y);
            if (drawable(p.low, false) && drawable(p.high, false)) ends.insert(ends.end(), {p.low, p.high});
        }
    const double firstX = xs.empty() ? 0 : *std::min_element(xs.begin(), xs.end()), lastX = xs.empty() ? 0 : *std::max_element(xs.begin(), xs.end());
    ends.insert(ends.end(), xs.begin(), xs.end());
    for (const PlotLine& fit : plot.fits)
        if (!xs.empty()) ys.insert(ys.end(), {fit.offset + fit.slope * firstX, fit.offset + fit.slope * lastX});

    // Where it goes.
    Scale x = scaleOf(ends, plot.x), y = scaleOf(ys, plot.y);
    const auto ticksOf = [](const Scale& s) {
        return s.logarithmic ? plotTicks(std::pow(10.0, s.low), std::pow(10.0, s.high), true) : plotTicks(s.low, s.high, false);
    };
    const std::vector<double> xTicks = ticksOf(x), yTicks = ticksOf(y);
    double widest = 0;
    for (const double tick : yTicks) widest = std::max(widest, textWidth(tickText(tick), kSmall));
    Box area = {widest + kLine + 14, 10, plot.width - 18, plot.height - 2 * kLine - 10 - (omitted ? kLine : 0)};

    std::vector<LegendEntry> entries;
    std::vector<std::pair<size_t, Style>> styles; // shape and colours of each series
    const auto sampleLine = [](const Style& style) { return lineFrom(0, 0, 28, 0, strokeOf(style, 2)); };
    size_t used = 0;
    for (const PlotSeries& series : plot.series) {
        const size_t shape = series.grey ? 0 : used++;
        styles.emplace_back(shape, series.grey ? kGrey : kStyles[shape % std::size(kStyles)]);
        const bool lined = series.line != PlotSeries::Line::kNone;
        if (!series.name.empty())
            entries.push_back({series.name, (lined ? sampleLine(styles.back().second) : "") +
                                                (series.markers ? marker(shape, 14, 0, kMarker, styles.back().second, series.grey, "") : "")});
    }
    const auto fitStyle = [&](size_t i) { return Style{"#000000", kStyles[(i + 1) % std::size(kStyles)].dash}; };
    for (size_t i = 0; i < plot.fits.size(); ++i)
        if (!plot.fits[i].name.empty() && std::isfinite(plot.fits[i].slope + plot.fits[i].offset))
            entries.push_back({plot.fits[i].name, sampleLine(fitStyle(i))});
    double legendHeight = 0;
    const std::string legendText = legend(entries, area.left, area.right, &legendHeight);
    area.top += legendHeight;
    const double height = plot.height + legendHeight; // the plot area keeps its size
    area.bottom += legendHeight;
    x.from = area.left, x.to = area.right, y.from = area.bottom, y.to = area.top;

    std::string out = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + at(plot.width) + " " + at(height) + "\" width=\"" +
                      at(plot.width) + "\" height=\"" + at(height) + "\" role=\"img\" aria-label=\"" + escaped(plot.title) +
                      "\" font-family=\"system-ui, 'Segoe UI', Helvetica, Arial, sans-serif\">\n";
    out += "<rect width=\"" + at(plot.width) + "\" height=\"" + at(height) + "\" fill=\"#fff\"/>\n";
    out += "<g transform=\"translate(0 6)\">\n" + legendText + "</g>\n";

    const std::string grid = std::string("stroke=\"") + kGrid + "\"";
    out += "<g class=\"axes\">\n";
    for (const double tick : xTicks)
        out += lineFrom(x(tick), area.top, x(tick), area.bottom, grid) + textAt(x(tick), area.bottom + kLine, tickText(tick), "middle", kSmall);
    for (const double tick : yTicks)
        out += lineFrom(area.left, y(tick), area.right, y(tick), grid) + textAt(area.left - 6, y(tick) + 4, tickText(tick), "end", kSmall);
    out += "<rect x=\"" + at(area.left) + "\" y=\"" + at(area.top) + "\" width=\"" + at(area.right - area.left) + "\" height=\"" +
           at(area.bottom - area.top) + "\" fill=\"none\" stroke=\"#777\"/>\n";
    const auto fitting = [](const std::string& label, double room) { return shortened(label, size_t(std::max(4.0, room / (0.56 * kFont)))); };
    out += textAt((area.left + area.right) / 2, area.bottom + 2 * kLine + 1, fitting(plot.x.label, area.right - area.left), "middle");
    const double middle = (area.top + area.bottom) / 2;
    out += textAt(kLine - 3, middle, fitting(plot.y.label, area.bottom - area.top), "middle", kFont,
                  " transform=\"rotate(-90 " + at(kLine - 3) + " " + at(middle) + ")\"");
    if (xs.empty()) out += textAt((area.left + area.right) / 2, middle, "nothing to show", "middle");
    out += "</g>\n";
    if (omitted)
        out += textAt(area.left, height - 8,
                      std::to_string(omitted) + " of " + std::to_string(all) + " points cannot be drawn: not finite" +
                          (plot.x.logarithmic || plot.y.logarithmic ? ", or not above 0" : ""),
                      "start", kSmall);

    const auto shown = [&](const PlotPoint& p) { return drawable(p.x, x.logarithmic) && drawable(p.y, y.logarithmic); };
    Labels labels(area);
    std::string lines, marks, texts;
    for (size_t i = 0; i < plot.fits.size() && firstX < lastX; ++i) {
        std::string points; // straight lines are curves on logarithmic axes
        for (int k = 0; k <= 64; ++k) {
            const double t = k / 64.0,
                         at0 = x.logarithmic ? std::pow(10.0, std::log10(firstX) * (1 - t) + std::log10(lastX) * t) : firstX * (1 - t) + lastX * t;
            const double value = plot.fits[i].offset + plot.fits[i].slope * at0;
            if (drawable(value, y.logarithmic)) points += at(x(at0)) + "," + at(y(value)) + " ";
        }
        if (!points.empty()) lines += "<polyline points=\"" + points + "\" fill=\"none\" " + strokeOf(fitStyle(i), 1.5) + "/>\n";
    }
    for (size_t i = 0; i < plot.series.size(); ++i) {
        const PlotSeries& series = plot.series[i];
        const auto& [shape, style] = styles[i];
        const double half = (series.grey ? 0.75 : 1) * kMarker;
        std::string path;
        double lastX = 0, lastY = 0;
        marks += "<g class=\"series\">\n";
        for (const PlotPoint& p : series.points) {
            if (!shown(p)) continue;
            const double px = x(p.x), py = y(p.y);
            if (!path.empty() && series.line == PlotSeries::Line::kSteps) {
                path += at(px) + "," + at(lastY) + " ";
                labels.avoidLine(lastX, lastY, px, lastY), labels.avoidLine(px, lastY, px, py);
            } else if (!path.empty() && series.line == PlotSeries::Line::kStraight)
                labels.avoidLine(lastX, lastY, px, py);
            path += at(px) + "," + at(py) + " ";
            lastX = px, lastY = py;
            labels.keepFree(px, py, p.marked ? kMarker + 5 : half + 1);
            if (drawable(p.low, false) && drawable(p.high, false)) { // a range that starts at or below 0 starts at the edge of a logarithmic axis
                const double from = std::max(x(std::min(p.low, p.x)), area.left), to = std::min(x(std::max(p.high, p.x)), area.right);
                const std::string stroke = std::string("stroke=\"") + style.color + "\" stroke-width=\"1.2\"";
                labels.avoidLine(from, py, to, py);
                marks += lineFrom(from, py, to, py, stroke) + lineFrom(from, py - 3, from, py + 3, stroke) + lineFrom(to, py - 3, to, py + 3, stroke);
            }
            if (p.marked)
                marks += "<circle cx=\"" + at(px) + "\" cy=\"" + at(py) + "\" r=\"" + at(kMarker + 4) +
                         "\" fill=\"none\" stroke=\"#000\" stroke-width=\"1.6\"/>\n";
            if (series.markers || p.marked) marks += marker(shape, px, py, half, style, series.grey, p.hint);
        }
        marks += "</g>\n";
        if (series.line != PlotSeries::Line::kNone && !path.empty())
            lines += "<polyline points=\"" + path + "\" fill=\"none\" " + strokeOf(style, series.grey ? 1 : 2) + "/>\n";
    }
    for (const bool marked : {true, false}) // those that must be there choose first
        for (const PlotSeries& series : plot.series)
            for (const PlotPoint& p : series.points)
                if (p.marked == marked && !p.label.empty() && shown(p)) texts += labels.place(p, x(p.x), y(p.y));
    return out + lines + marks + texts + "</svg>\n";
}

} // namespace nacre
