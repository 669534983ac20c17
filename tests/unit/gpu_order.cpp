// The order made by compute shaders against that of the CPU.
#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include "gpu_order.h"
#include "gpu_support.h"

#include <glm/gtc/matrix_transform.hpp>

using namespace nacre;

namespace {

struct Cloud {
    std::vector<glm::vec3> positions;
    std::vector<float> scales;
    SplatGrid grid;
    Texture geometry;
};

/// Positions in a cube, on a coarse grid if wanted so that many are equally far, as an asset's geometry.
void makeCloud(Context& context, Cloud& c, size_t count, uint32_t seed, float grid = 0)
{
    std::mt19937 rng(seed);
    const auto uniform = [&] { return float(rng() >> 8) * 0x1p-23f - 1.0f; };
    for (size_t g = 0; g < count; ++g) {
        const glm::vec3 p(uniform(), uniform(), uniform());
        c.positions.push_back(grid > 0 ? glm::round(p / grid) * grid : p);
        c.scales.push_back(0.01f);
    }
    c.grid = {uint32_t(count), 128, int(count + 127) / 128, 8};
    c.geometry = slotTexture(context, c.grid, GL_RGBA32F, 1);
    uploadSlot<float>(context.gl, c.grid, c.geometry, 0, [&](size_t g, float* out) { std::copy_n(&c.positions[g].x, 3, out); });
}

OrderInstance place(const Cloud& cloud, uint32_t first, const glm::mat4& worldFromAsset, const glm::vec3& eye)
{
    const glm::vec3 fromEye = glm::vec3(worldFromAsset[3]) - eye;
    return {cloud.positions.data(), cloud.scales.data(), uint32_t(cloud.positions.size()), first, glm::mat3(worldFromAsset), fromEye, glm::mat3(worldFromAsset), fromEye, 1.0f, 0.1f};
}

/// Sees everything that is not behind it.
OrderCamera camera(bool orthographic = false)
{
    glm::mat4 p(0);
    p[0][0] = p[1][1] = 0.01f;
    if (orthographic) p[3][3] = 1;
    else p[2][2] = p[2][3] = -1, p[3][2] = -0.02f;
    return {p, {512, 512}, 1e-3f, orthographic, orthographic ? glm::normalize(glm::vec3(0.3f, -0.2f, 0.9f)) : glm::vec3(0), 0.0f};
}

std::vector<uint32_t> readOrder(const Texture& order, size_t count)
{
    std::vector<uint32_t> texels(size_t(order.width()) * size_t(order.height()));
    order.bind(0);
    glGetTexImage(GL_TEXTURE_2D, 0, GL_RED_INTEGER, GL_UNSIGNED_INT, texels.data());
    texels.resize(count);
    return texels;
}

} // namespace

TEST_CASE("compute shaders order as the CPU does, index for index")
{
    GlContext gl;
    if (!gl.missing.empty()) return;
    Context& context = *gl.context;
    struct Case {
        size_t count;
        float grid;
        bool orthographic;
    };
    for (const Case& c : {Case{1, 0, false}, Case{2047, 0, false}, Case{2048, 0.25f, true}, Case{2049, 0.25f, false}, Case{30000, 0, true}, Case{60000, 0.03f, false},
                          Case{60000, 0, false}}) {
        CAPTURE(c.count);
        CAPTURE(c.grid);
        CAPTURE(c.orthographic);
        Cloud cloud;
        makeCloud(context, cloud, c.count, 1, c.grid);
        const Texture list(context, GL_R32UI, 256, int(c.count / 256) + 3);
        const OrderInstance instances[] = {place(cloud, 512, glm::rotate(glm::mat4(1), 0.7f, glm::vec3(0.6f, 0, 0.8f)), {0.2f, 0.1f, 4})};
        const OrderGeometry geometry[] = {{&cloud.geometry, &cloud.grid}};
        Order cpu;
        cpu.update(instances, camera(c.orthographic));
        GpuOrder gpu(context);
        const Failure f = gpu.update(instances, geometry, camera(c.orthographic), list, true);
        REQUIRE_MESSAGE(!f, f.text);
        REQUIRE(gpu.count() == cpu.farToNear().size());
        CHECK(readOrder(list, gpu.count()) == std::vector<uint32_t>(cpu.farToNear().begin(), cpu.farToNear().end()));
        CHECK(glGetError() == GL_NO_ERROR);
    }
}

TEST_CASE("compute shaders order instances jointly, and only what has moved")
{
    GlContext gl;
    if (!gl.missing.empty()) return;
    Context& context = *gl.context;
    Cloud a, b;
    makeCloud(context, a, 5000, 2, 0.25f);
    makeCloud(context, b, 3000, 3, 0.25f);
    const Texture list(context, GL_R32UI, 256, 64);
    glm::vec3 eye(0.5f, 0.25f, 6);
    Order cpu;
    GpuOrder gpu(context);
    const auto update = [&](OrderCamera camera) {
        const OrderInstance instances[] = {place(a, 0, glm::mat4(1), eye), place(b, 5120, glm::translate(glm::mat4(1), glm::vec3(0.5f, 0, 0)), eye),
                                           place(a, 8192, glm::scale(glm::mat4(1), glm::vec3(0.5f)), eye)};
        const OrderGeometry geometry[] = {{&a.geometry, &a.grid}, {&b.geometry, &b.grid}, {&a.geometry, &a.grid}};
        cpu.update(instances, camera);
        REQUIRE(!gpu.update(instances, geometry, camera, list, false));
        CHECK(readOrder(list, gpu.count()) == std::vector<uint32_t>(cpu.farToNear().begin(), cpu.farToNear().end()));
        return gpu.hasSorted();
    };
    CHECK(update(camera()));
    CHECK_FALSE(update(camera()));
    OrderCamera jittered = camera();
    jittered.clipFromView[2][0] += 0.002f;
    CHECK_FALSE(update(jittered));
    eye.x += 1e-3f;
    CHECK(update(camera()));
}
