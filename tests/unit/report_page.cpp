// Reports as pages, plots, JSON and tables: well-formed, whatever the texts and figures are.
#include "base/file.h"
#include "interchange/png.h"
#include "report/report_files.h"
#include "report/report_page.h"
#include "eval/report_text.h"
#include "eval/svg_plot.h"

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <set>

#include <stdlib.h> // mkdtemp

using namespace nacre;
using namespace nacre::report;

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInf = std::numeric_limits<double>::infinity();
const std::string kHostile = "a<script>alert(\"x\")</script> & 'b' \x01 \xff\xfe \xed\xa0\x80 \u00e9";

struct Element {
    std::string name, text; // of the element itself, decoded
    std::map<std::string, std::string> attributes;
    double number(const std::string& key) const { return std::stod(attributes.at(key)); }
};

std::string decoded(std::string_view text)
{
    std::string out;
    for (size_t i = 0; i < text.size();) {
        REQUIRE(text[i] != '<');
        if (text[i] != '&') {
            out += text[i++];
            continue;
        }
        static const std::map<std::string_view, char> kEntities = {{"&lt;", '<'}, {"&gt;", '>'}, {"&amp;", '&'}, {"&quot;", '"'}, {"&#39;", '\''}};
        const auto found = kEntities.find(text.substr(i, text.find(';', i) - i + 1));
        REQUIRE_MESSAGE(found != kEntities.end(), "entity at ", text.substr(i, 20));
        out += found->second, i += found->first.size();
    }
    return out;
}

/// The elements in the order of their starts. Fails what XML would refuse: tags that do not nest, attributes twice or without quotes, stray < and &,
/// bytes that are not UTF-8, control characters.
std::vector<Element> parsed(std::string_view xml)
{
    // JSON's writer refuses what is not UTF-8.
    REQUIRE_NOTHROW(nlohmann::json(std::string(xml)).dump());
    for (const char c : xml) REQUIRE((static_cast<unsigned char>(c) >= 0x20 || c == '\n'));
    if (xml.starts_with("<!DOCTYPE html>")) xml.remove_prefix(15);
    std::vector<Element> elements;
    std::vector<size_t> open;
    for (size_t i = 0; i < xml.size();) {
        if (xml[i] != '<') {
            const size_t end = std::min(xml.find('<', i), xml.size());
            const std::string text = decoded(xml.substr(i, end - i));
            if (!open.empty()) elements[open.back()].text += text;
            i = end;
            continue;
        }
        const size_t end = xml.find('>', i); // none in our attributes: > is escaped
        REQUIRE(end != std::string_view::npos);
        std::string_view tag = xml.substr(i + 1, end - i - 1);
        i = end + 1;
        if (tag.starts_with('/')) {
            REQUIRE(!open.empty());
            REQUIRE(elements[open.back()].name == tag.substr(1));
            open.pop_back();
            continue;
        }
        const bool closed = tag.ends_with('/');
        if (closed) tag.remove_suffix(1);
        Element e;
        size_t at = std::min(tag.find(' '), tag.size());
        e.name = tag.substr(0, at);
        REQUIRE(std::all_of(e.name.begin(), e.name.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)); }));
        while ((at = tag.find_first_not_of(' ', at)) != std::string_view::npos) {
            const size_t equals = tag.find("=\"", at), last = tag.find('"', equals + 2);
            REQUIRE_MESSAGE((equals != std::string_view::npos && last != std::string_view::npos), tag);
            REQUIRE(e.attributes.emplace(tag.substr(at, equals - at), decoded(tag.substr(equals + 2, last - equals - 2))).second);
            at = last + 1;
        }
        elements.push_back(std::move(e));
        if (!closed) open.push_back(elements.size() - 1);
    }
    REQUIRE(open.empty());
    return elements;
}

std::vector<Element> named(const std::vector<Element>& elements, const std::string& name)
{
    std::vector<Element> out;
    std::copy_if(elements.begin(), elements.end(), std::back_inserter(out), [&](const Element& e) { return e.name == name; });
    return out;
}

bool says(const std::vector<Element>& elements, const std::string& text)
{
    return std::any_of(elements.begin(), elements.end(), [&](const Element& e) { return e.text.find(text) != std::string::npos; });
}

PlotSeries seriesOf(std::vector<std::pair<double, double>> points)
{
    PlotSeries s;
    for (const auto& [x, y] : points) s.points.push_back({x, y});
    return s;
}

Plot plotOf(std::vector<std::pair<double, double>> points, bool xLog = false, bool yLog = false)
{
    return {"a plot", {"x", xLog}, {"y", yLog}, {seriesOf(std::move(points))}, {}};
}

/// Every part filled, every text hostile.
ReportData hostileData()
{
    ReportData d;
    d.asset = d.dataset = d.model = d.bakedWith = d.command = d.machine = d.renderer = d.version = d.date = d.stabilityNote = kHostile;
    d.splats = 1000, d.width = 20, d.height = 10, d.seconds = 61;
    d.splits = {{kHostile, 3, 30, 25, 0.9, 0.1, 0.01, kNan, 0.5, kInf, kNan}, {"test", 3, 31, 26, 0.9, 0.1, 0.01, 0.5, 0.5, 20, 40}};
    d.fullFrame = {8, 7.5, 8.5, 4, 1, 3};
    for (int i = 1; i <= 6; ++i) {
        FrontPoint p;
        p.settings = kHostile + std::to_string(i), p.preset = i == 2 ? kHostile : "";
        p.time = {double(i), i - 0.1, i + 0.1, 1, 1, 1}, p.bytes = 1000.0 * i, p.psnrMasked = i == 4 ? kNan : 20 + i, p.dominated = i == 3;
        d.frontTime.push_back(p), d.frontBytes.push_back(p), d.levels.push_back(p);
    }
    d.neverPays = d.notes = {kHostile, "b"};
    d.history = {{1, 20, 10, false}, {2, 25, 10, true}, {3, kNan, 10, true}};
    d.ledger = {{kHostile, false, 10, kNan, 0.5, kHostile}, {"lobe", true, kNan, 0.25, -0.1, ""}};
    d.scalings = {
        {kHostile, {1, 2, 4}, {1.5, 2.5, 4.5}, 1, 0.5, 0.01}, {"splats", {1e6, 2e6}, {kNan, kInf}, kNan, kNan, kNan}, {"pixels", {}, {}, 0, 0, 0}};
    const Picture picture{2, 1, {255, 0, 0, 0, 128, 255}};
    d.images = {{kHostile, picture}, {"not there", {}}};
    d.channels = {{kHostile, {{kHostile, picture}, {"direct", picture}}}};
    d.stability = {{kHostile, kHostile, kHostile, 1e-6, 9e-7, kHostile, true}, {"case", "alpha", "why", 0, kNan, "SIMD", false}};
    d.memory = {{"file", 6000}, {kHostile, kNan}};
    return d;
}

std::string textOf(const std::string& path)
{
    const Result<std::vector<std::byte>> bytes = readFile(path);
    REQUIRE(bytes);
    return {reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

struct Folder {
    std::string path = (std::filesystem::temp_directory_path() / "nacre-test-XXXXXX").string();
    Folder() { REQUIRE(mkdtemp(path.data()) != nullptr); }
    ~Folder()
    {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
};

/// RFC 4180.
std::vector<std::vector<std::string>> parsedCsv(const std::string& text)
{
    std::vector<std::vector<std::string>> rows(1, {""});
    bool quoted = false;
    for (size_t i = 0; i < text.size(); ++i) {
        std::string& cell = rows.back().back();
        if (quoted && text[i] == '"' && i + 1 < text.size() && text[i + 1] == '"')
            cell += text[i++];
        else if (text[i] == '"')
            quoted = !quoted;
        else if (quoted || (text[i] != ',' && text[i] != '\n'))
            cell += text[i];
        else if (text[i] == ',')
            rows.back().emplace_back();
        else if (i + 1 < text.size())
            rows.push_back({""});
    }
    REQUIRE(!quoted);
    for (const auto& row : rows) REQUIRE(row.size() == rows.front().size());
    return rows;
}

} // namespace

TEST_CASE("texts in markup come out as they went in, without what XML forbids")
{
    CHECK(escaped("a<b>&\"'") == "a&lt;b&gt;&amp;&quot;&#39;");
    CHECK(escaped("\u00e9 \u20ac \U0001f600") == "\u00e9 \u20ac \U0001f600");
    CHECK(escaped("a\tb\x02") == "a b?");
    CHECK(escaped("x\xff|\xc3|\xe2\x82|\xed\xa0\x80") == "x\ufffd|\ufffd|\ufffd\ufffd|\ufffd\ufffd\ufffd"); // alone, cut off, a surrogate
    CHECK(shortened("caf\u00e9", 4) == "caf\u00e9");
    CHECK(shortened("caf\u00e9s", 4) == "caf\u2026");
}

TEST_CASE("numbers have the digits that mean something")
{
    CHECK(fixedText(12345.678, 1) == "12,345.7");
    CHECK(fixedText(-0.001, 2) == "0.00");
    CHECK(fixedText(-123.4, 0) == "-123");
    CHECK(fixedText(kNan, 2) == "\u2013");
    CHECK(fixedText(1e300, 2) == "1.00e300");
    CHECK(figureText(0.012345) == "0.0123");
    CHECK(figureText(8.3e-6) == "8.3e-6");
    CHECK(figureText(1234.5) == "1,234"); // ties to even
    CHECK(countText(41688) == "41,688");
    CHECK(bytesText(812) == "812 bytes");
    CHECK(bytesText(1) == "1 byte");
    CHECK(bytesText(1.24e6) == "1.24 MB");
    CHECK(bytesText(-2500) == "-2.50 kB");
    CHECK(durationText(48) == "48.0 s");
    CHECK(durationText(200) == "3 min 20 s");
    CHECK(durationText(3900) == "1 h 05 min");
}

TEST_CASE("ticks are round, in order, inside the range and neither few nor many")
{
    const double ranges[][2] = {{0, 1}, {-3, 17}, {1e-5, 9e-5}, {999, 1001}, {0.1, 10000}, {1e-200, 1e200}, {1e6, 1e6 + 0.5}, {2.9, 31}};
    for (const auto& range : ranges)
        for (const bool logarithmic : {false, true}) {
            const double low = range[0], high = range[1];
            if (logarithmic && low <= 0) continue;
            CAPTURE(low);
            CAPTURE(logarithmic);
            const std::vector<double> ticks = plotTicks(low, high, logarithmic);
            CHECK(ticks.size() >= 2);
            CHECK(ticks.size() <= 14);
            CHECK(std::is_sorted(ticks.begin(), ticks.end()));
            CHECK(ticks.front() >= low - 1e-8 * (high - low));
            CHECK(ticks.back() <= high + 1e-8 * (high - low));
        }
    CHECK(plotTicks(0, 1, false) == std::vector<double>{0, 0.2, 2 * 0.2, 0.2 * 3, 0.8, 1});
    CHECK(plotTicks(0.9, 110, true) == std::vector<double>{1, 2, 5, 10, 20, 50, 100});
}

TEST_CASE("points lie on the axes in the order of their values, inside the plot")
{
    const std::vector<std::pair<double, double>> points = {{0.01, -5}, {0.5, -4}, {1, 0}, {3, 0.001}, {1000, 7}, {1e6, 8}};
    for (const bool logarithmic : {false, true}) {
        const std::vector<Element> elements = parsed(svgPlot(plotOf(points, logarithmic))), circles = named(elements, "circle");
        REQUIRE(circles.size() == points.size());
        for (size_t i = 1; i < circles.size(); ++i) {
            // Half a unit apart at least on a logarithmic axis; linear, 0.01 and 3 of a million are one place.
            CHECK(circles[i].number("cx") >= circles[i - 1].number("cx") + (logarithmic ? 5 : 0));
            CHECK(circles[i].number("cy") <= circles[i - 1].number("cy"));
        }
        for (const Element& c : circles) {
            CHECK(c.number("cx") > 0);
            CHECK(c.number("cx") < 560);
            CHECK(c.number("cy") > 0);
            CHECK(c.number("cy") < 360);
        }
        CHECK(circles.front().number("cy") > circles.back().number("cy") + 200);
    }
    // On a logarithmic axis, equal ratios are equal distances.
    const std::vector<Element> circles = named(parsed(svgPlot(plotOf({{1, 1}, {10, 2}, {100, 3}}, true))), "circle");
    CHECK(circles[1].number("cx") - circles[0].number("cx") ==
          doctest::Approx(circles[2].number("cx") - circles[1].number("cx")).epsilon(0.001)); // written with one decimal
}

TEST_CASE("plots of nothing, of one point, of equal and of huge values are plots")
{
    const double all[] = {0, -0.0, 1, -1, 1e-300, 1e300, -1e300, 1.7e308, 5e-324, kNan, kInf, -kInf, 1e6, 1e6 + 1e-9};
    for (const bool logarithmic : {false, true})
        for (const double a : all)
            for (const double b : all) {
                CAPTURE(a);
                CAPTURE(b);
                CAPTURE(logarithmic);
                Plot plot = plotOf({{a, b}, {b, a}, {a, a}}, logarithmic, logarithmic);
                plot.series[0].line = PlotSeries::Line::kSteps;
                plot.series[0].points[0].low = a, plot.series[0].points[0].high = b, plot.series[0].points[0].label = "one",
                plot.series[0].points[0].marked = true;
                plot.fits = {{"line", a, b}};
                const std::string svg = svgPlot(plot);
                CHECK(svg.find("nan") == std::string::npos);
                CHECK(svg.find("inf") == std::string::npos);
                const auto drawn = [&](double x) { return std::isfinite(x) && std::abs(x) <= 1e300 && (!logarithmic || x >= 1e-300); };
                const std::vector<Element> elements = parsed(svg);
                const size_t expected = drawn(a) && drawn(b) ? 4 : drawn(a) ? 1 : 0; // three, and the ring of the first
                CHECK(named(elements, "circle").size() == expected);
                CHECK(says(elements, "cannot be drawn") == (expected < 4));
                for (const Element& c : named(elements, "circle"))
                    CHECK((c.number("cx") > 0 && c.number("cx") < 560 && c.number("cy") > 0 && c.number("cy") < 400));
            }
    Plot none{"none", {"x"}, {"y"}, {}, {}};
    CHECK(says(parsed(svgPlot(none)), "nothing to show"));
    CHECK(says(parsed(svgPlot(plotOf({{1, 1}, {kNan, 1}}))), "1 of 2 points cannot be drawn"));
}

TEST_CASE("texts of a plot are escaped, presets are named, the grey and the lines are there")
{
    Plot plot = plotOf({{1, 1}, {2, 2}, {3, 3}});
    plot.title = plot.x.label = plot.y.label = plot.series[0].name = kHostile;
    plot.series[0].line = PlotSeries::Line::kStraight;
    plot.series[0].points[1].label = "half<&>", plot.series[0].points[1].marked = true, plot.series[0].points[1].hint = kHostile;
    plot.series[0].points[2].low = 2.5, plot.series[0].points[2].high = 3.5;
    plot.series.push_back(seriesOf({{1.5, 1}}));
    plot.series[1].name = "dominated", plot.series[1].grey = true;
    plot.fits = {{kHostile, 1, 0}};
    const std::string svg = svgPlot(plot);
    CHECK(svg.find("<script") == std::string::npos);
    const std::vector<Element> elements = parsed(svg);
    CHECK(says(named(elements, "text"), "half<&>"));
    CHECK(says(named(elements, "text"), "dominated"));
    CHECK(says(named(elements, "title"), "<script>alert(\"x\")"));
    CHECK(named(elements, "polyline").size() == 2);
    const std::vector<Element> circles = named(elements, "circle");
    REQUIRE(circles.size() == 7); // 4 points, 1 ring, 2 in the legend
    CHECK(std::count_if(circles.begin(), circles.end(), [](const Element& c) { return c.attributes.at("fill") == "#fff"; }) == 2);
}

TEST_CASE("series differ in shape and dash, not in colour alone")
{
    Plot plot{"all", {"x"}, {"y"}, {}, {}};
    for (int i = 0; i < 7; ++i) {
        plot.series.push_back(seriesOf({{1, double(i)}, {2, double(i)}}));
        plot.series.back().line = PlotSeries::Line::kStraight;
    }
    std::set<std::string> dashes, shapes;
    for (const Element& e : parsed(svgPlot(plot))) {
        if (e.name == "polyline") dashes.insert(e.attributes.contains("stroke-dasharray") ? e.attributes.at("stroke-dasharray") : "");
        if (e.name == "circle") shapes.insert("circle");
        if (e.name == "polygon") { // relative to its first corner
            const std::string& points = e.attributes.at("points");
            std::string shape;
            double x0 = 0, y0 = 0;
            for (size_t at = 0, n = 0; at < points.size(); ++n) {
                const size_t comma = points.find(',', at), end = std::min(points.find(' ', at), points.size());
                const double x = std::stod(points.substr(at, comma - at)), y = std::stod(points.substr(comma + 1, end - comma - 1));
                if (n == 0) x0 = x, y0 = y;
                shape += std::to_string(std::lround(x - x0)) + "," + std::to_string(std::lround(y - y0)) + " ";
                at = end + 1;
            }
            shapes.insert(shape.substr(0, 12));
        }
    }
    CHECK(dashes.size() == 7);
    CHECK(shapes.size() >= 7);
}

TEST_CASE("a page is well-formed, whole in itself, and escapes every text")
{
    const std::string page = reportPage(hostileData());
    const std::vector<Element> elements = parsed(page);
    for (const Element& e : elements) {
        CHECK(e.name != "script");
        CHECK(e.name != "link");
        for (const auto& [key, value] : e.attributes) {
            CHECK(!key.starts_with("on"));
            if (key == "src") CHECK(value.starts_with("data:image/png;base64,"));
            if (key == "href") CHECK(value.starts_with("#"));
        }
        if (e.name == "img") CHECK(!e.attributes.at("alt").empty());
        if (e.name == "th") CHECK((e.attributes.at("scope") == "col" || e.attributes.at("scope") == "row"));
    }
    CHECK(named(elements, "title").front().text.find("Nacre report: a<script>") == 0);
    CHECK(named(elements, "img").size() == 3);
    CHECK(says(elements, "this picture: cannot write a PNG of 0 x 0"));
    // Links within the page lead somewhere.
    std::set<std::string> ids;
    for (const Element& e : elements)
        if (e.attributes.contains("id")) CHECK(ids.insert(e.attributes.at("id")).second);
    for (const Element& e : named(elements, "a")) CHECK(ids.contains(e.attributes.at("href").substr(1)));
    // Key figures: the test split, not the first.
    CHECK(says(named(elements, "dd"), "26.00 dB"));
    CHECK(says(named(elements, "dd"), "6.00 bytes a splat"));
    CHECK(says(elements, "9.0e-7 of a<script>"));
    CHECK(says(elements, "FAILED"));
}

TEST_CASE("pictures come out of the page as they went in")
{
    ReportData d;
    d.images = {{"one", {2, 1, {255, 0, 10, 0, 128, 255}}}};
    const std::vector<Element> images = named(parsed(reportPage(d)), "img");
    REQUIRE(images.size() == 1);
    const std::string uri = images[0].attributes.at("src"), digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::vector<std::byte> png;
    uint32_t bits = 0, count = 0;
    for (const char c : uri.substr(uri.find(',') + 1)) {
        if (c == '=') break;
        bits = bits << 6 | uint32_t(digits.find(c)), count += 6;
        if (count >= 8) png.push_back(std::byte(bits >> (count -= 8) & 0xff));
    }
    const Result<Image8> image = decodePng8(png, "image");
    REQUIRE(image);
    CHECK(image->rgba == std::vector<uint8_t>{255, 0, 10, 255, 0, 128, 255, 255});
}

TEST_CASE("what was not measured is said in a line each, without empty tables, plots and boxes")
{
    const std::vector<Element> elements = parsed(reportPage(ReportData{}));
    for (const char* name : {"table", "svg", "img", "figure"}) CHECK(named(elements, name).empty());
    const std::vector<Element> paragraphs = named(elements, "p");
    CHECK(std::count_if(paragraphs.begin(), paragraphs.end(),
                        [](const Element& e) { return e.attributes.contains("class") && e.attributes.at("class") == "absent"; }) == 11);
    for (const Element& e : paragraphs) CHECK(!e.text.empty());
}

TEST_CASE("the page is written whole or not at all")
{
    const Folder folder;
    CHECK(!writeReportPage(hostileData(), folder.path + "/missing/report.html"));
    REQUIRE(writeReportPage(hostileData(), folder.path + "/report.html"));
    CHECK(textOf(folder.path + "/report.html") == reportPage(hostileData()));
    CHECK(std::distance(std::filesystem::directory_iterator(folder.path), {}) == 1);
}

TEST_CASE("JSON has every figure, null for what is none")
{
    using Json = nlohmann::ordered_json;
    ReportData d = hostileData();
    d.frontTime[1].settings = "50 % of the splats";
    const Json json = Json::parse(reportJson(d).dump(2, ' ', false, Json::error_handler_t::replace));
    CHECK(json["splits"]["test"]["psnr_masked"] == 26);
    CHECK(json["splits"]["test"]["noise_floor"] == 40);
    for (const auto& [name, split] : json["splits"].items())
        if (name != "test") CHECK((split["noise_floor"].is_null() && split["highlight_missing"].is_null() && split["psnr_highlight"].is_null()));
    REQUIRE(json["front_time"].size() == 6);
    CHECK(json["front_time"][1]["settings"] == "50 % of the splats");
    CHECK(json["front_time"][1]["ms"] == 2);
    CHECK(json["front_time"][1]["ms_low"] == 1.9);
    CHECK(json["front_time"][1]["psnr_masked"] == 22);
    CHECK(json["front_time"][2]["dominated"] == true);
    CHECK(json["front_time"][2]["preset"].is_null());
    CHECK(json["front_time"][3]["psnr_masked"].is_null());
    CHECK(json["front_bytes"][4]["bytes"] == 5000);
    CHECK(json["ledger"][0]["ms"].is_null());
    CHECK(json["ledger"][1] == Json{{"part", "lobe"}, {"left_out", true}, {"bytes", nullptr}, {"ms", 0.25}, {"loss_db", -0.1}, {"note", nullptr}});
    CHECK(json["scalings"][0]["points"][2] == Json{{"x", 4}, {"ms", 4.5}});
    CHECK(json["scalings"][1]["slope_ms"].is_null());
    CHECK(json["history"][1]["held_out"] == true);
    CHECK(json["stability"]["cases"][1]["max"].is_null());
    CHECK(json["memory"][0]["bytes"] == 6000);
    CHECK(json["seconds"] == 61);
    const Json empty = reportJson(ReportData{});
    CHECK((empty["splits"].is_object() && empty["front_time"].is_array() && empty["never_pays"].is_array()));
    for (const auto& [key, value] : empty["full_frame"].items()) CHECK(value.is_null());
}

TEST_CASE("tables are CSV: commas, quotes and line breaks come back")
{
    const Folder folder;
    ReportData d = hostileData();
    const std::string text = "50 %, \"half\"\r\nof it";
    d.frontTime[0].settings = d.ledger[0].part = text;
    REQUIRE(writeReportTables(d, folder.path + "/tables"));
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder.path + "/tables")) {
        parsedCsv(textOf(entry.path().string()));
        names.insert(entry.path().filename().string());
    }
    CHECK(names == std::set<std::string>{"about.csv", "front_bytes.csv", "front_time.csv", "history.csv", "ledger.csv", "levels.csv", "memory.csv",
                                         "scalings.csv", "splits.csv", "stability.csv"});
    const auto front = parsedCsv(textOf(folder.path + "/tables/front_time.csv"));
    REQUIRE(front.size() == 7);
    CHECK(front[1][0] == text);
    CHECK(front[0][2] == "ms");
    CHECK(front[1][2] == "1");
    CHECK(front[4][9] == ""); // not measured
    const auto ledger = parsedCsv(textOf(folder.path + "/tables/ledger.csv"));
    CHECK(ledger[1][0] == text);
    CHECK(ledger[1][3] == "");
    CHECK(ledger[2] == std::vector<std::string>{"lobe", "1", "", "0.25", "-0.1", ""});
    REQUIRE(writeReportTables(ReportData{}, folder.path + "/tables")); // replaced: lines of names only
    CHECK(parsedCsv(textOf(folder.path + "/tables/ledger.csv")).size() == 1);
}
