#define GL_GLEXT_PROTOTYPES
#include <GL/glcorearb.h>

#include "nacre_ogre.h"

#include <algorithm>
#include <cmath>

using namespace Ogre;

// OGRE's matrices are row-major, and float or double.
static void toGl(const Matrix4& m, float columns[16])
{
    for (int i = 0; i < 16; ++i) columns[i] = float(m[i % 4][i / 4]);
}

static void toGl(const Vector3& v, float out[3])
{
    for (int i = 0; i < 3; ++i) out[i] = float(v[i]);
}

static void check(NacreResult result, const char* what)
{
    if (result != NACRE_OK) OGRE_EXCEPT(Exception::ERR_RENDERINGAPI_ERROR, String(what) + ": see the log", "Nacre");
}

static void logMessage(NacreSeverity severity, const char* text, void*)
{
    LogManager::getSingleton().logMessage(String("Nacre: ") + text, severity == NACRE_INFO ? LML_NORMAL : LML_CRITICAL);
}

// ---- objects -----------------------------------------------------------------------------------------------------------------------

NacreObject::NacreObject(NacreOgre& owner, NacreAsset asset) : owner(owner)
{
    NacreAssetInfo info = {};
    info.structSize = sizeof info;
    check(nacreAssetGetInfo(asset, &info), "no such asset");
    const float* q = info.yUpFromAsset;
    nodeFromAsset = Affine3(Vector3::ZERO, Quaternion(q[3], q[0], q[1], q[2]));
    const Vector3 low(info.boundsMin), high(info.boundsMax);
    box = AxisAlignedBox(low, high);
    box.transform(nodeFromAsset);
    place = Affine3::IDENTITY;

    NacreInstanceDesc desc = {};
    desc.structSize = sizeof desc;
    desc.asset = asset;
    check(nacreInstanceCreate(&desc, &instance), "no instance");
}

NacreObject::~NacreObject() { nacreInstanceDestroy(instance); }

const String& NacreObject::getMovableType() const
{
    static const String type = "Nacre";
    return type;
}

void NacreObject::_updateRenderQueue(RenderQueue*) { owner.visible.push_back(instance); }

void NacreObject::update()
{
    const Affine3 now = isInScene() ? Affine3(_getParentNodeFullTransform()) * nodeFromAsset : nodeFromAsset;
    if (now != place) {
        float worldFromAsset[16];
        toGl(now, worldFromAsset);
        nacreInstanceSetTransform(instance, worldFromAsset);
        place = now;
    }
    nacreInstanceSetHidden(instance, !isInScene() || !getVisible());
    if (lightMask != getLightMask()) nacreInstanceSetMasks(instance, lightMask = getLightMask(), 0);
}

// ---- set up ------------------------------------------------------------------------------------------------------------------------

NacreOgre::NacreOgre(SceneManager* manager, NacreGetProcAddress getProcAddress, uint8 queueGroup) : manager(manager), queueGroup(queueGroup)
{
    NacreContextDesc desc = {};
    desc.structSize = sizeof desc;
    desc.getProcAddress = getProcAddress;
    desc.message = logMessage;
    check(nacreContextCreate(&desc, &context), "no context");
    manager->addRenderQueueListener(this);
    manager->addListener(this);
}

NacreOgre::~NacreOgre()
{
    if (manager) {
        manager->removeListener(this);
        manager->removeRenderQueueListener(this);
    }
    objects.clear();
    for (const auto& [light, map] : maps) glDeleteTextures(1, &map.texture);
    nacreContextDestroy(context);
}

NacreAsset NacreOgre::load(const DataStreamPtr& stream)
{
    MemoryDataStream bytes(stream);
    NacreAsset asset = {};
    check(nacreAssetCreate(context, bytes.getPtr(), bytes.size(), &asset), stream->getName().c_str());
    return asset;
}

NacreObject* NacreOgre::createObject(NacreAsset asset)
{
    objects.push_back(std::make_unique<NacreObject>(*this, asset));
    return objects.back().get();
}

void NacreOgre::destroyObject(NacreObject* object)
{
    std::erase_if(objects, [&](const auto& o) { return o.get() == object; });
}

// ---- drawing -----------------------------------------------------------------------------------------------------------------------

NacreView NacreOgre::viewOf(const Camera* camera)
{
    View& view = views[camera];
    if (view.view.id == 0) check(nacreViewCreate(context, nullptr, &view.view), "no view");
    view.lastUsed = Root::getSingleton().getNextFrameNumber();
    return view.view;
}

// Cameras and lights come and go; what belongs to them goes some frames after they were last seen.
void NacreOgre::dropUnused()
{
    const unsigned long now = Root::getSingleton().getNextFrameNumber();
    const auto unused = [now](const auto& entry) { return now - entry.second.lastUsed > 100; };
    for (const auto& view : views)
        if (unused(view)) nacreViewDestroy(view.second.view);
    for (const auto& map : maps)
        if (unused(map)) glDeleteTextures(1, &map.second.texture);
    std::erase_if(views, unused);
    std::erase_if(maps, unused);
}

// The warped shadow maps of LiSPSM and PSSM: clip w grows aslant to the camera's axis there. Nacre wants it along -z; a turn of view space
// between the two matrices does it.
static void straighten(Matrix4* clipFromView, Matrix4* viewFromWorld)
{
    const Matrix4& p = *clipFromView;
    const Vector3 w(p[3][0], p[3][1], p[3][2]);
    if (std::abs(w.x) + std::abs(w.y) <= 1e-6f * std::abs(w.z) || w == Vector3::ZERO) return;
    const Quaternion turn = w.getRotationTo(Vector3::NEGATIVE_UNIT_Z);
    *viewFromWorld = Matrix4(turn) * *viewFromWorld;
    *clipFromView = *clipFromView * Matrix4(turn.Inverse());
}

NacreDrawDesc NacreOgre::describe(const Viewport* viewport)
{
    NacreDrawDesc desc = {};
    desc.structSize = sizeof desc;
    Matrix4 view = viewport->getCamera()->getViewMatrix(true), projection = viewport->getCamera()->getProjectionMatrixWithRSDepth();
    if (viewport->getTarget()->requiresTextureFlipping()) // textures are rendered upside down
        for (int i = 0; i < 4; ++i) projection[1][i] = -projection[1][i];
    straighten(&projection, &view);
    toGl(view, desc.viewFromWorld);
    toGl(projection, desc.clipFromView);
    desc.viewportWidth = viewport->getActualWidth();
    desc.viewportHeight = viewport->getActualHeight();
    desc.depthTest = 1;
    desc.depthAlpha = depthAlpha;
    desc.instances = visible.data();
    desc.instanceCount = visible.size();
    return desc;
}

// After the last caster of a shadow map. OGRE's framebuffer is bound here, its viewport set.
void NacreOgre::postRenderQueues()
{
    if (manager->_getCurrentRenderStage() != SceneManager::IRS_RENDER_TO_TEXTURE || !shadowLight) return;
    const Viewport* viewport = manager->getCurrentViewport();
    for (const auto& object : objects) object->update();
    const NacreDrawDesc desc = describe(viewport);
    keepShadowMap(viewport, desc);
    if (!visible.empty()) nacreViewDrawDepth(viewOf(viewport->getCamera()), &desc);
}

void NacreOgre::renderQueueEnded(uint8 group, const String&, bool&)
{
    if (group != queueGroup || manager->_getCurrentRenderStage() == SceneManager::IRS_RENDER_TO_TEXTURE) return;
    const Viewport* viewport = manager->getCurrentViewport();
    for (const auto& object : objects) object->update();
    setLights();
    if (!visible.empty()) {
        const NacreView view = viewOf(viewport->getCamera());
        const NacreDrawDesc desc = describe(viewport);
        nacreViewDraw(view, &desc);
        stats.structSize = sizeof stats;
        nacreViewGetStats(view, &stats);
    }
    for (auto& [light, map] : maps) map.drawn = 0; // those of the next viewport may be others
    dropUnused();
}

// ---- shadow maps -------------------------------------------------------------------------------------------------------------------

void NacreOgre::shadowTextureCasterPreViewProj(Light* light, Camera*, size_t iteration)
{
    shadowLight = light;
    shadowLayer = iteration;
}

static uint64_t hashed(uint64_t hash, const void* data, size_t size) // FNV-1a
{
    for (size_t i = 0; i < size; ++i) hash = (hash ^ static_cast<const uint8_t*>(data)[i]) * 0x100000001b3u;
    return hash;
}

// What meshes look like to a shadow map: equal numbers, equal maps.
uint64_t NacreOgre::casterRevision() const
{
    uint64_t hash = 0xcbf29ce484222325u + otherChanges;
    for (const char* type : {"Entity", "ManualObject", "InstancedEntity"})
        for (const auto& [name, object] : manager->getMovableObjects(type)) {
            if (!object->isInScene() || !object->isVisible() || !object->getCastShadows()) continue;
            hash = hashed(hash, &object, sizeof object);
            const Matrix4 transform = object->_getParentNodeFullTransform();
            hash = hashed(hash, &transform, sizeof transform);
            if (const Entity* entity = dynamic_cast<const Entity*>(object); entity && entity->getAllAnimationStates()) {
                const unsigned long frame = entity->getAllAnimationStates()->getDirtyFrameNumber();
                hash = hashed(hash, &frame, sizeof frame);
            }
        }
    return hash;
}

// Copies the depth that meshes have left in the shadow texture, before splats are added to it.
void NacreOgre::keepShadowMap(const Viewport* viewport, const NacreDrawDesc& desc)
{
    constexpr size_t kMostLayers = 8;
    if (shadowLayer >= kMostLayers) return warnOnce("more than 8 shadow textures of a light: the others shade no splats");
    ShadowMap& map = maps[shadowLight];
    const uint32 size = viewport->getActualWidth();
    const uint32 layers = uint32(std::min(kMostLayers, manager->getShadowTextureCountPerLightType(shadowLight->getType())));
    if (viewport->getActualHeight() != int(size) || (shadowLayer > 0 && size != map.size))
        return warnOnce("shadow textures of one light differ in size or are not square: not all of them shade splats");

    GLint bound, unpackBuffer;
    glGetIntegerv(GL_TEXTURE_BINDING_2D_ARRAY, &bound);
    if (size != map.size || layers != map.layers) {
        if (!map.texture) glGenTextures(1, &map.texture);
        glBindTexture(GL_TEXTURE_2D_ARRAY, map.texture);
        glGetIntegerv(GL_PIXEL_UNPACK_BUFFER_BINDING, &unpackBuffer);
        glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
        glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_DEPTH_COMPONENT32F, size, size, layers, 0, GL_DEPTH_COMPONENT, GL_FLOAT, nullptr);
        glBindBuffer(GL_PIXEL_UNPACK_BUFFER, unpackBuffer);
        glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, 0);
        map.size = size, map.layers = layers;
    }
    glBindTexture(GL_TEXTURE_2D_ARRAY, map.texture);
    glCopyTexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, GLint(shadowLayer), viewport->getActualLeft(), viewport->getActualTop(), size, size);
    glBindTexture(GL_TEXTURE_2D_ARRAY, bound);

    Matrix4 view, projection;
    for (int i = 0; i < 16; ++i) view[i % 4][i / 4] = desc.viewFromWorld[i], projection[i % 4][i / 4] = desc.clipFromView[i];
    map.clipFromWorld.resize(16 * kMostLayers);
    toGl(projection * view, map.clipFromWorld.data() + 16 * shadowLayer);
    map.drawn = uint32(shadowLayer + 1);
    map.lastUsed = Root::getSingleton().getNextFrameNumber();
    map.revision = hashed(casterRevision(), map.clipFromWorld.data(), 16 * map.drawn * sizeof(float));
}

// ---- lights ------------------------------------------------------------------------------------------------------------------------

NacreLight NacreOgre::toNacre(const Light& light)
{
    NacreLight out = {};
    out.structSize = sizeof out;
    out.mask = light.getLightMask();
    const Vector3 position = light.getDerivedPosition(), direction = light.getDerivedDirection().normalisedCopy();
    toGl(position, out.position);
    toGl(direction, out.direction);

    Real gain = Math::PI * light.getPowerScale(); // a white mesh shows irradiance / pi
    if (light.getType() == Light::LT_DIRECTIONAL) {
        out.type = NACRE_LIGHT_DIRECTIONAL;
        toGl(-direction, out.direction);
    } else {
        const Real constant = light.getAttenuationConstant(), linear = light.getAttenuationLinear(), quadric = light.getAttenuationQuadric();
        Real d2 = 1; // where both falloffs agree
        if (constant != 0 || linear != 0) {
            AxisAlignedBox all;
            for (const auto& object : objects) all.merge(object->getWorldBoundingBox(true));
            d2 = std::max(Real(1e-6), all.isFinite() ? all.getCenter().squaredDistance(position) : Real(1));
            warnOnce("light '" + light.getName() + "' does not fall off with the square of the distance (attenuation range, 0, 0, 1): "
                     "it is right only at the centre of all objects");
        }
        gain *= d2 / std::max(Real(1e-20), constant + linear * std::sqrt(d2) + quadric * d2);
    }
    if (light.getType() == Light::LT_SPOTLIGHT) {
        out.type = NACRE_LIGHT_SPOT;
        const Real outer = 0.5f * light.getSpotlightOuterAngle().valueRadians(), inner = 0.5f * light.getSpotlightInnerAngle().valueRadians();
        Real cosInner = std::cos(inner);
        if (light.getSpotlightFalloff() != 2) { // keep the angle of half the light
            const Real half = std::pow(Real(0.5), 1 / std::max(Real(0.01), light.getSpotlightFalloff()));
            cosInner = std::min(Real(1), std::cos(outer) + (cosInner - std::cos(outer)) * half / std::sqrt(Real(0.5)));
            warnOnce("light '" + light.getName() + "' has a spot falloff other than 2: its cone fades out a little differently on splats");
        }
        out.outerCone = std::min(float(outer), 1.5707f);
        out.innerCone = std::clamp(float(std::acos(cosInner)), 0.0f, 0.999f * out.outerCone);
    }
    const ColourValue color = light.getDiffuseColour();
    for (int i = 0; i < 3; ++i) out.intensity[i] = std::clamp(float(color[i] * gain), 0.0f, 1e15f);
    return out;
}

void NacreOgre::setLights()
{
    std::vector<NacreLight> lights;
    std::vector<NacreShadowMap> shadowMaps; // addresses of its elements are handed over
    const auto& all = manager->getMovableObjects("Light");
    shadowMaps.reserve(all.size());
    for (const auto& [name, object] : all) {
        const Light& light = static_cast<const Light&>(*object);
        if (!light.isVisible() || light.getLightMask() == 0) continue;
        lights.push_back(toNacre(light));
        if (splatShadows && light.getCastShadows()) lights.back().flags |= NACRE_LIGHT_SPLAT_SHADOWS;
        const auto found = maps.find(&light);
        if (found == maps.end() || found->second.drawn == 0) continue;
        const ShadowMap& map = found->second;
        NacreShadowMap shadow = {};
        shadow.structSize = sizeof shadow;
        shadow.kind = NACRE_SHADOW_MAP_ARRAY;
        shadow.texture = map.texture;
        shadow.layers = map.drawn;
        shadow.clipFromWorld = map.clipFromWorld.data();
        shadow.softness = shadowSoftness;
        shadow.revision = map.revision;
        shadowMaps.push_back(shadow);
        lights.back().shadowMap = &shadowMaps.back();
    }
    nacreContextSetLights(context, lights.data(), lights.size());

    if (manager->getAmbientLight() != ambient) {
        ambient = manager->getAmbientLight();
        const float sh[3] = {3.5449077f * ambient.r, 3.5449077f * ambient.g, 3.5449077f * ambient.b}; // function 0 is 1 / 3.54
        NacreEnvironment environment = {};
        environment.structSize = sizeof environment;
        environment.sh = sh;
        environment.shCount = 1;
        nacreContextSetEnvironment(context, &environment);
    }
}

void NacreOgre::warnOnce(const std::string& text)
{
    if (warned.insert(text).second) logMessage(NACRE_WARNING, text.c_str(), nullptr);
}
