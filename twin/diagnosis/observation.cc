#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/diagnosis/observation.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/table.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

namespace fs = std::filesystem;
using Eigen::Index;
using identification::Samples, identification::Status;

constexpr std::array<std::size_t, feature_count> place_in_law{0, 1, 2, 4, 5};  // of the features; 3 is alpha

double mean_of(const std::vector<double>& x) {
  return std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
}

Result<identification::Fit> fitted(const Samples& curve) {
  return identification::fit(*friction::find_law(law_name), curve, {.fixed = {{"alpha", alpha}}, .threads = 1});
}

/// The levels as they would be at the mean load of the curve: boundary friction is proportional to 1 + k load.
Result<identification::Fit> fitted_at_mean_load(Samples curve, double k) {
  auto fit = fitted(curve);
  const double mean = mean_of(curve.load);
  if (k == 0 || std::ranges::all_of(curve.load, [&](double l) { return std::abs(l - mean) < 1e-6; })) return fit;
  const std::vector<double> measured = curve.friction;
  for (int round = 0; round < 2 && fit; ++round) {  // what is left after two is below 1e-3 of the correction
    const auto& p = fit->law.parameters;
    for (std::size_t i = 0; i < curve.size(); ++i) {
      const double boundary = p[0] + (p[1] - p[0]) * std::exp(-std::pow(curve.speed[i] / p[2], alpha));
      curve.friction[i] = measured[i] - boundary * k * (curve.load[i] - mean) / (1 + k * mean);
    }
    fit = fitted(curve);
  }
  return fit;
}

/// Of the campaign that a file of tribotwin lab belongs to.
std::string joint_beside(const fs::path& file) {
  const fs::path folder = fs::absolute(file).parent_path();
  for (const fs::path& campaign : {folder / "campaign.yaml", folder.parent_path() / "campaign.yaml"}) {
    std::error_code error;
    if (!fs::is_regular_file(campaign, error)) continue;
    const YAML::Node joint = load_yaml(campaign)["joint"];
    return joint && joint.IsScalar() ? joint.Scalar() : "";
  }
  return "";
}

/// torque_max_nm from rows that say friction in both units.
double torque_max_of(const Numbers& table, const fs::path& file) {
  const auto &norm = table.columns[1], &nm = table.columns[2];
  double largest = 0, ratio = 0;
  for (std::size_t i = 0; i < std::min(norm.size(), nm.size()); ++i)
    if (std::abs(norm[i]) > largest) largest = std::abs(norm[i]), ratio = nm[i] / norm[i];
  if (largest > 0 && !(ratio > 0))
    throw InputError(fmt::format("{}: friction_nm and friction_norm have different signs", file.string()));
  return ratio;
}

/// Of the levels that can tell.
double lost_motion_of(std::vector<double> levels) {
  std::erase(levels, 0.0);
  return levels.empty() ? 0 : identification::median_of(std::move(levels));
}

/// Largest ripple and median lost motion of each curve, where the file has them.
void take_indicators(const Numbers& table, ObservationFile& out) {
  const auto& number = table.columns[0];
  for (const auto& [which, column] : {std::pair{ripple, &table.columns[3]}, {lost_motion, &table.columns[4]}}) {
    if (column->empty()) continue;
    std::vector<std::vector<double>> by_curve;
    for (std::size_t i = 0; i < column->size(); ++i) {
      if (i == 0 || (!number.empty() && number[i] != number[i - 1])) by_curve.emplace_back();
      by_curve.back().push_back((*column)[i]);
    }
    if (by_curve.size() != out.observations.size()) {
      out.notes.push_back(
          fmt::format("{} is left out: without a column 'curve' it cannot be told which curve it belongs to",
                      indicators[which].column));
      continue;
    }
    for (std::size_t c = 0; c < by_curve.size(); ++c)
      out.observations[c].indicators[which] =
          which == ripple ? std::ranges::max(by_curve[c]) : lost_motion_of(std::move(by_curve[c]));
  }
}

}  // namespace

Features Observation::logarithmic() const {
  Features z = features;
  z.head(4) = z.head(4).cwiseMax(1e-12).array().log();
  return z;
}

std::string Observation::name() const {
  return fmt::format("{}, curve {}{}", file, curve,
                     temperature_degC ? fmt::format(" ({:.1f} degC)", *temperature_degC) : "");
}

Result<Observation> observe(const Samples& curve, double load_sensitivity) {
  const auto fit = fitted_at_mean_load(curve, load_sensitivity);
  if (!fit) return tl::unexpected(fit.error());
  Observation o{.residual_nm = fit->residual.std};
  const double variance = fit->cost / std::max(1.0, static_cast<double>(fit->samples - fit->estimated));
  Features slope = Features::Ones();
  for (Index i = 0; i < feature_count; ++i) {
    const auto& e = fit->parameters[place_in_law[static_cast<std::size_t>(i)]];
    o.features(i) = e.value;
    if (i < 4) slope(i) = 1 / std::max(e.value, 1e-12);
    if (e.status != Status::estimated || std::ranges::find(fit->unidentifiable, e.name) != fit->unidentifiable.end())
      o.weak.push_back(e.name);
  }
  for (Index i = 0; i < feature_count; ++i)
    for (Index k = 0; k < feature_count; ++k)
      o.shape(i, k) = fit->covariance(static_cast<Index>(place_in_law[static_cast<std::size_t>(i)]),
                                      static_cast<Index>(place_in_law[static_cast<std::size_t>(k)])) *
                      slope(i) * slope(k) / variance;
  if (!o.shape.allFinite() || !(variance > 0)) o.shape.setZero();
  // Standstill and Coulomb friction are apart only where the curve has levels on both sides of the Stribeck velocity.
  const auto [slowest, fastest] = std::ranges::minmax(curve.speed);
  if (const double Vs = o.features(2); slowest > Vs || fastest < 5 * Vs)
    o.weak.emplace_back(slowest > Vs ? "Fs" : "Fv");
  return o;
}

Result<ObservationFile> read_observations(const fs::path& file, const ObservationOptions& options) try {
  ObservationFile out{.joint = joint_beside(file)};
  Numbers table;
  if (file.extension() != ".h5") {
    auto read = read_numbers(file, {"curve", "friction_norm", "friction_nm", std::string(indicators[ripple].column),
                                    std::string(indicators[lost_motion].column), "load_norm", "temperature_degC"});
    if (!read) return tl::unexpected(read.error());
    table = *std::move(read);
    if (table.left_out)
      return tl::unexpected(
          fmt::format("{}:{}: a cell is empty, NaN or infinite, {} row(s) in all: measure these levels again, or take "
                      "their whole curve out",
                      file.string(), table.first_left_out, table.left_out));
    out.torque_max_nm = torque_max_of(table, file);
  }
  const auto samples = identification::read_samples(
      std::array{file}, *friction::find_law(law_name),
      {.torque_max_nm = options.torque_max_nm, .gear_ratio = options.gear_ratio, .joint = options.joint});
  if (!samples) return tl::unexpected(samples.error());
  if (samples->left_out)
    return tl::unexpected(
        fmt::format("{}: {} row(s) have cells that are empty, NaN or infinite: measure these levels again, or take "
                    "their whole curve out",
                    file.string(), samples->left_out));
  out.notes = samples->notes;
  const bool recording =
      file.extension() == ".h5" || std::ranges::find(table.names, "position_rad") != table.names.end();
  for (std::size_t begin = 0; begin < samples->size();) {
    std::vector<std::size_t> rows;
    for (const auto curve = samples->curve[begin]; begin < samples->size() && samples->curve[begin] == curve; ++begin)
      rows.push_back(begin);
    const Samples one = samples->subset(rows);
    auto seen = observe(one, options.load_sensitivity);
    const std::size_t number = out.observations.size() + 1;
    if (!seen)
      return tl::unexpected(
          fmt::format("{}, curve {}: {}; one row per level, and a column 'curve' or rising speeds tell curves apart",
                      file.string(), number, seen.error().message));
    seen->file = file.string();
    seen->curve = number;
    if (recording ? mean_of(one.temperature_degC) != 0 : !table.columns[6].empty())
      seen->temperature_degC = mean_of(one.temperature_degC);
    if (recording ? mean_of(one.load) != 0 : !table.columns[5].empty()) seen->indicators[load] = mean_of(one.load);
    out.observations.push_back(*std::move(seen));
  }
  take_indicators(table, out);
  return out;
} catch (const InputError& e) {
  return tl::unexpected(std::string(e.what()));
}

}  // namespace tribotwin::twin::diagnosis
