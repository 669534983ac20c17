// The text by which `nacre synth --capture` says what kind of capture to simulate and how wrong it is.
#pragma once

#include "base/result.h"
#include "light_stage/capture_plan.h"

#include <string>

namespace nacre::cli {

/// KIND[:KEY=NUMBER[UNIT],...], e.g. "stage:light-error=1deg,gain=3%". A unit may be left out; another than the key's is an error.
Result<CaptureOptions> parseCapture(const std::string& text);

/// One line that says everything, in the same form: for comparing settings.
std::string textOf(const CaptureOptions& capture);

/// The keys with units and usual values, for --help.
std::string captureKeys();

} // namespace nacre::cli
