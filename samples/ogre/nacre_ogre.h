// Nacre in OGRE 1.12: copy this file and its .cpp into your project. Needs the render system GL3Plus.
//
// An asset becomes movable objects that hang on scene nodes like meshes. They are lit by the lights of the scene, stand in the shadows of
// its meshes and cast their own into OGRE's shadow maps. Splats are drawn at the end of one render queue group: what comes before hides them
// by depth, what comes later is drawn over them. Use linear float targets (PF_FLOAT16_RGBA), and tone mapping afterwards.
//
//     NacreOgre nacre(sceneManager, getProcAddress);       // OGRE's GL context is current
//     NacreAsset vase = nacre.load(Ogre::Root::openFileStream("vase.glb"));
//     node->attachObject(nacre.createObject(vase));        // that is all; OGRE draws it with everything else
//
// Lights: point, spot and directional; albedo * diffuse colour * power is what a white mesh would show, so the light's irradiance is pi times
// that. Exact for lights that fall off with the square of the distance (setAttenuation(range, 0, 0, 1)) and spot falloff 2; others are
// brought as close as can be, with a warning. The attenuation range does not dim OGRE's lights, nor these.
// Shadows: any technique with shadow textures that have depth. Splats are not drawn into the maps they are shaded by (their own shadows
// are part of the asset, those of other objects are Nacre's: splatShadows), hence a copy of each map is kept before they are.
#pragma once

#include <Ogre.h>

#include <nacre/nacre.h>

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

class NacreOgre;

/// An instance. The scale of its node must be uniform. Visibility, culling, light mask and setCastShadows are those of any movable object.
class NacreObject : public Ogre::MovableObject {
public:
    NacreObject(NacreOgre& owner, NacreAsset asset);
    ~NacreObject() override;

    const Ogre::String& getMovableType() const override;
    const Ogre::AxisAlignedBox& getBoundingBox() const override { return box; }
    Ogre::Real getBoundingRadius() const override { return box.getHalfSize().length() + box.getCenter().length(); }
    void _updateRenderQueue(Ogre::RenderQueue*) override; // OGRE has found it visible
    void visitRenderables(Ogre::Renderable::Visitor*, bool) override {}

    NacreInstance instance = {}; // for tint and edits

private:
    friend class NacreOgre;
    void update(); // place and masks

    NacreOgre& owner;
    Ogre::Affine3 nodeFromAsset; // assets keep the axes of their dataset; +Y is up in the node
    Ogre::AxisAlignedBox box;    // of the node
    Ogre::Affine3 place;
    Ogre::uint32 lightMask = 0;
};

class NacreOgre : private Ogre::RenderQueueListener, private Ogre::SceneManager::Listener {
public:
    /// Throws Ogre::Exception where OpenGL is too old. Messages go to OGRE's log.
    NacreOgre(Ogre::SceneManager* manager, NacreGetProcAddress getProcAddress, Ogre::uint8 queueGroup = Ogre::RENDER_QUEUE_MAIN);
    ~NacreOgre() override; // with all objects; OGRE's GL context is current
    NacreOgre(const NacreOgre&) = delete;

    /// Throws Ogre::Exception if the bytes are no asset.
    NacreAsset load(const Ogre::DataStreamPtr& stream);
    NacreObject* createObject(NacreAsset asset);
    void destroyObject(NacreObject* object);

    /// Says that casters have changed in a way that transforms, visibility and animation states of entities do not show.
    void castersChanged() { ++otherChanges; }

    NacreContext context = {};
    NacreDrawStats stats = {};       // of the last draw that was not into a shadow map
    bool splatShadows = true;        // objects shade one another under lights that cast shadows
    float shadowSoftness = 1;        // texels
    float depthAlpha = 0.25f;        // splats that cover this much cast a shadow

private:
    friend class NacreObject;
    struct ShadowMap { // depth of the meshes, seen from a light; a layer for each of its shadow textures
        Ogre::uint32 texture = 0; // GL name
        Ogre::uint32 size = 0, layers = 0, drawn = 0; // drawn: for the viewport that is being rendered
        std::vector<float> clipFromWorld;
        uint64_t revision = 0;
        unsigned long lastUsed = 0; // frame
    };
    struct View {
        NacreView view = {};
        unsigned long lastUsed = 0;
    };
    void preFindVisibleObjects(Ogre::SceneManager*, Ogre::SceneManager::IlluminationRenderStage, Ogre::Viewport*) override { visible.clear(); }
    void sceneManagerDestroyed(Ogre::SceneManager*) override { manager = nullptr; }
    void shadowTextureCasterPreViewProj(Ogre::Light* light, Ogre::Camera*, size_t iteration) override;
    void postRenderQueues() override;
    void renderQueueEnded(Ogre::uint8 group, const Ogre::String& invocation, bool&) override;
    void keepShadowMap(const Ogre::Viewport* viewport, const NacreDrawDesc& desc);
    void setLights();
    NacreLight toNacre(const Ogre::Light& light);
    NacreDrawDesc describe(const Ogre::Viewport* viewport);
    NacreView viewOf(const Ogre::Camera* camera);
    void dropUnused();
    uint64_t casterRevision() const;
    void warnOnce(const std::string& text);

    Ogre::SceneManager* manager;
    Ogre::uint8 queueGroup;
    std::vector<std::unique_ptr<NacreObject>> objects;
    std::vector<NacreInstance> visible; // in the viewport that is being rendered
    std::map<const Ogre::Camera*, View> views;
    std::map<const Ogre::Light*, ShadowMap> maps;
    const Ogre::Light* shadowLight = nullptr; // whose shadow texture is being rendered
    size_t shadowLayer = 0;
    Ogre::ColourValue ambient = Ogre::ColourValue::ZERO;
    uint64_t otherChanges = 0;
    std::set<std::string> warned;
};
