#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/diagnosis/sequence.hpp>

namespace tribotwin::render {

struct DiagnosisOptions {
  twin::diagnosis::CheckOptions check;
  double watch_false_alarm = twin::diagnosis::once_a_year;
};

/// Observations of a joint and the verdicts on them.
struct DiagnosisData {
  std::filesystem::path file;  ///< of the healthy state
  std::string text;            ///< of the file, as it is
  twin::diagnosis::HealthyState healthy;
  std::vector<twin::diagnosis::Observation> learned;  ///< empty where the files that the state names are missing
  std::vector<twin::diagnosis::Observation> checked;
  /// Levels of the latest of them.
  struct Levels {
    std::vector<double> speed_rad_s, friction_nm, error_nm;  ///< motor side; arm side; one sigma
  } latest;
  std::vector<twin::diagnosis::Verdict> verdicts;  ///< as many as checked
  std::vector<double> days;  ///< since 1970, of the dates in the files' names; empty where one lacks
  std::optional<twin::diagnosis::Margin> trend;  ///< over `days`, where these ascend
  twin::diagnosis::Watch watch;
  DiagnosisOptions options;
  std::vector<std::string> missing;  ///< what is not there: sentences for the reader
};

/// Fails, naming the file, where tribotwin diagnose check would refuse.
Result<DiagnosisData> load_diagnosis(const std::filesystem::path& healthy,
                                     const std::vector<std::filesystem::path>& data,
                                     twin::diagnosis::ObservationOptions read, const DiagnosisOptions& options);

/// One self-contained page: what is to be done, the latest curve over those of a healthy joint at its temperature,
/// verdicts as sentences, the CUSUM, regions as in Figures 14 and 15 of Zhou 2024; distances as in
/// its Tables II and III in an appendix. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_diagnosis_report(const DiagnosisData& data, const ReportOptions& options);

}  // namespace tribotwin::render
