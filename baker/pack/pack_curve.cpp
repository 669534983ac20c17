#include "pack/pack_curve.h"

#include "base/file.h"
#include "eval/svg_plot.h"

#include <charconv>
#include <filesystem>

namespace nacre {

namespace {

std::string number(double x, int digits)
{
    char text[64];
    return std::string(text, std::to_chars(text, text + sizeof text, x, std::chars_format::fixed, digits).ptr);
}

Status writeText(const std::string& text, const std::string& path) { return writeFileAtomically(path, std::as_bytes(std::span(text))); }

std::string picture(std::span<const PackPoint> curve)
{
    PlotSeries series;
    series.line = PlotSeries::Line::kStraight;
    for (const PackPoint& p : curve) series.points.push_back({p.bytesPerSplat, p.lossDecibel});
    return svgPlot({"Loss against bytes per splat", {"bytes per splat", true}, {"loss [dB]", true}, {series}, {}});
}

} // namespace

Status writeCurve(std::span<const PackPoint> curve, const std::string& path)
{
    std::string table = "bytes_per_splat,loss_db\n";
    for (const PackPoint& p : curve) table += number(p.bytesPerSplat, 2) + "," + number(p.lossDecibel, 4) + "\n";
    if (Status s = writeText(table, path); !s) return s;
    return writeText(picture(curve), std::filesystem::path(path).replace_extension(".svg").string());
}

} // namespace nacre
