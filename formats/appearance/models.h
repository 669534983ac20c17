// The appearance models, once for all layers.
//
// A new model is a line here and files named after it in formats/appearance, runtime/src and baker/appearance. In the namespace nacre::NAME
// they define what each layer asks of a model; whatever is missing, the linker names:
//
//   formats   summary, channels                                        declared in appearance/model_table.h
//   runtime   makeGpuModel                                             gpu_model.h
//   baker     makeTrainable, makeReference, makeRadianceSampler        appearance/trainable.h, reference_model.h, splat_radiance.h
#pragma once

#define NACRE_APPEARANCE_MODELS(MODEL) \
    MODEL(bigs)                        \
    MODEL(sss)
