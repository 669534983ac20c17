#include "selftest/cases.h"

#include <iterator>

namespace nacre::selftest {

std::vector<Case> allCases()
{
    std::vector<Case> all;
    for (auto part : {projectionCases, blendingCases, lightCases, bigsCases, sssCases, gradientCases, borderCases, trainingCases}) {
        std::vector<Case> cases = part();
        all.insert(all.end(), std::make_move_iterator(cases.begin()), std::make_move_iterator(cases.end()));
    }
    return all;
}

} // namespace nacre::selftest
