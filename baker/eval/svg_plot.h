// Plots as SVG: points with ranges, lines, fitted lines, linear and logarithmic axes. Told apart by shape and dash as well as by colour, for
// prints in black and white; the colours are those of Okabe and Ito, which the colour-blind can tell apart.
#pragma once

#include <limits>
#include <string>
#include <vector>

namespace nacre {

struct PlotPoint {
    double x = 0, y = 0;
    double low = std::numeric_limits<double>::quiet_NaN(), high = low; // range of x: a bar where both are finite
    std::string label{}; // beside the point, where there is room
    std::string hint{};  // while a mouse rests on the point
    bool marked = false; // with a ring; its label is bold, and drawn whether there is room or not
};

struct PlotSeries {
    enum class Line { kNone, kStraight, kSteps }; // kSteps: y stays until the next point
    std::string name;                             // in the legend; empty: not there
    std::vector<PlotPoint> points;                // lines join them in this order
    Line line = Line::kNone;
    bool markers = true;
    bool grey = false;                            // in the background
};

/// y = offset + slope x, drawn over the range of the points' x.
struct PlotLine {
    std::string name;
    double slope = 0, offset = 0;
};

struct PlotAxis {
    std::string label;
    bool logarithmic = false;
    bool fromZero = false; // linear only
};

struct Plot {
    std::string title; // for those who cannot see it
    PlotAxis x, y;
    std::vector<PlotSeries> series;
    std::vector<PlotLine> fits;
    double width = 560, height = 360; // shown smaller where there is less room
};

/// One <svg> element, which is also a whole file. Texts may hold anything. What cannot be drawn (not finite, beyond 1e±300, not positive on a
/// logarithmic axis) is left out, and the plot says how many points those are.
std::string svgPlot(const Plot& plot);

/// Round numbers of the range, increasing, both ends finite and low < high; of a logarithmic axis 0 < low.
std::vector<double> plotTicks(double low, double high, bool logarithmic);

} // namespace nacre
