// The appearance models, once for all layers.
//
// A new model is a line here and files named after it in formats/appearance, runtime/src and baker/appearance. In the namespace nacre::NAME
// they define what each layer asks of a model; whatever is missing, the linker names:
//
//   formats   summary, channels, check                                 declared in appearance/model_table.h
//   runtime   makeGpuModel                                             gpu_model.h
//   baker     makeTrainable, makeReference, makeRadianceSampler        appearance/trainable.h, reference_model.h, splat_radiance.h
// NACRE_WITH_<NAME>=0, from the CMake option of this name, leaves a model out of a build.
#pragma once

#ifndef NACRE_WITH_BIGS
#define NACRE_WITH_BIGS 1
#endif
#ifndef NACRE_WITH_SSS
#define NACRE_WITH_SSS 1
#endif

#if NACRE_WITH_BIGS
#define NACRE_IF_BIGS(MODEL) MODEL(bigs)
#else
#define NACRE_IF_BIGS(MODEL)
#endif
#if NACRE_WITH_SSS
#define NACRE_IF_SSS(MODEL) MODEL(sss)
#else
#define NACRE_IF_SSS(MODEL)
#endif

#define NACRE_ALL_APPEARANCE_MODELS(MODEL) MODEL(bigs) MODEL(sss)
/// Those in this build.
#define NACRE_APPEARANCE_MODELS(MODEL) NACRE_IF_BIGS(MODEL) NACRE_IF_SSS(MODEL)
