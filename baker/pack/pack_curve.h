// Bytes against loss, as a table and a picture.
#pragma once

#include "base/result.h"
#include "pack/pack.h"

#include <span>
#include <string>

namespace nacre {

/// `path`: .csv with the columns bytes_per_splat and loss_db; the picture is the .svg of the same name.
Status writeCurve(std::span<const PackPoint> curve, const std::string& path);

} // namespace nacre
