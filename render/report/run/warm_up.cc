#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <yaml-cpp/yaml.h>

#include <tribotwin/render/page/kernel.hpp>
#include <tribotwin/render/page/what_if.hpp>
#include <tribotwin/render/report/record/cycles.hpp>
#include <tribotwin/render/report/run/histories.hpp>
#include <tribotwin/render/report/run/warm_up.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {
namespace {

constexpr double room_low_degC = 5, room_high_degC = 45;  ///< between which the ambient temperature may be chosen
constexpr double standing_max_min_h = 50;
/// Largest difference from whole runs at other ambient temperatures and with other pauses (warm_up_test.py).
constexpr double accuracy_K = 0.5;
/// A joint that warmed by less has no warm-up to predict.
constexpr double warmed_min_K = 1;
/// A joint is left out where the prediction differs from the run itself by more, or its recorded power from that of its
/// law by a larger share: then something else heats it, too.
constexpr double rms_max_K = 0.25, ratio_error_max = 0.05;
constexpr std::size_t fitted_cycles = 400, drawn_points = 150, drawn_marks = 12;

/// Mean friction power [W] of a joint in a cycle with these samples, as its law has it at a temperature.
class LawPower {
 public:
  LawPower(const drive::Drive& drive, const JointHistory& joint, const CompleteCycle& cycle) : drive_(drive) {
    for (std::size_t i = cycle.begin; i < cycle.end; ++i)
      samples_.push_back({joint.velocity_rad_s[i], joint.load_nm[i] / drive.torque_max_nm});
  }
  double operator()(double temperature_degC) const {
    const auto at = friction::at_temperature(drive_.law, temperature_degC);
    double sum = 0;
    for (const auto& [speed, load] : samples_) sum += std::abs(speed) * drive::friction_nm(drive_, at, speed, load);
    return sum / static_cast<double>(samples_.size());
  }

 private:
  struct Sample {
    double speed_rad_s, load_norm;
  };
  const drive::Drive& drive_;
  std::vector<Sample> samples_;
};

/// Recorded power over that of the law, by the temperature at which a cycle began; ascending.
struct Ratio {
  double temperature_degC, value;
};

double at(const std::vector<Ratio>& ratios, double temperature_degC) {
  const auto above = std::ranges::lower_bound(ratios, temperature_degC, {}, &Ratio::temperature_degC);
  if (above == ratios.begin()) return above->value;
  if (above == ratios.end()) return ratios.back().value;
  const auto& [low, from] = *(above - 1);
  return std::lerp(from, above->value, (temperature_degC - low) / (above->temperature_degC - low));
}

/// A joint as it is predicted.
struct Predicted {
  std::size_t index;  ///< of RunData::joints
  std::string name;
  kernel::WarmUp numbers;
  double rms_K, recorded_end_degC;
  std::optional<double> law_from_degC, law_to_degC;
};

/// What forbids the prediction of every joint; empty where nothing does.
std::string why_not(const RunData& run, std::span<const CompleteCycle> cycles) {
  const auto changes = [](const twin::Event& e) { return !std::holds_alternative<twin::Marker>(e.what); };
  if (std::ranges::any_of(run.scenario->events, changes)) return "an event of the scenario changes the run";
  const auto T_amb = [](const mujoco::Binding& d) { return d.drive.thermal.T_amb_degC; };
  const auto drives = run.model()->drives();
  if (!run.scenario->ambient_degC &&
      std::ranges::adjacent_find(drives, std::ranges::not_equal_to{}, T_amb) != drives.end())
    return "the scenario has no ambient_degC, and those of the drives differ";
  if (cycles.empty()) return "the record has fewer than 20 samples of a work cycle";
  return "";
}

class Forecast {
 public:
  explicit Forecast(const RunData& run) : run_(run), cycles_(complete_cycles(run)) {
    std::vector<std::size_t> warmed;
    for (std::size_t i = 0; i < run.joints.size(); ++i)
      if (has_warmed(i)) warmed.push_back(i);
    if (warmed.empty()) return;
    if (const std::string why = why_not(run, cycles_); !why.empty()) {
      reasons_.push_back(why + ".");
      return;
    }
    const auto& times = run.record.cycle_time_s;
    cycle_s_ = (times.back() - times.front()) / static_cast<double>(times.size() - 1);
    ambient_degC_ = run.scenario->ambient_degC.value_or(run.model()->drives()[0].drive.thermal.T_amb_degC);
    starts_at_ambient_ = !YAML::Load(run.scenario->resolved_yaml)["temperature_degC"];
    for (const std::size_t i : warmed) predict(i);
  }

  const std::vector<Predicted>& joints() const { return joints_; }
  const std::vector<std::string>& reasons() const { return reasons_; }
  double ambient_degC() const { return ambient_degC_; }
  double low_degC() const { return std::min(room_low_degC, ambient_degC_); }
  double high_degC() const { return std::max(room_high_degC, ambient_degC_); }
  bool starts_at_ambient() const { return starts_at_ambient_; }

 private:
  std::span<const double> temperatures(const std::string& joint) const {
    return run_.record.channel(joint, "cycle_temperature_degC");
  }

  double start_degC(const std::string& joint) const {
    return run_.scenario->temperature_degC[*twin::find_drive(*run_.model(), joint)];
  }

  bool has_warmed(std::size_t i) const {
    const JointHistory& joint = run_.joints[i];
    const auto degC = temperatures(joint.name);
    const std::size_t samples = run_.record.time_s.size();
    return joint.moved && twin::find_drive(*run_.model(), joint.name) &&
           degC.size() == run_.record.cycle_time_s.size() && joint.velocity_rad_s.size() == samples &&
           joint.load_nm.size() == samples && std::abs(degC.back() - start_degC(joint.name)) >= warmed_min_K;
  }

  void leave_out(const std::string& joint, const std::string& why) {
    reasons_.push_back(fmt::format("{}: {}.", joint, why));
  }

  void predict(std::size_t i) {
    const JointHistory& joint = run_.joints[i];
    const auto& drive = run_.model()->drives()[*twin::find_drive(*run_.model(), joint.name)].drive;
    if (drive.winding.present()) return leave_out(joint.name, "the winding of its motor heats it, too");
    const LawPower law(drive, joint, cycles_.back());
    const auto ratios = ratios_of(joint, law);
    const auto lawful = [](const Ratio& r) { return std::abs(r.value - 1) <= ratio_error_max; };
    if (ratios.empty() || !std::ranges::all_of(ratios, lawful))
      return leave_out(joint.name, "its friction power is not that of its law");
    Predicted p{.index = i,
                .name = joint.name,
                .numbers = numbers_of(drive, start_degC(joint.name)),
                .rms_K = 0,
                .recorded_end_degC = temperatures(joint.name).back(),
                .law_from_degC = {},
                .law_to_degC = {}};
    fill(p.numbers, [&](double degC) { return law(degC) * at(ratios, degC); });
    p.rms_K = rms_K(p);
    if (!(p.rms_K <= rms_max_K))
      return leave_out(joint.name,
                       fmt::format("the prediction differs from the run itself by {:.2g} K (rms)", p.rms_K));
    if (drive.law.info->temperature_dependent) {
      const auto& range = drive.law.range;
      if (range.temperature_min_degC > -friction::unlimited) p.law_from_degC = range.temperature_min_degC;
      if (range.temperature_max_degC < friction::unlimited) p.law_to_degC = range.temperature_max_degC;
    }
    joints_.push_back(std::move(p));
  }

  /// Without the first cycle, which comes from the start pose.
  std::vector<Ratio> ratios_of(const JointHistory& joint, const LawPower& law) const {
    const auto degC = temperatures(joint.name);
    const auto power = run_.record.channel(joint.name, "cycle_friction_power_W");
    const std::size_t count = std::min(degC.size(), power.size()), step = count / fitted_cycles + 1;
    std::vector<Ratio> all;
    for (std::size_t k = 1; k < count; k += step)
      if (std::isfinite(degC[k - 1])) all.push_back({degC[k - 1], power[k] / law(degC[k - 1])});
    std::ranges::sort(all, {}, &Ratio::temperature_degC);
    const auto repeated = std::ranges::unique(all, {}, &Ratio::temperature_degC);
    all.erase(repeated.begin(), repeated.end());
    return all;
  }

  kernel::WarmUp numbers_of(const drive::Drive& drive, double start_degC) const {
    const auto& thermal = drive.thermal;
    kernel::WarmUp w{.order = static_cast<double>(static_cast<int>(thermal.order)),
                     .T_amb_degC = thermal.T_amb_degC,
                     .t_s = {thermal.t_s[0], thermal.t_s[1]},
                     .gain_K_J = {thermal.gain_K_J[0], thermal.gain_K_J[1]},
                     .starts_at_ambient = starts_at_ambient_ ? 1.0 : 0.0,
                     .start_degC = start_degC,
                     .cycle_s = cycle_s_};
    w.power_from_degC = std::min(low_degC(), start_degC);
    return w;
  }

  /// The levels of power, up to the highest temperature that any choice leads to.
  void fill(kernel::WarmUp& w, auto power_at) const {
    const double from = w.power_from_degC, above = std::max(high_degC(), w.start_degC),
                 resistance_K_W = w.gain_K_J[0] * w.t_s[0] + w.gain_K_J[1] * w.t_s[1];
    w.power_to_degC = above + resistance_K_W * std::max(power_at(from), power_at(above)) + 1;
    const auto degC = evenly(from, w.power_to_degC, kernel::WarmUp::levels);
    for (std::size_t i = 0; i < degC.size(); ++i) w.power_W[i] = power_at(degC[i]);
  }

  /// Of the prediction at what the run had, over all its cycles.
  double rms_K(const Predicted& p) const {
    auto warming = kernel::begin(p.numbers, ambient_degC_, 0);
    const auto degC = temperatures(p.name);
    double squares = 0;
    for (const double recorded : degC) {
      kernel::work(p.numbers, 1, warming);
      squares += std::pow(warming.temperature_degC() - recorded, 2);
    }
    return std::sqrt(squares / static_cast<double>(degC.size()));
  }

  const RunData& run_;
  std::vector<CompleteCycle> cycles_;
  double cycle_s_ = 0, ambient_degC_ = 0;
  bool starts_at_ambient_ = true;
  std::vector<Predicted> joints_;
  std::vector<std::string> reasons_;
};

/// Numbers of cycles between the points that are drawn, from 0 at the start; denser there, where temperatures change.
std::vector<int> strides(std::size_t cycles) {
  std::vector<int> all{0};
  for (std::size_t k = 1, done = 0; k <= drawn_points; ++k) {
    const std::size_t until = k * k * cycles / (drawn_points * drawn_points);
    if (until == done) continue;
    all.push_back(static_cast<int>(until - done));
    done = until;
  }
  return all;
}

Trace line(const Predicted& joint, std::string label, const std::vector<int>& strides, double ambient_degC,
           double standing_min_h) {
  Trace t{.label = std::move(label), .time_s = {}, .values = {}, .stroke = joint.index};
  auto warming = kernel::begin(joint.numbers, ambient_degC, standing_min_h);
  double time_s = 0;
  for (const int cycles : strides) {
    kernel::work(joint.numbers, cycles, warming);
    t.time_s.push_back(time_s += cycles * joint.numbers.cycle_s);
    t.values.push_back(warming.temperature_degC());
  }
  return t;
}

Trace marks(const RunData& run, const Predicted& joint) {
  Trace t{.label = "", .time_s = {}, .values = {}, .stroke = joint.index, .mark = Mark::points};
  const auto degC = run.record.channel(joint.name, "cycle_temperature_degC");
  for (std::size_t k = 1; k <= drawn_marks; ++k) {
    const std::size_t at = (2 * k - 1) * degC.size() / (2 * drawn_marks);
    t.time_s.push_back(run.record.cycle_time_s[at]);
    t.values.push_back(degC[at]);
  }
  return t;
}

const Predicted& hottest(const Forecast& f) {
  return *std::ranges::max_element(f.joints(), {}, &Predicted::recorded_end_degC);
}

Figure figure(const RunData& run, const Forecast& f, const std::vector<int>& strides) {
  std::vector<Trace> traces;
  double low = f.low_degC(), high = low;
  for (const auto& joint : f.joints()) {
    traces.push_back(line(joint, joint.name, strides, f.ambient_degC(), 0));
    low = std::min(low, joint.numbers.power_from_degC);
    for (const double degC : line(joint, "", strides, f.high_degC(), 0).values) high = std::max(high, degC);
  }
  for (const auto& joint : f.joints()) traces.push_back(marks(run, joint));
  const Predicted& hot = hottest(f);
  for (const double ambient : {f.low_degC(), f.high_degC()}) {
    traces.push_back(line(hot, fmt::format("{}, ambient {:g} °C", hot.name, ambient), strides, ambient, 0));
    traces.back().mark = Mark::reference;
  }
  Figure drawn = history("What if: another room, other pauses", lubricant_temperature(), traces);
  for (Series& s : drawn.series)
    if (s.mark == Mark::points) s.shape = Shape::circle;
  drawn.y.from = 10 * std::floor(low / 10);
  drawn.y.to = 10 * std::ceil(high / 10);
  return drawn;
}

/// "0.048 K (rms, joint2)"
std::string difference(const Forecast& f) {
  const auto& worst = *std::ranges::max_element(f.joints(), {}, &Predicted::rms_K);
  if (worst.rms_K < 0.01) return "less than 0.01 K (rms)";
  return fmt::format("{:.2g} K (rms, {})", worst.rms_K, worst.name);
}

std::string caption(const Forecast& f) {
  return fmt::format(
      "Lines: the temperature of each joint that changed by {:g} K or more, predicted from this run's friction power "
      "and its law. Circles: the run itself; they differ by {}. Thin dashed: {} at other ambient temperatures. With "
      "scripts, sliders set the ambient temperature{}, and minutes of standing still per hour, spread evenly between "
      "the work cycles. Whole runs of the robots that ship agree within {:g} K.",
      warmed_min_K, difference(f), hottest(f).name,
      f.starts_at_ambient() ? ", at which joints also start" : " (joints start as warm as in the run)", accuracy_K);
}

nlohmann::json for_script(const Forecast& f, const std::vector<int>& strides) {
  nlohmann::json more{{"cycles", strides}};
  for (const auto& joint : f.joints()) {
    nlohmann::json j{{"name", joint.name}, {"recorded", joint.recorded_end_degC}};
    if (joint.law_from_degC) j["low"] = *joint.law_from_degC;
    if (joint.law_to_degC) j["high"] = *joint.law_to_degC;
    more["joints"].push_back(std::move(j));
  }
  return more;
}

bool may_predict(const RunData& run) {
  return !kernel_files().empty() && run.model() && run.damage.empty() && has_cycles(run) && !run.scenario->recording;
}

}  // namespace

Result<void> show_warm_up(IllustratedPage& page, pugi::xml_node grid, const RunData& run) {
  if (!may_predict(run)) return {};
  const Forecast forecast(run);
  if (!forecast.joints().empty()) {
    const auto steps = strides(run.record.cycle_time_s.size());
    if (auto ok = page.show(grid, figure(run, forecast, steps), "what_if", caption(forecast)); !ok) return ok;
    std::vector<std::string_view> numbers;
    for (const auto& joint : forecast.joints())
      numbers.emplace_back(reinterpret_cast<const char*>(&joint.numbers), sizeof joint.numbers);
    const std::array sliders{
        Slider{"ambient temperature", "°C", forecast.low_degC(), forecast.high_degC(), forecast.ambient_degC(), 1},
        Slider{"standing still", "min per h", 0, standing_max_min_h, 0, 0}};
    add_sliders(page, grid, "warm-up", sliders, numbers, for_script(forecast, steps));
  }
  if (!forecast.reasons().empty())
    page.add(grid.parent(), "p",
             "Not predicted for other ambient temperatures: " + twin::joined(forecast.reasons(), " "), "soft");
  return {};
}

}  // namespace tribotwin::render
