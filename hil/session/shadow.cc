#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/can/record_file.hpp>
#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/session/expectation.hpp>
#include <tribotwin/hil/session/listener.hpp>
#include <tribotwin/hil/session/shadow.hpp>

namespace tribotwin::hil {
namespace {

/// By how many samples `b` follows `a`: the maximum of their cross-correlation within +-limit.
int lag(const std::vector<double>& a, const std::vector<double>& b, int limit) {
  const auto n = static_cast<int>(std::min(a.size(), b.size()));
  if (n < 4 * limit) return 0;
  double mean_a = 0, mean_b = 0;
  for (int i = 0; i < n; ++i)
    mean_a += a[static_cast<std::size_t>(i)] / n, mean_b += b[static_cast<std::size_t>(i)] / n;
  int best = 0;
  double maximum = -1;
  for (int shift = -limit; shift <= limit; ++shift) {
    double sum = 0;
    for (int i = limit; i < n - limit; ++i)
      sum += (a[static_cast<std::size_t>(i)] - mean_a) * (b[static_cast<std::size_t>(i + shift)] - mean_b);
    if (sum > maximum * (1 + 1e-12)) maximum = sum, best = shift;
  }
  return best;
}

}  // namespace

bool ShadowResult::exceeded() const { return std::ranges::any_of(joints, &ShadowJoint::exceeded); }

std::string ShadowResult::table() const {
  std::string s = fmt::format("{:.2f} s\n{:<12} {:>8} {:>14} {:>14} {:>14} {:>9} {:>12}\n", seconds, "joint", "samples",
                              "mean [Nm]", "RMS [Nm]", "largest [Nm]", "lag [ms]", "lubricant");
  for (const auto& j : joints) {
    if (j.samples == 0)
      s += fmt::format("{:<12} {:>8} {:>14} {:>14} {:>14} {:>9} {:>7.2f} degC\n", j.name, 0, "-", "-", "-", "-",
                       j.temperature_degC);
    else
      s += fmt::format("{:<12} {:>8} {:>14.4g} {:>14.4g} {:>14.4g} {:>9.1f} {:>7.2f} degC{}\n", j.name, j.samples,
                       j.residual_mean_nm, j.residual_rms_nm, j.residual_max_nm, 1e3 * j.lag_s, j.temperature_degC,
                       j.exceeded ? "  limit exceeded" : "");
  }
  return s;
}

namespace {

/// Compares what the listeners of all drives hear with the expectation, cycle by cycle.
class Shadow {
 public:
  Shadow(const twin::Scenario& scenario, const ShadowOptions& o)
      : o_(o), cycle_s_(1e-6 * o.cycle_us), expectation_(scenario, cycle_s_) {
    for (const auto& p : drive_parameters(scenario, o.first_node, o.cycle_us)) {
      listeners_.push_back(make_listener(o.profile, p));
      result_.joints.push_back({.name = p.name});
    }
    series_.resize(listeners_.size());
  }

  Result<ShadowResult> run(const NextFrame& next) {
    if (auto ok = check_joints(); !ok) return tl::unexpected(ok.error());
    if (auto ok = open_csv(); !ok) return work_failed(ok.error().message);
    Frame frame;
    Result<bool> more = true;
    while (!stopped()) {
      more = next(frame);
      if (!more || !*more || over(frame)) break;
      if (!frame.error && ends_cycle(frame)) take_cycle();
    }
    result_.interrupted = stopped() && !o_.endless;
    close_csv();
    if (!more) return work_failed(more.error().message);
    if (!result_.interrupted)
      if (auto ok = require_predictions(); !ok) return tl::unexpected(ok.error());
    check_limit();
    return finished();
  }

 private:
  struct Series {
    std::vector<double> measured, predicted;
    double beyond_s = 0;
    double unheard_s = 0;  // since the last torque
  };
  static constexpr double stale_s = 0.5;  // a TPDO may come with every 240th SYNC only

  bool stopped() const { return o_.stop && o_.stop(); }
  bool over(const Frame& frame) {
    if (frame.error) return false;
    if (first_ns_ < 0) first_ns_ = frame.time_ns;
    return o_.duration_s && 1e-9 * static_cast<double>(frame.time_ns - first_ns_) >= *o_.duration_s;
  }
  /// "joint1, joint2": the joints for which `which` is true.
  std::string names(const std::function<bool(std::size_t)>& which) const {
    std::vector<std::string> chosen;
    for (std::size_t i = 0; i < result_.joints.size(); ++i)
      if (which(i)) chosen.push_back(result_.joints[i].name);
    return fmt::format("{}", fmt::join(chosen, ", "));
  }

  /// A cycle ends with the SYNC; without a SYNC, with the position of the first drive.
  bool ends_cycle(const Frame& frame) {
    const bool sync = frame.id == cob::sync && !frame.extended && frame.size <= 1;
    synced_ |= sync;
    bool heard_first = false;
    for (std::size_t i = 0; i < listeners_.size(); ++i) heard_first |= listeners_[i]->hear(frame) && i == 0;
    return synced_ ? sync : heard_first;
  }

  /// Positions of a cycle are those at its beginning.
  void take_cycle() {
    if (std::ranges::any_of(listeners_, [](const auto& l) { return !l->position_rad; })) return;
    ++positions_;
    std::vector<double> position, torque;
    for (std::size_t i = 0; i < listeners_.size(); ++i)
      position.push_back(*listeners_[i]->position_rad), torque.push_back(measured_nm(i));
    torques_.push_back(std::move(torque));
    if (!expectation_.add(position)) return;
    while (torques_.size() > Expectation::half + 1) torques_.pop_front();
    result_.seconds += cycle_s_;
    row_ = fmt::format("{:.6f}", result_.seconds);
    for (std::size_t i = 0; i < listeners_.size(); ++i) judge(i, torques_.front()[i]);
    write_row();
  }

  /// NaN while no torque is heard: the last one of a drive that fell silent must not be compared.
  double measured_nm(std::size_t i) {
    Listener& l = *listeners_[i];
    Series& s = series_[i];
    if (!l.torque_nm) return std::nan("");
    const double before_s = s.unheard_s;
    s.unheard_s = std::exchange(l.torque_heard, false) ? 0 : s.unheard_s + cycle_s_;
    if (s.unheard_s <= stale_s) return *l.torque_nm;
    if (before_s <= stale_s)
      note(fmt::format("{}: no torque for {} s, at {:.3f} s; not compared until it is back", result_.joints[i].name,
                       stale_s, result_.seconds));
    return std::nan("");
  }

  void judge(std::size_t i, double seen) {
    ShadowJoint& j = result_.joints[i];
    j.temperature_degC = expectation_.temperature_degC(i);
    const double low = expectation_.low_nm(i), high = expectation_.high_nm(i);
    const double expected = std::isnan(seen) ? (low + high) / 2 : std::clamp(seen, low, high),
                 residual = seen - expected;
    row_ += fmt::format(",{:.6g},{:.6g},{:.6g},{:.3f}", seen, expected, residual, j.temperature_degC);
    if (std::isnan(seen)) return;
    Series& s = series_[i];
    s.measured.push_back(seen);
    s.predicted.push_back(expected);
    ++j.samples;
    j.residual_mean_nm += (residual - j.residual_mean_nm) / static_cast<double>(j.samples);
    j.residual_rms_nm +=
        (residual * residual - j.residual_rms_nm) / static_cast<double>(j.samples);  // its square, until the end
    j.residual_max_nm = std::max(j.residual_max_nm, std::abs(residual));
    if (!limited(i)) return;
    s.beyond_s = std::abs(residual) > *o_.limit_nm ? s.beyond_s + cycle_s_ : 0;
    if (s.beyond_s > o_.limit_time_s && !std::exchange(j.exceeded, true))
      note(fmt::format("{}: residual {:.4g} Nm beyond {:.4g} Nm for {:.3g} s, at {:.3f} s", j.name, residual,
                       *o_.limit_nm, o_.limit_time_s, result_.seconds));
  }
  bool limited(std::size_t i) const {
    return o_.limit_nm && (o_.limit_joints.empty() ||
                           std::ranges::find(o_.limit_joints, result_.joints[i].name) != o_.limit_joints.end());
  }
  void note(const std::string& what) const {
    if (o_.note) o_.note(what);
  }

  Result<void> check_joints() const {
    for (const auto& name : o_.limit_joints)
      if (std::ranges::find(result_.joints, name, &ShadowJoint::name) == result_.joints.end())
        return tl::unexpected(
            fmt::format("no joint '{}' for --joint; there are {}", name, names([](std::size_t) { return true; })));
    return {};
  }

  Result<void> open_csv() {
    if (o_.csv.empty()) return {};
    auto csv = RecordFile::create(o_.csv, {.replace = o_.existing == twin::Existing::replace, .give_up = o_.stop});
    if (!csv) return tl::unexpected(csv.error());
    csv_.emplace(std::move(*csv));
    return {};
  }
  void write_row() {
    if (!csv_) return;
    std::string head;
    if (!std::exchange(headed_, true)) {
      head = "time_s";
      for (const auto& j : result_.joints)
        head += fmt::format(",{0}.measured_nm,{0}.predicted_nm,{0}.residual_nm,{0}.temperature_degC", j.name);
      head += '\n';
    }
    keep_csv(csv_->append(head + row_ + '\n'));
    if (csv_) keep_csv(csv_->flush());  // a bus may fall silent for long
  }
  void close_csv() {
    if (!csv_) return;
    if (headed_) keep_csv(csv_->finish());
    csv_.reset();  // without a row: no file
  }
  /// A full disk must not end the monitoring of a robot.
  void keep_csv(const Result<void>& written) {
    if (written) return;
    result_.csv_failure = fmt::format("{}; written up to {:.3f} s", written.error().message, result_.seconds);
    csv_.reset();
    note(result_.csv_failure + "; the shadow goes on");
  }

  Result<void> require_predictions() const {
    if (positions_ == 0) {
      const auto silent = names([&](std::size_t i) { return !listeners_[i]->position_rad; });
      return tl::unexpected(
          silent.empty()
              ? "no cycle was heard: there was one position of every drive, and nothing after it"
              : fmt::format("no position was heard of {}: is --first-node right, and is a PDO with 6064h on the bus?",
                            silent));
    }
    if (result_.seconds == 0)
      return tl::unexpected(fmt::format("positions of {} cycles were heard; a prediction takes {}: listen for longer",
                                        positions_, static_cast<int>(Expectation::window)));
    return {};
  }

  /// A limit that was not checked must not pass for one that was kept.
  void check_limit() {
    const auto no_torque =
        names([&](std::size_t i) { return result_.joints[i].samples == 0 && (!o_.limit_nm || limited(i)); });
    const auto too_short = names([&](std::size_t i) {
      return limited(i) && result_.joints[i].samples > 0 &&
             static_cast<double>(result_.joints[i].samples) * cycle_s_ <= o_.limit_time_s;
    });
    if (!no_torque.empty()) {
      const std::string why = fmt::format(
          "no torque was heard of {}: map 6077h into a TPDO that is sent with the SYNC (1A03h, 1803h)", no_torque);
      if (o_.limit_nm)
        result_.unchecked.push_back(fmt::format("{}, or name the joints to check with --joint", why));
      else
        note(fmt::format("{}; nothing was compared there", why));
    }
    if (!too_short.empty())
      result_.unchecked.push_back(
          fmt::format("torques of {} were heard for less than the {} s of --limit-time: listen for longer", too_short,
                      o_.limit_time_s));
  }

  ShadowResult finished() {
    for (std::size_t i = 0; i < series_.size(); ++i) {
      ShadowJoint& j = result_.joints[i];
      j.residual_rms_nm = std::sqrt(j.residual_rms_nm);
      j.lag_s = cycle_s_ * lag(series_[i].predicted, series_[i].measured, 50);
    }
    return std::move(result_);
  }

  const ShadowOptions& o_;
  double cycle_s_;
  Expectation expectation_;
  std::vector<std::unique_ptr<Listener>> listeners_;
  std::vector<Series> series_;
  std::deque<std::vector<double>> torques_;  // measured, waiting for their prediction
  std::uint64_t positions_ = 0;              // cycles with positions of all drives
  bool synced_ = false, headed_ = false;
  std::int64_t first_ns_ = -1;
  std::optional<RecordFile> csv_;
  std::string row_;
  ShadowResult result_;
};

}  // namespace

Result<ShadowResult> shadow(const twin::Scenario& scenario, const NextFrame& next, const ShadowOptions& options) {
  return Shadow(scenario, options).run(next);
}

}  // namespace tribotwin::hil
