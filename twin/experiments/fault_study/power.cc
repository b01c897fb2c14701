#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/experiments/fault_study/power.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin::study {
namespace {

using diagnosis::HealthyState, diagnosis::Observation, diagnosis::Verdict;
using Json = nlohmann::json;

constexpr double wanted_power = 0.95;
constexpr double false_alarms[] = {0.01, diagnosis::two_sigma_false_alarm, 0.1, 0.2};
constexpr double roc_severities[] = {0, 0.25, 0.5, 0.75, 1, 1.5, 2};  ///< of the detection limit

/// Curves of one joint, drawn from its law.
class Joint {
 public:
  Joint(const Campaign& campaign, const LevelStatistics& levels, const HealthyState& healthy)
      : campaign_(campaign),
        drive_(campaign.model->drives()[campaign.drive].drive),
        levels_(levels),
        healthy_(healthy),
        travel_rad_(test_cycle_travel_rad()) {}

  /// `number`: of the draw; the same random numbers at every severity.
  Result<Observation> draw(const drive::FaultInfo& fault, double severity, std::uint32_t number) const {
    std::seed_seq seed{static_cast<std::uint32_t>(campaign_.seed), number, 4u};
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const double temperature =
        std::uniform_real_distribution(healthy_.temperature_low_degC, healthy_.temperature_high_degC)(random);
    drive::Faults faults{};
    fault.add(faults, severity);
    const friction::Law law = drive::with_faults(drive_.law, faults);
    const auto at = friction::at_temperature(law, temperature);
    identification::Samples curve;
    double ripple = 0, load_sum = 0;
    for (std::size_t i = 0; i < levels_.speed_rad_s.size(); ++i) {
      const double v = levels_.speed_rad_s[i], load = levels_.load_norm[i], seen = 1 / (1 - faults.torque_loss);
      friction::Level level = friction::level(law, at, v / drive_.gear_ratio * drive_.speed_scale(), load);
      // A travel shorter than three periods of the ripple measures the mean of the ripple over it, which levels_of
      // corrects by the ripple of longer travels; those measure the amplitude.
      const double half_travel = 0.5 * travel_rad_[i] * drive_.gear_ratio,
                   start = campaign_.curves.front().measurement.start_rad[campaign_.drive];
      const double g_nm = level.weakening * drive_.torque_scale_nm();
      level.weakening *= 1 + faults.ripple * std::cos(drive_.gear_ratio * start) * std::sin(half_travel) / half_travel;
      const double sensor_nm = std::sqrt(std::max(
          0.0, levels_.stderr_nm[i] * levels_.stderr_nm[i] - campaign_.level_noise_nm * campaign_.level_noise_nm));
      const double amplitude =
          std::hypot(faults.ripple * g_nm * seen + std::numbers::sqrt2 * sensor_nm * normal(random),
                     std::numbers::sqrt2 * sensor_nm * normal(random));
      if (half_travel > 3 * std::numbers::pi && v < slow_enough && amplitude > standing_out * sensor_nm)
        ripple = std::max(ripple, amplitude);
      curve.speed.push_back(v);
      curve.load.push_back(load * seen);
      curve.temperature_degC.push_back(temperature);
      curve.friction.push_back(level.total() * drive_.torque_scale_nm() * seen + levels_.stderr_nm[i] * normal(random));
      curve.standard_error.push_back(levels_.stderr_nm[i]);
      curve.curve.push_back(0);
      load_sum += load * seen;
    }
    auto o = diagnosis::observe(curve, healthy_.load_sensitivity);
    if (!o) return o;
    o->file = "drawn";
    o->temperature_degC = temperature;
    o->indicators[diagnosis::load] = load_sum / static_cast<double>(levels_.speed_rad_s.size());
    o->indicators[diagnosis::ripple] = ripple;
    o->indicators[diagnosis::lost_motion] =
        std::max(0.0, faults.backlash_rad + (faults.backlash_rad > 0 ? lost_motion_error_rad * normal(random) : 0));
    return o;
  }

 private:
  static constexpr double slow_enough = 60;  ///< motor rad/s: up to here the servo holds its speed against the ripple
  static constexpr double standing_out =
      8;  ///< amplitude over the level's standard error at which levels_of reports a ripple
  static constexpr double lost_motion_error_rad = 3e-5;  ///< as the curves of the campaign show it
  const Campaign& campaign_;
  const drive::Drive& drive_;
  const LevelStatistics& levels_;
  const HealthyState& healthy_;
  std::vector<double> travel_rad_;
};

/// Verdicts on curves with a fault; none where check refuses a curve.
std::vector<std::optional<Verdict>> judged(const HealthyState& healthy, const std::vector<Observation>& curves,
                                           double false_alarm) {
  std::vector<std::optional<Verdict>> all;
  for (const Observation& o : curves) {
    diagnosis::ObservationFile one{.observations = {o}};
    auto verdict = diagnosis::check(healthy, one, {.false_alarm = false_alarm});
    all.push_back(verdict ? std::optional(std::move(verdict->front())) : std::nullopt);
  }
  return all;
}

double share_of(const std::vector<std::optional<Verdict>>& verdicts, auto&& what) {
  return static_cast<double>(std::ranges::count_if(verdicts, [&](const auto& v) { return v && what(*v); })) /
         static_cast<double>(verdicts.size());
}

Result<Power> power_of_one(const Joint& joint, const HealthyState& healthy, const drive::FaultInfo& fault,
                           std::size_t draws, double false_alarm) {
  Power power{.fault = &fault, .detection_limit = fault.maximum};
  const auto drawn = [&](double severity) -> Result<std::vector<Observation>> {
    std::vector<Observation> curves;
    for (std::uint32_t n = 0; n < draws; ++n) {
      auto one = joint.draw(fault, severity, n);
      if (!one) return work_failed(fmt::format("{} of {:.4g}: {}", fault.name, severity, one.error().message));
      curves.push_back(*std::move(one));
    }
    return curves;
  };
  const auto detected = [&](const std::vector<Observation>& curves, double rate) {
    return share_of(judged(healthy, curves, rate), [](const Verdict& v) { return v.anomalous; });
  };

  double low = std::log(1e-4 * fault.maximum), high = std::log(fault.maximum);
  for (int round = 0; round < 10; ++round) {
    const double middle = 0.5 * (low + high);
    const auto curves = drawn(std::exp(middle));
    if (!curves) return tl::unexpected(curves.error());
    (detected(*curves, false_alarm) >= wanted_power ? high : low) = middle;
  }
  power.detection_limit = std::exp(high);

  for (const double share : roc_severities) {
    const double severity = std::min(share * power.detection_limit, fault.maximum);
    const auto curves = drawn(severity);
    if (!curves) return tl::unexpected(curves.error());
    for (const double rate : false_alarms) power.roc.push_back({severity, rate, detected(*curves, rate)});
    if (share == 2)
      for (const auto& v : judged(healthy, *curves, false_alarm))
        power.named[v ? std::string(v->pattern) : "refused"] += 1 / static_cast<double>(draws);
  }
  return power;
}

std::string to_text(const Power& power) {
  Json j{{"fault", power.fault->name}, {"detection_limit", power.detection_limit}, {"named", power.named}};
  for (const auto& [severity, false_alarm, detected] : power.roc) j["roc"].push_back({severity, false_alarm, detected});
  return dump_json(j) + "\n";
}

/// None where the text is no such fault's.
std::optional<Power> from_text(const drive::FaultInfo& fault, const std::string& text) try {
  const Json j = parse_json(text);
  if (j.at("fault") != fault.name) return std::nullopt;
  Power power{.fault = &fault, .detection_limit = j.at("detection_limit"), .named = j.at("named")};
  for (const Json& point : j.at("roc")) power.roc.push_back({point.at(0), point.at(1), point.at(2)});
  return power;
} catch (const Json::exception&) {
  return std::nullopt;
}

/// All that the powers of a joint depend on.
std::string identity_of(const Campaign& campaign, const LevelStatistics& levels, const HealthyState& healthy,
                        std::size_t draws, double false_alarm) {
  Fingerprint learned;
  for (const auto* column : {&levels.speed_rad_s, &levels.load_norm, &levels.stderr_nm}) learned.add(*column);
  HealthyState anywhere = healthy;  // a study may be moved to another folder
  anywhere.data.clear();
  learned.add(diagnosis::to_yaml(anywhere));
  return campaign.resolved_yaml +
         fmt::format("# power: {} draws, false alarm {}, learned {:016x}\n", draws, false_alarm, learned.value());
}

}  // namespace

Result<std::vector<Power>> power_of(const Campaign& campaign, const LevelStatistics& levels,
                                    const HealthyState& healthy, std::size_t draws, double false_alarm,
                                    const LabOptions& options) {
  const Joint joint(campaign, levels, healthy);
  const auto faults = drive::faults();
  ResumableJobs parts{
      .folder = "faults",
      .files = {},
      .whole = [&](std::size_t i, const std::string& text) { return from_text(faults[i], text).has_value(); },
      .make = [&](std::size_t i) -> Result<std::string> {
        return power_of_one(joint, healthy, faults[i], draws, false_alarm).map(to_text);
      }};
  for (const auto& fault : faults) parts.files.push_back(fmt::format("{}.json", fault.name));
  LabOptions own = options;
  own.directory = options.directory / "power";
  own.progress = {};  // of the curves
  const std::string identity = identity_of(campaign, levels, healthy, draws, false_alarm);
  const auto cleared = ranks().on_root([&]() -> Result<void> {
    const auto there = read_text(own.directory / "campaign.yaml", "a file");
    std::error_code ignored;
    if (options.existing == Existing::replace && there && *there != identity)
      std::filesystem::remove_all(own.directory, ignored);
    return {};
  });
  if (!cleared) return tl::unexpected(cleared.error());
  const auto completed = complete(identity, parts, own);
  if (!completed) return tl::unexpected(completed.error());
  std::vector<Power> all;
  for (std::size_t i = 0; i < faults.size(); ++i) all.push_back(*from_text(faults[i], completed->texts[i]));
  return all;
}

}  // namespace tribotwin::twin::study
