#pragma once

#include <filesystem>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/render/report/study_data.hpp>

namespace tribotwin::render {

/// One self-contained page: Figures 9 to 15 and Tables II and III of Zhou 2024 for each joint, then faults:
/// verdicts on simulated ones, ROC curves over severity, confusion. `directory` is named in it. Fails where figures
/// cannot be drawn at all (no gnuplot).
Result<Report> make_study_report(const std::filesystem::path& directory, const std::vector<StudyJoint>& joints,
                                 const ReportOptions& options);

}  // namespace tribotwin::render
