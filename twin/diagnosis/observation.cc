#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/diagnosis/observation.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

namespace fs = std::filesystem;
using Eigen::Index;
using identification::Samples, identification::Status;

constexpr std::array<std::size_t, feature_count> place_in_law{0, 1, 2, 4, 5};  // of the features; 3: alpha

double mean_of(const std::vector<double>& x) {
  return std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
}

Result<identification::Fit> fitted(const Samples& curve) {
  return identification::fit(*friction::find_law(law_name), curve,
                             {.fixed = {{"alpha", alpha}}, .count_arcs = false, .threads = 1});
}

/// The levels as they would be at the mean load of the curve: boundary friction is proportional to 1 + k load.
Result<identification::Fit> fitted_at_mean_load(Samples curve, double k) {
  auto fit = fitted(curve);
  const double mean = mean_of(curve.load);
  if (k == 0 || std::ranges::all_of(curve.load, [&](double l) { return std::abs(l - mean) < 1e-6; })) return fit;
  const std::vector<double> measured = curve.friction;
  for (int round = 0; round < 2 && fit; ++round) {  // after two the error is below 1e-3 of the correction
    const auto& p = fit->law.parameters;
    for (std::size_t i = 0; i < curve.size(); ++i) {
      const double boundary = p[0] + (p[1] - p[0]) * std::exp(-std::pow(curve.speed[i] / p[2], alpha));
      curve.friction[i] = measured[i] - boundary * k * (curve.load[i] - mean) / (1 + k * mean);
    }
    fit = fitted(curve);
  }
  return fit;
}

/// Joint of the campaign that a file of tribotwin lab belongs to, or empty.
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

/// torque_max_nm from rows that have friction in both units; 0: not known.
double torque_max_of(const Numbers& table, const fs::path& file) {
  const auto &norm = table.columns[1], &nm = table.columns[2];
  double largest = 0, ratio = 0;
  for (std::size_t i = 0; i < std::min(norm.size(), nm.size()); ++i)
    if (std::abs(norm[i]) > largest) largest = std::abs(norm[i]), ratio = nm[i] / norm[i];
  if (largest > 0 && !(ratio > 0))
    throw InputError(fmt::format("{}: friction_nm and friction_norm have different signs", file.string()));
  return ratio;
}

/// Median over the levels that measured one.
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
          fmt::format("{} is left out: a column 'curve' is needed to assign it to curves", indicators[which].column));
      continue;
    }
    for (std::size_t c = 0; c < by_curve.size(); ++c)
      out.observations[c].indicators[which] =
          which == ripple ? std::ranges::max(by_curve[c]) : lost_motion_of(std::move(by_curve[c]));
  }
}

/// The columns that read_samples does not give; none of a telemetry.h5.
struct Columns {
  Numbers table;
  bool present = false;

  const std::vector<double>& load() const { return table.columns[5]; }
  const std::vector<double>& temperature() const { return table.columns[6]; }
};

Columns read_columns(const fs::path& file, const TableOptions& options) {
  if (record_of(file)) return {};
  Numbers table =
      or_wrong_input(read_numbers(file,
                                  {"curve", "friction_norm", "friction_nm", std::string(indicators[ripple].column),
                                   std::string(indicators[lost_motion].column), "load_norm", "temperature_degC"},
                                  options));
  if (table.left_out)
    throw InputError(
        fmt::format("{}:{}: a cell is empty, NaN or infinite, {} row(s) in all: measure these levels again, or take "
                    "their whole curve out",
                    file.string(), table.first_left_out, table.left_out));
  return {std::move(table), true};
}

/// The samples of each curve.
std::vector<Samples> curves_of(const Samples& samples) {
  std::vector<Samples> curves;
  for (std::size_t begin = 0; begin < samples.size();) {
    std::vector<std::size_t> rows;
    for (const auto curve = samples.curve[begin]; begin < samples.size() && samples.curve[begin] == curve; ++begin)
      rows.push_back(begin);
    curves.push_back(samples.subset(rows));
  }
  return curves;
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
  if (!fit) return tl::unexpected(Error(fit.error().message));
  Observation o{.residual_nm = fit->residual.std};
  const double variance = fit->cost / std::max(1.0, static_cast<double>(fit->samples - fit->estimated));
  Features slope = Features::Ones();
  for (Index i = 0; i < feature_count; ++i) {
    const auto& e = fit->parameters[place_in_law[static_cast<std::size_t>(i)]];
    o.features(i) = e.value;
    if (i < 4) slope(i) = 1 / std::max(e.value, 1e-12);
    // What scatter is worth is learned from the healthy curves: a number that exceeds its sigma is one here.
    if (e.status != Status::estimated || e.sigma > std::abs(e.value)) o.weak.push_back(e.name);
  }
  for (Index i = 0; i < feature_count; ++i)
    for (Index k = 0; k < feature_count; ++k)
      o.shape(i, k) = fit->covariance(static_cast<Index>(place_in_law[static_cast<std::size_t>(i)]),
                                      static_cast<Index>(place_in_law[static_cast<std::size_t>(k)])) *
                      slope(i) * slope(k) / variance;
  if (!o.shape.allFinite() || !(variance > 0)) o.shape.setZero();
  // Standstill and Coulomb friction differ only where the curve has levels on both sides of the Stribeck velocity.
  const auto [slowest, fastest] = std::ranges::minmax(curve.speed);
  if (const double Vs = o.features(2); slowest > Vs || fastest < 5 * Vs)
    o.weak.emplace_back(slowest > Vs ? "Fs" : "Fv");
  return o;
}

Result<ObservationFile> read_observations(const fs::path& file, const ObservationOptions& options) try {
  ObservationFile out{.joint = joint_beside(file)};
  const Columns columns = read_columns(file, with_gear_ratio(options.table, options.gear_ratio));
  if (columns.present) out.torque_max_nm = torque_max_of(columns.table, file);
  const Samples samples = or_wrong_input(identification::read_samples(
      std::array{file}, *friction::find_law(law_name),
      {.torque_max_nm = options.torque_max_nm, .gear_ratio = options.gear_ratio, .table = options.table}));
  if (samples.left_out)
    throw InputError(
        fmt::format("{}: {} row(s) have cells that are empty, NaN or infinite: measure these levels again, or take "
                    "their whole curve out",
                    file.string(), samples.left_out));
  out.notes = samples.notes;
  const bool recording = !columns.present || columns.table.has("position_rad");
  for (const Samples& one : curves_of(samples)) {
    auto seen = observe(one, options.load_sensitivity);
    const std::size_t number = out.observations.size() + 1;
    if (!seen)
      throw InputError(
          fmt::format("{}, curve {}: {}; one row per level, and a column 'curve' or rising speeds separate curves",
                      file.string(), number, seen.error().message));
    seen->file = file.string();
    seen->curve = number;
    // A recording without such a column reads as 0.
    if (recording ? mean_of(one.temperature_degC) != 0 : !columns.temperature().empty())
      seen->temperature_degC = mean_of(one.temperature_degC);
    if (recording ? mean_of(one.load) != 0 : !columns.load().empty()) seen->indicators[load] = mean_of(one.load);
    out.observations.push_back(*std::move(seen));
  }
  if (columns.present) take_indicators(columns.table, out);
  return out;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::diagnosis
