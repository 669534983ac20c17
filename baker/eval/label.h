// Text on pictures, as much as names and numbers need.
#pragma once

#include "eval/contact_sheet.h"

#include <span>
#include <string>

namespace nacre {

/// The picture beneath a black band with the lines in white, made wider where they need it: lower case, digits, some signs; others are boxes.
Picture labelled(const Picture& picture, std::span<const std::string> lines);

} // namespace nacre
