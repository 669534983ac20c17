// The order is compiled into this test: a runtime that is linked shows its C API only.
#include "order.h"

#include "base/camera.h"
#include "render/projection.h"

#include <doctest/doctest.h>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <numeric>
#include <random>

using namespace nacre;

namespace {

struct Cloud {
    std::vector<glm::vec3> positions;
    std::vector<float> scales;
};

/// Positions in a cube of half-width 1; on a coarse grid many are equally far.
Cloud makeCloud(size_t count, uint32_t seed, bool onGrid = false, float largestScale = 0.05f)
{
    std::mt19937 rng(seed);
    const auto uniform = [&](float lo, float hi) { return lo + (hi - lo) * float(rng() >> 8) * 0x1p-24f; };
    Cloud c;
    for (size_t g = 0; g < count; ++g) {
        glm::vec3 p(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
        c.positions.push_back(onGrid ? glm::round(4.0f * p) / 4.0f : p);
        c.scales.push_back(largestScale * uniform(0.01f, 1));
    }
    return c;
}

/// What a view makes of a placed cloud.
struct Viewer {
    glm::dmat4 worldFromCamera{1};
    glm::dmat4 clipFromView{1};
    int width = 80, height = 60;
    bool orthographic = false;
    float lowPass = 0.3f;

    OrderInstance see(const Cloud& cloud, uint32_t first, const glm::dmat4& worldFromAsset = glm::dmat4(1)) const
    {
        const glm::dmat4 viewFromAsset = glm::inverse(worldFromCamera) * worldFromAsset;
        OrderInstance i{};
        i.positions = cloud.positions.data(), i.maxScales = cloud.scales.data();
        i.count = uint32_t(cloud.positions.size()), i.first = first;
        i.worldFromAsset = glm::mat3(worldFromAsset);
        i.fromEye = glm::vec3(glm::dvec3(worldFromAsset[3]) - (orthographic ? glm::dvec3(0) : glm::dvec3(worldFromCamera[3])));
        i.viewFromAsset = glm::mat3(viewFromAsset), i.viewTranslation = glm::vec3(viewFromAsset[3]);
        i.viewScale = float(std::cbrt(std::abs(glm::determinant(glm::dmat3(viewFromAsset))))), i.lowPass = lowPass;
        return i;
    }
    OrderCamera camera() const
    {
        return {glm::mat4(clipFromView), glm::vec2(width, height), orthographic ? 0.0f : kNearPlane, orthographic,
                orthographic ? glm::vec3(glm::normalize(glm::dvec3(worldFromCamera[2]))) : glm::vec3(0), 1e-6f};
    }
};

Viewer lookingAt(glm::dvec3 eye, glm::dvec3 target, double focal = 80)
{
    Viewer v;
    v.worldFromCamera = glm::inverse(glm::lookAt(eye, target, glm::dvec3(0, 1, 0)));
    v.clipFromView = glm::dmat4(0);
    v.clipFromView[0][0] = 2 * focal / v.width, v.clipFromView[1][1] = 2 * focal / v.height;
    v.clipFromView[2][2] = v.clipFromView[2][3] = -1;
    v.clipFromView[3][2] = -2 * double(kNearPlane);
    return v;
}

/// Sees everything there is.
Viewer farAway() { return lookingAt({3, 2, 6}, {0, 0, 0}, 40); }

/// Keys as the header defines them and a stable sort by comparing, near to far, turned over.
std::vector<uint32_t> expectedOrder(std::span<const OrderInstance> instances, const OrderCamera& camera)
{
    std::vector<std::pair<float, uint32_t>> keyed;
    for (const OrderInstance& i : instances)
        for (uint32_t g = 0; g < i.count; ++g) {
            const glm::vec3 d = i.worldFromAsset * i.positions[g] + i.fromEye;
            keyed.push_back({camera.orthographic ? -glm::dot(camera.towardsEye, d) : glm::dot(d, d), i.first + g});
        }
    std::sort(keyed.begin(), keyed.end()); // equal keys by list index
    std::vector<uint32_t> order;
    for (auto it = keyed.rbegin(); it != keyed.rend(); ++it) order.push_back(it->second);
    return order;
}

std::vector<uint32_t> toVector(std::span<const uint32_t> s) { return {s.begin(), s.end()}; }

/// `part` in the order of `all`.
bool isSubsequence(std::span<const uint32_t> part, std::span<const uint32_t> all)
{
    size_t found = 0;
    for (size_t i = 0; i < all.size() && found < part.size(); ++i) found += all[i] == part[found];
    return found == part.size();
}

} // namespace

TEST_CASE("the order is that of a stable sort by comparison, ties included")
{
    const Viewer viewer = farAway();
    for (const size_t count : {0, 1, 2, 3, 1000, 20000})
        for (const bool onGrid : {false, true}) {
            CAPTURE(count);
            CAPTURE(onGrid);
            const Cloud cloud = makeCloud(count, 1, onGrid);
            const OrderInstance instances[] = {viewer.see(cloud, 64)};
            Order order;
            CHECK(order.update(instances, viewer.camera()));
            CHECK(toVector(order.farToNear()) == expectedOrder(instances, viewer.camera()));
        }
}

TEST_CASE("keys that are equal, tiny, huge, infinite or from afar are ordered as the comparison orders them")
{
    const Viewer viewer = farAway();
    for (const float size : {0.0f, 1e-30f, 1e-10f, 1e3f, 1e18f, 1e25f})
        for (const double distance : {0.0, 1e-3, 1e5}) {
            CAPTURE(size);
            CAPTURE(distance);
            Cloud cloud = makeCloud(3000, 2);
            for (glm::vec3& p : cloud.positions) p *= size;
            OrderInstance instances[] = {viewer.see(cloud, 0)};
            instances[0].fromEye = glm::vec3(0, 0, float(-distance));
            OrderCamera camera = viewer.camera();
            camera.nearW = 0;
            Order order;
            order.update(instances, camera);
            const auto expected = expectedOrder(instances, camera);
            CHECK(isSubsequence(order.farToNear(), expected));
            if (distance > 2 * double(size)) CHECK(toVector(order.farToNear()) == expected);
        }
}

TEST_CASE("two instances that overlap are ordered as one cloud")
{
    const Viewer viewer = farAway();
    const Cloud a = makeCloud(3000, 3, true), b = makeCloud(2000, 4, true);
    Cloud merged = a;
    merged.positions.resize(4096, glm::vec3(0)), merged.scales.resize(4096, 0.0f); // list indices of b begin on a row of their own
    merged.positions.insert(merged.positions.end(), b.positions.begin(), b.positions.end());
    merged.scales.insert(merged.scales.end(), b.scales.begin(), b.scales.end());

    const OrderInstance both[] = {viewer.see(a, 0), viewer.see(b, 4096)}, one[] = {viewer.see(merged, 0)};
    Order joint, single;
    joint.update(both, viewer.camera());
    single.update(one, viewer.camera());
    std::vector<uint32_t> expected = toVector(single.farToNear());
    std::erase_if(expected, [](uint32_t at) { return at >= 3000 && at < 4096; });
    CHECK(toVector(joint.farToNear()) == expected);
}

TEST_CASE("instances are placed by their own matrices, mirrored and scaled ones too")
{
    const Viewer viewer = lookingAt({3, 2, 9}, {0, 0, 0}, 30);
    const Cloud cloud = makeCloud(2000, 5);
    const glm::dmat4 turned = glm::rotate(glm::translate(glm::dmat4(1), glm::dvec3(0.5, 0.2, -0.3)), 1.0, glm::dvec3(0.6, 0, 0.8));
    const OrderInstance instances[] = {viewer.see(cloud, 0, turned), viewer.see(cloud, 2048, glm::scale(turned, glm::dvec3(-0.5, 0.5, 0.5))),
                                       viewer.see(cloud, 4096, glm::scale(glm::dmat4(1), glm::dvec3(1.5)))};
    Order order;
    order.update(instances, viewer.camera());
    CHECK(toVector(order.farToNear()) == expectedOrder(instances, viewer.camera()));

    // nearer and aside, some are in the frame in part, or not at all
    for (const double x : {0.0, 1.5, 4.0, 30.0}) {
        CAPTURE(x);
        const Viewer near = lookingAt({x, 2, 5}, {x, 0, 0}, 90);
        const OrderInstance seen[] = {near.see(cloud, 0, turned), near.see(cloud, 2048, glm::translate(glm::dmat4(1), glm::dvec3(3, 0, 0))),
                                      near.see(cloud, 4096, glm::scale(glm::dmat4(1), glm::dvec3(1.5)))};
        order.update(seen, near.camera());
        uint32_t drawn[3] = {};
        for (const uint32_t at : order.farToNear()) ++drawn[at / 2048];
        CHECK(toVector(order.drawnOf()) == std::vector<uint32_t>(drawn, drawn + 3));
        if (x == 30) CHECK(order.farToNear().empty());
    }
}

TEST_CASE("an orthographic view orders by depth, on both sides of the reference point")
{
    Viewer viewer;
    viewer.orthographic = true;
    viewer.worldFromCamera = glm::inverse(glm::lookAt(glm::dvec3(3, 2, 6), glm::dvec3(0), glm::dvec3(0, 1, 0)));
    viewer.clipFromView = glm::ortho(-3.0, 3.0, -2.5, 2.5, 0.1, 20.0);
    for (const bool onGrid : {false, true}) {
        const Cloud cloud = makeCloud(3000, 6, onGrid);
        const OrderInstance instances[] = {viewer.see(cloud, 0)};
        Order order;
        order.update(instances, viewer.camera());
        const auto expected = expectedOrder(instances, viewer.camera());
        CHECK(toVector(order.farToNear()) == expected);

        // zoomed in and moved aside: the same order, fewer splats
        viewer.clipFromView = glm::ortho(-0.3, 0.3, -0.25, 0.25, 0.1, 20.0);
        viewer.worldFromCamera[3] += 0.3 * viewer.worldFromCamera[0];
        const OrderInstance moved[] = {viewer.see(cloud, 0)};
        CHECK(order.update(moved, viewer.camera()));
        CHECK_FALSE(order.hasSorted());
        CHECK(isSubsequence(order.farToNear(), expected));
        CHECK(order.farToNear().size() < expected.size() / 4);
        const glm::dmat4 clipFromWorld = viewer.clipFromView * glm::inverse(viewer.worldFromCamera);
        size_t inFrame = 0;
        for (const uint32_t at : expected) {
            const glm::dvec4 clip = clipFromWorld * glm::dvec4(cloud.positions[at], 1);
            if (std::abs(clip.x) > 1 || std::abs(clip.y) > 1) continue;
            ++inFrame;
            CHECK(std::find(order.farToNear().begin(), order.farToNear().end(), at) != order.farToNear().end());
        }
        CHECK(inFrame > 10);
        viewer.worldFromCamera[3] -= 0.3 * viewer.worldFromCamera[0];
        viewer.clipFromView = glm::ortho(-3.0, 3.0, -2.5, 2.5, 0.1, 20.0);
    }
}

TEST_CASE("culling keeps every splat that reaches the frame, and leaves out most others")
{
    std::mt19937 rng(7);
    const auto uniform = [&](double lo, double hi) { return lo + (hi - lo) * double(rng()) / 4294967296.0; };
    Cloud cloud = makeCloud(3000, 8, false, 0.3f); // from tiny to a third of the scene
    std::vector<glm::quat> rotations;
    std::vector<glm::vec3> scales;
    for (size_t g = 0; g < 3000; ++g) {
        rotations.push_back(glm::normalize(glm::quat(float(uniform(-1, 1)), float(uniform(-1, 1)), float(uniform(-1, 1)), 0.1f)));
        scales.push_back(cloud.scales[g] * glm::vec3(1, float(uniform(0.01, 1)), float(uniform(0.01, 1))));
    }

    size_t seen = 0, listed = 0, all = 0;
    for (int n = 0; n < 60; ++n) {
        CAPTURE(n);
        const glm::dvec3 eye(uniform(-1.5, 1.5), uniform(-1.5, 1.5), uniform(-1.5, 1.5)); // inside the cloud, mostly
        Order order;
        int sorts = 0;
        for (int turn = 0; turn < 5; ++turn) { // within and beyond the margin of the first cull
            CAPTURE(turn);
            const double angle = 0.02 * turn * turn;
            const Viewer viewer = lookingAt(eye, eye + glm::dvec3(std::sin(angle), 0.1 * turn, -std::cos(angle)), 60);
            Camera camera;
            camera.width = viewer.width, camera.height = viewer.height;
            camera.fx = camera.fy = 60, camera.cx = 0.5 * viewer.width, camera.cy = 0.5 * viewer.height;
            camera.worldFromCamera = viewer.worldFromCamera;
            const View<double> view = makeView<double>(camera, viewer.lowPass);

            const OrderInstance instances[] = {viewer.see(cloud, 0)};
            order.update(instances, viewer.camera());
            sorts += order.hasSorted();
            std::vector<bool> drawn(cloud.positions.size());
            for (const uint32_t at : order.farToNear()) drawn[at] = true;
            for (size_t g = 0; g < cloud.positions.size(); ++g) {
                const glm::vec3 &p = cloud.positions[g], &s = scales[g];
                const glm::quat& q = rotations[g];
                ProjectedGaussian<double> projected;
                if (!projectGaussian(view, GaussianGeometry<double>{{p.x, p.y, p.z}, {s.x, s.y, s.z}, {q.w, q.x, q.y, q.z}, 1.0}, projected)) continue;
                ++seen;
                if (!drawn[g]) FAIL_CHECK("splat ", g, " reaches the frame and is not drawn");
            }
            listed += order.farToNear().size(), all += cloud.positions.size();
            if (order.farToNear().size() > 1) {
                const auto expected = expectedOrder(instances, viewer.camera());
                CHECK(isSubsequence(order.farToNear(), expected));
            }
        }
        CHECK(sorts <= 2); // what is in the frame first, all when it turns
    }
    CHECK(seen > 1000);
    MESSAGE("reach the frame: ", seen, ", listed: ", listed, ", of ", all);
    CHECK(listed < 2 * seen);
}

TEST_CASE("nothing is sorted again for jitter, a turn of the camera or another viewport")
{
    const Cloud cloud = makeCloud(2000, 9);
    const Viewer start = lookingAt({0, 0, 3}, {0, 0, 0});
    const auto run = [&](Order& order, const Viewer& viewer) {
        const OrderInstance instances[] = {viewer.see(cloud, 0)};
        return order.update(instances, viewer.camera());
    };
    Order order;
    CHECK(run(order, start));
    CHECK(order.hasSorted());
    CHECK_FALSE(run(order, start));
    CHECK_FALSE(order.hasSorted());

    Viewer jittered = start;
    jittered.clipFromView[2][0] += 1.0 / start.width, jittered.clipFromView[2][1] -= 0.7 / start.height;
    CHECK_FALSE(run(order, jittered));
    CHECK_FALSE(order.hasSorted());
    CHECK_FALSE(run(order, lookingAt({0, 0, 3}, {0.05, 0.02, 0})));
    CHECK_FALSE(order.hasSorted());

    CHECK(run(order, lookingAt({0, 0, 3}, {2, 0, 0}))); // other splats, in the same order
    CHECK_FALSE(order.hasSorted());
    CHECK(order.farToNear().size() < 2000);
    CHECK(run(order, lookingAt({0, 0, 3}, {0, 0, 6})));
    CHECK(order.farToNear().empty());
    CHECK(run(order, start));
    CHECK_FALSE(order.hasSorted());
    CHECK(order.farToNear().size() == 2000);

    Viewer tall = start;
    tall.width = 20;
    tall.clipFromView[0][0] *= 4;
    run(order, tall);
    CHECK_FALSE(order.hasSorted());

    CHECK(run(order, lookingAt({0, 1e-3, 3}, {0, 0, 0})));
    CHECK(order.hasSorted());
}

TEST_CASE("another asset at the same address, an instance more, less or moved are sorted again")
{
    Cloud cloud = makeCloud(500, 10), other = makeCloud(300, 11);
    const Viewer viewer = farAway();
    std::vector<OrderInstance> instances = {viewer.see(cloud, 0)};
    Order order;
    const auto resorts = [&] {
        const bool changed = order.update(instances, viewer.camera());
        CHECK(toVector(order.farToNear()) == expectedOrder(instances, viewer.camera()));
        CHECK(changed == order.hasSorted());
        return order.hasSorted();
    };
    CHECK(resorts());
    instances.push_back(viewer.see(other, 512));
    CHECK(resorts());
    CHECK_FALSE(resorts());
    std::reverse(cloud.positions.begin(), cloud.positions.end());
    instances[0].asset = 1;
    CHECK(resorts());
    instances[1].fromEye.x += 0.1f;
    CHECK(resorts());
    instances.pop_back();
    CHECK(resorts());
    instances.clear();
    CHECK(resorts());
    CHECK_FALSE(resorts());
}
