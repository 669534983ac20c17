// OGRE as a host, pixel by pixel: three balls of splats (radius 0.4, albedo 0.8, the lower half without blue) among OGRE's meshes. What a
// pixel has to show follows from tracing rays against spheres. Runs on a display, in a folder with the balls of write_assets.
#include "nacre_ogre.h"
#include "ogre_scene.h"

#include <GL/gl.h>
#include <OgreShadowCameraSetupPSSM.h>
#include <doctest/doctest.h>

#include <cstring>
#include <optional>

using namespace Ogre;

namespace {

constexpr int kWidth = 320, kHeight = 240;
constexpr float kRadius = 0.4f, kMeshRadius = 0.3f;
// Splats blur the edge of a ball, shadow maps that of a shadow: what is nearer to an edge than these factors of the radius is not looked at.
constexpr float kWithin = 0.8f, kBeyond = 1.3f;
const Vector3 kBalls[] = {{-1.2f, kRadius, 0.2f}, {-0.1f, kRadius, -0.1f}, {0.9f, kRadius, -0.1f}};

struct Picture {
    std::vector<float> rgba;
    const float* at(int x, int y) const { return rgba.data() + 4 * (y * kWidth + x); }
    bool operator==(const Picture& o) const { return !std::memcmp(rgba.data(), o.rgba.data(), rgba.size() * sizeof(float)); }
};

struct Messages : LogListener {
    std::string text; // of Nacre
    void messageLogged(const String& message, LogMessageLevel, bool, const String&, bool&) override
    {
        if (message.starts_with("Nacre: ")) text += message + "\n";
    }
};

struct Stage {
    Messages messages;
    OgreScene scene{kWidth, kHeight, /*hidden*/ true};
    Picture empty; // at time 0, by an OGRE that has never met Nacre
    std::unique_ptr<NacreOgre> nacre;
    std::vector<NacreObject*> balls;
    std::optional<Vector3> spotAt;

    Stage()
    {
        LogManager::getSingleton().getDefaultLog()->addListener(&messages);
        empty = picture(0);
        nacre = std::make_unique<NacreOgre>(scene.manager, OgreScene::getProcAddress);
        const NacreAsset assets[] = {nacre->load(Root::openFileStream("bigs_ball.glb")), nacre->load(Root::openFileStream("sss_ball.glb"))};
        for (int i = 0; i < 3; ++i) {
            balls.push_back(nacre->createObject(assets[i % 2]));
            scene.stand(balls.back(), kBalls[i] - Vector3(0, kRadius, 0), 2 * kRadius, Degree(40 * i));
        }
    }

    Picture picture(double seconds = 0)
    {
        scene.setTime(seconds);
        if (spotAt) {
            const Vector3 direction = (Vector3(0, 0.4f, 0) - *spotAt).normalisedCopy();
            scene.spot->getParentSceneNode()->setPosition(*spotAt);
            scene.spot->getParentSceneNode()->setOrientation(Vector3::NEGATIVE_UNIT_Z.getRotationTo(direction));
        }
        scene.render();
        return {scene.pixels()};
    }

    void only(const Light* light)
    {
        for (Light* l : {scene.sun, scene.spot, scene.lamp}) l->setVisible(!light || l == light);
    }

    /// The scene without splats, under the lights that are on.
    Picture withoutSplats()
    {
        for (NacreObject* ball : balls) ball->setVisible(false);
        const Picture p = picture();
        for (NacreObject* ball : balls) ball->setVisible(true);
        return p;
    }
};

Stage& stage()
{
    static Stage* theStage = new Stage; // OGRE has one root to a process
    theStage->only(nullptr);
    return *theStage;
}

struct Hit {
    enum Kind { kNothing, kGround, kMesh, kBall } kind = kNothing;
    Real distance = 1e9f;
    Vector3 point{}, normal{};
};

/// Balls of `factor` times their radius.
Hit trace(const OgreScene& scene, const Ray& ray, float factor)
{
    Hit hit;
    const auto meet = [&](std::pair<bool, Real> found, Hit::Kind kind, const std::optional<Vector3>& center) {
        if (!found.first || found.second >= hit.distance) return;
        const Vector3 p = ray.getPoint(found.second);
        hit = {kind, found.second, p, center ? (p - *center).normalisedCopy() : Vector3::UNIT_Y};
    };
    meet(ray.intersects(Plane(Vector3::UNIT_Y, 0)), Hit::kGround, {});
    const Vector3 cube = scene.cube->getParentSceneNode()->_getDerivedPosition(), half(0.25f);
    meet(ray.intersects(AxisAlignedBox(cube - half, cube + half)), Hit::kMesh, {});
    const Vector3 mesh = scene.sphere->getParentSceneNode()->_getDerivedPosition();
    meet(ray.intersects(Sphere(mesh, kMeshRadius)), Hit::kMesh, mesh);
    for (const Vector3& ball : kBalls) meet(ray.intersects(Sphere(ball, factor * kRadius)), Hit::kBall, ball);
    return hit;
}

Vector3 toLight(const Light& light, const Vector3& p)
{
    return light.getType() == Light::LT_DIRECTIONAL ? -light.getDerivedDirection() : (light.getDerivedPosition() - p).normalisedCopy();
}

/// Of a white surface at a right angle, by OGRE's formula.
Vector3 lightAt(const Light& light, const Vector3& p)
{
    const ColourValue c = light.getDiffuseColour() * light.getPowerScale();
    Real share = 1;
    if (light.getType() != Light::LT_DIRECTIONAL) share /= (light.getDerivedPosition() - p).squaredLength();
    if (light.getType() == Light::LT_SPOTLIGHT) {
        const Real inner = Math::Cos(light.getSpotlightInnerAngle() * 0.5f), outer = Math::Cos(light.getSpotlightOuterAngle() * 0.5f);
        const Real x = Math::Clamp((-toLight(light, p).dotProduct(light.getDerivedDirection()) - outer) / (inner - outer), Real(0), Real(1));
        share *= x * x;
    }
    return Vector3(c.r, c.g, c.b) * share;
}

enum Shade { kLit, kDark, kUnclear };
/// What lies between p and the light: a ball or, if `meshes`, the sphere of mesh.
Shade shadeOf(const OgreScene& scene, const Light& light, const Vector3& p, bool balls, bool meshes)
{
    const Ray ray(p, toLight(light, p));
    const Vector3 mesh = scene.sphere->getParentSceneNode()->_getDerivedPosition();
    Shade shade = kLit;
    const auto meet = [&](const Vector3& center, float radius) {
        if (center.squaredDistance(p) < 1.05f * radius * radius) return; // its own
        if (ray.intersects(Sphere(center, kWithin * radius)).first) shade = kDark;
        else if (shade == kLit && ray.intersects(Sphere(center, kBeyond * radius)).first) shade = kUnclear;
    };
    if (balls)
        for (const Vector3& ball : kBalls) meet(ball, kRadius);
    if (meshes) meet(mesh, kMeshRadius);
    return shade;
}

template <class F> void eachPixel(const OgreScene& scene, F&& f)
{
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) f(x, y, scene.camera->getCameraToViewportRay((x + 0.5f) / kWidth, (y + 0.5f) / kHeight));
}

/// The cosine as bigs has it: harmonics up to degree 4.
Real smoothCosine(Real c)
{
    const Real c2 = c * c;
    return 0.25f + 0.5f * c + 0.3125f * (1.5f * c2 - 0.5f) - 0.09375f * (35 * c2 * c2 - 30 * c2 + 3) / 8;
}

/// Pixels of balls that face camera and light, compared with a matte ball of albedo 0.8.
struct BallCheck { int lit = 0, dark = 0; double worstLit = 0, meanLit = 0, worstDark = 0, meanDark = 0; }; // errors by full light
BallCheck checkBalls(Stage& s, const Light& light)
{
    const Picture picture = s.picture();
    const ColourValue ambient = s.scene.manager->getAmbientLight();
    BallCheck check;
    eachPixel(s.scene, [&](int x, int y, const Ray& ray) {
        const Hit hit = trace(s.scene, ray, 1);
        if (hit.kind != Hit::kBall || -hit.normal.dotProduct(ray.getDirection()) < 0.5f) return;
        const Real cosine = hit.normal.dotProduct(toLight(light, hit.point));
        const Shade shade = shadeOf(s.scene, light, hit.point, true, true);
        if (cosine < 0.4f || shade == kUnclear || std::abs(hit.normal.y) < 0.15f) return; // the colour changes at the equator
        const bool bigs = hit.point.squaredDistance(kBalls[1]) > 1.1f * kRadius * kRadius;
        const Vector3 full = lightAt(light, hit.point) * (bigs ? smoothCosine(cosine) : cosine);
        if (full.x < 0.05f) return; // outside of the cone
        const float* got = picture.at(x, y);
        for (int c = 0; c < 3; ++c) {
            const float albedo = c == 2 && hit.normal.y < 0 ? 0 : 0.8f, base = albedo * ambient[c];
            const double error = (got[c] - base - (shade == kLit ? albedo * full[c] : 0)) / (0.8 * full[c]);
            if (shade == kLit) check.worstLit = std::max(check.worstLit, std::abs(error)), check.meanLit += error;
            else check.worstDark = std::max(check.worstDark, std::abs(error)), check.meanDark += error;
        }
        ++(shade == kLit ? check.lit : check.dark);
    });
    check.meanLit /= 3 * std::max(check.lit, 1);
    check.meanDark /= 3 * std::max(check.dark, 1);
    return check;
}

} // namespace

TEST_CASE("splats are lit by OGRE's lights as a matte mesh would be")
{
    Stage& s = stage();
    for (const Light* light : {s.scene.sun, s.scene.spot, s.scene.lamp}) {
        s.only(light);
        const BallCheck check = checkBalls(s, *light);
        CAPTURE(light->getType());
        CHECK(check.lit > 300);
        CHECK(std::abs(check.meanLit) < 0.04); // harmonics of degree 4, highlights of sss
        CHECK(check.worstLit < 0.15);          // a splat's normal stands for all of its pixels
    }
}

TEST_CASE("a mesh's shadow falls on splats")
{
    Stage& s = stage();
    s.only(s.scene.sun);
    const auto shadowed = [&] {
        const BallCheck check = checkBalls(s, *s.scene.sun);
        CHECK(check.dark > 40);
        CHECK(check.worstDark < 0.1);
        CHECK(check.lit > 300);
        CHECK(check.worstLit < 0.15);
    };
    shadowed();
    SUBCASE("and goes with it")
    {
        s.scene.sphere->setCastShadows(false);
        const BallCheck check = checkBalls(s, *s.scene.sun);
        CHECK(check.meanDark > 0.8);
        s.scene.sphere->setCastShadows(true);
        shadowed();
    }
    SUBCASE("through the cascades of a PSSM setup")
    {
        const auto pssm = std::make_shared<PSSMShadowCameraSetup>();
        pssm->setSplitPoints({1, 4.3f, 6, 20}); // one goes through the balls
        s.scene.sun->setCustomShadowCameraSetup(pssm);
        s.scene.manager->setShadowTextureCountPerLightType(Light::LT_DIRECTIONAL, 3);
        s.scene.manager->setShadowTextureCount(3);
        shadowed();
        s.scene.manager->setShadowTextureCountPerLightType(Light::LT_DIRECTIONAL, 1);
        s.scene.manager->setShadowTextureCount(2);
        s.scene.sun->setCustomShadowCameraSetup(s.scene.sunCamera);
    }
}

TEST_CASE("a ball of splats shades another where that is wanted, though splats are not in the maps that shade splats")
{
    Stage& s = stage();
    s.only(s.scene.spot);
    s.spotAt = Vector3(-3.5f, 0.7f, 0.6f); // low: a ball stands behind another one
    BallCheck check = checkBalls(s, *s.scene.spot);
    CHECK(check.dark > 40);
    CHECK(check.meanDark < 0.1);
    CHECK(check.lit > 50);
    CHECK(check.worstLit < 0.2);
    s.nacre->splatShadows = false;
    check = checkBalls(s, *s.scene.spot);
    CHECK(check.meanDark > 0.7); // but for blue below the equator
    CHECK(check.worstLit < 0.2);
    s.nacre->splatShadows = true;
    s.spotAt.reset();
}

TEST_CASE("splats cast their shadow on the ground, and nothing else changes")
{
    Stage& s = stage();
    for (const Light* light : {s.scene.sun, s.scene.spot}) {
        s.only(light);
        const Picture without = s.withoutSplats(), with = s.picture();
        const ColourValue ambient = s.scene.manager->getAmbientLight();
        int dark = 0, bright = 0, changed = 0, still = 0;
        eachPixel(s.scene, [&](int x, int y, const Ray& ray) {
            const Hit hit = trace(s.scene, ray, kBeyond);
            if (hit.kind != Hit::kGround) return;
            const Shade balls = shadeOf(s.scene, *light, hit.point, true, false);
            const float *a = without.at(x, y), *b = with.at(x, y);
            if (balls == kLit) std::memcmp(a, b, 16) ? ++changed : ++still;
            else if (balls == kDark && a[0] > 0.1f) b[0] > 0.05f + ambient.r ? ++bright : ++dark;
        });
        CAPTURE(light->getType());
        CHECK(changed == 0);
        CHECK(still > 10000);
        CHECK(bright == 0);
        CHECK(dark > 100);
    }
}

TEST_CASE("meshes hide splats, later queues are drawn over them, bit for bit what they were")
{
    Stage& s = stage();
    const Picture with = s.picture();
    int before = 0, changed = 0;
    eachPixel(s.scene, [&](int x, int y, const Ray& ray) {
        const Hit hit = trace(s.scene, ray, kBeyond);
        if (hit.kind != Hit::kMesh) return;
        for (const Light* light : {s.scene.sun, s.scene.spot})
            if (shadeOf(s.scene, *light, hit.point, true, false) != kLit) return;
        Ray behind(hit.point + 0.75f * ray.getDirection(), ray.getDirection()); // 0.75: through the cube
        before += trace(s.scene, behind, 0.9f).kind == Hit::kBall;
        changed += std::memcmp(s.empty.at(x, y), with.at(x, y), 16) != 0;
    });
    CHECK(before > 50);
    CHECK(changed == 0);
}

TEST_CASE("OGRE's state stays right over many frames")
{
    Stage& s = stage();
    const Picture first = s.picture();
    int errors = 0;
    for (int i = 1; i <= 20; ++i) {
        s.picture(0.3 * i);
        errors += glGetError() != GL_NO_ERROR;
    }
    CHECK(errors == 0);
    CHECK(s.picture() == first);
    CHECK(s.withoutSplats() == s.empty);
    CHECK(s.picture() == first);
}

TEST_CASE("a scene at rest is neither relit nor sorted again; a moved light relights")
{
    Stage& s = stage();
    for (int i = 0; i < 4; ++i) s.picture();
    CHECK(s.nacre->stats.instancesDrawn == 3);
    CHECK(s.nacre->stats.relightSplats == 0);
    CHECK(s.nacre->stats.projected == 0);
    CHECK(s.nacre->stats.sorted == 0);
    s.picture(0.1);
    CHECK(s.nacre->stats.relightSplats > 0);
    CHECK(s.nacre->stats.sorted == 0);
}

TEST_CASE("two cameras, drawn in turns, do not disturb each other")
{
    Stage& s = stage();
    const Picture alone = s.picture();
    TexturePtr texture = TextureManager::getSingleton().createManual("Second", RGN_DEFAULT, TEX_TYPE_2D, 200, 150, 0, PF_FLOAT16_RGBA,
                                                                        TU_RENDERTARGET);
    Camera* camera = s.scene.manager->createCamera("Second");
    camera->setNearClipDistance(0.1f);
    SceneNode* node = s.scene.manager->getRootSceneNode()->createChildSceneNode(Vector3(-3, 1.5f, 1));
    node->attachObject(camera);
    node->lookAt(Vector3(0, 0.4f, 0), Node::TS_WORLD);
    texture->getBuffer()->getRenderTarget()->addViewport(camera);
    CHECK(s.picture() == alone);
    s.picture();
    CHECK(s.nacre->stats.projected == 0);
    CHECK(s.nacre->stats.sorted == 0);
    TextureManager::getSingleton().remove(texture);
    s.scene.manager->destroyCamera(camera);
    CHECK(s.picture() == alone);
}

TEST_CASE("light masks of OGRE's objects are kept")
{
    Stage& s = stage();
    s.only(s.scene.sun);
    s.scene.sun->setLightMask(1);
    s.balls[0]->setLightMask(2);
    const Picture picture = s.picture();
    const Vector3 up = kBalls[0] + Vector3(0, 0.3f, 0.25f);
    const Vector3 clip = s.scene.camera->getProjectionMatrix() * (s.scene.camera->getViewMatrix() * up);
    const float* p = picture.at(int((0.5f + 0.5f * clip.x) * kWidth), int((0.5f - 0.5f * clip.y) * kHeight));
    CHECK(p[0] == doctest::Approx(0.8 * s.scene.manager->getAmbientLight().r).epsilon(0.1));
    s.balls[0]->setLightMask(0xffffffff);
    s.scene.sun->setLightMask(0xffffffff);
}

TEST_CASE("without Nacre, OGRE draws what it drew before") // the last: it ends what the others use
{
    Stage& s = stage();
    s.picture();
    CHECK(s.messages.text == "");
    s.nacre.reset();
    CHECK(glGetError() == GL_NO_ERROR);
    CHECK(s.picture(0) == s.empty);
}
