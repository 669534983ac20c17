#include "splat_shadows.h"

#include "base/hash.h"
#include "instance.h"
#include "projection.h"
#include "shader_sources.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cmath>
#include <set>

namespace nacre {

constexpr int kPlanes = 4;
constexpr double kReach = 3.4;         // standard deviations at which alpha falls below kMinAlpha
constexpr double kWidest = 8;          // half-width of a frustum by its depth, beyond which a light counts as within the receiver
constexpr double kNearest = 1e-3;      // near plane, by the distance of the receiver

namespace {

/// Bounds of an instance in the world: corners of the box of its centres, and a ball that holds its splats.
struct Bounds {
    glm::dvec3 corners[8], centre;
    double radius = 0;
};

} // namespace

static Bounds boundsOf(const Instance& instance)
{
    const Asset& asset = *instance.asset;
    Bounds b;
    for (int k = 0; k < 8; ++k) {
        const glm::dvec3 corner(k & 1 ? asset.boundsMax.x : asset.boundsMin.x, k & 2 ? asset.boundsMax.y : asset.boundsMin.y, k & 4 ? asset.boundsMax.z : asset.boundsMin.z);
        b.corners[k] = glm::dvec3(instance.placement.worldFromAsset * glm::dvec4(corner, 1));
    }
    b.centre = 0.5 * (b.corners[0] + b.corners[7]);
    b.radius = 0.5 * glm::distance(b.corners[0], b.corners[7]) + kReach * double(asset.largestScale) * instance.placement.scale;
    return b;
}

static glm::dvec3 anyRightAngle(const glm::dvec3& axis) { return std::abs(axis.y) < 0.9 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0); }

/// False if the light is too near for one frustum.
static bool makeLamp(const glm::dvec4& light, const Bounds& receiver, int size, SplatShadowLamp* lamp)
{
    const bool directional = light.w == 0;
    const glm::dvec3 towards = directional ? glm::dvec3(light) : glm::normalize(glm::dvec3(light) - receiver.centre);
    const glm::dvec3 eye = directional ? receiver.centre : glm::dvec3(light);
    if (!directional && !(glm::distance(eye, receiver.centre) > 0)) return false;
    ViewFrame& f = lamp->frame;
    f.viewFromWorld = glm::lookAt(eye, eye - towards, anyRightAngle(towards));
    f.eye = eye;
    f.orthographic = directional;
    f.viewport = glm::vec2(float(size));
    lamp->low = glm::dvec2(1e300), lamp->high = glm::dvec2(-1e300);
    lamp->nearest = 1e300, lamp->farthest = -1e300;
    for (const glm::dvec3& corner : receiver.corners) {
        const glm::dvec3 p = f.viewFromWorld * glm::dvec4(corner, 1);
        const double depth = -p.z;
        if (!directional && !(depth > 0)) return false;
        const glm::dvec2 at = directional ? glm::dvec2(p) : glm::dvec2(p) / depth;
        lamp->low = glm::min(lamp->low, at), lamp->high = glm::max(lamp->high, at);
        lamp->nearest = std::min(lamp->nearest, depth), lamp->farthest = std::max(lamp->farthest, directional ? depth : glm::length(p));
    }
    if (!directional && std::max({-lamp->low.x, -lamp->low.y, lamp->high.x, lamp->high.y}) > kWidest) return false;
    const glm::dvec2 margin = 2.0 / size * (lamp->high - lamp->low) + 1e-6 * (directional ? receiver.radius : 1.0); // a texel and a half of the border
    lamp->low -= margin, lamp->high += margin;

    const glm::dvec2 span = lamp->high - lamp->low, sum = lamp->high + lamp->low;
    glm::dmat4 p(0.0); // depth of clip space is never used (splat_shadow.vert.glsl)
    p[0][0] = 2 / span.x, p[1][1] = 2 / span.y;
    if (directional) {
        p[3] = {-sum.x / span.x, -sum.y / span.y, 0, 1};
        f.towardsEye = towards;
        f.nearPlane = {0, 0, 0, 1};
    } else {
        p[2] = {sum.x / span.x, sum.y / span.y, 0, -1};
        f.nearW = float(kNearest * lamp->farthest);
        f.nearPlane = {0, 0, -1, -f.nearW};
    }
    f.clipFromView = glm::mat4(p);
    lamp->firstPlane = float(lamp->nearest);
    lamp->planeStep = float(std::max((lamp->farthest - lamp->nearest) / (kPlanes - 1), 1e-6 * receiver.radius));
    return true;
}

/// Whether some of the ball may lie between the light and the far side of the receiver.
static bool meets(const SplatShadowLamp& lamp, const Bounds& caster)
{
    const glm::dvec3 c = lamp.frame.viewFromWorld * glm::dvec4(caster.centre, 1);
    const double r = caster.radius, depth = -c.z;
    const auto inside = [&](double x, double low, double high) {
        if (lamp.frame.orthographic) return x + r > low && x - r < high;
        return x - low * depth > -r * std::sqrt(1 + low * low) && x - high * depth < r * std::sqrt(1 + high * high);
    };
    const double distance = lamp.frame.orthographic ? depth : glm::length(c);
    const bool inFront = lamp.frame.orthographic || depth + r > 0;
    return inFront && distance - r < lamp.farthest && inside(c.x, lamp.low.x, lamp.high.x) && inside(c.y, lamp.low.y, lamp.high.y);
}

/// Lights that ask for shadows, of one instance: their indices, and a point of each.
static std::vector<std::pair<uint32_t, const LightPoint*>> askingLights(const Context& context, const Instance& instance)
{
    std::vector<std::pair<uint32_t, const LightPoint*>> lights;
    for (const uint32_t p : instance.lights.point) {
        const LightPoint& point = context.lights.points()[p];
        if (!(point.flags & NACRE_LIGHT_SPLAT_SHADOWS) || point.source == kEnvironmentSource) continue;
        if (lights.empty() || lights.back().first != point.source) lights.emplace_back(point.source, &point);
    }
    return lights;
}

/// Of everything that decides which maps are wanted.
uint64_t SplatShadows::sceneHash(std::span<Instance* const> receivers) const
{
    std::vector<uint64_t> all = {context_.lights.revision(), uint64_t(size_)};
    for (const auto& i : context_.instances.all()) all.insert(all.end(), {i->handle.serial, i->looksRevision, uint64_t(i->hidden), uint64_t(i->asset->complete()), i->lightMask});
    all.push_back(~uint64_t(0));
    for (const Instance* i : receivers) all.push_back(i->handle.serial);
    return fnv1a(all.data(), all.size() * sizeof all[0]);
}

bool SplatShadows::isOutdated(const SplatShadow& map) const { return !(map.drawn == map.wanted) || !context_.passes.sure(map.draw); }

void SplatShadows::findWanted(std::span<Instance* const> receivers, std::vector<SplatShadow*>* outdated)
{
    struct Caster {
        const Instance* instance;
        Bounds bounds;
    };
    std::vector<Caster> casters;
    for (const auto& i : context_.instances.all())
        if (!i->hidden && i->asset->complete()) casters.push_back({i.get(), boundsOf(*i)});
    std::set<uint32_t> serials, lights; // that live
    for (const Caster& c : casters) serials.insert(c.instance->handle.serial);
    for (const LightPoint& p : context_.lights.points())
        if (p.flags & NACRE_LIGHT_SPLAT_SHADOWS) lights.insert(p.source);
    std::erase_if(maps_, [&](const auto& m) { return !serials.contains(m.first.first) || !lights.contains(m.first.second); });
    for (const Instance* receiver : receivers) {
        const Bounds bounds = boundsOf(*receiver);
        for (const auto& [light, point] : askingLights(context_, *receiver)) {
            SplatShadowSource wanted;
            wanted.light = point->directional ? glm::dvec4(glm::normalize(glm::dvec3(point->direction)), 0) : glm::dvec4(point->centre, 1);
            wanted.receiver = receiver->placement;
            wanted.size = size_;
            SplatShadowLamp lamp;
            const bool sees = makeLamp(wanted.light, bounds, size_, &lamp);
            if (!sees && !warned_)
                warned_ = true, context_.report(NACRE_WARNING, "light " + std::to_string(light) + " is so near to an instance, or within it, that other splats cast no "
                                                               "shadows on it (said once)");
            if (sees)
                for (const Caster& c : casters)
                    if (c.instance != receiver && (c.instance->lightMask & point->mask) && meets(lamp, c.bounds))
                        wanted.casters.push_back({c.instance->handle.serial, c.instance->looksRevision});
            const Key key{receiver->handle.serial, light};
            if (wanted.casters.empty()) maps_.erase(key);
            else maps_[key].wanted = std::move(wanted), maps_[key].wantedLamp = lamp;
        }
    }
    for (auto& [key, map] : maps_)
        if (isOutdated(map)) outdated->push_back(&map);
}

Failure SplatShadows::update(std::span<Instance* const> receivers, NacreDrawStats& stats)
{
    const std::vector<LightPoint>& points = context_.lights.points();
    const bool asked = std::any_of(points.begin(), points.end(), [](const LightPoint& p) { return (p.flags & NACRE_LIGHT_SPLAT_SHADOWS) != 0; });
    if (!asked && maps_.empty()) return {};
    const uint64_t scene = sceneHash(receivers);
    if (scene == seenScene_ && !pending_) return {};
    seenScene_ = scene;
    std::vector<SplatShadow*> outdated;
    findWanted(receivers, &outdated);
    std::stable_sort(outdated.begin(), outdated.end(), [](const SplatShadow* a, const SplatShadow* b) { return a->draw < b->draw; });
    const size_t count = std::min(outdated.size(), size_t(mostMaps_));
    for (size_t i = 0; i < count; ++i) {
        if (Failure f = draw(*outdated[i])) return pending_ = true, f;
        ++stats.shadowMapsDrawn;
    }
    stats.shadowMapsPending = uint32_t(outdated.size() - count);
    pending_ = !outdated.empty(); // those that were drawn until the GPU has told
    return {};
}

Failure SplatShadows::prepareTarget(SplatShadow& map)
{
    const int size = map.wanted.size;
    if (!map.transmittance || map.transmittance.width() != size) {
        clearHostErrors(context_);
        map.transmittance = {};
        map.transmittance = Texture(context_, GL_RGBA16F, size, size);
        map.revision = 0;
        if (takeGlError(context_.gl) != GL_NO_ERROR) {
            map.transmittance = {}, map.drawn = {};
            return {NACRE_ERROR_OUT_OF_MEMORY, "not enough GPU memory for one more shadow map of splats; use fewer lights with NACRE_LIGHT_SPLAT_SHADOWS"};
        }
    }
    if (!framebuffer_) framebuffer_ = Framebuffer(context_);
    framebuffer_.bind();
    framebuffer_.attach(0, map.transmittance);
    constexpr float kAll[4] = {1, 1, 1, 1};
    context_.passes.pass();
    context_.gl.ClearBufferfv(GL_COLOR, 0, kAll);
    return {};
}

/// Into the list, from its start.
Failure SplatShadows::project(const ViewFrame& frame, std::span<const std::shared_ptr<Instance>> casters, std::vector<ListRows>* rows)
{
    rows->resize(casters.size());
    for (int round = 0; round < 2; ++round) // a later one may make the list wider
        for (size_t i = 0; i < casters.size(); ++i)
            if (Failure f = list_.place(casters[i]->handle.serial, casters[i]->asset->grid.count, &(*rows)[i])) return f;
    const Program* program = nullptr;
    if (Failure f = projectionProgram(context_, &program)) return f;
    beginProjection(*program, frame, false);
    list_.beginProjected();
    for (size_t i = 0; i < casters.size(); ++i)
        projectInstance(*program, *casters[i], makeInstanceFrame(frame, casters[i]->placement), true, list_, (*rows)[i]);
    for (const auto& caster : casters) list_.remove(caster->handle.serial); // the next map begins anew
    return {};
}

Failure SplatShadows::draw(SplatShadow& map)
{
    const Gl& gl = context_.gl;
    std::vector<std::shared_ptr<Instance>> casters;
    std::vector<ListRows> rows;
    uint32_t most = 0;
    for (const auto& i : context_.instances.all())
        for (const SplatShadowSource::Caster& c : map.wanted.casters)
            if (c.serial == i->handle.serial) casters.push_back(i), most = std::max(most, i->asset->grid.count);
    for (const auto& caster : casters) {
        if (!caster->model) caster->model = caster->asset->model->makeInstance(*caster);
        if (Failure f = caster->model->updateGeometry()) return f;
    }
    const SplatShadowLamp& lamp = map.wantedLamp;
    if (Failure f = growIndexBuffer(context_, most)) return f;
    if (Failure f = project(lamp.frame, casters, &rows)) return f;
    const Program* program = nullptr;
    if (Failure f = findProgram(context_, {"splat shadow", define("UNORDERED", 1) + shaders::kListGlsl + shaders::kSplatShadowVertGlsl, shaders::kSplatShadowFragGlsl,
                                           {"uProjected0", "uProjected1"}}, &program))
        return f;
    if (Failure f = prepareTarget(map)) return f;
    const float box[4] = {0, 0, lamp.frame.viewport.x, lamp.frame.viewport.y};
    setViewport(gl, box);
    beginMultiplying(gl, GL_ONE_MINUS_SRC_COLOR, GL_ONE_MINUS_SRC_ALPHA);
    program->use();
    list_.projected0.bind(0), list_.projected1.bind(1);
    program->set("uListWidth", list_.width());
    program->set("uViewport", lamp.frame.viewport);
    program->set("uFirstPlane", lamp.firstPlane);
    program->set("uPlaneStep", lamp.planeStep);
    for (size_t i = 0; i < casters.size(); ++i) {
        program->set("uFirstIndex", int(list_.firstIndex(rows[i])));
        gl.DrawElements(GL_TRIANGLES, GLsizei(6 * casters[i]->asset->grid.count), GL_UNSIGNED_INT, nullptr);
    }
    gl.Disable(GL_BLEND);
    map.revision = ++lastRevision_, map.draw = context_.passes.now();
    map.drawn = map.wanted, map.lamp = lamp;
    return {};
}

const SplatShadow* SplatShadows::find(const Instance& receiver, uint32_t light) const
{
    const auto found = maps_.find({receiver.handle.serial, light});
    return found != maps_.end() && found->second.revision > 0 ? &found->second : nullptr;
}

} // namespace nacre
