// Looks for alpha that means something else than coverage of premultiplied colour, in at most kMaxImages images.
//
// Colour where alpha is 0 was never multiplied by it: straight alpha, or a background that is not black.
// Edges.  A pixel of coverage a beside opaque ones of brightness F has brightness a F. Of straight colours taken for premultiplied it is F,
//         of premultiplied ones taken for straight a a F: the median of brightness / (a F) is about 1, 1 / a or a, where a is about 1/2.
// Inverted masks are opaque along the frame and have a hole in the middle, and what is opaque is plain: the background.
#include "dataset/olat_dataset.h"

#include "base/text.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nacre {
namespace {

constexpr size_t kMaxImages = 24;     // keeps `nacre info` fast
constexpr float kNone = 0.5f / 255;   // alpha of nothing
constexpr float kOpaque = 0.98f;
constexpr float kInside = 0.5f;       // alpha of the silhouette
constexpr float kVisible = 0.01f;     // linear brightness that is not noise or ringing
constexpr double kShareUnder = 0.05;  // of the pixels without alpha: glows and dust stay below
constexpr size_t kMinEdges = 200;     // fewer pixels may all lie in one highlight
// Sound renders of wax, marble, paint and fur gave medians of 0.73 to 0.99 (rims are darker than what lies beside them); straight colours taken
// for premultiplied about twice that, the other way round half.
constexpr double kStraight = 1.3, kTwice = 0.55;
constexpr size_t kMinInverted = 3; // images: one may show the inside of something

float brightness(const float* p) { return 0.2126f * p[0] + 0.7152f * p[1] + 0.0722f * p[2]; }

struct AlphaLook {
    float highest = 0;
    size_t under = 0, colouredUnder = 0;  // pixels of alpha 0; those of them with colour
    bool inverted = false;
    std::vector<float> edges;             // brightness / (a F)
};

/// Mean and spread of brightness.
struct Spread {
    double sum = 0, sum2 = 0, count = 0;
    void add(double x) { sum += x, sum2 += x * x, ++count; }
    double mean() const { return count > 0 ? sum / count : 0; }
    double deviation() const { return count > 0 ? std::sqrt(std::max(0.0, sum2 / count - mean() * mean())) : 0; }
};

bool looksInverted(const Image& image)
{
    size_t border = 0, opaqueBorder = 0;
    Spread opaque, hole;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
            const float* p = image.pixel(x, y);
            if (x == 0 || y == 0 || x == image.width - 1 || y == image.height - 1) ++border, opaqueBorder += p[3] > kOpaque;
            if (p[3] > kOpaque) opaque.add(brightness(p));
            else if (p[3] >= 0 && p[3] < 1 - kOpaque) hole.add(brightness(p));
        }
    if (10 * opaqueBorder < 9 * border || hole.count < 0.01 * (hole.count + opaque.count)) return false;
    return opaque.deviation() < 0.02 * opaque.mean() + 1e-3 || opaque.mean() < 0.3 * hole.mean();
}

AlphaLook lookAt(const Image& image)
{
    AlphaLook out;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
            const float* p = image.pixel(x, y);
            const float a = p[3];
            out.highest = std::max(out.highest, a);
            if (a < 0) continue; // nothing is known
            if (a < kNone) ++out.under, out.colouredUnder += brightness(p) > kVisible;
            if (!(a > 0.2f && a < 0.8f)) continue;
            Spread beside;
            for (int v = std::max(0, y - 1); v <= std::min(image.height - 1, y + 1); ++v)
                for (int u = std::max(0, x - 1); u <= std::min(image.width - 1, x + 1); ++u)
                    if (const float* q = image.pixel(u, v); q[3] > kOpaque) beside.add(brightness(q));
            if (beside.mean() > kVisible) out.edges.push_back(float(brightness(p) / (a * beside.mean())));
        }
    out.inverted = looksInverted(image);
    return out;
}

std::string number(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.2g", x);
    return text;
}

} // namespace

std::vector<std::string> checkAlpha(const OlatDataset& dataset, ImageCache& images)
{
    std::vector<std::pair<const OlatSplit*, size_t>> all;
    for (const OlatSplit& split : dataset.splits)
        for (size_t i = 0; i < split.images.size(); ++i) all.emplace_back(&split, i);
    size_t looked = 0, faint = 0, inverted = 0, coloured = 0, withUnder = 0;
    float highest = 0;
    std::string firstFaint, firstColoured;
    std::vector<float> edges;
    const size_t count = std::min(all.size(), kMaxImages);
    for (size_t k = 0; k < count; ++k) {
        const auto [split, index] = all[k * all.size() / count];
        const auto image = images.load(*split, index);
        if (!image) continue; // others say so
        const AlphaLook look = lookAt(**image);
        const std::string& path = split->images[index].path;
        ++looked;
        highest = std::max(highest, look.highest);
        if (look.highest <= kInside && faint++ == 0) firstFaint = path;
        inverted += look.inverted;
        withUnder += look.under > 0;
        if (double(look.colouredUnder) > kShareUnder * double(look.under) && coloured++ == 0) firstColoured = path;
        edges.insert(edges.end(), look.edges.begin(), look.edges.end());
    }
    std::vector<std::string> out = images.notes();
    if (looked == 0) return out;
    const std::string of = " of " + std::to_string(looked) + " images looked at";
    if (highest < kNone) {
        out.push_back("alpha is 0 everywhere in the " + std::to_string(looked) + " images looked at: check the alpha channel or leave it out");
        return out;
    }
    if (faint == looked) {
        out.push_back("alpha nowhere exceeds " + number(highest) + " in the " + std::to_string(looked) +
                      " images looked at: masks are scaled or faint; an opaque object has alpha 1");
    } else if (faint > 0) {
        out.push_back(std::to_string(faint) + of + " have no alpha above 0.5, the first is " + inQuotes(firstFaint) +
                      ": masks that are empty or faint; leave these images out or mend their alpha");
    }
    if (2 * inverted > looked && inverted >= kMinInverted) {
        out.push_back("alpha looks inverted in " + std::to_string(inverted) + of + ": opaque along the frame, where there is only background, and a hole in the "
                      "middle; write 1 where the object is");
        return out;
    }
    const char* key = dataset.premultiplied && !dataset.straightPng ? "straight" : "premultiplied";
    const std::string advice = std::string("; write \"alpha\": \"") + key + "\" at the top level of the description if so";
    if (2 * coloured > withUnder && coloured > 0) {
        out.push_back(std::to_string(coloured) + of + " have colour where alpha is 0, the first is " + inQuotes(firstColoured) +
                      ": alpha is straight, or the background is not black" + advice);
        return out;
    }
    if (edges.size() < kMinEdges) return out;
    std::nth_element(edges.begin(), edges.begin() + ptrdiff_t(edges.size() / 2), edges.end());
    const double median = edges[edges.size() / 2];
    if (median > kStraight && *key == 's')
        out.push_back("half-transparent pixels are " + number(median) + " times as bright as their alpha allows: alpha is straight" + advice);
    if (median < kTwice)
        out.push_back("half-transparent pixels are only " + number(median) + " times as bright as their alpha says: " +
                      (*key == 'p' ? "colours are premultiplied already" + advice : std::string("colours were multiplied by alpha twice, or after their sRGB encoding (masks of "
                                                                          "photographs before something dark do that, too: a rim of a pixel is too dark)")));
    return out;
}

} // namespace nacre
