#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/identification/thermal/thermal_prediction.hpp>

namespace tribotwin::render {

/// Thermal models of joints, and the recordings that they are compared with.
struct ThermalData {
  std::filesystem::path file;
  std::string text;  ///< of the file, as it is
  twin::identification::ThermalParameters parameters;
  twin::identification::ThermalRecordings recordings;
  std::vector<std::vector<twin::identification::PredictedSession>> predicted;  ///< per joint of the recordings, session
  std::size_t seen = 0;  ///< how many of the recordings the models were identified from
};

/// `data`: what the models are compared with; else what `parameters` names, in the working directory or beside it.
/// ErrorKind::input with the file and what it lacks.
Result<ThermalData> load_thermal(const std::filesystem::path& parameters, std::vector<std::string> data,
                                 std::span<const double> cycle_s, const twin::TableOptions& tables);

/// One self-contained page about how joints warm up: verdict, recorded and predicted temperatures, their difference,
/// heat, parameters, origin. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_thermal_report(const ThermalData& data, const ReportOptions& options);

}  // namespace tribotwin::render
