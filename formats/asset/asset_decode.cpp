// Bytes of a container -> an asset that is valid.
#include "asset/asset_decode.h"

#include "appearance/model_table.h"
#include "asset/glb_layout.h"

namespace nacre {

Result<SplatAsset> decodeAsset(std::span<const std::byte> bytes)
{
    Result<SplatAsset> asset = glb::read(bytes);
    if (!asset) return asset;
    if (Status s = validate(*asset); !s) return s.error();
    return asset;
}

} // namespace nacre
