// The stability suite within its bounds, and that it finds what is planted.
#include "eval/headless_gl.h"
#include "selftest/print.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string>

using namespace nacre;
using namespace nacre::selftest;

namespace {

const Row& rowOf(const Report& report, const std::string& name)
{
    const auto found = std::find_if(report.rows.begin(), report.rows.end(), [&](const Row& row) { return row.name == name; });
    REQUIRE_MESSAGE(found != report.rows.end(), "no case '", name, "'");
    return *found;
}

/// Runs the case alone; whether it passes.
bool passes(const Hooks& hooks, const std::string& name, bool gl = false)
{
    Options options;
    options.only = name, options.randomScenes = 0, options.gl = gl, options.hooks = hooks;
    const auto report = run(options);
    REQUIRE(report);
    return rowOf(*report, name).passes;
}

// ---- wrong formulas ----------------------------------------------------------------------------------------------------------------

template <class T>
LightSample<T> withoutCap(const T* position, T radius, const T* p)
{
    LightSample<T> s = samplePointLight(position, radius, p);
    s.falloff = T(1) / s.distance2;
    return s;
}

template <class T>
bool withoutLowPass(const View<T>& view, const GaussianGeometry<T>& g, ProjectedGaussian<T>& out)
{
    View<T> bare = view;
    bare.lowPassVariance = T(0);
    return projectGaussian(bare, g, out);
}

template <class T>
bool withoutCompensation(const View<T>& view, const GaussianGeometry<T>& g, ProjectedGaussian<T>& out)
{
    GaussianGeometry<T> larger = g; // as if the low-pass cost no opacity
    detail::ProjectionSteps<T> s;
    if (detail::projectionSteps(view, g, s) && s.compensation > T(0)) larger.opacity = g.opacity / s.compensation;
    return projectGaussian(view, larger, out);
}

template <class T>
bool withoutNearPlane(const View<T>& view, const GaussianGeometry<T>& g, ProjectedGaussian<T>& out)
{
    GaussianGeometry<T> before = g; // what is nearer than the plane is drawn at the plane
    const T z = view.r[6] * g.position[0] + view.r[7] * g.position[1] + view.r[8] * g.position[2] + view.t[2];
    const T push = z > T(0) && z <= T(kNearPlane) ? T(1.001) * T(kNearPlane) - z : T(0);
    for (int k = 0; k < 3; ++k) before.position[k] += push * view.r[6 + k];
    return projectGaussian(view, before, out);
}

template <class T>
bool withoutQuaternionGuard(const View<T>& view, const GaussianGeometry<T>& g, ProjectedGaussian<T>& out)
{
    GaussianGeometry<T> unit = g;
    const T length = std::sqrt(g.rotation[0] * g.rotation[0] + g.rotation[1] * g.rotation[1] + g.rotation[2] * g.rotation[2] + g.rotation[3] * g.rotation[3]);
    for (T& q : unit.rotation) q /= length;
    return projectGaussian(view, unit, out);
}

/// As blendPixel with other ends.
template <class T, bool kCapped, bool kSkips>
T blendWithout(std::span<const uint32_t> order, const ProjectedGaussian<T>* splats, const T* colors, int channels, T px, T py, T* color)
{
    T transmittance = T(1), dx, dy;
    for (int c = 0; c < channels; ++c) color[c] = T(0);
    for (uint32_t i : order) {
        T alpha = splatAlpha(splats[i], px, py, &dx, &dy);
        if (kSkips && !(alpha >= T(kMinAlpha))) continue;
        if (kCapped && alpha > T(kMaxAlpha)) alpha = T(kMaxAlpha);
        for (int c = 0; c < channels; ++c) color[c] += transmittance * alpha * colors[size_t(i) * size_t(channels) + size_t(c)];
        transmittance *= T(1) - alpha;
        if (transmittance < T(kMinTransmittance)) break;
    }
    return T(1) - transmittance;
}

template <class T>
T withoutClamp(const BigsTerms<T>& t, const BigsSharpTerms<T>& sharp, int c)
{
    return sharp.visible * (t.direct * t.scatter[c] + sharp.lobe[c]) + t.indirect[c];
}

template <class T>
BigsSharpTerms<T> lobeFromBehind(const BigsCoefficients<T>& g, const T* wo, const T* wi, T widening)
{
    BigsSharpTerms<T> t = bigsSharpTerms(g, wo, wi, widening);
    for (int c = 0; c < 3 && g.lobe; ++c) t.lobe[c] = g.lobe[4 + c];
    return t;
}

template <class T>
SssReflection<T> smootherThanAllowed(const SssSurface<T>& s, const T* wo, const T* wi, T widening)
{
    const SssReflection<T> o = sssReflect(s, wo, wi, widening);
    SssReflection<T> out = o;
    const T r = s.roughness, a2 = r * r * r * r;
    const T q = T(1) / ((T(1) - o.nh * o.nh) + o.nh * o.nh * a2);
    for (int c = 0; c < 3; ++c) out.value[c] += (a2 * T(kSssInversePi) * q * q - o.d) * o.vis * o.fresnel[c] * o.nl;
    return out;
}

template <class T>
SssReflection<T> litFromBehind(const SssSurface<T>& s, const T* wo, const T* wi, T widening)
{
    T nl = 0;
    for (int c = 0; c < 3; ++c) nl += s.normal[c] * wi[c];
    const T mirrored[3] = {wi[0] - T(2) * nl * s.normal[0], wi[1] - T(2) * nl * s.normal[1], wi[2] - T(2) * nl * s.normal[2]};
    return sssReflect(s, wo, nl < T(0) ? mirrored : wi, widening);
}

struct Planted {
    const char* name;
    const char* found; // by this case
    void (*plant)(Hooks&);
    bool shared = true; // found, too, if reference and column are wrong alike
};

#define NACRE_PLANT(member, function) \
    [](Hooks& h) { h.scalar.member = function<float>, h.reference.member = function<double>; }

template <class T> T uncapped(std::span<const uint32_t> o, const ProjectedGaussian<T>* s, const T* c, int n, T x, T y, T* out) { return blendWithout<T, false, true>(o, s, c, n, x, y, out); }
template <class T> T unskipped(std::span<const uint32_t> o, const ProjectedGaussian<T>* s, const T* c, int n, T x, T y, T* out) { return blendWithout<T, true, false>(o, s, c, n, x, y, out); }

const Planted kPlanted[] = {
    {"no cap of 1/r^2", "light on the mean of a splat: 1/r^2 ends at the least radius", NACRE_PLANT(pointLight, withoutCap)},
    {"no cap of 1/r^2", "light in a splat, nearer than its own radius", NACRE_PLANT(pointLight, withoutCap)},
    {"no low-pass", "a splat of a tenth of a pixel fades with its area", NACRE_PLANT(project, withoutLowPass)},
    {"no compensation of opacity", "a splat of a tenth of a pixel fades with its area", NACRE_PLANT(project, withoutCompensation)},
    {"no near plane", "centres at the near plane and before it", NACRE_PLANT(project, withoutNearPlane), false},
    {"quaternions of no length", "quaternions of length 1e-15 and 0", NACRE_PLANT(project, withoutQuaternionGuard), false},
    {"no cap of alpha", "opacity 1 never blocks everything", NACRE_PLANT(blend, uncapped)},
    {"alpha below 1/255 is blended", "one splat on the axis", NACRE_PLANT(blend, unskipped), false},
    {"no clamps of transport", "T_dir and rho of both signs", NACRE_PLANT(transport, withoutClamp), false},
    {"no clamps of transport", "T_dir negative everywhere: clamped", NACRE_PLANT(transport, withoutClamp), false},
    {"lobes shine from behind", "a lobe before the light, which comes from behind the camera's side", NACRE_PLANT(sharp, lobeFromBehind), false},
    {"no least roughness", "sss: roughness 0, straight on", NACRE_PLANT(reflect, smootherThanAllowed)},
    {"surfaces lit from behind", "sss: a light behind the surface", NACRE_PLANT(reflect, litFromBehind)},
};

// ---- wrong shaders -----------------------------------------------------------------------------------------------------------------

/// Replaced in the source of every shader on its way to OpenGL.
std::string gFind, gReplacement;
size_t gReplaced = 0;
void (*gShaderSource)(unsigned, int, const char* const*, const int*) = nullptr;

void spoiltShaderSource(unsigned shader, int count, const char* const* strings, const int* lengths)
{
    std::string source;
    for (int i = 0; i < count; ++i) source += lengths && lengths[i] >= 0 ? std::string(strings[i], size_t(lengths[i])) : std::string(strings[i]);
    for (size_t at = 0; (at = source.find(gFind, at)) != std::string::npos; at += gReplacement.size()) source.replace(at, gFind.size(), gReplacement), ++gReplaced;
    const char* text = source.c_str();
    gShaderSource(shader, 1, &text, nullptr);
}

void* spoiltProcAddress(const char* name, void* user)
{
    void* real = HeadlessGl::getProcAddress(name, user);
    if (std::strcmp(name, "glShaderSource") != 0) return real;
    gShaderSource = reinterpret_cast<void (*)(unsigned, int, const char* const*, const int*)>(real);
    return reinterpret_cast<void*>(spoiltShaderSource);
}

struct PlantedShader { const char* name; const char* find; const char* replacement; const char* found; };
const PlantedShader kPlantedShaders[] = {
    {"no cap of 1/r^2", "1.0 / max(distance2, row0.w)", "1.0 / distance2", "light in a splat, nearer than its own radius"},
    {"no low-pass", "float det = detRaw + uLowPass * (xx + yy + uLowPass)", "float det = detRaw", "a splat of a tenth of a pixel fades with its area"},
    {"no clamp of T_dir", "t = max(t, 0.0) * s.falloff", "t = t * s.falloff", "T_dir negative everywhere: clamped"},
    {"quads whose corners lie anywhere", "> FARTHEST_REACH", "> 1e30", "condition 1e10: needles across the scene"},
};

} // namespace

TEST_CASE("every case is within its bounds in every column, and random extreme scenes stay finite")
{
    Options options;
    options.randomScenes = 200;
    const auto report = run(options);
    REQUIRE(report);
    for (const ColumnInfo& c : report->columns)
        if (!c.skipped.empty()) MESSAGE("SKIPPED: ", c.name, ": ", c.skipped);
    const std::string text = asText(*report);
    INFO(text.substr(text.find("\nworst case")));
    CHECK(report->failures() == 0);
    CHECK(report->rows.size() >= 40);
    std::set<std::string> names;
    for (const Row& row : report->rows) {
        CAPTURE(row.name);
        CHECK(names.insert(row.name).second);
        CHECK(std::strlen(row.bound.reason) > 5);
        if (report->columns.back().skipped.empty()) CHECK(std::any_of(row.cells.begin(), row.cells.end(), [](const Cell& c) { return c.what != Cell::What::kEmpty; }));
    }
    // the same table in all three forms
    const std::string json = asJson(*report, "test", "a machine"), markdown = asMarkdown(*report, "test", "a machine");
    for (const std::string& name : names) {
        CHECK(json.find(name) != std::string::npos);
        CHECK(markdown.find("| " + name + " |") != std::string::npos);
        CHECK(text.find(name) != std::string::npos);
    }
}

TEST_CASE("a formula that is wrong in one column fails its case")
{
    for (const Planted& planted : kPlanted) {
        CAPTURE(std::string(planted.name));
        CAPTURE(std::string(planted.found));
        CHECK(passes({}, planted.found));
        Hooks hooks;
        planted.plant(hooks);
        hooks.reference = {};
        CHECK_FALSE(passes(hooks, planted.found));
    }
}

TEST_CASE("a formula that is wrong in the template, for columns and reference alike, fails where a closed form is known")
{
    for (const Planted& planted : kPlanted) {
        if (!planted.shared) continue;
        CAPTURE(std::string(planted.name));
        CAPTURE(std::string(planted.found));
        Hooks hooks;
        planted.plant(hooks);
        CHECK_FALSE(passes(hooks, planted.found));
    }
}

TEST_CASE("a shader that is wrong fails its case")
{
    if (const auto gl = HeadlessGl::create(); !gl) {
        MESSAGE("SKIPPED: ", gl.error().message);
        return;
    }
    for (const PlantedShader& planted : kPlantedShaders) {
        CAPTURE(std::string(planted.name));
        gFind = planted.find, gReplacement = planted.find, gReplaced = 0;
        Hooks hooks;
        hooks.getProcAddress = spoiltProcAddress;
        CHECK(passes(hooks, planted.found, true));
        CHECK(gReplaced > 0); // the text is still in the shaders
        gReplacement = planted.replacement;
        CHECK_FALSE(passes(hooks, planted.found, true));
    }
}

TEST_CASE("what is not finite is never within a bound")
{
    const double nan = std::numeric_limits<double>::quiet_NaN(), infinite = std::numeric_limits<double>::infinity();
    const Values reference = {{"colour", {1, 2}, 0}};
    for (const double bad : {nan, infinite, -infinite}) CHECK(deviation({{"colour", {1, bad}, 0}}, reference).max == infinite);
    CHECK(deviation({{"colour", {1, 2.002}, 0}}, reference).max == doctest::Approx(1e-3));
    CHECK(deviation({{"colour", {0, 0.5}, 0}}, {{"colour", {0, 0}, 0}}).max == 0.5);
}
