// Frames of scenes through the public API on a headless context, as ratios in one run: what relighting costs beside the raster, what one
// more light costs, what many instances cost beside one asset of as many splats, and what quads cost that are only blended.
//   bench_scene [frames] [OUT.json]      default 20; fewer where a row would take more than 12 s, but 3
// Variants of a row take turns, frame by frame, after 250 ms of warm-up; times are medians, with glFinish around each frame.
#include "appearance/bigs/bigs.h"
#include "asset/asset_io.h"
#include "base/random.h"
#include "eval/headless_gl.h"
#include "render/projection.h"

#include "nacre/nacre.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/type_ptr.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

using namespace nacre;

namespace {

void demand(bool good, const std::string& what)
{
    if (good) return;
    std::fprintf(stderr, "bench_scene: %s\n", what.c_str());
    std::exit(1);
}
void demand(NacreResult result, const char* what) { demand(result == NACRE_OK, what); }

/// A sphere of splats, bigs with s on 9 functions, lobe and visibility.
SplatAsset sphere(size_t splats, float radius)
{
    Random random(1);
    SplatAsset a;
    a.model = "bigs";
    a.cloud.count = splats;
    const float spacing = radius * std::sqrt(4 * 3.14159f / float(splats));
    Channel lobe{"lobe", kBigsLobeFloats, {}, {}}, visibility{"visibility", 256, {}, {}};
    for (size_t i = 0; i < splats; ++i) {
        const float z = 1 - 2 * (float(i) + 0.5f) / float(splats), phi = 2.39996f * float(i), r = std::sqrt(1 - z * z);
        const glm::vec3 n(r * std::cos(phi), r * std::sin(phi), z);
        a.cloud.positions.push_back(radius * n);
        a.cloud.rotations.push_back(glm::quat(1, 0, 0, 0));
        a.cloud.scales.push_back(glm::vec3(0.5f * spacing)); // about ten splats over a pixel, as in baked assets
        a.cloud.opacities.push_back(0.8f);
        lobe.values.insert(lobe.values.end(), {n.x, n.y, n.z, 200, 0.5f, 0.5f, 0.5f});
        for (int k = 0; k < 256; ++k) visibility.bytes.push_back(uint8_t(random.uniform() * 255));
    }
    const auto channel = [&](const char* name, int components, float size) {
        std::vector<float> values(splats * size_t(components));
        for (float& v : values) v = size * random.uniform();
        a.channels.push_back({name, uint32_t(components), std::move(values), {}});
    };
    channel("tDir", kBigsTransportFunctions, 0.2f);
    channel("tInd", 3 * kBigsTransportFunctions, 0.05f);
    channel("rho", 3, 1.0f);
    channel("s", 3 * bigsPairCount(9), 0.05f);
    a.channels.push_back(std::move(lobe)), a.channels.push_back(std::move(visibility));
    return a;
}

/// The asset `copies` times side by side on a grid, as one asset.
SplatAsset merged(const SplatAsset& one, const std::vector<glm::vec3>& places)
{
    SplatAsset a = one;
    a.cloud.positions.clear(), a.cloud.rotations.clear(), a.cloud.scales.clear(), a.cloud.opacities.clear();
    for (Channel& c : a.channels) c.values.clear(), c.bytes.clear();
    for (const glm::vec3& place : places) {
        for (const glm::vec3& p : one.cloud.positions) a.cloud.positions.push_back(p + place);
        const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
        append(a.cloud.rotations, one.cloud.rotations), append(a.cloud.scales, one.cloud.scales), append(a.cloud.opacities, one.cloud.opacities);
        for (size_t c = 0; c < a.channels.size(); ++c) append(a.channels[c].values, one.channels[c].values), append(a.channels[c].bytes, one.channels[c].bytes);
    }
    a.cloud.count = a.cloud.positions.size();
    return a;
}

std::vector<glm::vec3> grid(int side, float step)
{
    std::vector<glm::vec3> places;
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) places.push_back(step * glm::vec3(float(x) - 0.5f * float(side - 1), float(y) - 0.5f * float(side - 1), 0));
    return places;
}

/// One context with views of instances of assets.
class Scene {
public:
    explicit Scene(HeadlessGl& gl) : gl_(gl)
    {
        NacreContextDesc desc{};
        desc.structSize = sizeof desc, desc.getProcAddress = HeadlessGl::getProcAddress;
        desc.message = [](NacreSeverity, const char* text, void*) { std::fprintf(stderr, "nacre: %s\n", text); };
        demand(nacreContextCreate(&desc, &context_), "no context");
        demand(nacreViewCreate(context_, nullptr, &view_), "no view");
    }
    ~Scene() { nacreContextDestroy(context_); }
    Scene(const Scene&) = delete;

    void add(const SplatAsset& source, const std::vector<glm::vec3>& places)
    {
        const auto bytes = encodeAsset(source);
        demand(bool(bytes), "encoding failed");
        NacreAsset asset;
        demand(nacreAssetCreate(context_, bytes->data(), bytes->size(), &asset), "no asset");
        for (const glm::vec3& p : places) {
            NacreInstanceDesc desc{};
            desc.structSize = sizeof desc, desc.asset = asset;
            const glm::mat4 m = glm::translate(glm::mat4(1), p);
            std::memcpy(desc.worldFromAsset, glm::value_ptr(m), sizeof m);
            NacreInstance instance;
            demand(nacreInstanceCreate(&desc, &instance), "no instance");
        }
    }
    void light(int count, float phase)
    {
        std::vector<NacreLight> lights(size_t(count), NacreLight{});
        for (int l = 0; l < count; ++l) {
            NacreLight& n = lights[size_t(l)];
            n.structSize = sizeof n;
            const float phi = 6.2832f * float(l) / float(count) + phase;
            const float position[3] = {5 * std::cos(phi), 5 * std::sin(phi), 3};
            std::copy_n(position, 3, n.position);
            std::fill_n(n.intensity, 3, 60.0f / float(count));
        }
        demand(nacreContextSetLights(context_, lights.data(), lights.size()), "no lights");
    }
    /// Seconds, all of it done; of its passes with profiling.
    double draw(int width, int height, glm::dvec3 eye, bool turned = false)
    {
        demand(bool(gl_.beginFrame(width, height)), "no frame");
        glFinish();
        const auto start = std::chrono::steady_clock::now();
        NacreDrawDesc desc{};
        desc.structSize = sizeof desc, desc.viewportWidth = width, desc.viewportHeight = height;
        glm::dmat4 view = glm::lookAt(eye, glm::dvec3(0), glm::dvec3(0, 1, 0));
        if (turned) view = glm::rotate(glm::dmat4(1), 1e-4, glm::dvec3(0, 1, 0)) * view;
        const glm::mat4 v(view), p(glm::infinitePerspective(0.7, double(width) / height, 0.05));
        std::memcpy(desc.viewFromWorld, glm::value_ptr(v), sizeof v), std::memcpy(desc.clipFromView, glm::value_ptr(p), sizeof p);
        demand(nacreViewDraw(view_, &desc), "no draw");
        glFinish();
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }
    NacreDrawStats stats() const
    {
        NacreDrawStats s{};
        s.structSize = sizeof s;
        demand(nacreViewGetStats(view_, &s), "no stats");
        return s;
    }

private:
    HeadlessGl& gl_;
    NacreContext context_;
    NacreView view_;
};

double median(std::vector<double> v)
{
    std::nth_element(v.begin(), v.begin() + ptrdiff_t(v.size() / 2), v.end());
    return v[v.size() / 2];
}

/// Medians of the variants, which take turns; each gets the number of the frame.
std::vector<double> interleaved(int frames, const std::vector<std::function<double(int)>>& variants)
{
    std::vector<std::vector<double>> times(variants.size());
    const auto start = std::chrono::steady_clock::now();
    const auto longerThan = [&](double seconds) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() > seconds; };
    int frame = 0;
    for (; frame < 3 || !longerThan(0.25); ++frame)
        for (const auto& v : variants) v(frame);
    const int first = frame;
    for (; frame < first + frames && (frame < first + 3 || !longerThan(12)); ++frame)
        for (size_t i = 0; i < variants.size(); ++i) times[i].push_back(variants[i](frame));
    std::vector<double> medians;
    for (auto& t : times) medians.push_back(median(t));
    return medians;
}

/// The quads of the splats in constant colour, in the order of the asset: what blending them costs at least.
class PlainQuads {
public:
    PlainQuads(HeadlessGl& gl, const SplatAsset& asset, int size, glm::dvec3 eye) : gl_(gl), size_(size)
    {
        Camera camera;
        camera.width = camera.height = size;
        camera.fx = camera.fy = 0.5 * size / std::tan(0.35), camera.cx = camera.cy = 0.5 * size;
        camera.worldFromCamera = glm::inverse(glm::lookAt(eye, glm::dvec3(0), glm::dvec3(0, 1, 0)));
        const View<float> view = makeView<float>(camera, asset.lowPassVariance);
        std::vector<float> corners;
        std::vector<uint32_t> indices;
        for (size_t g = 0; g < asset.cloud.count; ++g) {
            const glm::vec3 &p = asset.cloud.positions[g], &s = asset.cloud.scales[g];
            ProjectedGaussian<float> o;
            if (!projectGaussian(view, {{p.x, p.y, p.z}, {s.x, s.y, s.z}, {1, 0, 0, 0}, asset.cloud.opacities[g]}, o)) continue;
            const float xx = o.conic[0], xy = o.conic[1], yy = o.conic[2], det = xx * yy - xy * xy; // of the inverse
            const float lxx = std::sqrt(yy / det), lyx = -xy / det / lxx, lyy = std::sqrt(xx / det - lyx * lyx), r = std::sqrt(2 * std::log(255 * o.opacity));
            const uint32_t first = uint32_t(corners.size() / 4);
            for (int k = 0; k < 4; ++k) {
                const float u = r * (k & 1 ? 1.0f : -1.0f), v = r * (k & 2 ? 1.0f : -1.0f);
                corners.insert(corners.end(), {2 * (o.mean[0] + lxx * u) / float(size) - 1, 1 - 2 * (o.mean[1] + lyx * u + lyy * v) / float(size), u, v});
            }
            for (const uint32_t k : {0u, 1u, 2u, 2u, 1u, 3u}) indices.push_back(first + k);
        }
        count_ = GLsizei(indices.size());
        glGenVertexArrays(1, &vertices_), glBindVertexArray(vertices_);
        GLuint buffers[2];
        glGenBuffers(2, buffers);
        glBindBuffer(GL_ARRAY_BUFFER, buffers[0]), glBufferData(GL_ARRAY_BUFFER, GLsizeiptr(4 * corners.size()), corners.data(), GL_STATIC_DRAW);
        glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]), glBufferData(GL_ELEMENT_ARRAY_BUFFER, GLsizeiptr(4 * indices.size()), indices.data(), GL_STATIC_DRAW);
        glEnableVertexAttribArray(0), glVertexAttribPointer(0, 4, GL_FLOAT, GL_FALSE, 16, nullptr);
        const char* sources[] = {"#version 330 core\nlayout(location=0) in vec4 c; out vec2 u; void main(){u=c.zw;gl_Position=vec4(c.xy,0,1);}",
                                 "#version 330 core\nin vec2 u; out vec4 o; void main(){float a=min(0.99,0.8*exp(-0.5*dot(u,u))); if(a<1.0/255.0)discard; o=vec4(0.5*a,0.4*a,0.3*a,a);}"};
        program_ = glCreateProgram();
        for (int k = 0; k < 2; ++k) {
            const GLuint shader = glCreateShader(k ? GL_FRAGMENT_SHADER : GL_VERTEX_SHADER);
            glShaderSource(shader, 1, &sources[k], nullptr), glCompileShader(shader), glAttachShader(program_, shader);
        }
        glLinkProgram(program_);
        glBindVertexArray(0);
    }
    double draw()
    {
        demand(bool(gl_.beginFrame(size_, size_)), "no frame");
        glFinish();
        const auto start = std::chrono::steady_clock::now();
        glUseProgram(program_), glBindVertexArray(vertices_);
        glEnable(GL_BLEND), glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA), glDisable(GL_DEPTH_TEST);
        glDrawElements(GL_TRIANGLES, count_, GL_UNSIGNED_INT, nullptr);
        glFinish();
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        glDisable(GL_BLEND), glUseProgram(0), glBindVertexArray(0);
        return seconds;
    }

private:
    HeadlessGl& gl_;
    int size_;
    GLsizei count_ = 0;
    GLuint vertices_ = 0, program_ = 0;
};

std::string json;
void row(const char* name, double value, const char* unit, const char* bar)
{
    std::printf("%-72s %10.4f %-6s %s\n", name, value, unit, bar);
    std::fflush(stdout);
    json += std::string(json.empty() ? "" : ",\n") + "  \"" + name + "\": " + std::to_string(value);
}

} // namespace

int main(int argc, char** argv)
{
    const int frames = argc > 1 ? std::max(std::atoi(argv[1]), 1) : 20;
    auto made = HeadlessGl::create();
    demand(bool(made), made ? "" : made.error().message);
    HeadlessGl& gl = **made;
    std::printf("%s, %d frames\n", gl.description().c_str(), frames);
    const glm::dvec3 eye(1.2, 0.9, 2.6);

    const SplatAsset one = sphere(30000, 0.75f);
    {
        Scene scene(gl), lit[3] = {Scene(gl), Scene(gl), Scene(gl)};
        PlainQuads quads(gl, one, 800, eye);
        const int lights[3] = {1, 9, 17};
        scene.add(one, {glm::vec3(0)});
        scene.light(1, 0);
        for (int i = 0; i < 3; ++i) lit[i].add(one, {glm::vec3(0)}), lit[i].light(lights[i], 0);
        const auto moved = [&](int i) { return [&, i](int f) { return lit[i].light(lights[i], 0.01f * float(f)), lit[i].draw(800, 800, eye); }; };
        const std::vector<double> t = interleaved(frames, {[&](int) { return scene.draw(800, 800, eye); }, moved(0), moved(1), moved(2), [&](int) { return quads.draw(); }});
        const NacreDrawStats rest = scene.stats();
        row("30k, 800^2, at rest: frame", 1e3 * t[0], "ms", "");
        row("30k, 800^2, at rest: passes and sorts", rest.lightPassesRun + rest.viewPassesRun + rest.combinePassesRun + rest.sorted + rest.projected, "", "0");
        row("30k, 800^2: constant quads without order", 1e3 * t[4], "ms", "");
        row("30k, 800^2: raster / constant quads", t[0] / t[4], "", "<= 1.5");
        row("30k, 800^2: relight 1 moving light / raster", (t[1] - t[0]) / t[0], "", "<= 0.25");
        row("30k, 800^2: each further moving light", 1e3 * (t[3] - t[2]) / 8, "ms", "<= 0.02 on a GPU");
        row("30k, 800^2: each further moving light / frame", (t[3] - t[2]) / 8 / t[1], "", "<= 0.02");
    }
    {
        const std::vector<glm::vec3> places = grid(10, 0.16f);
        const SplatAsset prop = sphere(3000, 0.06f);
        Scene many(gl), single(gl);
        many.add(prop, places), single.add(merged(prop, places), {glm::vec3(0)});
        many.light(1, 0), single.light(1, 0);
        const auto at = [&](int f) { return eye + glm::dvec3(1e-3 * f, 0, 0); };
        const std::vector<double> move = interleaved(frames, {[&](int f) { return many.draw(800, 800, at(f)); }, [&](int f) { return single.draw(800, 800, at(f)); }});
        row("100 x 3k, camera moves: frame", 1e3 * move[0], "ms", "");
        row("100 x 3k / 1 x 300k, camera moves", move[0] / move[1], "", "<= 1.3");
        const std::vector<double> lit = interleaved(frames, {[&](int f) { return many.light(1, 0.01f * float(f)), many.draw(800, 800, eye); },
                                                             [&](int f) { return single.light(1, 0.01f * float(f)), single.draw(800, 800, eye); }});
        row("100 x 3k / 1 x 300k, a light moves", lit[0] / lit[1], "", "<= 1.3");
        const std::vector<double> turn = interleaved(frames, {[&](int f) { return many.draw(800, 800, eye, f % 2); }, [&](int f) { return single.draw(800, 800, eye, f % 2); }});
        row("100 x 3k / 1 x 300k, camera turns", turn[0] / turn[1], "", "<= 1.3");
    }
    {
        Scene scene(gl);
        scene.add(sphere(271000, 0.75f), {glm::vec3(0)});
        scene.light(8, 0);
        const std::vector<double> t = interleaved(frames, {[&](int) { return scene.draw(1280, 720, eye); },
                                                           [&](int f) { return scene.light(8, 0.01f * float(f)), scene.draw(1280, 720, eye + glm::dvec3(1e-3 * f, 0, 0)); }});
        row("271k, 720p, 8 lights at rest: frame", 1e3 * t[0], "ms", "");
        row("271k, 720p, 8 lights and camera move: frame", 1e3 * t[1], "ms", "<= 2 on a GPU");
    }
    if (argc > 2) {
        std::FILE* out = std::fopen(argv[2], "w");
        demand(out != nullptr, std::string("cannot write ") + argv[2]);
        std::fprintf(out, "{\n  \"renderer\": \"%s\",\n%s\n}\n", gl.description().c_str(), json.c_str());
        demand(std::fclose(out) == 0, std::string("cannot write ") + argv[2]);
    }
}
