#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/experiments/friction/warmup.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/robot/drive_change.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
constexpr Bounds positions{-1e4, 1e4};                           // of joints: rad, or m of a sliding one
constexpr std::size_t most_curves = 100000, most_benches = 900;  // the engine's callbacks serve 1024 models

/// A reproducible stream for one purpose of one curve.
std::mt19937_64 random_for(std::uint64_t seed, std::uint64_t number, std::uint64_t purpose) {
  std::seed_seq sequence{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                         static_cast<std::uint32_t>(number), static_cast<std::uint32_t>(purpose)};
  return std::mt19937_64(sequence);
}
enum Purpose : std::uint64_t { for_sensors = 1, for_levels = 2, for_conditions = 3 };

/// What a quantity takes in a series: values, or a range to draw from.
struct Axis {
  std::vector<double> values;
  double low = 0, high = 0;
  bool range = false;

  double draw(std::mt19937_64& random) const {
    const double share = static_cast<double>(random() >> 11) * 0x1p-53;  // the same on every standard library
    if (range) return low + (high - low) * share;
    return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
  }
};

/// A number, a list, or {from, to, count, spacing}; where `drawn`, the range may lack its count.
Axis axis(Mapping& in, const std::string& key, Bounds bounds, bool drawn) {
  if (!in.has(key)) in.fail(key, "is missing: a number, a list, or {from, to, count}");
  const YAML::Node node = in.raw(key);
  Axis a;
  if (node.IsScalar()) {
    a.values.push_back(in.number(key, bounds));
  } else if (node.IsSequence()) {
    a.values = in.numbers(key, bounds);
    if (a.values.empty()) in.fail(key, "is an empty list");
  } else {
    auto range = in.mapping(key);
    range->accept({"from", "to", "count", "spacing"});
    a.low = range->number("from", bounds);
    a.high = range->number("to", bounds);
    a.range = !range->has("count");
    const std::string spacing = range->has("spacing") ? range->choice("spacing", {"linear", "logarithmic"}) : "linear";
    if (a.range && !drawn) range->fail("count", "is missing");
    if (!a.range) {
      const auto count = static_cast<double>(range->whole("count", {1, static_cast<double>(most_curves)}));
      if (spacing == "logarithmic" && !(a.low > 0 && a.high > 0))
        range->fail("spacing", "logarithmic needs from and to above 0");
      for (double k = 0; k < count; ++k) {
        const double share = count == 1 ? 0 : k / (count - 1);
        a.values.push_back(spacing == "linear" ? a.low + (a.high - a.low) * share
                                               : a.low * std::pow(a.high / a.low, share));
      }
    }
    range->done();
  }
  return a;
}

/// One entry of `series` on its way to curves.
class Series {
 public:
  Series(Campaign& campaign, const Measurement& basis, std::set<std::string>& names, std::size_t index, Mapping in)
      : campaign_(campaign),
        basis_(basis),
        drive_(campaign.model->drives()[campaign.drive].drive),
        index_(index),
        in_(std::move(in)) {
    in_.accept({"name", "load", "temperature", "combine", "count", "fault"});
    name_ = in_.text("name");
    if (name_.find_first_of(",\"\n\r") != std::string::npos)
      in_.fail("name", "must have no comma, quote or line break: it is a cell of curves.csv");
    if (!names.insert(name_).second) in_.fail("name", fmt::format("'{}' is the name of another series", name_));
    combine_ = in_.has("combine") ? in_.choice("combine", {"grid", "pairs", "random"}) : "grid";
    if (combine_ == "random") {
      count_ = in_.whole("count", {1, static_cast<double>(most_curves)});
    } else if (in_.has("count")) {
      in_.fail("count", "is for combine: random");
    }
    if (const YAML::Node fault = in_.raw("fault"); fault && fault.IsSequence())
      for (Mapping one : in_.mappings("fault")) read_fault(one);
    else if (fault)
      read_fault(*in_.mapping("fault"));
    drive_.law = drive::with_faults(drive_.law, faults_);
    read_load();
    read_temperature();
    in_.done();
  }

  void add() {
    std::mt19937_64 random = random_for(campaign_.seed, index_, for_conditions);
    if (combine_ == "random") {
      for (std::size_t k = 0; k < count_; ++k) {
        const double load = load_.draw(random);  // in this order, whatever a compiler does with arguments
        prescribed(loaded(load), temperature_.draw(random));
      }
    } else if (combine_ == "pairs") {
      const std::size_t temperatures = heating_ ? steps_.size() : temperature_.values.size();
      if (load_.values.size() != temperatures)
        in_.fail("combine", fmt::format("pairs needs as many loads as temperatures, but there are {} and {}",
                                        load_.values.size(), temperatures));
      thermal::Rise rise = start_;
      for (std::size_t k = 0; k < temperatures; ++k) {
        const Loaded load = loaded(load_.values[k]);
        if (heating_)
          rise = observed(load, k, rise);
        else
          prescribed(load, temperature_.values[k]);
      }
    } else {
      for (const double l : load_.values) {
        const Loaded load = loaded(l);
        thermal::Rise rise = start_;
        for (std::size_t k = 0; k < steps_.size(); ++k) rise = observed(load, k, rise);
        for (const double T : temperature_.values) prescribed(load, T);
      }
    }
  }

 private:
  struct Loaded {
    std::size_t bench;
    Measurement measurement;
    double payload_kg;
    std::shared_ptr<const mujoco::Model> arm;  ///< with its payload, without gravity's absence: what Gravity asks
    std::string text;
  };
  struct Step {
    double duration_s, speed_rad_s;  ///< arm side
  };

  void read_fault(Mapping in) {
    in.accept({"type", "severity"});
    const auto fault = fault_of(in, "type", *campaign_.model, campaign_.drive);
    fault.type->add(faults_, fault.severity);
    in.done();
  }

  void read_load() {
    auto load = in_.mapping("load");
    if (!load)
      in_.fail("load", "is missing: {by: torque, norm: ...}, {by: pose, norm: ...} or {by: payload, mass_kg: ...}");
    const std::string by = load->choice("by", {"torque", "pose", "payload"});
    by_ = by == "torque" ? LoadBy::torque : by == "pose" ? LoadBy::pose : LoadBy::payload;
    const bool drawn = combine_ == "random";
    if (by_ == LoadBy::payload) {
      load_ = axis(*load, "mass_kg", {0, 1e6}, drawn);
    } else {
      load_ = axis(*load, "norm", {-1000, 1000}, drawn);
      if (by_ == LoadBy::pose) {
        payload_.mass_kg = load->number_or("payload_kg", 0, {0, 1e6});
        if (campaign_.procedure == Procedure::test_cycle)
          load->fail("by",
                     "pose has no meaning for the test cycle, whose travel runs through all loads of the joint; use "
                     "torque or payload");
      }
    }
    if (by_ != LoadBy::torque && load->has("com_m")) {
      const auto com = load->numbers("com_m", {-1e3, 1e3});
      if (com.size() != 3) load->fail("com_m", "must be three numbers [x, y, z]");
      std::ranges::copy(com, payload_.com_m.begin());
    }
    load->done();
  }

  void read_temperature() {
    auto temperature = in_.mapping("temperature");
    if (!temperature) in_.fail("temperature", "is missing: {prescribed_degC: ...} or {heating: {steps: [...]}}");
    if (temperature->has("prescribed_degC") == temperature->has("heating"))
      in_.fail("temperature", "needs either prescribed_degC or heating");
    if (temperature->has("prescribed_degC")) {
      temperature_ = axis(*temperature, "prescribed_degC", {-100, 300}, combine_ == "random");
      temperature->done();
      return;
    }
    heating_ = true;
    if (combine_ == "random") in_.fail("combine", "random needs prescribed_degC: a warm-up has its order");
    auto heating = temperature->mapping("heating");
    heating->accept({"ambient_degC", "start_degC", "travel_rad", "steps"});
    if (drive_.thermal.order == thermal::Order::prescribed)
      temperature->fail("heating",
                        "needs a thermal model, but this drive's is 'prescribed'; give it one with drive: {thermal: "
                        "first_order, R_th: ..., kappa: ...}");
    ambient_offset_K_ =
        heating->number_or("ambient_degC", drive_.thermal.T_amb_degC, {-100, 300}) - drive_.thermal.T_amb_degC;
    start_ = thermal::settled(
        drive_.thermal, heating->number_or("start_degC", drive_.thermal.T_amb_degC + ambient_offset_K_, {-100, 300}) -
                            drive_.thermal.T_amb_degC);
    travel_rad_ = heating->number_or("travel_rad", 1, {0, 100});
    for (Mapping step : heating->mappings("steps")) {
      step.accept({"duration_s", "speed_rad_s", "repeat"});
      const std::size_t repeat = step.whole_or("repeat", 1, {1, 10000});
      const Step one{step.number("duration_s", {0, 1e9}),
                     step.number_or("speed_rad_s", 0, {0, 1e6}) / drive_.gear_ratio};
      steps_.insert(steps_.end(), repeat, one);
      step.done();
    }
    if (steps_.empty())
      heating->fail("steps", "must be a list of {duration_s, speed_rad_s}; a curve is measured after each");
    heating->done();
    temperature->done();
  }

  /// The bench of a load and where on it to measure.
  Loaded loaded(double load) {
    const bool gravity = by_ != LoadBy::torque;
    Payload payload = payload_;
    if (by_ == LoadBy::payload) payload.mass_kg = load;
    Loaded l{.bench = 0,
             .measurement = basis_,
             .payload_kg = gravity ? payload.mass_kg : 0,
             .arm = campaign_.model,
             .text = {}};
    if (gravity && payload.mass_kg > 0) {
      if (!arm_ || arm_mass_kg_ != payload.mass_kg) {
        auto carrying = with_payload(*campaign_.model, payload);
        if (!carrying) in_.fail("load", carrying.error().message);
        arm_ = *carrying;
        arm_mass_kg_ = payload.mass_kg;
        gravity_.reset();
      }
      l.arm = arm_;
    }
    if (gravity && (!gravity_ || gravity_of_ != l.arm)) {
      gravity_.emplace(*l.arm, campaign_.drive, basis_.start_rad);
      gravity_of_ = l.arm;
    }
    switch (by_) {
      case LoadBy::torque:
        l.measurement.external_nm = load * drive_.torque_max_nm;
        l.text = fmt::format("load {:.4g} by torque", load);
        break;
      case LoadBy::pose: {
        const auto pose = gravity_->pose_for(load * drive_.torque_max_nm);
        if (!pose) in_.fail("load", pose.error().message);
        l.measurement.start_rad = pose->position_rad;
        l.measurement.width_rad = pose->width_rad;
        l.text = fmt::format("load {:.4g} by pose", load);
        break;
      }
      case LoadBy::payload:
        if (campaign_.procedure == Procedure::plus_minus) l.measurement.width_rad = gravity_->start().width_rad;
        l.text = fmt::format("payload {:.4g} kg", load);
        break;
    }
    if (!bench_arm_ || bench_arm_ != l.arm) {
      if (campaign_.benches.size() >= most_benches)
        in_.fail("load", fmt::format("the campaign has more than {} different payloads", most_benches));
      auto bench = bench_of(*l.arm, gravity, basis_.sensors.sampling_hz);
      if (!bench) in_.fail("load", bench.error().message);
      campaign_.benches.push_back(*bench);
      bench_arm_ = l.arm;
    }
    l.bench = campaign_.benches.size() - 1;
    return l;
  }

  void prescribed(const Loaded& load, double temperature_degC) {
    add_curve(load, {.rise = thermal::settled(drive_.thermal, temperature_degC - drive_.thermal.T_amb_degC)},
              fmt::format("{:.4g} degC", temperature_degC));
  }

  /// Step `k` of the warm-up and the curve after it; returns where both leave the lubricant.
  thermal::Rise observed(const Loaded& load, std::size_t k, const thermal::Rise& before) {
    const auto load_nm = [&](double q) {
      return by_ == LoadBy::torque ? load.measurement.external_nm : gravity_->load_nm(load.measurement.start_rad, q);
    };
    double mean = 0;  // friction follows |load|
    constexpr int points = 41;
    for (int i = 0; i < points; ++i)
      mean += std::abs(load_nm(load.measurement.start_rad[campaign_.drive] +
                               travel_rad_ * (static_cast<double>(i) / (points - 1) - 0.5))) /
              points / drive_.torque_max_nm;
    const Heat heat{
        .rise = after_steady_work(drive_, before, ambient_offset_K_, steps_[k].speed_rad_s, mean, steps_[k].duration_s),
        .ambient_offset_K = ambient_offset_K_,
        .held = false};
    add_curve(load, heat,
              fmt::format("observation {} at {:.4g} degC", k + 1, drive_.thermal.T_amb_degC + heat.rise.total_K()));
    return after_motion(drive_, heat.rise, ambient_offset_K_, motion(load, heat), campaign_.drive, load_nm);
  }

  Motion motion(const Loaded& load, const Heat& heat) {
    const mujoco::Model& bench = *campaign_.benches[load.bench];
    Measurement me = load.measurement;
    me.heat = heat;
    if (campaign_.procedure == Procedure::test_cycle) return test_cycle_of(bench, campaign_.drive, me.start_rad);
    auto found = plus_minus(bench, campaign_.drive, me);
    if (!found) in_.fail("load", fmt::format("{}: {}", load.text, found.error().message));
    return *found;
  }

  void add_curve(const Loaded& load, const Heat& heat, const std::string& temperature) {
    if (campaign_.curves.size() >= most_curves)
      in_.fail("name", fmt::format("the campaign has more than {} curves", most_curves));
    Curve curve{.series = name_,
                .number = campaign_.curves.size() + 1,
                .bench = load.bench,
                .measurement = load.measurement,
                .payload_kg = load.payload_kg,
                .conditions = load.text + ", " + temperature};
    curve.measurement.heat = heat;
    curve.measurement.faults = faults_;
    curve.measurement.seed = random_for(campaign_.seed, curve.number, for_sensors)();
    motion(load, heat);  // whether it can be done shows here, before hours of work
    if (drive_.law.validity == friction::Validity::error) {
      const auto at = friction::at_temperature(drive_.law, drive_.thermal.T_amb_degC + heat.rise.total_K());
      const double l = by_ == LoadBy::payload ? 0 : load.measurement.external_nm / drive_.torque_max_nm;
      for (const double v : curve.measurement.speeds_rad_s)
        if (friction::level(drive_.law, at, v * drive_.speed_scale(), l).outside)
          in_.fail("name", fmt::format("curve {} ({}) leaves the range of law '{}' at {:.4g} rad/s of the joint, and "
                                       "its validity is 'error'",
                                       curve.number, curve.conditions, drive_.law.info->name, v));
    }
    campaign_.curves.push_back(std::move(curve));
  }

  Campaign& campaign_;
  const Measurement& basis_;
  drive::Drive drive_;  ///< with its faults
  drive::Faults faults_{};
  std::size_t index_;
  Mapping in_;
  std::string name_, combine_;
  std::size_t count_ = 0;
  LoadBy by_ = LoadBy::torque;
  Axis load_, temperature_;
  Payload payload_;
  bool heating_ = false;
  double ambient_offset_K_ = 0, travel_rad_ = 1;
  thermal::Rise start_;
  std::vector<Step> steps_;
  std::shared_ptr<const mujoco::Model> arm_, gravity_of_, bench_arm_;
  double arm_mass_kg_ = 0;
  std::optional<Gravity> gravity_;
};

std::vector<double> start_of(Mapping& in, const mujoco::Model& model) {
  std::vector<double> start(model.drives().size(), 0.0);
  const YAML::Node node = in.raw("start_rad");
  if (!node) return start;
  if (node.IsSequence()) {
    start = in.numbers("start_rad", positions);
    if (start.size() != model.drives().size())
      in.fail("start_rad",
              fmt::format("has {} numbers, but the model has {} drives", start.size(), model.drives().size()));
    return start;
  }
  auto by_name = in.mapping("start_rad");
  for (const auto& joint : by_name->names())
    start[drive_index(model, *by_name, joint, joint)] = by_name->number(joint, positions);
  return start;
}

}  // namespace

YAML::Node campaign_tree(const fs::path& file, const std::vector<std::string>& overrides) {
  YAML::Node root = load_yaml(file);
  for (const auto& assignment : overrides)
    apply_setting(root, assignment, "--set seed=7 or --set series.0.load.norm=0.3");
  return root;
}

Campaign load_campaign(const fs::path& file, const std::vector<std::string>& overrides) {
  return campaign_of(file, campaign_tree(file, overrides));
}

Campaign campaign_of(const fs::path& file, YAML::Node root) {
  Campaign c;
  c.file = file;
  Mapping in(file.string(), "", root);
  in.accept({"name", "description", "model", "joint", "procedure", "speeds_rad_s", "seed", "start_rad", "sensors",
             "level_noise_nm", "servo", "drive", "series"});
  c.name = in.file_name_or("name", file.stem().string());
  root["name"] = c.name;
  c.description = in.text_or("description", "");
  c.seed = in.whole_or("seed", 1, {0, 9007199254740992.0});
  c.level_noise_nm = in.number_or("level_noise_nm", 0, {0, 1e9});
  c.procedure = in.choice("procedure", {"plus_minus", "test_cycle"}) == "plus_minus" ? Procedure::plus_minus
                                                                                     : Procedure::test_cycle;

  drive::Configuration keys;
  if (auto drive = in.mapping("drive"))
    for (const auto& key : drive->names()) keys.emplace_back(key, drive->text(key));
  const fs::path model = in.file("model", fs::absolute(file).parent_path());
  root["model"] = model.string();
  const std::string joint = in.text("joint");
  const auto plain = mujoco::load_file(model);
  if (!plain) throw InputError(plain.error().message);
  c.drive = drive_index(**plain, in, "joint", joint);
  auto loaded = load_with_drive(model, joint, keys);
  if (!loaded) in.fail("drive", loaded.error().message);
  c.model = *loaded;
  const drive::Drive& drive = c.model->drives()[c.drive].drive;

  Measurement basis;
  basis.start_rad = start_of(in, *c.model);
  if (auto sensors = in.mapping("sensors")) {
    sensors->accept({"encoder_increments_per_turn", "torque_noise_nm", "sampling_hz", "lag_s"});
    basis.sensors.encoder_increments_per_turn = sensors->number_or("encoder_increments_per_turn", 0, {0, 1e12});
    basis.sensors.torque_noise_nm = sensors->number_or("torque_noise_nm", 0, {0, 1e9});
    basis.sensors.sampling_hz = sensors->number_or("sampling_hz", basis.sensors.sampling_hz, {20, 10000});
    basis.sensors.lag_s = sensors->number_or("lag_s", 0, {0, 0.1});
    sensors->done();
  }
  if (auto servo = in.mapping("servo")) {
    servo->accept({"position_gain_1_s", "speed_bandwidth_rad_s", "integral_time_s"});
    basis.servo.position_gain_1_s = servo->number_or("position_gain_1_s", basis.servo.position_gain_1_s, {0, 200});
    basis.servo.speed_bandwidth_rad_s =
        servo->number_or("speed_bandwidth_rad_s", basis.servo.speed_bandwidth_rad_s, {1, 400});
    basis.servo.integral_time_s = servo->number_or("integral_time_s", basis.servo.integral_time_s, {0.005, 10});
    servo->done();
  }
  if (c.procedure == Procedure::test_cycle) {
    if (in.has("speeds_rad_s")) in.fail("speeds_rad_s", "is for plus_minus; the test cycle has paper 2's 15 speeds");
    basis.speeds_rad_s = test_cycle_speeds_rad_s();
    const auto& binding = c.model->drives()[c.drive];
    const auto [low, high] = test_cycle_of(*c.model, c.drive, basis.start_rad).reach_rad(c.drive);
    const mjModel* m = c.model->get();
    if (m->jnt_limited[binding.joint] &&
        !(low >= m->jnt_range[2 * binding.joint] && high <= m->jnt_range[2 * binding.joint + 1]))
      in.fail("joint",
              fmt::format("the test cycle takes it to {:.4g} .. {:.4g} rad, but its range is {:.4g} .. {:.4g} rad", low,
                          high, m->jnt_range[2 * binding.joint], m->jnt_range[2 * binding.joint + 1]));
  } else {
    const std::vector<double> speeds = axis(in, "speeds_rad_s", {1e-6, 1e6}, false).values;
    if (speeds.size() > 1000)
      in.fail("speeds_rad_s", fmt::format("has {} speeds, at most 1000 are possible", speeds.size()));
    std::vector<double> sorted = speeds;
    std::ranges::sort(sorted);
    for (std::size_t i = 1; i < sorted.size(); ++i)
      if (sorted[i] < 1.05 * sorted[i - 1])
        in.fail("speeds_rad_s",
                fmt::format("{} and {} are too near to be told apart, 5 % is the least", sorted[i - 1], sorted[i]));
    for (const double v : speeds) basis.speeds_rad_s.push_back(v / drive.gear_ratio);
  }
  std::set<std::string> names;
  const auto series = in.mappings("series");
  if (series.empty()) in.fail("series", "is missing: a list of {name, load, temperature}");
  for (std::size_t i = 0; i < series.size(); ++i) Series(c, basis, names, i, series[i]).add();
  in.done();
  c.resolved_yaml = resolved_yaml(*c.model, root);
  return c;
}

Result<std::string> measured_rows(const Campaign& campaign, const Curve& curve) {
  const mujoco::Model& bench = *campaign.benches[curve.bench];
  const drive::Drive& drive = campaign.model->drives()[campaign.drive].drive;
  const Measurement& me = curve.measurement;
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(
        fmt::format("curve {} of series '{}' ({}): {}", curve.number, curve.series, curve.conditions, why));
  };
  const auto motion = campaign.procedure == Procedure::test_cycle ? test_cycle_of(bench, campaign.drive, me.start_rad)
                                                                  : plus_minus(bench, campaign.drive, me);
  if (!motion) return fail(motion.error().message);
  const auto recording = record(bench, campaign.drive, *motion, me);
  if (!recording) return fail(recording.error().message);
  const auto found = levels_of(
      *recording,
      {.speeds_rad_s = me.speeds_rad_s, .centre_rad = me.start_rad[campaign.drive], .width_rad = me.width_rad});
  if (!found) return fail(found.error().message);
  std::mt19937_64 random = random_for(campaign.seed, curve.number, for_levels);
  std::normal_distribution<double> noise;
  std::string rows;
  for (const Level& level : found->levels) {
    const double error = campaign.level_noise_nm > 0 ? campaign.level_noise_nm * noise(random) : 0;
    const double norm = 1 / drive.torque_max_nm, stderr_nm = std::hypot(level.stderr_nm, campaign.level_noise_nm),
                 friction = level.friction_nm + error;
    rows += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", curve.series, curve.number,
                        level.speed_rad_s * drive.gear_ratio, level.load_nm * norm, level.temperature_degC,
                        friction * norm, stderr_nm * norm, (level.forward->friction_nm + error) * norm,
                        (level.backward->friction_nm + error) * norm, friction, stderr_nm, found->lag_s,
                        level.ripple_nm, level.lost_motion_rad);
  }
  return rows;
}

}  // namespace tribotwin::twin
