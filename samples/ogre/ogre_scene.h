// The host of the sample: an OGRE 1.12 scene as a game has one, drawn into a linear half-float target. Nothing here knows Nacre.
//
// A ground and a sphere in the air (both cast and receive OGRE's shadows), a cube in a later queue, which OGRE draws after the splats, and
// three lights: a sun and a spot light with shadow maps, and a lamp without. World: +Y up, metres; the stage is about 4 wide around the origin.
#pragma once

#include <Ogre.h>

#include <memory>
#include <vector>

class OgreScene {
public:
    /// Opens a window of this size; `hidden`: none that is seen, and the target alone is of this size. Throws Ogre::Exception, where there is
    /// no display for example.
    OgreScene(int width, int height, bool hidden);
    ~OgreScene();
    OgreScene(const OgreScene&) = delete;

    /// Moves lights and sphere to where they are at this time.
    void setTime(double seconds);

    /// Of the GL context that OGRE draws in; for anybody else who does.
    static void* getProcAddress(const char* name, void* user);

    void render() { root->renderOneFrame(); }

    /// What was drawn last: linear rgba, top row first.
    std::vector<float> pixels() const;

    Ogre::Root* root = nullptr; // one to a process
    Ogre::RenderWindow* window = nullptr;
    Ogre::SceneManager* manager = nullptr;
    Ogre::Camera* camera = nullptr;
    Ogre::TexturePtr target; // PF_FLOAT16_RGBA
    Ogre::ShadowCameraSetupPtr sunCamera; // of its shadow map
    Ogre::Light *sun = nullptr, *spot = nullptr, *lamp = nullptr;
    Ogre::Entity *ground = nullptr, *sphere = nullptr, *cube = nullptr;

    /// A mesh of one colour, lit by OGRE.
    Ogre::Entity* addMesh(Ogre::SceneManager::PrefabType shape, const Ogre::Vector3& position, const Ogre::Vector3& scale,
                          const Ogre::Vector3& albedo);

    /// Puts something on the ground, of this height, turned about +Y.
    Ogre::SceneNode* stand(Ogre::MovableObject* object, const Ogre::Vector3& position, float height, Ogre::Degree turn = Ogre::Degree(0));

private:
    void openWindow(int width, int height, bool hidden);
    void makeTarget(int width, int height);
    void showTarget();
    void addLights();
    Ogre::SceneManager* screen = nullptr; // one rectangle, to show the target in the window
};
