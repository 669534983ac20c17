// What must not come in: refused at the border, with a message, by every column that has one.
#include "selftest/cases.h"

#include <cstring>
#include <limits>

namespace nacre::selftest {

constexpr float kMarker = 0.7231453f; // a number that stands once in a file

static std::string bytesOf(float x)
{
    std::string bytes(sizeof x, '\0');
    std::memcpy(bytes.data(), &x, sizeof x);
    return bytes;
}

static Scene spoilt(float& (*where)(Scene&), float value)
{
    Scene scene = bigsScene(8, 4, 3);
    where(scene) = kMarker;
    scene.spoilt = bytesOf(kMarker), scene.spoiltWith = bytesOf(value);
    return scene;
}

std::vector<Case> borderCases()
{
    std::vector<Case> cases;
    const auto add = [&](const char* name, auto scene) {
        cases.push_back({.name = std::string("border: ") + name, .quantity = "accepted", .kind = Kind::kRefusedFile, .bound = {0, "has to be refused with a message"}, .scene = scene});
    };
    const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
    const auto position = +[](Scene& s) -> float& { return s.asset.cloud.positions[3].y; };
    const auto scale = +[](Scene& s) -> float& { return s.asset.cloud.scales[2].x; };
    const auto opacity = +[](Scene& s) -> float& { return s.asset.cloud.opacities[5]; };
    const auto coefficient = +[](Scene& s) -> float& { return channel(s, "tInd")[77]; };

    add("an asset without splats", [] {
        Scene scene = bigsScene(1, 0, 3);
        scene.spoilt = "\"count\":1,", scene.spoiltWith = "\"count\":0,";
        return scene;
    });
    add("a position that is NaN", [=] { return spoilt(position, nan); });
    add("a position that is infinite", [=] { return spoilt(position, infinite); });
    add("a position of 1e20", [=] { return spoilt(position, 1e20f); });
    add("a scale of 0", [=] { return spoilt(scale, 0); });
    add("a scale that is NaN", [=] { return spoilt(scale, nan); });
    add("an opacity of 1.5", [=] { return spoilt(opacity, 1.5f); });
    add("an opacity that is NaN", [=] { return spoilt(opacity, nan); });
    add("a coefficient that is NaN", [=] { return spoilt(coefficient, nan); });
    add("a network whose sums overflow", [] {
        Scene scene = sssScene(8, true, 3);
        for (float& w : channel(scene, "network")) w *= 1e14f;
        return scene;
    });
    add("codes that make the network's sums overflow", [] {
        Scene scene = sssScene(8, true, 3);
        for (float& w : channel(scene, "network")) w *= 1e5f;
        fill(scene, "code", 1e15f);
        return scene;
    });
    const auto lit = [&](const char* name, Light light) {
        add(name, [light] {
            Scene scene = bigsScene(8, 4, 3);
            scene.lights = {light};
            return scene;
        });
        cases.back().kind = Kind::kRefused;
    };
    lit("a light whose position is NaN", pointLight({0, nan, 1}, 1));
    lit("a light whose intensity is infinite", pointLight({0, 0, 1}, infinite));
    lit("a light of negative intensity", pointLight({0, 0, 1}, -1));
    lit("a light without direction", [] {
        Light light;
        light.type = LightType::kDirectional, light.directionToLight = glm::vec3(0);
        return light;
    }());
    add("a camera that is NaN", [nan] {
        Scene scene = bigsScene(8, 4, 3);
        scene.camera.worldFromCamera[3][0] = double(nan);
        return scene;
    });
    cases.back().kind = Kind::kRefused;
    return cases;
}

} // namespace nacre::selftest
