// What `nacre report` measured, as a page for people.
#pragma once

#include "base/result.h"
#include "report/report_data.h"

#include <string>

namespace nacre::report {

/// One HTML file with its plots and pictures inside: nothing is loaded from elsewhere, no script runs, it prints. What `data` lacks is said in a
/// line each. Texts of `data` may hold anything. Written atomically.
Status writeReportPage(const ReportData& data, const std::string& path);

/// The page's text.
std::string reportPage(const ReportData& data);

} // namespace nacre::report
