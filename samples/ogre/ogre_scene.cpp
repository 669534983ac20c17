#include "ogre_scene.h"

#include <OgreRectangle2D.h>

#include <GL/glx.h> // last: X11 has macros of everyday words

#include <cmath>

using namespace Ogre;

namespace {

constexpr int kShadowMapSize = 1024;

// OGRE's lights as its own shaders have them: colour = albedo * light * cosine. The first two lights may have a shadow map.
const char* kLitVertex = R"(#version 330 core
uniform mat4 clipFromObject, worldFromObject, normalFromObject;
in vec4 vertex;
in vec3 normal;
out vec3 position, worldNormal;
void main()
{
    gl_Position = clipFromObject * vertex;
    position = (worldFromObject * vertex).xyz;
    worldNormal = mat3(normalFromObject) * normal;
}
)";

const char* kLitFragment = R"(#version 330 core
uniform vec3 albedo;
uniform vec4 ambient, lightPosition[4], lightColour[4], lightAttenuation[4], spotParameters[4], lightDirection[4];
uniform float castsShadows[2];
uniform mat4 mapFromWorld[2];
uniform sampler2D shadowMap0, shadowMap1;
in vec3 position, worldNormal;
out vec4 colour;

// The share of a 3x3 neighbourhood of texels that is not behind something. Beyond the map there is no shadow.
float lit(sampler2D map, vec4 p)
{
    vec3 c = p.xyz / p.w;
    c.z = 0.5 * c.z + 0.5; // OGRE's matrix makes texture coordinates of x and y only
    if (p.w <= 0.0 || any(lessThan(c, vec3(0.0))) || any(greaterThan(c, vec3(1.0)))) return 1.0;
    float sum = 0.0;
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) sum += step(c.z, texture(map, c.xy + vec2(x, y) / vec2(textureSize(map, 0))).r);
    return sum / 9.0;
}

void main()
{
    vec3 n = normalize(worldNormal);
    vec3 sum = ambient.rgb;
    for (int i = 0; i < 4; ++i) {
        vec3 toLight = lightPosition[i].xyz - position * lightPosition[i].w;
        float d = length(toLight);
        toLight /= max(d, 1e-6);
        vec4 a = lightAttenuation[i];
        float share = lightPosition[i].w == 0.0 ? 1.0 : 1.0 / (a.y + a.z * d + a.w * d * d);
        vec4 s = spotParameters[i];
        if (s.w > 0.0) share *= pow(clamp((dot(-toLight, lightDirection[i].xyz) - s.y) / (s.x - s.y), 0.0, 1.0), s.z);
        vec3 p = position + 0.02 * n; // about three texels of the maps
        if (i == 0 && castsShadows[0] > 0.0) share *= lit(shadowMap0, mapFromWorld[0] * vec4(p, 1.0));
        if (i == 1 && castsShadows[1] > 0.0) share *= lit(shadowMap1, mapFromWorld[1] * vec4(p, 1.0));
        sum += lightColour[i].rgb * (share * max(dot(n, toLight), 0.0));
    }
    colour = vec4(albedo * sum, 1.0);
}
)";

const char* kCasterVertex = R"(#version 330 core
uniform mat4 clipFromObject;
in vec4 vertex;
void main() { gl_Position = clipFromObject * vertex; }
)";

const char* kCasterFragment = R"(#version 330 core
void main() {}
)";

const char* kScreenVertex = R"(#version 330 core
in vec4 vertex;
out vec2 at;
void main() { gl_Position = vertex; at = vec2(0.5, -0.5) * vertex.xy + 0.5; }
)";

const char* kScreenFragment = R"(#version 330 core
uniform sampler2D scene;
in vec2 at;
out vec4 colour;
void main()
{
    vec3 c = clamp(texture(scene, at).rgb, 0.0, 1.0);
    colour = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)), 1.0);
}
)";

// The sun's shadow map covers the stage, whatever the camera sees: a scene at rest has a map at rest.
class StageCamera : public ShadowCameraSetup {
    void getShadowCamera(const SceneManager*, const Camera*, const Viewport*, const Light* light, Camera* map, size_t) const override
    {
        const Vector3 direction = light->getDerivedDirection();
        map->setCustomViewMatrix(false);
        map->setCustomProjectionMatrix(false);
        map->setProjectionType(PT_ORTHOGRAPHIC);
        map->setOrthoWindow(7, 7);
        map->setNearClipDistance(0.1f);
        map->setFarClipDistance(12);
        map->getParentSceneNode()->setPosition(-6 * direction);
        map->getParentSceneNode()->setOrientation(light->getParentSceneNode()->_getDerivedOrientation());
    }
};

void makeProgram(const String& name, GpuProgramType type, const char* source)
{
    HighLevelGpuProgramManager::getSingleton().createProgram(name, RGN_DEFAULT, "glsl", type)->setSource(source);
}

Pass* makeMaterial(const String& name, const String& vertexProgram, const String& fragmentProgram)
{
    Pass* pass = MaterialManager::getSingleton().create(name, RGN_DEFAULT)->getTechnique(0)->getPass(0);
    pass->setVertexProgram(vertexProgram);
    pass->setFragmentProgram(fragmentProgram);
    return pass;
}

MaterialPtr makeLitMaterial(const String& name, const Vector3& albedo)
{
    Pass* pass = makeMaterial(name, "LitVertex", "LitFragment");
    GpuProgramParametersPtr p = pass->getVertexProgramParameters();
    p->setNamedAutoConstant("clipFromObject", GpuProgramParameters::ACT_WORLDVIEWPROJ_MATRIX);
    p->setNamedAutoConstant("worldFromObject", GpuProgramParameters::ACT_WORLD_MATRIX);
    p->setNamedAutoConstant("normalFromObject", GpuProgramParameters::ACT_INVERSE_TRANSPOSE_WORLD_MATRIX);
    p = pass->getFragmentProgramParameters();
    p->setNamedConstant("albedo", albedo);
    p->setNamedAutoConstant("ambient", GpuProgramParameters::ACT_AMBIENT_LIGHT_COLOUR);
    p->setNamedAutoConstant("lightPosition", GpuProgramParameters::ACT_LIGHT_POSITION_ARRAY, 4);
    p->setNamedAutoConstant("lightColour", GpuProgramParameters::ACT_LIGHT_DIFFUSE_COLOUR_POWER_SCALED_ARRAY, 4);
    p->setNamedAutoConstant("lightAttenuation", GpuProgramParameters::ACT_LIGHT_ATTENUATION_ARRAY, 4);
    p->setNamedAutoConstant("spotParameters", GpuProgramParameters::ACT_SPOTLIGHT_PARAMS_ARRAY, 4);
    p->setNamedAutoConstant("lightDirection", GpuProgramParameters::ACT_LIGHT_DIRECTION_ARRAY, 4);
    p->setNamedAutoConstant("castsShadows", GpuProgramParameters::ACT_LIGHT_CASTS_SHADOWS_ARRAY, 2);
    p->setNamedAutoConstant("mapFromWorld", GpuProgramParameters::ACT_TEXTURE_VIEWPROJ_MATRIX_ARRAY, 2);
    for (int i = 0; i < 2; ++i) {
        TextureUnitState* unit = pass->createTextureUnitState();
        unit->setContentType(TextureUnitState::CONTENT_SHADOW);
        unit->setTextureFiltering(TFO_NONE);
        unit->setTextureAddressingMode(TextureUnitState::TAM_CLAMP);
        p->setNamedConstant("shadowMap" + StringConverter::toString(i), i);
    }
    return MaterialManager::getSingleton().getByName(name, RGN_DEFAULT);
}

} // namespace

OgreScene::OgreScene(int width, int height, bool hidden)
{
    openWindow(hidden ? 64 : width, hidden ? 64 : height, hidden);
    manager = root->createSceneManager();
    makeProgram("LitVertex", GPT_VERTEX_PROGRAM, kLitVertex);
    makeProgram("LitFragment", GPT_FRAGMENT_PROGRAM, kLitFragment);
    makeProgram("CasterVertex", GPT_VERTEX_PROGRAM, kCasterVertex);
    makeProgram("CasterFragment", GPT_FRAGMENT_PROGRAM, kCasterFragment);
    makeProgram("ScreenVertex", GPT_VERTEX_PROGRAM, kScreenVertex);
    makeProgram("ScreenFragment", GPT_FRAGMENT_PROGRAM, kScreenFragment);

    Pass* pass = makeMaterial("Caster", "CasterVertex", "CasterFragment");
    pass->getVertexProgramParameters()->setNamedAutoConstant("clipFromObject", GpuProgramParameters::ACT_WORLDVIEWPROJ_MATRIX);
    pass->setCullingMode(CULL_NONE);
    manager->setShadowTechnique(SHADOWTYPE_TEXTURE_ADDITIVE_INTEGRATED);
    manager->setShadowTextureSettings(kShadowMapSize, 2, PF_DEPTH32F);
    manager->setShadowTextureCasterMaterial(MaterialManager::getSingleton().getByName("Caster", RGN_DEFAULT));
    manager->setShadowTextureSelfShadow(true);
    manager->setShadowCasterRenderBackFaces(false);
    manager->setAmbientLight(ColourValue(0.02f, 0.02f, 0.03f));

    makeTarget(width, height);
    addLights();
    ground = addMesh(SceneManager::PT_PLANE, Vector3::ZERO, Vector3(0.06f, 0.06f, 1), Vector3(0.45f, 0.45f, 0.42f)); // 12 x 12
    ground->getParentSceneNode()->pitch(Degree(-90));
    sphere = addMesh(SceneManager::PT_SPHERE, Vector3::ZERO, Vector3(0.006f), Vector3(0.6f, 0.25f, 0.15f)); // radius 0.3
    cube = addMesh(SceneManager::PT_CUBE, Vector3(1.15f, 0.25f, 0.9f), Vector3(0.005f), Vector3(0.2f, 0.35f, 0.6f)); // 0.5 wide
    cube->setRenderQueueGroup(RENDER_QUEUE_8);
    setTime(0);
    showTarget();
}

void* OgreScene::getProcAddress(const char* name, void*)
{
    return reinterpret_cast<void*>(glXGetProcAddressARB(reinterpret_cast<const GLubyte*>(name)));
}

OgreScene::~OgreScene()
{
    target.reset();
    delete root;
}

void OgreScene::openWindow(int width, int height, bool hidden)
{
    LogManager* log = new LogManager; // the root deletes it
    log->createLog("ogre.log", /*default*/ true, /*to stderr*/ true, /*no file*/ true)->setLogDetail(LL_LOW); // errors and warnings
    root = new Root("", "", "");
    const String folder = OGRE_PLUGINS;
    root->loadPlugin(folder + "/RenderSystem_GL3Plus");
    root->loadPlugin(folder + "/Codec_STBI"); // writes PNG
    root->setRenderSystem(root->getAvailableRenderers().front());
    root->initialise(false);
    const NameValuePairList options = {{"hidden", hidden ? "true" : "false"}, {"vsync", "true"}};
    window = root->createRenderWindow("Nacre in OGRE", width, height, false, &options);
    ResourceGroupManager& resources = ResourceGroupManager::getSingleton();
    resources.addResourceLocation(OGRE_MEDIA "/ShadowVolume", "FileSystem", RGN_INTERNAL); // any shadow technique asks for it
    resources.initialiseAllResourceGroups();
}

void OgreScene::makeTarget(int width, int height)
{
    target = TextureManager::getSingleton().createManual("Target", RGN_DEFAULT, TEX_TYPE_2D, width, height, 0, PF_FLOAT16_RGBA, TU_RENDERTARGET);
    camera = manager->createCamera("Camera");
    camera->setNearClipDistance(0.1f);
    camera->setFarClipDistance(50);
    camera->setFOVy(Degree(40));
    camera->setAspectRatio(float(width) / float(height));
    SceneNode* node = manager->getRootSceneNode()->createChildSceneNode(Vector3(0, 1.7f, 4.2f));
    node->attachObject(camera);
    node->lookAt(Vector3(0, 0.5f, 0), Node::TS_WORLD);
    Viewport* viewport = target->getBuffer()->getRenderTarget()->addViewport(camera);
    viewport->setBackgroundColour(ColourValue(0.02f, 0.03f, 0.05f));
    viewport->setOverlaysEnabled(false);
}

void OgreScene::showTarget()
{
    Pass* pass = makeMaterial("Screen", "ScreenVertex", "ScreenFragment");
    pass->setDepthCheckEnabled(false);
    pass->setDepthWriteEnabled(false);
    pass->setCullingMode(CULL_NONE);
    pass->createTextureUnitState()->setTexture(target);
    pass->getFragmentProgramParameters()->setNamedConstant("scene", 0);
    screen = root->createSceneManager();
    Rectangle2D* rectangle = new Rectangle2D;
    rectangle->setCorners(-1, 1, 1, -1);
    rectangle->setBoundingBox(AxisAlignedBox::BOX_INFINITE);
    rectangle->setMaterial(MaterialManager::getSingleton().getByName("Screen", RGN_DEFAULT));
    screen->getRootSceneNode()->attachObject(rectangle);
    window->addViewport(screen->createCamera("Screen"));
}

void OgreScene::addLights()
{
    const auto light = [&](Light::LightTypes type, const ColourValue& colour, float power, bool shadows) {
        Light* l = manager->createLight();
        l->setType(type);
        l->setDiffuseColour(colour);
        l->setPowerScale(power);
        l->setAttenuation(100, 0, 0, 1); // 1 / distance^2
        l->setCastShadows(shadows);
        manager->getRootSceneNode()->createChildSceneNode()->attachObject(l);
        return l;
    };
    sun = light(Light::LT_DIRECTIONAL, ColourValue(1, 0.95f, 0.85f), 0.8f, true);
    sunCamera = std::make_shared<StageCamera>();
    sun->setCustomShadowCameraSetup(sunCamera);
    spot = light(Light::LT_SPOTLIGHT, ColourValue(0.6f, 0.8f, 1), 14, true);
    spot->setSpotlightRange(Degree(30), Degree(50), 2); // falloff 2: the cone of glTF
    spot->setShadowNearClipDistance(0.5f);
    spot->setShadowFarClipDistance(12);
    lamp = light(Light::LT_POINT, ColourValue(1, 0.5f, 0.2f), 0.6f, false);
}

Entity* OgreScene::addMesh(SceneManager::PrefabType shape, const Vector3& position, const Vector3& scale, const Vector3& albedo)
{
    static int count = 0; // names
    Entity* entity = manager->createEntity(shape);
    entity->setMaterial(makeLitMaterial("Lit" + StringConverter::toString(count++), albedo));
    SceneNode* node = manager->getRootSceneNode()->createChildSceneNode(position);
    node->setScale(scale);
    node->attachObject(entity);
    return entity;
}

SceneNode* OgreScene::stand(MovableObject* object, const Vector3& position, float height, Degree turn)
{
    const AxisAlignedBox& box = object->getBoundingBox();
    const Real scale = height / box.getSize().y;
    SceneNode* turned = manager->getRootSceneNode()->createChildSceneNode(position, Quaternion(turn, Vector3::UNIT_Y));
    SceneNode* node = turned->createChildSceneNode(-scale * Vector3(box.getCenter().x, box.getMinimum().y, box.getCenter().z));
    node->setScale(Vector3(scale));
    node->attachObject(object);
    return turned;
}

void OgreScene::setTime(double seconds)
{
    const float t = float(std::fmod(seconds, 6.0) * (Math::TWO_PI / 6));
    const auto towards = [](const Vector3& v) { return Vector3::NEGATIVE_UNIT_Z.getRotationTo(v.normalisedCopy()); };
    sun->getParentSceneNode()->setOrientation(towards(Vector3(-0.5f + 0.3f * std::sin(t), -1, -0.4f)));
    spot->getParentSceneNode()->setPosition(Vector3(-2.5f, 3, 2 + std::sin(t)));
    spot->getParentSceneNode()->setOrientation(towards(-spot->getParentSceneNode()->getPosition()));
    lamp->getParentSceneNode()->setPosition(Vector3(1.2f * std::sin(t), 0.6f, 1.2f * std::cos(t)));
    sphere->getParentSceneNode()->setPosition(Vector3(0.4f, 1.5f + 0.1f * std::sin(t), 0.3f));
}

std::vector<float> OgreScene::pixels() const
{
    std::vector<float> rgba(4 * target->getWidth() * target->getHeight());
    RenderTarget* t = target->getBuffer()->getRenderTarget();
    t->copyContentsToMemory(Box(0, 0, target->getWidth(), target->getHeight()),
                            PixelBox(target->getWidth(), target->getHeight(), 1, PF_FLOAT32_RGBA, rgba.data()));
    return rgba;
}
