#include "pack/pack_curve.h"

#include "base/file.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>

namespace nacre {

namespace {

std::string number(double x, int digits)
{
    char text[64];
    return std::string(text, std::to_chars(text, text + sizeof text, x, std::chars_format::fixed, digits).ptr);
}

Status writeText(const std::string& text, const std::string& path) { return writeFileAtomically(path, std::as_bytes(std::span(text))); }

/// Both axes logarithmic.
std::string picture(std::span<const PackPoint> curve)
{
    constexpr double kWidth = 640, kHeight = 400, kLeft = 70, kBelow = 50, kMargin = 20;
    constexpr double kLeastBytes = 8, kMostBytes = 512, kLeastLoss = 0.01, kMostLoss = 10;
    const auto along = [](double v, double low, double high) { return std::log(std::clamp(v, low, high) / low) / std::log(high / low); };
    const auto x = [&](double bytes) { return kLeft + along(bytes, kLeastBytes, kMostBytes) * (kWidth - kLeft - kMargin); };
    const auto y = [&](double loss) { return kHeight - kBelow - along(loss, kLeastLoss, kMostLoss) * (kHeight - kBelow - kMargin); };
    std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"640\" height=\"400\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"640\" height=\"400\" fill=\"white\"/>\n";
    const auto text = [&](double px, double py, const std::string& what, const char* anchor) {
        svg += "<text x=\"" + number(px, 1) + "\" y=\"" + number(py, 1) + "\" text-anchor=\"" + anchor + "\">" + what + "</text>\n";
    };
    const auto line = [&](double x0, double y0, double x1, double y1) {
        svg += "<line x1=\"" + number(x0, 1) + "\" y1=\"" + number(y0, 1) + "\" x2=\"" + number(x1, 1) + "\" y2=\"" + number(y1, 1) + "\" stroke=\"#ccc\"/>\n";
    };
    for (double bytes = kLeastBytes; bytes <= kMostBytes; bytes *= 2) line(x(bytes), kMargin, x(bytes), kHeight - kBelow), text(x(bytes), kHeight - kBelow + 16, number(bytes, 0), "middle");
    for (const double loss : {0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0}) line(kLeft, y(loss), kWidth - kMargin, y(loss)), text(kLeft - 6, y(loss) + 4, number(loss, 2), "end");
    text(0.5 * (kWidth + kLeft), kHeight - 12, "bytes per splat", "middle");
    text(kLeft, kMargin - 6, "loss [dB]", "middle");
    std::string points;
    for (const PackPoint& p : curve) points += number(x(p.bytesPerSplat), 1) + "," + number(y(p.lossDecibel), 1) + " ";
    svg += "<polyline points=\"" + points + "\" fill=\"none\" stroke=\"#06c\" stroke-width=\"2\"/>\n";
    for (const PackPoint& p : curve) svg += "<circle cx=\"" + number(x(p.bytesPerSplat), 1) + "\" cy=\"" + number(y(p.lossDecibel), 1) + "\" r=\"3\" fill=\"#06c\"/>\n";
    return svg + "</svg>\n";
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
