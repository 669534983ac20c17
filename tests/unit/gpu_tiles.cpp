// The tile rasteriser against blending every splat at every pixel in float64.
#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include "gl_state.h"
#include "gpu_support.h"
#include "splats/blend.h"
#include "tile_raster.h"

#include <cmath>

using namespace nacre;

namespace {

struct Record {
    glm::vec4 projected0, projected1, color;
};

/// From below a pixel to wider than the frame, opaque and faint, some outside, some not to be drawn.
std::vector<Record> randomRecords(size_t count, uint32_t seed, glm::vec2 size, float opacity)
{
    std::mt19937 rng(seed);
    const auto uniform = [&](float lo, float hi) { return lo + (hi - lo) * float(rng() >> 8) * 0x1p-24f; };
    std::vector<Record> records;
    for (size_t g = 0; g < count; ++g) {
        Record r;
        const float radius = std::exp(uniform(-1.2f, 2.5f)) * (g % 97 == 0 ? size.x : 1.0f);
        r.projected0 = {uniform(-1.3f, 1.3f), uniform(-1.3f, 1.3f), uniform(-1.05f, 1.05f), g % 11 == 0 ? 0.0f : uniform(kMinAlpha, opacity)};
        r.projected1 = {radius * uniform(0.5f, 1), radius * uniform(-1, 1), radius * uniform(0.1f, 1), 0};
        r.color = {uniform(0, 2), uniform(0, 1), uniform(0, 1), 0};
        records.push_back(r);
    }
    return records;
}

/// Far to near, as the quads are blended.
Image reference(std::span<const Record> records, std::span<const uint32_t> order, uint32_t first, int width, int height)
{
    Image image{width, height, std::vector<float>(size_t(4) * size_t(width) * size_t(height))};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            glm::dvec4 sum(0);
            for (const uint32_t at : order) {
                const Record& r = records[at - first];
                if (!(r.projected0.w > 0 && std::abs(r.projected0.z) <= 1)) continue;
                const glm::dvec2 d = glm::dvec2(x + 0.5, height - y - 0.5) - (0.5 * glm::dvec2(r.projected0) + 0.5) * glm::dvec2(width, height);
                const double ux = d.x / r.projected1.x, uy = (d.y - r.projected1.y * ux) / r.projected1.z;
                const double alpha = std::min(double(kMaxAlpha), r.projected0.w * std::exp(-0.5 * (ux * ux + uy * uy)));
                if (alpha >= double(kMinAlpha)) sum = glm::dvec4(glm::dvec3(r.color), 1) * alpha + sum * (1 - alpha);
            }
            for (int k = 0; k < 4; ++k) image.pixel(x, y)[k] = float(sum[k]);
        }
    return image;
}

void write(const Gl& gl, const DrawList& list, std::span<const Record> records, uint32_t first)
{
    const auto upload = [&](const Texture& texture, glm::vec4 Record::*what) {
        std::vector<glm::vec4> texels(size_t(texture.width()) * size_t(texture.height()), glm::vec4(NAN)); // nobody may look elsewhere
        for (size_t g = 0; g < records.size(); ++g) texels[first + g] = records[g].*what;
        texture.bind(0);
        gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, texture.width(), texture.height(), GL_RGBA, GL_FLOAT, texels.data());
    };
    upload(list.projected0, &Record::projected0), upload(list.projected1, &Record::projected1), upload(list.color, &Record::color);
}

} // namespace

TEST_CASE("tiles are what blending each splat at each pixel gives, over what the target holds")
{
    GlContext gl;
    if (!gl.missing.empty()) return;
    Context& context = *gl.context;
    markGlContext(context);
    struct Case {
        size_t count;
        int width, height;
        float opacity;
        uint32_t batch;
    };
    for (const Case& c : {Case{1, 16, 16, 1, 1u << 18}, Case{700, 75, 53, 0.3f, 1u << 18}, Case{700, 75, 53, 0.3f, 64}, Case{900, 200, 140, 1, 100}, Case{1500, 33, 17, 0.02f, 1u << 18}}) {
        CAPTURE(c.count);
        CAPTURE(c.width);
        CAPTURE(c.batch);
        const std::vector<Record> records = randomRecords(c.count, 1, {c.width, c.height}, c.opacity);
        DrawList list(context);
        ListRows gap, rows;
        REQUIRE(!list.place(1, 300, &gap));
        REQUIRE(!list.place(2, uint32_t(c.count), &rows));
        const uint32_t first = list.firstIndex(rows);
        write(context.gl, list, records, first);
        std::vector<uint32_t> order;
        for (uint32_t g = 0; g < c.count; ++g) order.push_back(first + g);
        std::shuffle(order.begin(), order.end(), std::mt19937(2));
        list.upload(order);

        REQUIRE(gl.gl->beginFrame(c.width, c.height));
        const float background[4] = {0.25f, 0.5f, 0.75f, 1};
        glClearBufferfv(GL_COLOR, 0, background);
        ViewFrame frame;
        frame.viewport = {c.width, c.height};
        TileRaster tiles(context, c.batch);
        {
            GlStateGuard state(context.gl);
            context.gl.BindVertexArray(context.vertexArray);
            bool drawn = false;
            const Failure f = tiles.draw(frame, list, uint32_t(c.count), false, state, &drawn);
            REQUIRE_MESSAGE(!f, f.text);
            CHECK(drawn);
        }
        CHECK(glGetError() == GL_NO_ERROR);
        const Image image = gl.gl->readFrame(), expected = reference(records, order, first, c.width, c.height);
        double most = 0;
        for (size_t i = 0; i < image.rgba.size(); ++i) {
            const float behind = background[i % 4] * (1 - expected.rgba[i - i % 4 + 3]);
            most = std::max(most, std::abs(double(image.rgba[i]) - double(expected.rgba[i] + behind)));
        }
        CHECK(most < 2.5 * double(kMinTransmittance)); // what lies behind it is left out, colours go to 2
    }
    gl.gl->makeCurrent();
    glDeleteVertexArrays(1, &context.vertexArray);
}
