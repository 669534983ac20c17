// The device's side of an appearance model, as the engine sees it: forward, resolve and backwardAndStep of TrainableAppearance. beginStep stays
// the host's.
#pragma once

#include "device/bigs.h"
#include "device/device.h"
#include "device/lit_view.h"
#include "device/sss.h"
#include "device/tiles.h"

#include <memory>

namespace nacre::NACRE_BACKEND {

/// One view of all splats.
struct DeviceView {
    TileView tiles;
    const GaussianGeometry<float>* geometry; // [splats]
    uint32_t splats;
    DeviceLitView lit;
    PixelRays rays;
    size_t pixels() const { return size_t(tiles.width) * size_t(tiles.height); }
};

class DeviceModel {
public:
    virtual ~DeviceModel() = default;

    virtual void upload(Device& device) = 0;   // all that the host has of the model
    virtual void download(Device& device) = 0; // all that steps have changed of it
    /// After beginStep of the model, and what splats learn from their neighbours.
    virtual void beginStep(Device& device) = 0;
    virtual void forward(Device& device, const DeviceView& view, float* channels) = 0;
    virtual const float* resolve(Device&, const DeviceView&, const float* planes) { return planes; }
    virtual const float* resolveBackward(Device&, const DeviceView&, const float* planes, const float* dImage) { return (void)planes, dImage; }
    virtual void backwardAndStep(Device& device, const DeviceView& view, const uint8_t* active, const float* dChannels) = 0;
};

class BigsOnDevice final : public DeviceModel {
public:
    explicit BigsOnDevice(BigsState& state) : state_(state) {}
    void upload(Device& device) override { bigs_.upload(device, state_); }
    void download(Device& device) override { bigs_.download(device, state_); }
    void beginStep(Device& device) override { bigs_.shareAmongNeighbours(device, state_); }
    void forward(Device& device, const DeviceView& v, float* channels) override { bigs_.forward(device, state_, v.tiles, v.geometry, v.lit, channels); }
    void backwardAndStep(Device& device, const DeviceView& v, const uint8_t* active, const float* dChannels) override
    {
        bigs_.backwardAndStep(device, state_, v.tiles, v.geometry, v.lit, active, dChannels);
    }

private:
    BigsState& state_;
    DeviceBigs bigs_;
};

class SssOnDevice final : public DeviceModel {
public:
    explicit SssOnDevice(SssState& state) : state_(state) {}
    void upload(Device& device) override { sss_.upload(device, state_); }
    void download(Device& device) override { sss_.download(device, state_); }
    void beginStep(Device&) override { sss_.beginStep(state_); }
    void forward(Device& device, const DeviceView& v, float* channels) override
    {
        sss_.forward(device, v.geometry, v.tiles.splatFromVisible, v.tiles.visibleCount, v.lit, channels);
    }
    const float* resolve(Device& device, const DeviceView& v, const float* planes) override { return sss_.resolve(device, v.rays, v.lit, planes); }
    const float* resolveBackward(Device& device, const DeviceView& v, const float* planes, const float* dImage) override
    {
        return sss_.resolveBackward(device, v.rays, v.lit, planes, dImage);
    }
    void backwardAndStep(Device& device, const DeviceView& v, const uint8_t* active, const float* dChannels) override
    {
        sss_.backwardAndStep(device, v.geometry, v.tiles.splatFromVisible, v.tiles.visibleCount, v.lit, active, dChannels);
    }

private:
    SssState& state_;
    DeviceSss sss_;
};

inline std::unique_ptr<DeviceModel> makeDeviceModel(TrainableAppearance& model)
{
    if (SssState* sss = sssState(model)) return std::make_unique<SssOnDevice>(*sss);
    if (BigsState* bigs = bigsState(model)) return std::make_unique<BigsOnDevice>(*bigs);
    throw DeviceError("the model has no kernels for devices");
}

} // namespace nacre::NACRE_BACKEND
