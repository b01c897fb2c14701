#pragma once

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/render/report/dynamics/dynamics_data.hpp>

namespace tribotwin::render {

/// One self-contained page about predicted torques of a robot: verdict, errors, what the residuals depend on, recorded
/// and predicted torques, friction parameters, origin. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_dynamics_report(const DynamicsData& data, const ReportOptions& options);

}  // namespace tribotwin::render
