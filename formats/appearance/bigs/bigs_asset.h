// How an asset stores the bigs model (SPEC.md), one splat of it at a time. Host only.
#pragma once

#include "appearance/bigs/bigs.h"
#include "splats/splat_asset.h"

namespace nacre {

/// The channels of a valid asset (validate in model_table.h), which must outlive this.
class BigsChannels {
public:
    explicit BigsChannels(const SplatAsset& asset)
        : tDir_(asset.find("tDir")), tInd_(asset.find("tInd")), rho_(asset.find("rho")), s_(asset.find("s")),
          lobe_(asset.find("lobe")), forward_(asset.find("forward")), visibility_(asset.find("visibility")), shadow_(asset.find("shadow")),
          scattering_(s_ ? s_->rows(asset.cloud.count) : 0), sFunctions_(s_ ? bigsScatterFunctions(s_->components) : 0)
    {
    }

    BigsCoefficients<float> at(size_t splat) const
    {
        const bool scatters = splat < scattering_;
        return {&tDir_->values[tDir_->components * splat],
                &tInd_->values[tInd_->components * splat],
                &rho_->values[rho_->components * splat],
                scatters ? &s_->values[s_->components * splat] : nullptr,
                scatters ? sFunctions_ : 0,
                lobe_ ? &lobe_->values[lobe_->components * splat] : nullptr,
                visibility_
                    ? VisibilityMap{&visibility_->bytes[visibility_->components * splat], visibilitySize(visibility_->components)}
                    : VisibilityMap{},
                shadow_ ? shadow_->values[splat] : 1.0f,
                forward_ ? &forward_->values[forward_->components * splat] : nullptr};
    }

private:
    const Channel *tDir_, *tInd_, *rho_, *s_, *lobe_, *forward_, *visibility_, *shadow_;
    size_t scattering_; // splats with s
    int sFunctions_;
};

} // namespace nacre
