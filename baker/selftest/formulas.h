// The scalar formulas that the suite draws with, as a table: a test hands in a wrong one and sees which cases notice.
#pragma once

#include "appearance/bigs/bigs.h"
#include "appearance/sss/sss.h"
#include "appearance/sss/sss_network.h"
#include "base/light_sample.h"
#include "render/projection.h"
#include "render/reference_raster.h"

namespace nacre::selftest {

template <class T>
struct Formulas {
    bool (*project)(const View<T>&, const GaussianGeometry<T>&, ProjectedGaussian<T>&) = projectGaussian<T>;
    void (*projectBackward)(const View<T>&, const GaussianGeometry<T>&, const T*, const T*, T, T, GaussianGeometry<T>&) = projectGaussianBackward<T>;
    T (*blend)(std::span<const uint32_t>, const ProjectedGaussian<T>*, const T*, int, T, T, T*) = blendPixel<T>;
    LightSample<T> (*pointLight)(const T*, T, const T*) = samplePointLight<T>;
    BigsTerms<T> (*terms)(const BigsCoefficients<T>&, const T*, const T*) = bigsTerms<T>;
    BigsSharpTerms<T> (*sharp)(const BigsCoefficients<T>&, const T*, const T*, T) = bigsSharpTerms<T>;
    T (*transport)(const BigsTerms<T>&, const BigsSharpTerms<T>&, int) = bigsTransport<T>;
    void (*fixedInputs)(const T*, const T*, const T*, T*) = sssFixedInputs<T>;
    SssActivations<T> (*network)(const T*, const T*, const T*) = sssNetworkLight<T>;
    SssPixel<T> (*pixel)(const T*, T, const T*, const T*) = sssPixel<T>;
    SssReflection<T> (*reflect)(const SssSurface<T>&, const T*, const T*, T) = sssReflect<T>;
};

} // namespace nacre::selftest
