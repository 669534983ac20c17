// From the pixels of a packed dataset to what the loss reads, without floats in between.
#pragma once

#include "dataset/packed_images.h"
#include "train/loss.h"

namespace nacre {

/// prepareImage(decodePixels(block, bytes)), bit by bit.
PreparedImage preparePacked(const PackedBlock& block, std::span<const std::byte> bytes);

} // namespace nacre
