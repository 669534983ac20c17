// The table of cases: what is drawn, learnt or refused, how far a column may be from the float64 reference, and why so far.
#pragma once

#include "base/result.h"
#include "selftest/scene.h"
#include "selftest/values.h"

#include <functional>
#include <string>
#include <vector>

namespace nacre::selftest {

enum class Kind {
    kImage,     // radiance and coverage of a scene
    kGradients, // of them, with respect to geometry and colours
    kRefusedFile, // the asset's file has to be refused: 1 where it is not
    kRefused,     // the lights or the camera have to be
    kTraining,  // what a bake or an optimisation leaves, on the engines that train
};

/// A pixel in closed form, which the float64 reference is held to; channel 3 is alpha.
struct Known {
    int x, y, channel;
    double value;
};

/// Largest deviation allowed, in units of the largest value of its kind (alpha: of 1), and the reason.
struct Bound {
    double value;
    const char* reason;
};

struct Case {
    std::string name, quantity;
    Kind kind = Kind::kImage;
    Bound bound{};
    std::function<Scene()> scene{};
    std::function<Scene()> like{};     // the scene that it has to look like: its float64 image is the reference; empty: its own is
    std::vector<Known> known{};
    Bound gl{};                    // of columns of OpenGL; value 0: as `bound`
    bool exactColor = false;           // only colour is compared, in units of 1
    bool mayRefuse = false;            // columns that read files refuse it, which is right, too
    std::function<Result<Values>()> train{}; // values that should be 0
};

/// In the order of the table.
std::vector<Case> allCases();

std::vector<Case> projectionCases();
std::vector<Case> blendingCases();
std::vector<Case> lightCases();
std::vector<Case> bigsCases();
std::vector<Case> sssCases();
std::vector<Case> gradientCases();
std::vector<Case> borderCases();
std::vector<Case> trainingCases();

} // namespace nacre::selftest
