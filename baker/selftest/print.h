// A report for people, as text for a terminal, as Markdown for the documentation, as JSON for programs.
#pragma once

#include "selftest/selftest.h"

#include <string>

namespace nacre::selftest {

std::string asText(const Report& report);
/// `command`, `machine`: how and where it was made.
std::string asMarkdown(const Report& report, const std::string& command, const std::string& machine);
std::string asJson(const Report& report, const std::string& command, const std::string& machine);

} // namespace nacre::selftest
