// Silhouettes of one object agree: along the ray of every silhouette pixel there is a point that all other cameras see inside their
// silhouettes (the visual hull covers the silhouettes it was carved from). Wrong intrinsics, poses or masks leave rays without one.
//
// For sampled pixels of each view, the ray is walked through the ball that the cameras frame. A training view vetoes a point that it frames
// and sees outside its silhouette. The pixel is uncovered if every point is vetoed; the views that veto its best point are suspects.
// Silhouettes are kept at kGrid cells a side, a cell being inside if any of its pixels or neighbours' is: steps and rounding cost nothing,
// and thin parts are not lost.
#include "dataset/checks.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace nacre {
namespace {

constexpr int kGrid = 96, kSteps = 128;   // cells of a silhouette; points of a ray, about one a cell
constexpr int kRaysPerSide = 14;          // of each view
constexpr double kReach = 2.0;            // of the ball, in half-sizes of what the cameras frame
// Right data of ten objects, fur among them, left at most 0.01 uncovered; wrong intrinsics or poses 0.2 to 0.9.
constexpr double kMostUncovered = 0.06;
constexpr double kOneToBlame = 0.5;       // share of the vetoes: then a view is named

struct Silhouette {
    const CheckedView* view;
    glm::dmat4 cameraFromWorld;
    int columns, rows;
    std::vector<uint8_t> inside;          // dilated
    bool outside(const glm::dvec3& world) const
    {
        const glm::dvec3 p(cameraFromWorld * glm::dvec4(world, 1.0));
        if (!(p.z < 0)) return false;     // not framed: this camera cannot tell
        const Camera& c = *view->camera;
        const double x = (c.cx + c.fx * p.x / -p.z) / c.width, y = (c.cy - c.fy * p.y / -p.z) / c.height;
        if (!(x >= 0 && y >= 0 && x < 1 && y < 1)) return false;
        return !inside[size_t(y * rows) * size_t(columns) + size_t(x * columns)];
    }
};

Silhouette silhouetteOf(const CheckedView& view)
{
    const Image& image = *view.pixels;
    Silhouette s{&view, glm::inverse(view.camera->worldFromCamera), std::min(kGrid, image.width), std::min(kGrid, image.height), {}};
    s.inside.assign(size_t(s.columns) * size_t(s.rows), 0);
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
            const float alpha = image.pixel(x, y)[3];
            if (alpha >= 0 && !(alpha > kInside)) continue; // of what is not known the camera cannot tell
            const int i = int(int64_t(x) * s.columns / image.width), j = int(int64_t(y) * s.rows / image.height);
            for (int dj = -1; dj <= 1; ++dj)
                for (int di = -1; di <= 1; ++di)
                    if (i + di >= 0 && j + dj >= 0 && i + di < s.columns && j + dj < s.rows) s.inside[size_t(j + dj) * size_t(s.columns) + size_t(i + di)] = 1;
        }
    return s;
}

struct Tally {
    size_t rays = 0, uncovered = 0;
    double share() const { return rays ? double(uncovered) / double(rays) : 0; }
};

/// The views that veto the best point of the ray through the middle of pixel (x, y); none: the pixel is covered.
std::vector<size_t> vetoes(const CheckedView& view, int x, int y, const std::vector<Silhouette>& carvers, const glm::dvec3& centre, double radius)
{
    const glm::dvec3 eye = view.camera->position(), ray = pixelRay(*view.camera, x + 0.5, y + 0.5);
    const double nearest = glm::dot(centre - eye, ray), miss2 = glm::dot(centre - eye, centre - eye) - nearest * nearest;
    const double half = std::sqrt(std::max(0.0, radius * radius - miss2));
    std::vector<size_t> best(carvers.size() + 1), now;
    for (int step = 0; step < kSteps && !best.empty(); ++step) {
        const double along = nearest + half * (2.0 * (step + 0.5) / kSteps - 1.0);
        if (!(along > 0)) continue;
        now.clear();
        for (size_t c = 0; c < carvers.size() && now.size() < best.size(); ++c)
            if (carvers[c].view != &view && carvers[c].outside(eye + along * ray)) now.push_back(c);
        if (now.size() < best.size()) best = now;
    }
    if (best.size() > carvers.size()) best.clear(); // behind the camera altogether: nothing is known
    return best;
}

} // namespace

void checkHull(const std::vector<CheckedView>& views, const Framing& framing, DatasetExamination& out)
{
    const bool hasTrain = std::any_of(views.begin(), views.end(), [](const CheckedView& v) { return v.split->name == "train"; });
    std::vector<Silhouette> carvers;
    for (const CheckedView& view : views)
        if (!hasTrain || view.split->name == "train") carvers.push_back(silhouetteOf(view));
    std::erase_if(carvers, [](const Silhouette& s) { return std::find(s.inside.begin(), s.inside.end(), 1) == s.inside.end(); }); // a blank mask excludes all: checkAlpha says so
    if (carvers.size() < 3) return; // two silhouettes hardly contradict each other

    std::map<std::string, Tally> tallies;
    std::vector<double> blame(carvers.size());
    double blamed = 0;
    for (const CheckedView& view : views) {
        Tally& tally = tallies[view.split->name];
        const Image& image = *view.pixels;
        const int step = 1 + (std::max(image.width, image.height) - 1) / (2 * kRaysPerSide); // an object fills about half of each side
        for (int y = step / 2; y < image.height; y += step)
            for (int x = step / 2; x < image.width; x += step) {
                if (!(image.pixel(x, y)[3] > kInside)) continue;
                const std::vector<size_t> against = vetoes(view, x, y, carvers, framing.centre, kReach * framing.halfSize);
                tally.rays++, tally.uncovered += !against.empty();
                if (view.split->name != carvers[0].view->split->name) continue;
                for (size_t c : against) blame[c] += 1.0 / double(against.size());
                blamed += !against.empty();
            }
    }

    const std::string carving = carvers[0].view->split->name;
    const bool carversWrong = tallies[carving].share() > kMostUncovered;
    for (SplitFigures& figures : out.splits) {
        const auto found = tallies.find(figures.split);
        if (found == tallies.end() || found->second.rays == 0) continue;
        figures.uncovered = found->second.share();
        if (!(*figures.uncovered > kMostUncovered) || (carversWrong && figures.split != carving)) continue;
        std::string line = "split '" + figures.split + "': " + briefly(100 * *figures.uncovered) +
                           " % of the silhouettes are excluded by those of other cameras (0 is right): ";
        const size_t worst = size_t(std::max_element(blame.begin(), blame.end()) - blame.begin());
        if (figures.split != carving)
            line += "its poses or intrinsics do not fit those of '" + carving + "'; check that they are of these images and in the same units";
        else if (blame[worst] > kOneToBlame * blamed)
            line += "most of them by " + carvers[worst].view->image->path + "; check its pose and mask";
        else
            line += "intrinsics or poses are wrong, or of other images; check focal length and principal point (of this image size? in the order "
                    "the key asks for?), the order of the frames, and the masks";
        out.warnings.push_back(std::move(line));
    }
}

} // namespace nacre
