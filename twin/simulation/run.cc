#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <tribotwin/twin/control/loop.hpp>
#include <tribotwin/twin/control/tracking.hpp>
#include <tribotwin/twin/simulation/multirate.hpp>
#include <tribotwin/twin/simulation/recorder.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::twin {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// Compares a twin with the recording that it follows: the measured position of every recorded instant against the
/// twin's at that time. For scenarios with recording and baseline; otherwise it does nothing.
class RecordingComparison {
 public:
  explicit RecordingComparison(const Scenario& scenario) : scenario_(scenario) {}
  /// Called before each step.
  void add(const Twin& twin);
  /// Mean absolute errors of the twin and of the baseline over `steps` steps; nothing without compared samples.
  std::optional<Comparison> result(std::int64_t steps) const;

 private:
  double baseline_mae_mrad(std::int64_t steps) const;

  const Scenario& scenario_;
  std::size_t next_ = 0;
  std::int64_t samples_ = 0;
  double error_sum_rad_ = 0;
};

void RecordingComparison::add(const Twin& twin) {
  if (!scenario_.recording || !scenario_.baseline) return;
  const SetPoints& r = *scenario_.recording;
  const int address = position_address(twin.model().get(), twin.model().drives()[0]);
  for (; next_ < r.time_s.size() && r.time_s[next_] - r.time_s[0] <= twin.time_s() + 1e-12; ++next_) {
    if (!std::isfinite(r.measured_rad[0][next_])) continue;
    error_sum_rad_ += std::abs(twin.data()->qpos[address] - r.measured_rad[0][next_]);
    ++samples_;
  }
}

std::optional<Comparison> RecordingComparison::result(std::int64_t steps) const {
  if (samples_ == 0) return std::nullopt;
  return Comparison{1e3 * error_sum_rad_ / static_cast<double>(samples_), baseline_mae_mrad(steps)};
}

/// The same recording on the same mechanism with MuJoCo's own frictionloss and damping.
double RecordingComparison::baseline_mae_mrad(std::int64_t steps) const {
  const SetPoints& r = *scenario_.recording;
  const mjModel* m = scenario_.baseline->get();
  const double timestep_s = scenario_.model->get()->opt.timestep;
  const mujoco::DataPtr d = scenario_.baseline->make_data();
  d->qpos[0] = r.measured_rad[0][0];
  double sum = 0;
  std::size_t next = 0, goal = 0, count = 0;
  for (std::int64_t k = 0; k < steps; ++k) {
    const double t = static_cast<double>(k) * timestep_s;
    while (next < r.time_s.size() && r.time_s[next] - r.time_s[0] <= t + 1e-12) {
      sum += std::abs(d->qpos[0] - r.measured_rad[0][next++]);
      ++count;
    }
    while (goal + 1 < r.time_s.size() && r.time_s[goal + 1] - r.time_s[0] + scenario_.baseline_delay_s <= t) ++goal;
    const bool on = next == 0 || r.torque_on.empty() || r.torque_on[next - 1];
    d->ctrl[0] = on ? dc_torque_nm(scenario_.baseline_control, r.position_rad[0][goal] - d->qpos[0], d->qvel[0]) : 0;
    mj_step(m, d.get());
  }
  return 1e3 * sum / static_cast<double>(std::max<std::size_t>(1, count));
}

/// The loop around a Twin: records, paces, watches transmissions, and skips work cycles whose outcome is known.
class Runner : RunningTwin {
 public:
  Runner(const Scenario& scenario, const RunOptions& options)
      : options_(options),
        twin_(scenario),
        scenario_(twin_.scenario()),
        comparison_(scenario_),
        timestep_s_(scenario_.model->get()->opt.timestep),
        total_(twin_.steps_total()),
        cycle_(scenario_.motion ? std::llround(scenario_.motion->period_s() / timestep_s_) : 0),
        every_(steps_per_sample(scenario_)),
        drives_(scenario_.model->drives().size()),
        extrapolation_(scenario_, cycle_) {
    const auto springs = scenario_.model->springs().size();
    if (std::holds_alternative<CompensatedOptions>(scenario_.control)) tracking_.resize(springs);
    for (const Wave& wave : scenario_.waves)
      if (const double samples = 1 / (wave.frequency_hz * timestep_s_);
          loops_.empty() && wave.frequency_hz > 0 && samples <= static_cast<double>(total_)) {
        loop_hz_ = wave.frequency_hz;
        loops_.assign(springs, HysteresisLoop(static_cast<std::size_t>(std::llround(samples))));
      }
  }

  Result<void> open() {
    if (options_.directory.empty()) return {};
    auto recorder = Recorder::create(options_.directory, scenario_, cycle_ != 0, options_.existing);
    if (!recorder) return tl::unexpected(recorder.error());
    recorder_ = std::move(*recorder);
    return {};
  }

  Result<void> run() {
    started_ = Clock::now();
    while (twin_.steps() < total_ && !stopped())
      if (auto ok = cycle_ ? run_cycle() : run_steps(total_); !ok) return with_replaced(ok);
    return {};
  }

  Result<void> finish(const Summary& summary) {
    return recorder_ ? with_replaced(recorder_->finish(summary)) : Result<void>{};
  }

  Summary summary() {
    Summary s = summarize(twin_, seconds_since(started_), recorder_ ? predicted_bytes(scenario_) : 0);
    s.interrupted = twin_.steps() < total_;
    if (options_.now) s.finished_at = fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(options_.now()));
    if (s.interrupted && recorder_ && !recorder_->replaced().empty())
      s.warnings.push_back(kept_in(recorder_->replaced()));
    if (skipped_cycles_ > 0)
      s.warnings.push_back(
          fmt::format("multi-rate: {} of {} work cycles were computed step by step, the others followed from them "
                      "(largest correction {:.2g} K)",
                      cycles_ - skipped_cycles_, cycles_, largest_correction_K_));
    if (!s.interrupted) s.comparison = comparison_.result(total_);
    add_transmissions(s);
    return s;
  }

 private:
  const Twin& twin() const override { return twin_; }

  void happen(YAML::Node event) override {
    const std::string type = event["type"].as<std::string>();
    if (scenario_.multirate.enabled && type != "marker")
      throw InputError(type + ": this run skips cycles (multirate); one that knows of the event would skip others");
    twin::happen(twin_, recorder_.get(), event, scenario_.duration_s);
  }

  bool stopped() const { return options_.stop && options_.stop->load(std::memory_order_relaxed); }

  static std::string kept_in(const std::filesystem::path& folder) {
    return fmt::format("the run that this one was to replace is kept in {}", folder.string());
  }
  Result<void> with_replaced(Result<void> result) const {
    if (result || !recorder_ || recorder_->replaced().empty()) return result;
    return tl::unexpected(
        Error(fmt::format("{}; {}", result.error().message, kept_in(recorder_->replaced())), result.error().kind));
  }

  Result<void> run_steps(std::int64_t until) {
    while (twin_.steps() < until && !stopped()) {
      const std::int64_t k = twin_.steps();
      wait_while_held();
      if (stopped()) break;
      comparison_.add(twin_);
      if (auto step = twin_.step(); !step) return tl::unexpected(step.error());
      if (recorder_)
        if (auto ok = recorder_->sample(twin_, k); !ok) return ok;
      if (options_.sample && k % every_ == 0) options_.sample(twin_, static_cast<double>(k) * timestep_s_);
      watch_transmissions();
      if (k % 1024 == 0) report();
      if (options_.realtime) keep_pace();
    }
    return {};
  }

  void wait_while_held() {
    if (!options_.held || !options_.held(*this)) return;
    const auto since = Clock::now();
    do std::this_thread::sleep_for(std::chrono::milliseconds(10));
    while (!stopped() && options_.held(*this));
    started_ += Clock::now() - since;
  }

  /// Waits until the clock is where the twin is: hours, after skipped cycles. Sleeps are short, for `stop`.
  void keep_pace() const {
    const auto due =
        started_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(twin_.time_s()));
    for (auto now = Clock::now(); now < due && !stopped(); now = Clock::now())
      std::this_thread::sleep_until(std::min(due, now + std::chrono::milliseconds(50)));
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

  void add_transmissions(Summary& s) const {
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
  }

  void report() {
    if (!options_.progress) return;
    const double share = static_cast<double>(twin_.steps()) / static_cast<double>(total_),
                 wall = seconds_since(started_);
    options_.progress(share, share > 0 ? wall / share - wall : 0);
  }

  // Work cycles (multirate.hpp).

  double cycle_s() const { return static_cast<double>(cycle_) * timestep_s_; }
  /// False where the run ended within a cycle.
  bool cycle_complete() const { return twin_.steps() % cycle_ == 0; }

  template <class SampleOf>
  Result<void> record_cycle(double time_s, const SampleOf& sample_of) {
    ++cycles_;
    if (!recorder_ && !options_.cycle) return {};
    cycle_samples_.clear();
    for (std::size_t i = 0; i < drives_; ++i) cycle_samples_.push_back(sample_of(i));
    if (options_.cycle) options_.cycle(time_s, cycle_samples_);
    return recorder_ ? recorder_->append_cycle(time_s, cycle_samples_) : Result<void>{};
  }

  Result<void> record_computed(const CycleMap& map) {
    return record_cycle(twin_.time_s(), [&](std::size_t i) {
      return CycleSample{twin_.temperature_degC(i), map.heat_J[i] / cycle_s()};
    });
  }

  Result<CycleMap> compute_cycle() {
    const CycleStart before(twin_);
    if (auto ok = run_steps(std::min(total_, twin_.steps() + cycle_)); !ok) return tl::unexpected(ok.error());
    return extrapolation_.map(twin_, before);
  }

  /// Cycles that were skipped, and the rises of the drives in them.
  struct Skipped {
    std::int64_t count;
    double start_s;
    std::vector<thermal::Rise> start, predicted;   ///< per drive, before and after
    std::vector<std::vector<thermal::Rise>> path;  ///< per drive, corrected, after each cycle
  };

  Skipped skip(const CycleMap& map, std::int64_t count) {
    Skipped skipped{.count = count, .start_s = twin_.time_s(), .start = {}, .predicted = {}, .path = {}};
    for (std::size_t i = 0; i < drives_; ++i) {
      skipped.start.push_back(twin_.state(i).rise);
      skipped.predicted.push_back(extrapolation_.ahead(i, skipped.start[i], map, map, count, 1, {}));
    }
    twin_.skip(count * cycle_, skipped.predicted);
    return skipped;
  }

  /// Corrects the rises, now that the cycle after the skipped ones is computed, and books what adds up.
  void correct(Skipped& skipped, const CycleMap& map, const CycleMap& next) {
    const std::int64_t count = skipped.count;
    std::vector<thermal::Rise> corrected(drives_);
    const auto in_all = [&](double from, double to) { return 0.5 * static_cast<double>(count) * (from + to); };
    std::vector<double> heat_J(drives_), sums = next.sums;
    for (std::size_t i = 0; i < drives_; ++i) {
      auto& path = skipped.path.emplace_back(static_cast<std::size_t>(count), skipped.start[i]);
      const thermal::Rise end = extrapolation_.ahead(
          i, skipped.start[i], map, next, count, count + 1,
          [&](std::int64_t c, const thermal::Rise& rise) { path[static_cast<std::size_t>(c - 1)] = rise; });
      corrected[i] = twin_.state(i).rise;
      double correction = 0;
      for (std::size_t n = 0; n < 2; ++n) {
        const double shift = end.node_K[n] - skipped.predicted[i].node_K[n];
        corrected[i].node_K[n] += extrapolation_.keep(i, n) * shift;
        correction += shift;
      }
      largest_correction_K_ = std::max(largest_correction_K_, std::abs(correction));
      heat_J[i] = in_all(map.heat_J[i], next.heat_J[i]);
    }
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = in_all(i < map.sums.size() ? map.sums[i] : 0, sums[i]);
    twin_.skip(0, corrected);
    twin_.add(heat_J, sums);
    skipped_cycles_ += count;
  }

  Result<void> record_skipped(const Skipped& skipped, const CycleMap& map, const CycleMap& next) {
    for (std::int64_t c = 1; c <= skipped.count; ++c) {
      const auto sample = [&](std::size_t i) {
        return CycleSample{scenario_.model->drives()[i].drive.thermal.T_amb_degC +
                               skipped.path[i][static_cast<std::size_t>(c - 1)].total_K(),
                           between(map.heat_J[i], next.heat_J[i], c, skipped.count) / cycle_s()};
      };
      if (auto ok = record_cycle(skipped.start_s + static_cast<double>(c) * cycle_s(), sample); !ok) return ok;
    }
    return {};
  }

  /// Of skipped cycle `c` of `count`.
  static double between(double from, double to, std::int64_t c, std::int64_t count) {
    const double w = static_cast<double>(c) / static_cast<double>(count + 1);
    return (1 - w) * from + w * to;
  }

  /// One computed cycle, and with multi-rate those that follow from it.
  Result<void> run_cycle() {
    auto map = compute_cycle();
    if (!map) return tl::unexpected(map.error());
    if (!cycle_complete()) return {};
    if (auto ok = record_computed(*map); !ok) return ok;
    while (scenario_.multirate.enabled) {
      const std::int64_t count = extrapolation_.cycles_to_skip(twin_, *map);
      if (count < 2) return {};
      Skipped skipped = skip(*map, count);
      auto next = compute_cycle();
      if (!next) return tl::unexpected(next.error());
      if (!cycle_complete()) next = *map;  // cut short: no better end for the cycles that were skipped
      correct(skipped, *map, *next);
      if (auto ok = record_skipped(skipped, *map, *next); !ok) return ok;
      if (!cycle_complete()) return {};
      if (auto ok = record_computed(*next); !ok) return ok;
      map = std::move(next);
    }
    return {};
  }

  const RunOptions& options_;
  Twin twin_;
  const Scenario& scenario_;
  RecordingComparison comparison_;
  std::unique_ptr<Recorder> recorder_;
  double timestep_s_;
  std::int64_t total_, cycle_, every_, cycles_ = 0, skipped_cycles_ = 0;
  std::size_t drives_;
  CycleExtrapolation extrapolation_;
  std::vector<CycleSample> cycle_samples_;
  double largest_correction_K_ = 0;
  std::vector<TrackingError> tracking_;  // per transmission, of a compensated servo
  std::vector<HysteresisLoop> loops_;    // per transmission, under a periodic actuator
  double loop_hz_ = 0;
  Clock::time_point started_ = Clock::now();
};

}  // namespace

Result<Summary> run(const Scenario& scenario, const RunOptions& options) {
  Runner runner(scenario, options);
  if (auto ok = runner.open(); !ok) return tl::unexpected(ok.error());
  if (auto ok = runner.run(); !ok) return tl::unexpected(ok.error());
  const Summary summary = runner.summary();
  if (options.complete && !summary.interrupted)
    if (auto ok = options.complete(summary); !ok) return tl::unexpected(ok.error());
  if (auto ok = runner.finish(summary); !ok) return tl::unexpected(ok.error());
  return summary;
}

}  // namespace tribotwin::twin
