// What the CPU's TileBuilder has made of a view, on a device.
#pragma once

#include "device/device.h"
#include "device/tiles.h"
#include "render/tiles.h"

namespace nacre::NACRE_BACKEND {

struct DeviceFrame {
    Buffer<uint32_t> splatFromVisible, visibleFromSplat, tileStart, pairStart, entryFromPair;
    Buffer<ProjectedGaussian<float>> projected;
    Buffer<TileEntry> entries;
    TileView view;

    /// `splats`: of the whole cloud, if visibleFromSplat is needed.
    DeviceFrame(Device& device, const TileBuilder& builder, size_t splats = 0)
    {
        const VisibleSplats& v = builder.visible;
        const TileLists& t = builder.tiles;
        std::vector<uint32_t> inverse(splats, ~0u);
        for (size_t i = 0; splats > 0 && i < v.count(); ++i) inverse[v.splatFromVisible[i]] = uint32_t(i);
        splatFromVisible.upload(device, v.splatFromVisible), visibleFromSplat.upload(device, inverse), projected.upload(device, v.projected);
        tileStart.upload(device, t.tileStart), entries.upload(device, t.entries);
        pairStart.upload(device, t.pairStart), entryFromPair.upload(device, t.entryFromPair);
        view = {splatFromVisible.data(), visibleFromSplat.data(), projected.data(), uint32_t(v.count()),  tileStart.data(), entries.data(), pairStart.data(),
                entryFromPair.data(),    uint32_t(t.entries.size()), t.width,        t.height,             t.tilesX,         t.tilesY};
    }
};

} // namespace nacre::NACRE_BACKEND
