#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/identification/estimates_file.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/identification/thermal/model_keys.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index;

namespace {

void write_coupling(YAML::Emitter& out, const Regressor& regressor) {
  if (regressor.motors().empty()) return;
  out << YAML::Key << "coupling" << YAML::Value << YAML::BeginMap;
  for (const CoupledMotor& motor : regressor.motors()) {
    out << YAML::Key << motor.name << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "joint" << YAML::Value
        << regressor.joint_name(motor.joint) << YAML::Key << "turns_with" << YAML::Value << YAML::BeginMap;
    for (Index j = 0; j < regressor.joints(); ++j)
      if (motor.turns_with(j) != 0) out << YAML::Key << regressor.joint_name(j) << YAML::Value << motor.turns_with(j);
    out << YAML::EndMap << YAML::EndMap;
  }
  out << YAML::EndMap;
}

void write_ranges(YAML::Emitter& out, const Regressor& regressor, const std::vector<JointRange>& ranges) {
  if (ranges.empty()) return;
  out << YAML::Key << "ranges" << YAML::Value << YAML::BeginMap;
  for (std::size_t j = 0; j < ranges.size(); ++j) {
    out << YAML::Key << regressor.joint_name(static_cast<Index>(j)) << YAML::Value << YAML::BeginMap;
    for (std::size_t k = 0; k < ranged_infos.size(); ++k)
      if (const Span& span = ranges[j][k]; span.known())
        out << YAML::Key << std::string(ranged_infos[k].name) << YAML::Value << YAML::Flow
            << std::vector<double>{span.low, span.high};
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
}

/// Of joints with a band; nothing without values.
void write_of_band(YAML::Emitter& out, const DynamicsFit& fit, const std::string& name, const Eigen::VectorXd& values,
                   const Eigen::VectorXd& band) {
  if (values.size() == 0) return;
  out << YAML::Key << name << YAML::Value << YAML::BeginMap;
  for (Index j = 0; j < values.size(); ++j)
    if (std::isfinite(band(j)))
      out << YAML::Key << fit.joints[static_cast<std::size_t>(j)].name << YAML::Value << values(j);
  out << YAML::EndMap;
}

/// Empty where the file has none of that name; NaN of joints that it does not have.
std::vector<double> read_per_joint(Mapping& in, const std::string& name, const Regressor& robot) {
  std::vector<double> out;
  if (auto joints = in.mapping(name))
    for (Index j = 0; j < robot.joints(); ++j)
      out.push_back(joints->number_or(robot.joint_name(j), std::numeric_limits<double>::quiet_NaN(), {0, 1e9}));
  return out;
}

std::vector<JointRange> read_ranges(Mapping& in, const Regressor& regressor) {
  std::vector<JointRange> out;
  auto ranges = in.mapping("ranges");
  if (!ranges) return out;
  for (Index j = 0; j < regressor.joints(); ++j) {
    auto joint = ranges->mapping(regressor.joint_name(j));
    if (!joint) ranges->fail(regressor.joint_name(j), "is missing: every joint of the model has its ranges");
    auto& of_joint = out.emplace_back();
    for (std::size_t k = 0; k < ranged_infos.size(); ++k) {
      const std::string name(ranged_infos[k].name);
      if (!joint->has(name)) continue;
      const auto span = joint->numbers(name);
      if (span.size() != 2 || span[0] > span[1]) joint->fail(name, "must be [LOWEST, HIGHEST]");
      of_joint[k] = {span[0], span[1]};
    }
    joint->done();
  }
  ranges->done();
  return out;
}

/// Names of a rotor's friction parameters, in their order.
std::vector<std::string> friction_names(const friction::LawInfo& law, Directional beside, bool coupled,
                                        bool by_position) {
  std::vector<std::string> names;
  for (const auto& p : law.parameters) names.emplace_back(p.name);
  if (beside.offset && !coupled) names.emplace_back(offset_name);
  if (beside.asymmetry) names.emplace_back(asymmetry_name);
  if (by_position) names.emplace_back(cosine_name), names.emplace_back(sine_name);
  return names;
}

void write_consistent(YAML::Emitter& out, const DynamicsFit& fit, const BaseParameters& base,
                      const Regressor& regressor, const ConsistentDynamics& dynamics) {
  out << YAML::Key << "consistent" << YAML::Value << YAML::BeginMap << YAML::Key << "same" << YAML::Value
      << dynamics.same;
  if (!dynamics.same) {
    out << YAML::Key << "predict_worse" << YAML::Value << dynamics.predict_worse;
    out << YAML::Key << "residual_growth" << YAML::Value << YAML::Flow << YAML::BeginMap;
    for (std::size_t j = 0; j < fit.joints.size(); ++j)
      if (const double growth = dynamics.growth(static_cast<Index>(j)); std::isfinite(growth))
        out << YAML::Key << fit.joints[j].name << YAML::Value << growth;
    out << YAML::EndMap << YAML::Key << "base_parameters" << YAML::Value << YAML::BeginMap;
    for (Index k = 0; k < base.size(); ++k)
      out << YAML::Key << base.parameters[static_cast<std::size_t>(k)].name << YAML::Value
          << dynamics.parameters.base(k);
    out << YAML::EndMap << YAML::Key << "friction" << YAML::Value << YAML::BeginMap;
    for (std::size_t r = 0; r < fit.friction.size(); ++r) {
      if (r < fit.joints.size() && fit.joints[r].samples == 0) continue;
      out << YAML::Key << regressor.rotor_name(static_cast<Index>(r)) << YAML::Value << YAML::Flow << YAML::BeginMap;
      for (std::size_t p = 0; p < fit.friction[r].size(); ++p)
        out << YAML::Key << fit.friction[r][p].name << YAML::Value << dynamics.parameters.friction[r][p];
      out << YAML::EndMap;
    }
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
}

/// Into what is read of the file so far.
void read_consistent(Mapping& in, const Regressor& regressor, const BaseParameters& base, DynamicsFile& out) {
  auto found = in.mapping("consistent");
  if (!found) return;
  ConsistentDynamics dynamics{
      .same = found->flag_or("same", false), .parameters = out.parameters, .bodies = {}, .growth = {}};
  if (!dynamics.same) {
    dynamics.predict_worse = found->flag_or("predict_worse", false);
    dynamics.growth.setConstant(regressor.joints(), std::numeric_limits<double>::quiet_NaN());
    if (auto growth = found->mapping("residual_growth")) {
      for (Index j = 0; j < regressor.joints(); ++j)
        if (growth->has(regressor.joint_name(j)))
          dynamics.growth(j) = growth->number(regressor.joint_name(j), {0, 1e9});
      growth->done();
    }
    auto parameters = found->mapping("base_parameters"), friction = found->mapping("friction");
    if (!parameters || !friction) found->fail(parameters ? "friction" : "base_parameters", "is missing");
    for (Index k = 0; k < base.size(); ++k)
      dynamics.parameters.base(k) = parameters->number(base.parameters[static_cast<std::size_t>(k)].name);
    for (Index r = 0; r < regressor.rotors(); ++r) {
      if (!regressor.is_coupled(r) && !out.left_out[static_cast<std::size_t>(r)].empty()) continue;
      auto rotor = friction->mapping(regressor.rotor_name(r));
      if (!rotor) friction->fail(regressor.rotor_name(r), "is missing");
      auto value = dynamics.parameters.friction[static_cast<std::size_t>(r)].begin();
      for (const auto& name : friction_names(*out.law, out.directional, regressor.is_coupled(r),
                                             out.by_position[static_cast<std::size_t>(r)]))
        *value++ = rotor->number(name);
      rotor->done();
    }
    parameters->done(), friction->done();
  }
  found->done();
  out.consistent = std::move(dynamics);
}

/// Index of a joint that a file names.
int joint_of(const Mapping& in, const std::string& key, const std::string& name, const Regressor& robot) {
  for (Index j = 0; j < robot.joints(); ++j)
    if (robot.joint_name(j) == name) return static_cast<int>(j);
  in.fail(key, fmt::format("'{}' is no joint of the model; the file is one of another robot", name));
}

/// Per joint, the correlations of the parameters with a sigma, in their order.
void write_correlation(YAML::Emitter& out, const DynamicsFit& fit) {
  if (fit.friction_covariance.empty()) return;
  out << YAML::Key << "friction_correlation" << YAML::Value << YAML::BeginMap;
  for (std::size_t j = 0; j < fit.friction_covariance.size() && j < fit.joints.size(); ++j) {
    if (fit.joints[j].samples == 0) continue;
    const auto& covariance = fit.friction_covariance[j];
    std::vector<Index> with_sigma;
    for (Index p = 0; p < covariance.rows(); ++p)
      if (!std::isnan(fit.friction[j][static_cast<std::size_t>(p)].sigma)) with_sigma.push_back(p);
    out << YAML::Key << fit.joints[j].name << YAML::Value << YAML::Flow << YAML::BeginSeq;
    for (const Index a : with_sigma) {
      std::vector<double> row;
      for (const Index b : with_sigma) {
        const double r = covariance(a, b) / std::sqrt(covariance(a, a) * covariance(b, b));
        row.push_back(a == b ? 1 : std::isfinite(r) ? r : 0);
      }
      out << row;
    }
    out << YAML::EndSeq;
  }
  out << YAML::EndMap;
}

/// Into the covariance of a joint whose estimates are read.
void read_correlation(Mapping& all, FrictionEstimates& joint) {
  const YAML::Node rows = all.raw(joint.joint);
  std::vector<Index> with_sigma;
  for (std::size_t p = 0; p < joint.estimates.size(); ++p)
    if (!std::isnan(joint.estimates[p].sigma)) with_sigma.push_back(static_cast<Index>(p));
  const auto fits = [&](const YAML::Node& list) {
    return list && list.IsSequence() && list.size() == with_sigma.size();
  };
  const auto wrong = [&]() {
    all.fail(joint.joint,
             fmt::format("must be {0} lists of {0} numbers within -1 .. 1, for the parameters with a sigma",
                         with_sigma.size()));
  };
  if (!fits(rows)) wrong();
  for (std::size_t a = 0; a < with_sigma.size(); ++a) {
    if (!fits(rows[a])) wrong();
    for (std::size_t b = 0; b < with_sigma.size(); ++b) {
      const double r = rows[a][b].as<double>(2);
      if (!(std::abs(r) <= 1.000001)) wrong();
      const Index i = with_sigma[a], k = with_sigma[b];
      joint.covariance(i, k) =
          r * joint.estimates[static_cast<std::size_t>(i)].sigma * joint.estimates[static_cast<std::size_t>(k)].sigma;
    }
  }
}

void write_gains(YAML::Emitter& out, const std::vector<Estimate>& gains) {
  if (gains.empty()) return;
  out << YAML::Key << "drive_gains" << YAML::Value << YAML::BeginMap;
  for (const Estimate& e : gains)
    if (!std::isnan(e.value)) write(out, e);
  out << YAML::EndMap;
}

/// Per joint; empty where the file has none.
std::vector<Estimate> read_gains(Mapping& in, const Regressor& robot) {
  std::vector<Estimate> out;
  auto gains = in.mapping("drive_gains");
  if (!gains) return out;
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  for (Index j = 0; j < robot.joints(); ++j) {
    Estimate& e = out.emplace_back(Estimate{.name = robot.joint_name(j), .unit = {}, .value = nan});
    auto one = gains->mapping(e.name);
    if (!one) continue;
    e.unit = one->text("unit");
    if (e.unit != "1" && e.unit != "Nm/A" && e.unit != "N/A")
      one->fail("unit", "must be 1, of torque columns, or Nm/A or N/A, of currents");
    e.value = read_estimate(*gains, e.name, {1e-12, 1e12}, &e.sigma);
  }
  for (const auto& name : gains->names()) joint_of(*gains, name, name, robot);
  return out;
}

}  // namespace

Result<std::vector<FrictionEstimates>> read_friction(const std::filesystem::path& file) try {
  const YAML::Node root = load_yaml(file);
  refuse_other_kind(root, file.string(), "tribotwin dynamics");
  Mapping in(file.string(), "", root);
  const std::string law = in.text("friction_law");
  auto friction = in.mapping("friction"), correlation = in.mapping("friction_correlation"),
       largest = in.mapping("torque_max_nm"), coupling = in.mapping("coupling");
  if (!friction) in.fail("friction", "is missing: a mapping of joints");
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<FrictionEstimates> all;
  for (const auto& name : friction->names()) {
    if (coupling && coupling->has(name)) continue;
    auto parameters = friction->mapping(name);
    FrictionEstimates& joint =
        all.emplace_back(FrictionEstimates{.joint = name, .law = law, .estimates = {}, .covariance = {}});
    if (largest) joint.torque_max_nm = largest->number(name, {1e-9, 1e9});
    for (const auto& p : parameters->names()) {
      Estimate& e = joint.estimates.emplace_back(Estimate{.name = p, .unit = {}, .low = nan, .high = nan});
      e.value = read_estimate(*parameters, p, {}, &e.sigma);
    }
    const auto size = std::ssize(joint.estimates);
    joint.covariance = Eigen::MatrixXd::Constant(size, size, nan);
    for (Index p = 0; p < size; ++p)
      if (const double sigma = joint.estimates[static_cast<std::size_t>(p)].sigma; !std::isnan(sigma))
        joint.covariance(p, p) = sigma * sigma;
    joint.correlated = correlation && correlation->has(name);
    if (joint.correlated) read_correlation(*correlation, joint);
  }
  return all;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<std::vector<CoupledMotor>> read_coupling(const std::filesystem::path& file, const Regressor& robot) try {
  std::vector<CoupledMotor> motors;
  Mapping in(file.string(), "", load_yaml(file));
  auto coupling = in.mapping("coupling");
  if (!coupling) return motors;
  for (const auto& name : coupling->names()) {
    auto one = coupling->mapping(name);
    CoupledMotor motor{.name = name, .turns_with = Eigen::VectorXd::Zero(robot.joints())};
    motor.joint = joint_of(*one, "joint", one->text("joint"), robot);
    auto turns = one->mapping("turns_with");
    if (!turns) one->fail("turns_with", "is missing: joints and their coefficients");
    for (const auto& joint : turns->names())
      motor.turns_with(joint_of(*turns, joint, joint, robot)) = turns->number(joint, {-1e6, 1e6});
    one->done();
    motors.push_back(std::move(motor));
  }
  return motors;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

std::string to_yaml(const DynamicsFit& fit, const BaseParameters& base, const friction::LawInfo& law,
                    const Regressor& regressor, const Consistency& consistency, const DynamicsOrigin& origin) {
  const auto& thermal = origin.thermal;
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << YAML::BeginMap << YAML::Key << "model" << YAML::Value << origin.model << YAML::Key << "data" << YAML::Value
      << YAML::Flow << origin.data;
  out << YAML::Key << "friction_law" << YAML::Value << std::string(law.name);
  out << YAML::Key << "estimator" << YAML::Value << std::string(estimator_of(fit));
  out << YAML::Key << "signals" << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "cutoff_hz"
      << YAML::Value << origin.signals.cutoff_hz << YAML::Key << "recorded_velocity" << YAML::Value
      << origin.signals.recorded_velocity << YAML::Key << "reversals" << YAML::Value << origin.signals.reversals;
  if (origin.signals.turn_lead_s != 0) out << YAML::Key << "turn_lead_s" << YAML::Value << origin.signals.turn_lead_s;
  out << YAML::EndMap;
  write_coupling(out, regressor);
  write_gains(out, origin.drive_gains);
  if (!origin.torque_max_nm.empty()) {
    out << YAML::Key << "torque_max_nm" << YAML::Value << YAML::Flow << YAML::BeginMap;
    for (std::size_t j = 0; j < fit.joints.size(); ++j)
      out << YAML::Key << fit.joints[j].name << YAML::Value << origin.torque_max_nm[j];
    out << YAML::EndMap;
  }
  out << YAML::Key << "relative_error" << YAML::Value << fit.relative_error << YAML::Key << "condition_number"
      << YAML::Value << fit.condition_number;
  out << YAML::Key << "base_parameters" << YAML::Value << YAML::BeginMap;
  for (std::size_t k = 0; k < fit.base.size(); ++k) write(out, fit.base[k], base.parameters[k].group);
  out << YAML::EndMap << YAML::Key << "friction" << YAML::Value << YAML::BeginMap;
  for (std::size_t j = 0; j < fit.friction.size(); ++j) {
    if (j < fit.joints.size() && fit.joints[j].samples == 0) continue;
    out << YAML::Key << regressor.rotor_name(static_cast<Index>(j)) << YAML::Value << YAML::BeginMap;
    for (const auto& e : fit.friction[j]) write(out, e);
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
  write_correlation(out, fit);
  if (std::ranges::any_of(origin.left_out, [](const std::string& why) { return !why.empty(); })) {
    out << YAML::Key << "left_out" << YAML::Value << YAML::BeginMap;
    for (std::size_t j = 0; j < origin.left_out.size(); ++j)
      if (!origin.left_out[j].empty()) out << YAML::Key << fit.joints[j].name << YAML::Value << origin.left_out[j];
    out << YAML::EndMap;
  }
  if (!origin.lag.empty()) {
    out << YAML::Key << "lag" << YAML::Value << YAML::BeginMap;
    for (const Estimate& e : origin.lag) write(out, e);
    out << YAML::EndMap;
  }
  if (!thermal.empty()) {
    out << YAML::Key << "thermal" << YAML::Value << YAML::BeginMap;
    for (std::size_t j = 0; j < thermal.size(); ++j) {
      out << YAML::Key << fit.joints[j].name << YAML::Value << YAML::Flow << YAML::BeginMap;
      write(out, thermal[j]);
      out << YAML::EndMap;
    }
    out << YAML::EndMap;
  }
  out << YAML::Key << "noise" << YAML::Value << YAML::BeginMap;
  for (const auto& joint : fit.joints)
    if (joint.samples > 0) out << YAML::Key << joint.name << YAML::Value << joint.noise;
  out << YAML::EndMap << YAML::Key << "physically_possible" << YAML::Value << consistency.possible << YAML::Key
      << "distance_sigma" << YAML::Value << consistency.distance_sigma << YAML::Key << "chance" << YAML::Value
      << consistency.chance;
  write_of_band(out, fit, "band", origin.band, origin.band);
  write_of_band(out, fit, "band_independent", origin.band_independent, origin.band);
  write_ranges(out, regressor, origin.ranges);
  if (origin.consistent) write_consistent(out, fit, base, regressor, *origin.consistent);
  const Eigen::VectorXd& bodies = origin.consistent ? origin.consistent->bodies : consistency.parameters;
  out << YAML::Key << "nearest_consistent" << YAML::Value << YAML::BeginMap;
  for (std::size_t c = 0; c < regressor.columns().size(); ++c)
    out << YAML::Key << regressor.columns()[c].name << YAML::Value << bodies(static_cast<Index>(c));
  out << YAML::EndMap << YAML::EndMap;
  return "# A robot's dynamics by tribotwin dynamics; torques arm side, base parameters as groups of inertial "
         "parameters\n" +
         std::string(out.c_str()) + "\n";
}

Result<const friction::LawInfo*> dynamics_law(const std::string& name, const std::string& where,
                                              std::string_view also) {
  std::vector<const friction::LawInfo*> laws{&coulomb_viscous(), &coulomb_viscous_load(), &coulomb_viscous_stribeck(),
                                             &coulomb_viscous_load_stribeck()};
  for (const auto& law : friction::laws()) laws.push_back(&law);
  if (const auto law = std::ranges::find(laws, name, &friction::LawInfo::name); law != laws.end()) return *law;
  std::vector<std::string_view> names;
  for (const auto* law : laws) names.push_back(law->name);
  if (!also.empty()) names.push_back(also);
  return tl::unexpected(Error(fmt::format("{} '{}': no such friction; did you mean '{}'? There are {}", where, name,
                                          nearest(name, names), joined(names))));
}

Result<DynamicsFile> read_dynamics(const std::filesystem::path& file, const Regressor& regressor,
                                   const BaseParameters& base) try {
  const YAML::Node root = load_yaml(file);
  refuse_other_kind(root, file.string(), "tribotwin dynamics");
  Mapping in(file.string(), "", root);
  in.accept({"model",           "data",        "friction_law",         "estimator",          "signals",
             "coupling",        "drive_gains", "torque_max_nm",        "relative_error",     "condition_number",
             "base_parameters", "friction",    "friction_correlation", "left_out",           "lag",
             "thermal",         "noise",       "physically_possible",  "distance_sigma",     "band",
             "chance",          "ranges",      "consistent",           "nearest_consistent", "band_independent"});
  DynamicsFile out;
  out.law = or_wrong_input(dynamics_law(in.text("friction_law"), file.string() + ": friction_law"));
  auto parameters = in.mapping("base_parameters");
  if (!parameters) in.fail("base_parameters", "is missing: this is no file of tribotwin dynamics");
  out.parameters.base.resize(base.size());
  out.sigma.base.resize(base.size());
  for (const auto& name : parameters->names())
    if (std::ranges::find(base.parameters, name, &BaseParameters::Parameter::name) == base.parameters.end())
      parameters->fail(name, "is no base parameter of the model; the file is one of another robot");
  for (Index k = 0; k < base.size(); ++k)
    out.parameters.base(k) =
        read_estimate(*parameters, base.parameters[static_cast<std::size_t>(k)].name, {}, &out.sigma.base(k));
  out.left_out.resize(static_cast<std::size_t>(regressor.joints()));
  if (auto left_out = in.mapping("left_out")) {
    for (Index j = 0; j < regressor.joints(); ++j)
      out.left_out[static_cast<std::size_t>(j)] = left_out->text_or(regressor.joint_name(j), "");
    left_out->done();
  }
  auto friction = in.mapping("friction");
  if (!friction) in.fail("friction", "is missing: a mapping of joints");
  out.by_position.assign(static_cast<std::size_t>(regressor.rotors()), false);
  for (Index r = 0; r < regressor.rotors(); ++r) {
    if (!regressor.is_coupled(r) && !out.left_out[static_cast<std::size_t>(r)].empty()) {
      out.parameters.friction.emplace_back();
      out.sigma.friction.emplace_back();
      continue;
    }
    auto joint = friction->mapping(regressor.rotor_name(r));
    if (!joint)
      friction->fail(regressor.rotor_name(r), regressor.is_coupled(r)
                                                  ? "is missing: every motor of 'coupling' needs its friction"
                                                  : "is missing: every joint of the model needs its friction");
    auto &values = out.parameters.friction.emplace_back(), &sigmas = out.sigma.friction.emplace_back();
    const auto read = [&](std::string_view name, Bounds bounds = {}) {
      values.push_back(read_estimate(*joint, std::string(name), bounds, &sigmas.emplace_back()));
    };
    for (const auto& p : out.law->parameters) read(p.name);
    const Directional beside{.offset = joint->has(std::string(offset_name)),
                             .asymmetry = joint->has(std::string(asymmetry_name))};
    if (!regressor.is_coupled(r)) out.directional = beside;
    if (out.directional.offset && !regressor.is_coupled(r)) read(offset_name);
    if (out.directional.asymmetry) read(asymmetry_name, {-1, 1});
    if (may_depend_on_position(regressor, r) && joint->has(std::string(cosine_name))) {
      read(cosine_name), read(sine_name);
      out.by_position[static_cast<std::size_t>(r)] = true;
    }
    joint->done();
  }
  friction->done();
  // What is not known of a joint left out: no friction, no sigma.
  const std::size_t count = out.law->parameters.size() + static_cast<std::size_t>(out.directional.count());
  for (std::size_t j = 0; j < out.left_out.size(); ++j) {
    if (out.left_out[j].empty()) continue;
    out.parameters.friction[j].assign(count, 0.0);
    out.sigma.friction[j].assign(count, std::numeric_limits<double>::quiet_NaN());
  }
  if (auto signals = in.mapping("signals")) {
    out.signals.cutoff_hz = signals->number("cutoff_hz", {0, 1e6});
    out.signals.recorded_velocity = signals->flag_or("recorded_velocity", false);
    out.signals.reversals = signals->flag_or("reversals", false);
    out.signals.turn_lead_s = signals->number_or("turn_lead_s", 0, {-largest_lag_s, largest_lag_s});
    if (signals->has("reversal_periods")) (void)signals->number("reversal_periods", {0, 100});  // of earlier versions
    signals->done();
  }
  out.drive_gains = read_gains(in, regressor);
  if (auto lag = in.mapping("lag")) {
    for (Index j = 0; j < regressor.joints(); ++j)
      out.signals.lag_s.push_back(read_estimate(*lag, regressor.joint_name(j), {-largest_lag_s, largest_lag_s}));
    lag->done();
  }
  out.noise = read_per_joint(in, "noise", regressor);
  out.band = read_per_joint(in, "band", regressor);
  out.band_independent = read_per_joint(in, "band_independent", regressor);
  if (auto largest = in.mapping("torque_max_nm"))
    for (Index j = 0; j < regressor.joints(); ++j)
      out.torque_max_nm.push_back(largest->number(regressor.joint_name(j), {1e-9, 1e9}));
  if (auto thermal = in.mapping("thermal")) {
    for (Index j = 0; j < regressor.joints(); ++j) {
      auto joint = thermal->mapping(regressor.joint_name(j));
      if (!joint)
        thermal->fail(regressor.joint_name(j), "is missing: every joint of the model needs its thermal model");
      out.thermal.push_back(read_model(*joint));
    }
    thermal->done();
  }
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  out.possible = in.flag_or("physically_possible", true);
  out.distance_sigma = in.number_or("distance_sigma", nan, {0, 1e300});
  out.contradicted = contradicted(out.distance_sigma, base.size());
  out.chance = in.number_or("chance", nan, {0, 1});
  out.ranges = read_ranges(in, regressor);
  read_consistent(in, regressor, base, out);
  return out;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::identification
