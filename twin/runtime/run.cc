#include <tribotwin/twin/runtime/run.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/file.h>
#include <unistd.h>

#include <tribotwin/twin/output/output.hpp>
#include <tribotwin/twin/telemetry/telemetry.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = tl::expected<void, std::string>;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

const std::vector<Channel> channels = {
    {"position_rad", "rad", "joint angle, arm side, at time_s"},
    {"velocity_rad_s", "rad/s", "joint speed, arm side, at time_s"},
    {"motor_torque_nm", "Nm", "motor torque, motor side, over the step from time_s (arm side: torque_nm)"},
    {"torque_nm", "Nm", "motor torque seen from the arm: motor_torque_nm x gear ratio"},
    {"friction_nm", "Nm", "transmitted friction, arm side, positive when it opposes positive motion, over the step from time_s"},
    {"load_nm", "Nm", "gear torque that friction was evaluated at, arm side, signed"},
    {"temperature_degC", "degC", "lubricant temperature that friction was evaluated at"},
};
const std::vector<Channel> cycle_channels = {
    {"cycle_temperature_degC", "degC", "lubricant temperature at the end of a work cycle"},
    {"cycle_friction_power_W", "W", "mean friction power over a work cycle"},
};

/// Keeps a second run out of a folder while the first writes there. A killed run leaves the file but not the lock.
class FolderLock {
 public:
  FolderLock() = default;
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  ~FolderLock() {
    if (file_ < 0) return;
    ::unlink(path_.c_str());
    ::close(file_);
  }
  Status take(const fs::path& directory) {
    path_ = directory / "run.lock";
    file_ = ::open(path_.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
    if (file_ < 0) return tl::unexpected(fmt::format("{}: cannot be written ({})", path_.string(), std::strerror(errno)));
    if (::flock(file_, LOCK_EX | LOCK_NB) == 0) return {};
    ::close(std::exchange(file_, -1));
    return tl::unexpected(fmt::format("{}: another run is writing into this folder; choose another with -o", directory.string()));
  }

 private:
  fs::path path_;
  int file_ = -1;
};

/// The loop around a Twin: records, paces, and skips work cycles whose outcome is known.
class Runner {
 public:
  Runner(const Scenario& scenario, const RunOptions& options)
      : scenario_(scenario), options_(options), twin_(scenario), timestep_s_(scenario.model->get()->opt.timestep),
        total_(std::llround(std::ceil(scenario.duration_s / timestep_s_ - 1e-6))),
        every_(std::max<std::int64_t>(1, std::llround(1 / (scenario.telemetry_rate_hz * timestep_s_)))),
        drives_(scenario.model->drives().size()) {
    if (scenario.motion && scenario.motion->period_s() > 0) cycle_ = std::llround(scenario.motion->period_s() / timestep_s_);
    row_.resize(drives_ * channels.size());
    cycle_row_.resize(drives_ * cycle_channels.size());
  }

  Status open() {
    if (options_.directory.empty()) return {};
    std::error_code error;
    fs::create_directories(options_.directory, error);
    if (error) return tl::unexpected(fmt::format("{}: cannot be created ({})", options_.directory.string(), error.message()));
    if (auto ok = lock_.take(options_.directory); !ok) return ok;
    // A summary marks a whole run: one left by an earlier run must not stand beside a new, unfinished record.
    fs::remove(options_.directory / "summary.json", error);
    if (auto ok = write_file(options_.directory / "scenario.yaml", scenario_.resolved_yaml); !ok) return ok;
    TelemetryOptions o{.attributes = {{"engine", "MuJoCo"},
                                      {"engine_version", mj_versionString()},
                                      {"scenario", scenario_.name},
                                      {"seed", std::to_string(scenario_.seed)},
                                      {"timestep_s", fmt::format("{}", timestep_s_)}},
                       .channels = channels,
                       .cycle_channels = cycle_ ? cycle_channels : std::vector<Channel>{}};
    for (const auto& drive : scenario_.model->drives()) {
      o.joints.push_back(joint_name(scenario_.model->get(), drive));
      o.joint_attributes.push_back({{"gear_ratio", drive.drive.gear_ratio}, {"torque_max_nm", drive.drive.torque_max_nm}});
    }
    auto telemetry = Telemetry::create(options_.directory / "telemetry.h5", std::move(o));
    if (!telemetry) return tl::unexpected(telemetry.error());
    telemetry_ = std::make_unique<Telemetry>(std::move(*telemetry));
    return {};
  }

  Status run() {
    started_ = Clock::now();
    while (twin_.steps() < total_)
      if (auto ok = cycle_ ? run_cycle() : run_steps(total_); !ok) return ok;
    if (telemetry_) return telemetry_->finish();
    return {};
  }

  Summary summary() {
    Summary s{.simulated_s = twin_.time_s(), .wall_s = seconds_since(started_), .steps = twin_.steps(),
              .steps_computed = twin_.steps_computed(), .seed = scenario_.seed,
              .motor_work_J = twin_.motor_work_J(), .energy_balance_J = twin_.balance_J()};
    const auto drives = twin_.model().drives();
    for (std::size_t i = 0; i < drives_; ++i) {
      const auto& d = twin_.drive(i);
      const auto& f = twin_.figures(i);
      s.friction_work_J += d.friction_work_J;
      s.heat_J += d.heat_J;
      s.joints.push_back({.name = joint_name(twin_.model().get(), drives[i]),
                          .temperature_degC = {scenario_.temperature_degC[i], twin_.temperature_degC(i),
                                               std::max(f.temperature_max_degC, twin_.temperature_degC(i))},
                          .friction_nm = {std::sqrt(f.friction_squared_sum / static_cast<double>(std::max<std::int64_t>(1, twin_.steps_computed()))), f.friction_max_nm},
                          .load_max_norm = f.load_max_norm,
                          .clamped_samples = static_cast<std::int64_t>(d.steps_outside),
                          .stuck_s = d.stuck_s});
      if (d.steps_outside > 0)
        s.warnings.push_back(fmt::format("{}: {:.3g} % of the computed steps lay outside the range in which law '{}' was identified (policy: {})",
                                         s.joints.back().name, 100 * d.steps_outside / static_cast<double>(twin_.steps_computed()), drives[i].drive.law.info->name,
                                         drives[i].drive.law.validity == friction::Validity::extrapolate ? "extrapolate" : "clamp"));
    }
    if (skipped_cycles_ > 0)
      s.warnings.push_back(fmt::format("multi-rate: {} of {} work cycles were computed step by step, the others followed from them (largest correction {:.2g} K)",
                                       cycles_ - skipped_cycles_, cycles_, largest_correction_K_));
    if (scenario_.recording && scenario_.baseline && samples_compared_ > 0)
      s.comparison = Comparison{1e3 * error_sum_rad_ / static_cast<double>(samples_compared_), baseline_mae_mrad()};
    return s;
  }

 private:
  Status run_steps(std::int64_t until) {
    while (twin_.steps() < until) {
      const std::int64_t k = twin_.steps();
      compare();
      if (auto ok = twin_.step(); !ok) return ok;
      if (telemetry_ && k % every_ == 0)
        if (auto ok = record(static_cast<double>(k) * timestep_s_); !ok) return ok;
      if (k % 1024 == 0) report();
      if (options_.realtime) std::this_thread::sleep_until(started_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(twin_.time_s())));
    }
    return {};
  }

  Status record(double time_s) {
    for (std::size_t i = 0; i < drives_; ++i) {
      const auto& d = twin_.drive(i);
      const double gear = twin_.model().drives()[i].drive.gear_ratio;
      const double values[] = {twin_.position_rad(i), twin_.velocity_rad_s(i), d.torque_nm / gear, d.torque_nm, d.friction_nm, d.load_used_nm, d.temperature_degC};
      std::ranges::copy(values, row_.begin() + static_cast<std::ptrdiff_t>(i * channels.size()));
    }
    return telemetry_->append(time_s, row_);
  }

  Status record_cycle(double time_s, const auto& temperature, const auto& power) {
    ++cycles_;
    if (!telemetry_) return {};
    for (std::size_t i = 0; i < drives_; ++i) {
      cycle_row_[2 * i] = temperature(i);
      cycle_row_[2 * i + 1] = power(i);
    }
    return telemetry_->append_cycle(time_s, cycle_row_);
  }

  void report() {
    if (!options_.progress) return;
    const double share = static_cast<double>(twin_.steps()) / static_cast<double>(total_), wall = seconds_since(started_);
    options_.progress(share, share > 0 ? wall / share - wall : 0);
  }

  // Multi-rate. One work cycle, computed in full, is an affine map of each thermal node: rise' = keep rise + input, where
  // `input` depends on the temperature only slowly. Cycles ahead follow from that map in closed form until they would
  // leave the tolerance; the next cycle is computed again, and the cycles between are redone with the input in between
  // (trapezoid). The heat of a skipped cycle is interpolated alike and booked.
  struct CycleMap {
    std::vector<std::array<double, 2>> input;
    std::vector<double> heat_J;
  };

  double keep(std::size_t drive, int node) const {
    return std::exp(-static_cast<double>(cycle_) * timestep_s_ / scenario_.model->drives()[drive].drive.thermal.t_s[node]);
  }

  tl::expected<CycleMap, std::string> compute_cycle() {
    CycleMap map;
    std::vector<thermal::Rise> before(drives_);
    std::vector<double> heat(drives_);
    for (std::size_t i = 0; i < drives_; ++i) {
      before[i] = twin_.memory(i).rise;
      heat[i] = twin_.drive(i).heat_J;
    }
    if (auto ok = run_steps(std::min(total_, twin_.steps() + cycle_)); !ok) return tl::unexpected(ok.error());
    for (std::size_t i = 0; i < drives_; ++i) {
      map.heat_J.push_back(twin_.drive(i).heat_J - heat[i]);
      auto& input = map.input.emplace_back();
      for (int n = 0; n < 2; ++n) input[static_cast<std::size_t>(n)] = twin_.memory(i).rise.node_K[n] - keep(i, n) * before[i].node_K[n];
    }
    return map;
  }

  /// Rise of a drive after each of `count` cycles from `rise`, its inputs going linearly from `from` to `to`.
  thermal::Rise ahead(std::size_t i, thermal::Rise rise, const CycleMap& from, const CycleMap& to, std::int64_t count, std::int64_t span, auto&& each) const {
    if (scenario_.model->drives()[i].drive.thermal.order == thermal::Order::prescribed) return rise;
    const double k[2] = {keep(i, 0), keep(i, 1)};
    for (std::int64_t c = 1; c <= count; ++c) {
      const double w = static_cast<double>(c) / static_cast<double>(span);
      for (std::size_t n = 0; n < 2; ++n)
        rise.node_K[n] = k[n] * rise.node_K[n] + (1 - w) * from.input[i][n] + w * to.input[i][n];
      each(c, rise);
    }
    return rise;
  }

  /// How many cycles may be skipped: none may change a temperature by more than the tolerance, cross the edge of a
  /// law's range, an event, or the end; the last cycle is always computed.
  std::int64_t cycles_to_skip(const CycleMap& map) const {
    const double until_s = std::min(scenario_.duration_s, twin_.next_event_s());
    std::int64_t count = static_cast<std::int64_t>((until_s - twin_.time_s()) / (static_cast<double>(cycle_) * timestep_s_) - 1 + 1e-9);
    count = std::clamp<std::int64_t>(count, 0, 100000);
    for (std::size_t i = 0; i < drives_ && count > 0; ++i) {
      const auto& drive = scenario_.model->drives()[i].drive;
      const double T = twin_.temperature_degC(i), base = drive.thermal.T_amb_degC;
      double low = T - scenario_.multirate.tolerance_K, high = T + scenario_.multirate.tolerance_K;
      if (drive.law.info->temperature_dependent)
        for (const double edge : {drive.law.range.temperature_min_degC, drive.law.range.temperature_max_degC}) {
          if (edge > T) high = std::min(high, edge);
          if (edge < T) low = std::max(low, edge);
        }
      std::int64_t allowed = 0;
      bool inside = true;
      // Temperatures of one map are monotone but for a short start; the walk stops at the first cycle outside.
      ahead(i, twin_.memory(i).rise, map, map, count, 1, [&](std::int64_t c, const thermal::Rise& rise) {
        const double t = base + rise.total_K();
        inside = inside && t >= low && t <= high;
        if (inside) allowed = c;
      });
      if (drive.thermal.order != thermal::Order::prescribed) count = std::min(count, allowed);
    }
    return count;
  }

  Status run_cycle() {
    const auto computed_row = [&](const CycleMap& map) {
      return record_cycle(twin_.time_s(), [&](std::size_t i) { return twin_.temperature_degC(i); },
                          [&](std::size_t i) { return map.heat_J[i] / (static_cast<double>(cycle_) * timestep_s_); });
    };
    auto map = compute_cycle();
    if (!map) return tl::unexpected(map.error());
    if (twin_.steps() % cycle_ != 0) return {};   // the end of the run came first
    if (auto ok = computed_row(*map); !ok) return ok;
    while (scenario_.multirate.enabled) {
      const std::int64_t count = cycles_to_skip(*map);
      if (count < 2) return {};
      std::vector<thermal::Rise> start(drives_), predicted(drives_);
      std::vector<double> heat(drives_);
      for (std::size_t i = 0; i < drives_; ++i) {
        start[i] = twin_.memory(i).rise;
        predicted[i] = ahead(i, start[i], *map, *map, count, 1, [](auto, const auto&) {});
        heat[i] = 0;   // booked below, when the heat at the far end is known
      }
      const double start_s = twin_.time_s(), cycle_s = static_cast<double>(cycle_) * timestep_s_;
      twin_.skip(count * cycle_, predicted, heat);
      auto next = compute_cycle();
      if (!next) return tl::unexpected(next.error());
      std::vector<std::vector<thermal::Rise>> path(drives_);
      std::vector<thermal::Rise> corrected(drives_);
      for (std::size_t i = 0; i < drives_; ++i) {
        path[i].assign(static_cast<std::size_t>(count), start[i]);
        const thermal::Rise end = ahead(i, start[i], *map, *next, count, count + 1,
                                        [&](std::int64_t c, const thermal::Rise& rise) { path[i][static_cast<std::size_t>(c - 1)] = rise; });
        corrected[i] = twin_.memory(i).rise;
        double correction = 0;
        for (int n = 0; n < 2; ++n) {
          const double shift = end.node_K[n] - predicted[i].node_K[n];
          corrected[i].node_K[n] += keep(i, n) * shift;
          correction += shift;
        }
        largest_correction_K_ = std::max(largest_correction_K_, std::abs(correction));
        for (std::int64_t c = 1; c <= count; ++c) heat[i] += skipped_heat(*map, *next, i, c, count);
      }
      twin_.skip(0, corrected, heat);
      for (std::int64_t c = 1; c <= count; ++c)
        if (auto ok = record_cycle(start_s + static_cast<double>(c) * cycle_s,
                                   [&](std::size_t i) { return scenario_.model->drives()[i].drive.thermal.T_amb_degC + path[i][static_cast<std::size_t>(c - 1)].total_K(); },
                                   [&](std::size_t i) { return skipped_heat(*map, *next, i, c, count) / cycle_s; });
            !ok)
          return ok;
      skipped_cycles_ += count;
      if (twin_.steps() % cycle_ != 0) return {};
      if (auto ok = computed_row(*next); !ok) return ok;
      map = std::move(next);
    }
    return {};
  }

  static double skipped_heat(const CycleMap& from, const CycleMap& to, std::size_t i, std::int64_t c, std::int64_t count) {
    const double w = static_cast<double>(c) / static_cast<double>(count + 1);
    return (1 - w) * from.heat_J[i] + w * to.heat_J[i];
  }

  // Comparison with a recording: the measured position at each recorded instant against the twin's at that time.
  void compare() {
    if (!scenario_.recording || !scenario_.baseline) return;
    const SetPoints& r = *scenario_.recording;
    const int address = position_address(twin_.model().get(), twin_.model().drives()[0]);
    while (compared_ < r.time_s.size() && r.time_s[compared_] - r.time_s[0] <= twin_.time_s() + 1e-12) {
      if (std::isfinite(r.measured_rad[compared_])) {
        error_sum_rad_ += std::abs(twin_.data()->qpos[address] - r.measured_rad[compared_]);
        ++samples_compared_;
      }
      ++compared_;
    }
  }

  /// The same recording through the same mechanism with MuJoCo's own frictionloss and damping.
  double baseline_mae_mrad() const {
    const SetPoints& r = *scenario_.recording;
    const mjModel* m = scenario_.baseline->get();
    const mujoco::DataPtr d = scenario_.baseline->make_data();
    d->qpos[0] = r.measured_rad[0];
    double sum = 0;
    std::size_t next = 0, goal = 0, count = 0;
    for (std::int64_t k = 0; k < total_; ++k) {
      const double t = static_cast<double>(k) * timestep_s_;
      while (next < r.time_s.size() && r.time_s[next] - r.time_s[0] <= t + 1e-12) {
        sum += std::abs(d->qpos[0] - r.measured_rad[next++]);
        ++count;
      }
      while (goal + 1 < r.time_s.size() && r.time_s[goal + 1] - r.time_s[0] + scenario_.baseline_delay_s <= t) ++goal;
      const bool on = next == 0 || r.torque_on.empty() || r.torque_on[next - 1];
      d->ctrl[0] = on ? dc_torque_nm(scenario_.baseline_control, r.position_rad[0][goal] - d->qpos[0], d->qvel[0]) : 0;
      mj_step(m, d.get());
    }
    return 1e3 * sum / static_cast<double>(std::max<std::size_t>(1, count));
  }

  const Scenario& scenario_;
  const RunOptions& options_;
  Twin twin_;
  FolderLock lock_;
  std::unique_ptr<Telemetry> telemetry_;
  double timestep_s_;
  std::int64_t total_, every_, cycle_ = 0, cycles_ = 0, skipped_cycles_ = 0;
  std::size_t drives_;
  std::vector<double> row_, cycle_row_;
  double largest_correction_K_ = 0, error_sum_rad_ = 0;
  std::size_t compared_ = 0;
  std::int64_t samples_compared_ = 0;
  Clock::time_point started_ = Clock::now();
};

}  // namespace

tl::expected<Summary, std::string> run(const Scenario& scenario, const RunOptions& options) {
  Runner runner(scenario, options);
  if (auto ok = runner.open(); !ok) return tl::unexpected(ok.error());
  if (auto ok = runner.run(); !ok) return tl::unexpected(ok.error());
  Summary summary = runner.summary();
  if (!options.directory.empty())
    if (auto ok = write_file(options.directory / "summary.json", summary_json(summary)); !ok) return tl::unexpected(ok.error());
  return summary;
}

std::string summary_json(const Summary& s) {
  nlohmann::ordered_json json{{"simulated_s", s.simulated_s},
                              {"wall_s", s.wall_s},
                              {"steps", s.steps},
                              {"steps_computed", s.steps_computed},
                              {"realtime_factor", s.wall_s > 0 ? s.simulated_s / s.wall_s : 0},
                              {"seed", s.seed},
                              {"engine", {{"name", "MuJoCo"}, {"version", mj_versionString()}}},
                              {"friction_work_J", s.friction_work_J},
                              {"heat_J", s.heat_J},
                              {"motor_work_J", s.motor_work_J},
                              {"energy_balance_J", s.energy_balance_J}};
  json["joints"] = nlohmann::ordered_json::array();
  for (const auto& j : s.joints)
    json["joints"].push_back({{"name", j.name},
                              {"temperature_degC", {{"start", j.temperature_degC.start}, {"end", j.temperature_degC.end}, {"max", j.temperature_degC.max}}},
                              {"friction_nm", {{"rms", j.friction_nm.rms}, {"max", j.friction_nm.max}}},
                              {"load_norm", {{"max", j.load_max_norm}}},
                              {"clamped_samples", j.clamped_samples},
                              {"stuck_s", j.stuck_s}});
  json["warnings"] = s.warnings;
  if (s.comparison) json["comparison"] = {{"mae_mrad", s.comparison->mae_mrad}, {"baseline_mae_mrad", s.comparison->baseline_mae_mrad}};
  return json.dump(2) + "\n";
}

}  // namespace tribotwin::twin
