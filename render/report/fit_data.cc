#include <tribotwin/render/report/fit_data.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace tribotwin::render {
namespace {

namespace fs = std::filesystem;
using twin::identification::ParameterFile;

bool is_file(const fs::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

/// The files that a parameter file names, where they all are.
std::vector<fs::path> named_data(FitData& fit) {
  std::vector<fs::path> found;
  std::vector<std::string> lost;
  for (const auto& name : fit.parameters.data) {
    const fs::path beside = fit.file.parent_path() / name;
    if (is_file(name)) found.emplace_back(name);
    else if (is_file(beside)) found.push_back(beside);
    else lost.push_back(name);
  }
  if (lost.empty() && !found.empty()) return found;
  std::string what = "The file does not say which data the law was identified from";
  if (!lost.empty()) {
    const std::size_t most = std::min<std::size_t>(lost.size(), 5), all = fit.parameters.data.size();
    const std::string which = all == 1 ? "The data of this identification are" : fmt::format("Of the {} data files of this identification, {} {}", all, lost.size(), lost.size() == 1 ? "is" : "are");
    what = fmt::format("{} missing: {}{} (looked for in the working directory and beside {})", which, fmt::join(std::span(lost).first(most), ", "), most < lost.size() ? ", ..." : "", fit.file.filename().string());
  }
  fit.missing.push_back(what + ". Curves are shown without points, and what needs the residuals is not shown; all numbers are those of the identification.");
  return {};
}

void hold_against_law(FitData& fit) {
  const auto& s = fit.samples;
  const friction::Law& law = fit.parameters.law;
  const auto n = static_cast<double>(s.size());
  double last_degC = std::nan("");
  friction::AtTemperature at{};
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (s.temperature_degC[i] != last_degC) at = friction::at_temperature(law, last_degC = s.temperature_degC[i]);
    const auto level = friction::level(law, at, s.speed[i], s.load[i]);
    fit.residuals.push_back(s.friction[i] - level.total());
    fit.outside += level.outside || (law.info->temperature_dependent && at.outside);
  }
  for (const double r : fit.residuals) fit.mean += r / n, fit.largest = std::max(fit.largest, std::abs(r));
  for (const double r : fit.residuals) fit.deviation += (r - fit.mean) * (r - fit.mean) / n;
  fit.deviation = std::sqrt(fit.deviation);
}

}  // namespace

tl::expected<ParameterFile, std::string> read_parameter_file(const fs::path& path) {
  try {
    return twin::identification::read_parameters(path);
  } catch (const std::exception& e) {
    const std::string why = e.what();
    return tl::unexpected(why.starts_with(path.string()) ? why : fmt::format("{}: {}", path.string(), why));
  }
}

drive::Drive drawn_drive(const ParameterFile& file) {
  drive::Drive drive;
  drive.law = file.law;
  if (file.torque_max_nm > 0) drive.torque_max_nm = file.torque_max_nm;
  if (file.gear_ratio > 0) drive.gear_ratio = file.gear_ratio;
  return drive;
}

tl::expected<std::unique_ptr<FitData>, std::string> load_fit(const fs::path& path, const FitOptions& options) {
  auto fit = std::make_unique<FitData>();
  fit->file = path;
  auto parameters = read_parameter_file(path);
  if (!parameters) return tl::unexpected(parameters.error());
  fit->parameters = std::move(*parameters);
  std::ifstream in(path, std::ios::binary);
  fit->text.assign(std::istreambuf_iterator<char>(in), {});
  ParameterFile& p = fit->parameters;
  auto read = options.read;
  if (!(read.torque_max_nm > 0)) read.torque_max_nm = p.torque_max_nm;
  if (!(read.gear_ratio > 0)) read.gear_ratio = p.gear_ratio;
  p.torque_max_nm = read.torque_max_nm;
  p.gear_ratio = read.gear_ratio;
  fit->drive = drawn_drive(p);

  fit->data = options.data.empty() ? named_data(*fit) : options.data;
  if (fit->data.empty()) return fit;
  auto samples = twin::identification::read_samples(fit->data, *p.law.info, read);
  if (!samples) return tl::unexpected(samples.error());
  fit->samples = std::move(*samples);
  hold_against_law(*fit);
  fit->own_data = p.samples == fit->samples.size() && std::abs(fit->deviation - p.residual_std) <= 1e-3 * p.residual_std + 1e-12 * std::ranges::max(fit->samples.friction);
  return fit;
}

}  // namespace tribotwin::render
