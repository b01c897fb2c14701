#include <algorithm>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/friction/axis.hpp>
#include <tribotwin/twin/experiments/friction/random.hpp>
#include <tribotwin/twin/experiments/friction/series.hpp>
#include <tribotwin/twin/experiments/friction/warmup.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {
namespace {

constexpr std::size_t max_benches = 900;  // the engine's callbacks serve 1024 models

/// One entry of `series`: reads it, then adds its curves to the campaign.
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
      count_ = in_.whole("count", {1, static_cast<double>(max_curves)});
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
    if (combine_ == "random")
      add_random();
    else if (combine_ == "pairs")
      add_pairs();
    else
      add_grid();
  }

 private:
  struct Loaded {
    std::size_t bench;
    Measurement measurement;
    double payload_kg;
    std::shared_ptr<const mujoco::Model> arm;  ///< with payload and gravity
    std::string text;
  };
  struct Step {
    double duration_s, speed_rad_s;  ///< arm side
  };

  void add_random() {
    std::mt19937_64 random = random_for(campaign_.seed, index_, for_conditions);
    for (std::size_t k = 0; k < count_; ++k) {
      const double load = load_.draw(random);  // before the temperature: arguments have no order of evaluation
      prescribed(loaded(load), temperature_.draw(random));
    }
  }

  void add_pairs() {
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
  }

  void add_grid() {
    for (const double l : load_.values) {
      const Loaded load = loaded(l);
      thermal::Rise rise = start_;
      for (std::size_t k = 0; k < steps_.size(); ++k) rise = observed(load, k, rise);
      for (const double T : temperature_.values) prescribed(load, T);
    }
  }

  void read_fault(Mapping in) {
    in.accept({"type", "severity"});
    const auto fault = fault_of(in, "type", *campaign_.model, campaign_.drive);
    fault.type->add(faults_, fault.severity);
    fault_names_.emplace_back(fault.type->name);
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
      load_ = read_axis(*load, "mass_kg", {0, 1e6}, drawn);
    } else {
      load_ = read_axis(*load, "norm", {-1000, 1000}, drawn);
      if (by_ == LoadBy::pose) {
        payload_.mass_kg = load->number_or("payload_kg", 0, {0, 1e6});
        if (campaign_.procedure == Procedure::test_cycle)
          load->fail(
              "by",
              "pose is not possible with the test cycle, whose travel passes through all loads of the joint; use "
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
      temperature_ = read_axis(*temperature, "prescribed_degC", {-100, 300}, combine_ == "random");
      temperature->done();
      return;
    }
    heating_ = true;
    if (combine_ == "random") in_.fail("combine", "random needs prescribed_degC: a warm-up has its order");
    auto heating = temperature->mapping("heating");
    heating->accept({"ambient_degC", "start_degC", "travel_rad", "steps"});
    if (drive_.winding.present())
      temperature->fail("heating",
                        "knows no heat of windings, and this joint's motor has one; use prescribed_degC, or a model "
                        "without winding_resistance_ohm");
    if (drive_.thermal.order == thermal::Order::prescribed)
      temperature->fail("heating",
                        "needs a thermal model, but this drive's is 'prescribed'; give it one with drive: {thermal: "
                        "first_order, R_th: ..., kappa: ...}");
    ambient_offset_K_ =
        heating->number_or("ambient_degC", drive_.thermal.T_amb_degC, {-100, 300}) - drive_.thermal.T_amb_degC;
    start_ = thermal::steady_rise(
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

  /// Sets arm_ and gravity_ to those of a load with gravity.
  void set_payload(const Payload& payload) {
    if (payload.mass_kg > 0 && (!arm_ || arm_mass_kg_ != payload.mass_kg)) {
      auto carrying = with_payload(*campaign_.model, payload);
      if (!carrying) in_.fail("load", carrying.error().message);
      arm_ = *carrying;
      arm_mass_kg_ = payload.mass_kg;
      gravity_.reset();
    }
    const auto& arm = payload.mass_kg > 0 ? arm_ : campaign_.model;
    if (gravity_ && gravity_of_ == arm) return;
    gravity_.emplace(*arm, campaign_.drive, basis_.start_rad);
    gravity_of_ = arm;
  }

  /// The bench of an arm, made unless it is the latest.
  std::size_t bench_for(const std::shared_ptr<const mujoco::Model>& arm, bool gravity) {
    if (bench_arm_ != arm) {
      if (campaign_.benches.size() >= max_benches)
        in_.fail("load", fmt::format("the campaign has more than {} different payloads", max_benches));
      auto bench = bench_of(*arm, gravity, basis_.sensors.sampling_hz);
      if (!bench) in_.fail("load", bench.error().message);
      campaign_.benches.push_back(*bench);
      bench_arm_ = arm;
    }
    return campaign_.benches.size() - 1;
  }

  /// The bench of a load, and the pose there.
  Loaded loaded(double load) {
    const bool gravity = by_ != LoadBy::torque;
    Payload payload = payload_;
    if (by_ == LoadBy::payload) payload.mass_kg = load;
    if (gravity) set_payload(payload);
    Loaded l{.bench = 0,
             .measurement = basis_,
             .payload_kg = gravity ? payload.mass_kg : 0,
             .arm = gravity ? gravity_of_ : campaign_.model,
             .text = {}};
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
    l.bench = bench_for(l.arm, gravity);
    return l;
  }

  void prescribed(const Loaded& load, double temperature_degC) {
    add_curve(load, {.rise = thermal::steady_rise(drive_.thermal, temperature_degC - drive_.thermal.T_amb_degC)},
              fmt::format("{:.4g} degC", temperature_degC));
  }

  /// Step `k` of the warm-up and the curve after it; returns the temperature rise after both.
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
    if (campaign_.curves.size() >= max_curves)
      in_.fail("name", fmt::format("the campaign has more than {} curves", max_curves));
    Curve curve{.series = name_,
                .number = campaign_.curves.size() + 1,
                .bench = load.bench,
                .measurement = load.measurement,
                .payload_kg = load.payload_kg,
                .faults = fault_names_,
                .conditions = load.text + ", " + temperature};
    curve.measurement.heat = heat;
    curve.measurement.faults = faults_;
    curve.measurement.seed = random_for(campaign_.seed, curve.number, for_sensors)();
    motion(load, heat);  // fails here rather than after hours of measuring
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
  std::vector<std::string> fault_names_;
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

}  // namespace

void add_series(Campaign& campaign, const Measurement& basis, std::set<std::string>& names, std::size_t index,
                Mapping in) {
  Series(campaign, basis, names, index, std::move(in)).add();
}

}  // namespace tribotwin::twin
