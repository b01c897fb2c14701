#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include <fmt/format.h>

#include <tribotwin/twin/simulation/loop.hpp>
#include <tribotwin/twin/simulation/recorder.hpp>
#include <tribotwin/twin/simulation/run.hpp>
#include <tribotwin/twin/simulation/tracking.hpp>

namespace tribotwin::twin {
namespace {

using Status = Result<void>;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// The loop around a Twin: records, paces, and skips work cycles whose outcome is known.
class Runner {
 public:
  Runner(const Scenario& scenario, const RunOptions& options)
      : scenario_(scenario),
        options_(options),
        twin_(scenario),
        timestep_s_(scenario.model->get()->opt.timestep),
        total_(std::llround(std::ceil(scenario.duration_s / timestep_s_ - 1e-6))),
        drives_(scenario.model->drives().size()) {
    if (scenario.motion && scenario.motion->period_s() > 0)
      cycle_ = std::llround(scenario.motion->period_s() / timestep_s_);
    cycle_row_.resize(2 * drives_);
    const auto springs = scenario.model->springs().size();
    if (std::holds_alternative<CompensatedOptions>(scenario.control)) tracking_.resize(springs);
    for (const Wave& wave : scenario.waves)
      if (const double samples = 1 / (wave.frequency_hz * timestep_s_);
          loops_.empty() && wave.frequency_hz > 0 && samples <= static_cast<double>(total_)) {
        loop_hz_ = wave.frequency_hz;
        loops_.assign(springs, HysteresisLoop(static_cast<std::size_t>(std::llround(samples))));
      }
  }

  Status open() {
    if (options_.directory.empty()) return {};
    auto recorder = Recorder::create(options_.directory, scenario_, cycle_ != 0, options_.existing);
    if (!recorder) return tl::unexpected(recorder.error());
    recorder_ = std::move(*recorder);
    return {};
  }

  Status run() {
    started_ = Clock::now();
    while (twin_.steps() < total_ && !stopped())
      if (auto ok = cycle_ ? run_cycle() : run_steps(total_); !ok) return with_replaced(ok);
    return {};
  }

  Status finish(const Summary& summary) { return recorder_ ? with_replaced(recorder_->finish(summary)) : Status{}; }

  Summary summary() {
    Summary s = summarize(twin_, scenario_, seconds_since(started_));
    s.interrupted = twin_.steps() < total_;
    if (s.interrupted && recorder_ && !recorder_->replaced().empty())
      s.warnings.push_back(kept_in(recorder_->replaced()));
    if (skipped_cycles_ > 0)
      s.warnings.push_back(
          fmt::format("multi-rate: {} of {} work cycles were computed step by step, the others followed from them "
                      "(largest correction {:.2g} K)",
                      cycles_ - skipped_cycles_, cycles_, largest_correction_K_));
    if (scenario_.recording && scenario_.baseline && samples_compared_ > 0 && !s.interrupted)
      s.comparison = Comparison{1e3 * error_sum_rad_ / static_cast<double>(samples_compared_), baseline_mae_mrad()};
    const auto start_degC = [&](std::size_t spring) {
      return scenario_.temperature_degC[twin_.transmission(scenario_.model->springs()[spring]).drive];
    };
    for (std::size_t i = 0; i < tracking_.size(); ++i)
      s.tracking.push_back(
          {start_degC(i),
           std::string(name_of(std::get<CompensatedOptions>(scenario_.control).compensator.compensation)),
           tracking_[i].l1_mrad(), tracking_[i].standstill_pp_mrad()});
    for (std::size_t i = 0; i < loops_.size(); ++i)
      s.loops.push_back(
          {loop_hz_, start_degC(i), loops_[i].area_J(), loops_[i].torque_max_nm(), loops_[i].chord_nm_rad()});
    return s;
  }

 private:
  bool stopped() const { return options_.stop && options_.stop->load(std::memory_order_relaxed); }

  static std::string kept_in(const std::filesystem::path& folder) {
    return fmt::format("the run that this one was to replace is kept in {}", folder.string());
  }
  Status with_replaced(Status status) const {
    if (status || !recorder_ || recorder_->replaced().empty()) return status;
    return tl::unexpected(fmt::format("{}; {}", status.error().message, kept_in(recorder_->replaced())));
  }

  Status run_steps(std::int64_t until) {
    while (twin_.steps() < until && !stopped()) {
      const std::int64_t k = twin_.steps();
      compare();
      if (auto ok = twin_.step(); !ok) return ok;
      if (recorder_)
        if (auto ok = recorder_->sample(twin_, k); !ok) return ok;
      watch_transmissions();
      if (k % 1024 == 0) report();
      if (options_.realtime)
        std::this_thread::sleep_until(
            started_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(twin_.time_s())));
    }
    return {};
  }

  void watch_transmissions() {
    if (tracking_.empty() && loops_.empty()) return;
    const auto springs = scenario_.model->springs();
    for (std::size_t i = 0; i < springs.size(); ++i) {
      const auto t = twin_.transmission(springs[i]);
      if (i < tracking_.size())
        tracking_[i].add(t.arm_set_point_rad, t.arm_rad, t.arm_set_speed_rad_s == 0, timestep_s_);
      if (i < loops_.size()) loops_[i].add(t.torsion_rad, t.torque_nm);
    }
  }

  Status record_cycle(double time_s, const auto& temperature, const auto& power) {
    ++cycles_;
    if (!recorder_) return {};
    for (std::size_t i = 0; i < drives_; ++i) {
      cycle_row_[2 * i] = temperature(i);
      cycle_row_[2 * i + 1] = power(i);
    }
    return recorder_->append_cycle(time_s, cycle_row_);
  }

  void report() {
    if (!options_.progress) return;
    const double share = static_cast<double>(twin_.steps()) / static_cast<double>(total_),
                 wall = seconds_since(started_);
    options_.progress(share, share > 0 ? wall / share - wall : 0);
  }

  // Multi-rate. One work cycle, computed in full, is an affine map of each thermal node: rise' = keep rise + input,
  // where `input` depends on the temperature only slowly. Cycles ahead follow from that map in closed form until they
  // would leave the tolerance; the next cycle is computed again, and the cycles between are redone with the input in
  // between (trapezoid). The heat of a skipped cycle is interpolated alike and booked.
  struct CycleMap {
    std::vector<std::array<double, 2>> input;
    std::vector<double> heat_J;
  };

  double keep(std::size_t drive, int node) const {
    return std::exp(-static_cast<double>(cycle_) * timestep_s_ /
                    scenario_.model->drives()[drive].drive.thermal.t_s[node]);
  }

  Result<CycleMap> compute_cycle() {
    CycleMap map;
    std::vector<thermal::Rise> before(drives_);
    std::vector<double> heat(drives_);
    for (std::size_t i = 0; i < drives_; ++i) {
      before[i] = twin_.state(i).rise;
      heat[i] = twin_.drive(i).heat_J;
    }
    if (auto ok = run_steps(std::min(total_, twin_.steps() + cycle_)); !ok) return tl::unexpected(ok.error());
    for (std::size_t i = 0; i < drives_; ++i) {
      map.heat_J.push_back(twin_.drive(i).heat_J - heat[i]);
      auto& input = map.input.emplace_back();
      for (int n = 0; n < 2; ++n)
        input[static_cast<std::size_t>(n)] = twin_.state(i).rise.node_K[n] - keep(i, n) * before[i].node_K[n];
    }
    return map;
  }

  /// Rise of a drive after each of `count` cycles from `rise`, its inputs going linearly from `from` to `to`.
  thermal::Rise ahead(std::size_t i, thermal::Rise rise, const CycleMap& from, const CycleMap& to, std::int64_t count,
                      std::int64_t span, auto&& each) const {
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
  /// law's range, an event, or the end, nor may a fault grow much; the last cycle is always computed.
  std::int64_t cycles_to_skip(const CycleMap& map) const {
    const double until_s =
        std::min({scenario_.duration_s, twin_.next_event_s(), twin_.time_s() + twin_.growth_horizon_s()});
    std::int64_t count =
        static_cast<std::int64_t>((until_s - twin_.time_s()) / (static_cast<double>(cycle_) * timestep_s_) - 1 + 1e-9);
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
      ahead(i, twin_.state(i).rise, map, map, count, 1, [&](std::int64_t c, const thermal::Rise& rise) {
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
      return record_cycle(
          twin_.time_s(), [&](std::size_t i) { return twin_.temperature_degC(i); },
          [&](std::size_t i) { return map.heat_J[i] / (static_cast<double>(cycle_) * timestep_s_); });
    };
    auto map = compute_cycle();
    if (!map) return tl::unexpected(map.error());
    if (twin_.steps() % cycle_ != 0) return {};  // the end of the run came first
    if (auto ok = computed_row(*map); !ok) return ok;
    while (scenario_.multirate.enabled) {
      const std::int64_t count = cycles_to_skip(*map);
      if (count < 2) return {};
      std::vector<thermal::Rise> start(drives_), predicted(drives_);
      std::vector<double> heat(drives_);
      for (std::size_t i = 0; i < drives_; ++i) {
        start[i] = twin_.state(i).rise;
        predicted[i] = ahead(i, start[i], *map, *map, count, 1, [](auto, const auto&) {});
        heat[i] = 0;  // booked below, when the heat at the far end is known
      }
      const double start_s = twin_.time_s(), cycle_s = static_cast<double>(cycle_) * timestep_s_;
      twin_.skip(count * cycle_, predicted, heat);
      auto next = compute_cycle();
      if (!next) return tl::unexpected(next.error());
      if (twin_.steps() % cycle_ != 0) next = *map;  // cut short: no better end for the cycles that were skipped
      std::vector<std::vector<thermal::Rise>> path(drives_);
      std::vector<thermal::Rise> corrected(drives_);
      for (std::size_t i = 0; i < drives_; ++i) {
        path[i].assign(static_cast<std::size_t>(count), start[i]);
        const thermal::Rise end =
            ahead(i, start[i], *map, *next, count, count + 1,
                  [&](std::int64_t c, const thermal::Rise& rise) { path[i][static_cast<std::size_t>(c - 1)] = rise; });
        corrected[i] = twin_.state(i).rise;
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
        if (auto ok = record_cycle(
                start_s + static_cast<double>(c) * cycle_s,
                [&](std::size_t i) {
                  return scenario_.model->drives()[i].drive.thermal.T_amb_degC +
                         path[i][static_cast<std::size_t>(c - 1)].total_K();
                },
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

  static double skipped_heat(const CycleMap& from, const CycleMap& to, std::size_t i, std::int64_t c,
                             std::int64_t count) {
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
  std::unique_ptr<Recorder> recorder_;
  double timestep_s_;
  std::int64_t total_, cycle_ = 0, cycles_ = 0, skipped_cycles_ = 0;
  std::size_t drives_;
  std::vector<double> cycle_row_;
  double largest_correction_K_ = 0, error_sum_rad_ = 0;
  std::size_t compared_ = 0;
  std::int64_t samples_compared_ = 0;
  std::vector<TrackingError> tracking_;  // per transmission, of a compensated servo
  std::vector<HysteresisLoop> loops_;    // per transmission, under an actuator that goes to and fro
  double loop_hz_ = 0;
  Clock::time_point started_ = Clock::now();
};

}  // namespace

Result<Summary> run(const Scenario& scenario, const RunOptions& options) {
  Runner runner(scenario, options);
  if (auto ok = runner.open(); !ok) return tl::unexpected(ok.error());
  if (auto ok = runner.run(); !ok) return tl::unexpected(ok.error());
  const Summary summary = runner.summary();
  if (auto ok = runner.finish(summary); !ok) return tl::unexpected(ok.error());
  return summary;
}

}  // namespace tribotwin::twin
