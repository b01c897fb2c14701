#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/report/fit_data.hpp>
#include <tribotwin/twin/identification/curves/direction.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

namespace fs = std::filesystem;
using twin::identification::ParameterFile;

/// The files that a parameter file names, where they all are.
std::vector<fs::path> named_data(FitData& fit) {
  const auto& names = fit.parameters.data;
  if (names.empty()) {
    fit.missing.push_back(
        "The file does not say which data the law was identified from: curves are shown without points, and no "
        "residuals.");
    return {};
  }
  if (!fit.has_residual()) {
    fit.missing.push_back(
        "The parameters were not found from measured friction: curves are shown without points, and no residuals.");
    return {};
  }
  std::vector<fs::path> found;
  for (const auto& name : names) {
    if (const auto file = twin::named_file(name, fit.file))
      found.push_back(*file);
    else {
      fit.missing.push_back(
          fmt::format("The data of this identification are missing: {} is neither in the working directory nor beside "
                      "{}. Curves are shown without points, and no residuals.",
                      name, fit.file.filename().string()));
      return {};
    }
  }
  return found;
}

/// Makes the samples those of the law alone, which the figures draw. Residuals stay those of each direction.
twin::identification::Direction take_direction_out(FitData& fit) {
  const twin::identification::Direction direction{.asymmetry = fit.parameters.asymmetry,
                                                  .offset = fit.parameters.offset};
  if (direction.asymmetry == 0 && direction.offset == 0) return direction;
  const auto rows = twin::identification::by_direction(fit.samples);
  std::vector<double> unused;
  fit.samples = rows;
  twin::identification::make_symmetric(rows, {}, direction, fit.samples, unused);
  return direction;
}

void compute_residuals(FitData& fit) {
  const twin::identification::Direction direction = take_direction_out(fit);
  const auto& s = fit.samples;
  const friction::Law& law = fit.parameters.law;
  double last_degC = std::nan("");
  friction::AtTemperature at{};
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (s.temperature_degC[i] != last_degC) at = friction::at_temperature(law, last_degC = s.temperature_degC[i]);
    const double factor = s.direction.empty() ? 1 : direction.factor(s.direction[i]);
    fit.residuals.push_back(factor * (s.friction[i] - friction::level(law, at, s.speed[i], s.load[i]).total()));
  }
  const auto n = static_cast<double>(s.size());
  double mean = 0, square = 0;
  for (const double r : fit.residuals) mean += r / n;
  for (const double r : fit.residuals) square += (r - mean) * (r - mean) / n;
  fit.deviation = std::sqrt(square);
}

}  // namespace

Result<ParameterFile> read_parameter_file(const fs::path& path, const twin::identification::ReadOptions& given) {
  auto file = twin::identification::read_parameters(path);
  if (!file) return file;
  if (given.torque_max_nm > 0) file->torque_max_nm = given.torque_max_nm;
  if (given.gear_ratio > 0) file->gear_ratio = given.gear_ratio;
  return file;
}

drive::Drive drawn_drive(const ParameterFile& file) {
  drive::Drive drive;
  drive.law = file.law;
  if (file.torque_max_nm > 0) drive.torque_max_nm = file.torque_max_nm;
  if (file.gear_ratio > 0) drive.gear_ratio = file.gear_ratio;
  return drive;
}

std::optional<friction::Uncertainty> uncertainty_of(const ParameterFile& file) {
  const std::size_t n = file.law.info->parameters.size();
  if (file.found.parameters.size() < n || file.found.covariance.rows() < static_cast<Eigen::Index>(n))
    return std::nullopt;
  std::vector covariance(n, std::vector<double>(n));
  double interval_sigmas = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const auto& e = file.found.parameters[i];
    if (e.status == twin::identification::Status::fixed) continue;  // given
    if (!(e.sigma > 0) || !std::isfinite(e.high - e.low)) return std::nullopt;
    interval_sigmas = std::max(interval_sigmas, (e.high - e.low) / (2 * e.sigma));
    for (std::size_t k = 0; k < n; ++k) {
      const double both = file.found.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
      if (file.found.parameters[k].status == twin::identification::Status::fixed) continue;
      if (!std::isfinite(both)) return std::nullopt;
      covariance[i][k] = both;
    }
  }
  if (!(interval_sigmas > 0)) return std::nullopt;
  return friction::make_uncertainty(file.law, covariance, interval_sigmas);
}

std::vector<FrictionPoint> friction_points(const drive::Drive& drive, const twin::identification::Samples& s,
                                           std::span<const std::size_t> rows) {
  std::vector<FrictionPoint> points;
  const double nm = drive.torque_scale_nm();
  for (const std::size_t i : rows)
    points.push_back({s.speed[i] / drive.speed_scale(), s.load[i], s.temperature_degC[i], s.friction[i] * nm,
                      s.standard_error.empty() ? 0 : s.standard_error[i] * nm});
  return points;
}

Result<FitData> load_fit(const fs::path& path, std::vector<fs::path> data, twin::identification::ReadOptions read) {
  auto parameters = read_parameter_file(path, read);
  if (!parameters) return tl::unexpected(parameters.error());
  FitData fit{.file = path, .parameters = std::move(*parameters)};
  fit.text = twin::read_text(path, "a file").value_or("");
  const ParameterFile& p = fit.parameters;
  read.torque_max_nm = p.torque_max_nm;
  read.gear_ratio = p.gear_ratio;
  fit.drive = drawn_drive(p);

  if (data.empty()) data = named_data(fit);
  if (data.empty()) return fit;
  auto samples = twin::identification::read_samples(data, *p.law.info, read);
  if (!samples) return tl::unexpected(samples.error());
  fit.samples = std::move(*samples);
  compute_residuals(fit);
  fit.own_data = p.found.samples == fit.samples.size() &&
                 std::abs(fit.deviation - p.found.residual.std) <=
                     1e-3 * p.found.residual.std + 1e-12 * std::ranges::max(fit.samples.friction);
  return fit;
}

}  // namespace tribotwin::render
