// What `nacre report` measured, for programs: JSON and tables. Pictures are left out.
#pragma once

#include "base/result.h"
#include "report/report_data.h"

#include <nlohmann/json_fwd.hpp>

#include <string>

namespace nacre::report {

/// Numbers that were not measured, or are not finite, are null.
nlohmann::ordered_json reportJson(const ReportData& data);

/// about, splits, front_time, front_bytes, levels, history, ledger, scalings, stability and memory, each with a line of names, as FOLDER/NAME.csv
/// (RFC 4180; what was not measured is empty). Makes the folder.
Status writeReportTables(const ReportData& data, const std::string& folder);

} // namespace nacre::report
