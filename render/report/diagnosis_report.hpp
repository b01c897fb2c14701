#pragma once

#include <filesystem>
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
  std::vector<twin::diagnosis::Verdict> verdicts;  ///< as many as checked
  twin::diagnosis::Watch watch;
  DiagnosisOptions options;
  std::vector<std::string> missing;  ///< what is not there: sentences for the reader
};

/// Fails, naming the file, where tribotwin diagnose check would refuse.
Result<DiagnosisData> load_diagnosis(const std::filesystem::path& healthy,
                                     const std::vector<std::filesystem::path>& data,
                                     twin::diagnosis::ObservationOptions read, const DiagnosisOptions& options);

/// One self-contained page: verdicts as sentences, distances as in Tables II and III of Zhou 2024, regions as in its
/// Figures 14 and 15, the CUSUM and the margin left. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_diagnosis_report(const DiagnosisData& data, const ReportOptions& options);

}  // namespace tribotwin::render
