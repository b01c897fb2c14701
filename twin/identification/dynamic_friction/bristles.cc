#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamic_friction/bristles.hpp>
#include <tribotwin/twin/identification/dynamic_friction/prediction_error.hpp>
#include <tribotwin/twin/identification/time_series.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::VectorXd;

/// The nonlinear numbers, then per recording the deflection at its start as a share of breakaway. sigma1 is the linear
/// number.
enum Shape : Index { log_sigma0, log_vd, first_start };

constexpr double arm_speed_max = 60;

double temperature_of(const SlidingRecording& r, std::size_t i) {
  return r.temperature_degC.empty() ? 0 : r.temperature_degC[i];
}
double load_of(const SlidingRecording& r, std::size_t i) { return r.load_nm.empty() ? 0 : r.load_nm[i]; }

/// Torque without sigma1 [Nm], and what one unit of it adds.
Prediction predict(const drive::Drive& of_law, std::span<const SlidingRecording> recordings, const VectorXd& at) {
  drive::Drive without = of_law;
  without.dynamics = drive::Dynamics::lugre;
  without.bristles = {.sigma0 = std::exp(at(log_sigma0)), .sigma1 = 0, .vd = std::exp(at(log_vd))};
  drive::Drive with = without;
  with.bristles.sigma1 = 1;
  Index rows = 0;
  for (const auto& r : recordings) rows += static_cast<Index>(r.time_s.size());
  Prediction p{.known = VectorXd(rows), .basis = Eigen::MatrixXd(rows, 1)};
  Index row = 0;
  for (std::size_t k = 0; k < recordings.size(); ++k) {
    const SlidingRecording& r = recordings[k];
    drive::MotorState state;
    drive::Workspace workspace{.temperature_held = 1};
    const auto begins = [&](const drive::Drive& drive, std::size_t i) {
      drive::set_temperature(drive, state, temperature_of(r, i));
      state.load_nm = load_of(r, i);
      drive::begin_step(drive, state, workspace, r.time_s[i], r.velocity_rad_s[i]);
      return workspace.applied_nm;
    };
    begins(without, 0);
    const double breakaway =
        drive::level(without, {workspace.cache, false}, 0, load_of(r, 0) / without.torque_max_nm).weakening;
    state.z = at(first_start + static_cast<Index>(k)) * breakaway / without.bristles.sigma0;
    for (std::size_t i = 0; i < r.time_s.size(); ++i, ++row) {
      const double v = r.velocity_rad_s[i], damped = begins(with, i), elastic = begins(without, i);
      p.known(row) = elastic + (v == 0 ? 0 : std::copysign(workspace.limit_nm, v)) + of_law.offset_nm;
      p.basis(row, 0) = std::abs(damped - elastic) < 1e-100 ? 0 : damped - elastic;  // the square would underflow
      if (i + 1 == r.time_s.size()) continue;
      // The travel between two samples, by the trapezoidal rule.
      const double dt = r.time_s[i + 1] - r.time_s[i], next = r.velocity_rad_s[i + 1];
      drive::end_step(without, {}, {.qd_end_rad_s = next, .q_end_rad = 0.5 * (v + next) * dt}, dt, state, workspace);
    }
  }
  return p;
}

/// Extremes of all recordings, motor side.
struct Extent {
  double fastest = 0;    ///< |speed| [rad/s]
  double travel = 0;     ///< largest travel of a recording [rad]
  double breakaway = 0;  ///< largest, unit of the law
  std::size_t samples = 0;
};

Extent extent_of(const drive::Drive& drive, std::span<const SlidingRecording> recordings) {
  Extent e;
  for (const auto& r : recordings) {
    e.samples += r.time_s.size();
    double position = 0, lowest = 0, highest = 0;
    for (std::size_t i = 0; i < r.time_s.size(); ++i) {
      if (i) position += 0.5 * (r.velocity_rad_s[i] + r.velocity_rad_s[i - 1]) * (r.time_s[i] - r.time_s[i - 1]);
      lowest = std::min(lowest, position), highest = std::max(highest, position);
      e.fastest = std::max(e.fastest, std::abs(r.velocity_rad_s[i]) * drive.speed_scale());
    }
    e.travel = std::max(e.travel, (highest - lowest) * drive.speed_scale());
    e.breakaway = std::max(e.breakaway, drive::level(drive, friction::at_temperature(drive.law, temperature_of(r, 0)),
                                                     0, load_of(r, 0) / drive.torque_max_nm)
                                            .weakening);
  }
  return e;
}

/// Why these recordings cannot identify bristles.
Result<void> require_motion(const Extent& e) {
  if (!(e.fastest > 0))
    return work_failed("the speed is 0 in every sample: bristles are identified from their bending");
  if (!(e.breakaway > 0))
    return work_failed("the static law has no friction at standstill, which is what bristles transmit");
  constexpr std::size_t minimum = 50;
  if (e.samples < minimum)
    return work_failed(
        fmt::format("{} samples are too few for sigma0, sigma1 and vd: record {} or more", e.samples, minimum));
  return {};
}

/// ln sigma0 of bristles that bend up to breakaway within this share of the recorded travel.
double log_sigma0_at(const Extent& e, double share) { return std::log(e.breakaway / (share * e.travel)); }

std::vector<VectorXd> starts_of(const Extent& e, Index size) {
  std::vector<VectorXd> starts;
  for (double bend = 1; bend > 1e-6; bend /= 4)
    for (const double vd : {1e-3, 0.02, 0.3}) {
      VectorXd& at = starts.emplace_back(VectorXd::Zero(size));
      at(log_sigma0) = log_sigma0_at(e, bend), at(log_vd) = std::log(vd * e.fastest);
    }
  return starts;
}

/// Squared error of the law without bristles; samples at rest do not count.
double cost_of_law(const drive::Drive& drive, std::span<const SlidingRecording> recordings) {
  double cost = 0;
  for (const auto& r : recordings)
    for (std::size_t i = 0; i < r.time_s.size(); ++i) {
      const double v = r.velocity_rad_s[i];
      if (v == 0) continue;
      const auto level = drive::level(drive, friction::at_temperature(drive.law, temperature_of(r, i)),
                                      v * drive.speed_scale(), load_of(r, i) / drive.torque_max_nm);
      const double predicted = std::copysign(level.total() * drive.torque_scale_nm(), v) + drive.offset_nm;
      cost += std::pow(r.torque_nm[i] - predicted, 2);
    }
  return cost;
}

std::string bristle_advice(const Estimate& e, Lack) {
  if (e.name == "sigma0") return "record slow reversals, with many samples before sliding begins";
  return "record reversals at faster and at slower speeds, with many samples each";
}

}  // namespace

Result<SlidingRecordings> read_sliding(std::span<const std::filesystem::path> files, const drive::Drive& drive,
                                       const TableOptions& options) {
  SlidingRecordings all;
  const friction::LawInfo& law = *drive.law.info;
  for (const auto& file : files) {
    const auto table = read_time_series(file, {"time_s", "velocity_rad_s", "torque_nm"},
                                        {"temperature_degC", "load_nm"}, all.notes, options);
    if (!table) return tl::unexpected(table.error());
    const auto& c = table->columns;
    if (law.temperature_dependent && c[3].empty())
      return tl::unexpected(fmt::format("{}:1: law '{}' depends on temperature: a column temperature_degC is needed",
                                        file.string(), law.name));
    if (law.load_dependent && c[4].empty())
      return tl::unexpected(
          fmt::format("{}:1: law '{}' depends on load: a column load_nm is needed", file.string(), law.name));
    if (auto problem = implausible_temperature(file, "temperature_degC", c[3]))
      return tl::unexpected(std::move(*problem));
    const double fastest = std::abs(std::ranges::max(c[1], {}, [](double v) { return std::abs(v); }));
    if (fastest * std::min(1.0, drive.speed_scale()) > arm_speed_max)
      return tl::unexpected(
          fmt::format("{}: velocity_rad_s reaches {:.4g} rad/s, but a joint turns at up to {:g}; are these degrees "
                      "per second, or the motor's?",
                      file.string(), fastest, arm_speed_max));
    if (std::inner_product(c[1].begin(), c[1].end(), c[2].begin(), 0.0) < 0)
      return tl::unexpected(fmt::format(
          "{}: torque_nm mostly drives the motion; friction is counted positive when it opposes positive motion",
          file.string()));
    all.recordings.push_back(
        {.time_s = c[0], .velocity_rad_s = c[1], .torque_nm = c[2], .temperature_degC = c[3], .load_nm = c[4]});
  }
  return all;
}

Result<BristleFit> fit_bristles(const drive::Drive& drive, std::span<const SlidingRecording> recordings,
                                unsigned threads) {
  const Extent extent = extent_of(drive, recordings);
  if (const auto ok = require_motion(extent); !ok) return tl::unexpected(ok.error());
  std::vector<double> torque;
  for (const auto& r : recordings) torque.insert(torque.end(), r.torque_nm.begin(), r.torque_nm.end());
  const auto n_starts = static_cast<Index>(recordings.size());
  Simulated model{.measured = Eigen::Map<const VectorXd>(torque.data(), static_cast<Index>(torque.size())),
                  .predict = [&](const VectorXd& at) { return predict(drive, recordings, at); },
                  .low = VectorXd(first_start + n_starts),
                  .high = VectorXd(first_start + n_starts),
                  .linear_free = {true},
                  .linear_low = 0,
                  .threads = threads};
  model.low << log_sigma0_at(extent, 100), std::log(1e-5 * extent.fastest), VectorXd::Constant(n_starts, -1);
  model.high << log_sigma0_at(extent, 1e-8), std::log(100 * extent.fastest), VectorXd::Constant(n_starts, 1);
  const Simulation found = search(model, model, starts_of(extent, model.low.size()));

  const double of_law = cost_of_law(drive, recordings), n = static_cast<double>(torque.size());
  // Three numbers and the starts reduce the cost by as much by chance in one of some ten thousand recordings.
  const double by_chance = 22 + 3 * static_cast<double>(n_starts);
  if (!(of_law - found.cost > by_chance * found.cost / n))
    return work_failed(
        fmt::format("there is no pre-sliding in these data: the static law alone predicts the torque to {:.3g} Nm, "
                    "with bristles it does to {:.3g} Nm; record slow reversals, with many samples each",
                    std::sqrt(of_law / n), std::sqrt(found.cost / n)));

  const Uncertainty sure = uncertainty(model, found);
  BristleFit result;
  const drive::Bristles b = result.bristles = {.sigma0 = std::exp(found.nonlinear(log_sigma0)),
                                               .sigma1 = found.linear(0),
                                               .vd = std::exp(found.nonlinear(log_vd))};
  Eigen::MatrixXd to = Eigen::MatrixXd::Zero(3, sure.covariance.cols());
  const bool normalised = drive.law.info->normalised;
  const auto add = [&](const char* name, const char* unit, double value, Index coordinate, double slope) {
    to(static_cast<Index>(result.parameters.size()), coordinate) = slope;
    result.parameters.push_back(
        {.name = name, .unit = unit, .value = value, .status = sure.status[static_cast<std::size_t>(coordinate)]});
  };
  add("sigma0", normalised ? "1/rad" : "Nm/rad", b.sigma0, 1 + log_sigma0, b.sigma0);
  add("sigma1", normalised ? "s/rad" : "Nm s/rad", b.sigma1, 0, 1);
  add("vd", "rad/s", b.vd, 1 + log_vd, b.vd);
  conclude(model, found, sure, to, {}, bristle_advice, result);
  result.normalised_mse = 1 - result.r_squared;
  return result;
}

}  // namespace tribotwin::twin::identification
