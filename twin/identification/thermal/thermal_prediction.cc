#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/estimates_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_band.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_prediction.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::ranges::find(names, name) != names.end();
}

void read_chain_rows(Mapping& in, ThermalParameters& out) {
  const auto lacking = in.texts("unidentifiable");
  const auto add = [&](Mapping& from, const std::string& joint, const char* name, const char* unit) {
    ThermalParameters::Row row{joint, {.name = name, .unit = unit}};
    row.estimate.value = read_estimate(from, name, {}, &row.estimate.sigma);
    row.identifiable = !contains(lacking, joint == "all" ? std::string(name) : joint + "." + name);
    out.rows.push_back(std::move(row));
  };
  add(in, "all", "exchange", "1/s");
  auto joints = in.mapping("chain");
  for (const auto& joint : joints->names()) {
    auto one = joints->mapping(joint);
    add(*one, joint, "gain", "K/J");
    add(*one, joint, "t", "s");
    add(*one, joint, "T_amb", "degC");
  }
}

void read_joint_rows(Mapping& in, const std::vector<NamedThermalModel>& models, ThermalParameters& out) {
  auto joints = in.mapping("joints");
  for (const auto& named : models) {
    const auto& [joint, model, uncertainty] = named;
    if (uncertainty && !out.surroundings) out.surroundings = uncertainty->surroundings;
    auto one = joints->mapping(joint);
    const auto lacking = one->texts("unidentifiable");
    auto sigma = one->mapping("sigma");
    const auto add = [&](const std::string& name, const std::string& unit, double value) {
      const bool known = sigma && sigma->has(name);
      out.rows.push_back({joint,
                          {.name = name, .unit = unit, .value = value, .sigma = known ? sigma->number(name) : none},
                          !contains(lacking, name)});
    };
    const auto values = thermal::values(model);
    for (std::size_t k = 0; k < values.size(); ++k) {
      const auto& p = thermal::parameters(model.order)[k];
      add(std::string(p.name), std::string(p.unit), values[k]);
    }
  }
}

/// What is predicted of the sessions of one joint.
using Sessions = std::vector<PredictedSession>;

Result<std::vector<Sessions>> of_chain(const std::filesystem::path& file, const ThermalRecordings& recordings,
                                       const std::vector<bool>& seen) {
  const auto known = read_thermal_chain(file);
  if (!known) return tl::unexpected(known.error());
  const auto& joints = recordings.joints;
  if (!std::ranges::equal(joints, known->chain.joints, {}, &JointHeat::name))
    return tl::unexpected(Error(fmt::format("{}: chain: its joints are {}, those of {} are not, in this order",
                                            file.string(), joined(known->chain.joints), recordings.files.front())));
  std::vector<Sessions> out(joints.size());
  for (std::size_t s = 0; s < joints.front().sessions.size(); ++s) {
    const auto predicted = predicted_temperatures(known->chain, joints, s);
    Eigen::MatrixXd half;
    if (known->uncertainty)
      half = half_widths_K(known->chain, *known->uncertainty, joints, s, seen[joints.front().sessions[s].file]);
    for (Eigen::Index k = 0; k < predicted.rows(); ++k) {
      PredictedSession& one = out[static_cast<std::size_t>(k)].emplace_back();
      one.temperature_degC = {predicted.row(k).begin(), predicted.row(k).end()};
      if (half.size()) one.half_width_K = {half.row(k).begin(), half.row(k).end()};
    }
  }
  return out;
}

Result<std::vector<Sessions>> of_joints(const std::filesystem::path& file, const ThermalRecordings& recordings,
                                        const std::vector<bool>& seen) {
  const auto models = read_thermal(file);
  if (!models) return tl::unexpected(models.error());
  std::vector<Sessions> out;
  for (const auto& joint : recordings.joints) {
    const auto known = std::ranges::find(*models, joint.name, &NamedThermalModel::joint);
    if (known == models->end())
      return tl::unexpected(Error(fmt::format("{}: joints: has no '{}', of which {} has a temperature", file.string(),
                                              joint.name, recordings.files[joint.sessions.front().file])));
    Sessions& own = out.emplace_back();
    for (const auto& session : joint.sessions) {
      PredictedSession& one = own.emplace_back();
      one.temperature_degC = predicted_temperature(known->model, session);
      if (known->uncertainty)
        one.half_width_K = half_width_K(known->model, *known->uncertainty, session, seen[session.file]);
    }
  }
  return out;
}

void compare(PredictedSession& with, const std::vector<double>& recorded) {
  double squares = 0, inside = 0;
  for (std::size_t i = 0; i < recorded.size(); ++i) {
    const double error = with.temperature_degC[i] - recorded[i];
    squares += error * error;
    with.largest_K = std::max(with.largest_K, std::abs(error));
    if (i > 0 && !with.half_width_K.empty()) inside += std::abs(error) <= with.half_width_K[i];
  }
  with.rms_K = std::sqrt(squares / static_cast<double>(recorded.size()));
  with.inside = inside / std::max(1.0, static_cast<double>(recorded.size()) - 1);
}

}  // namespace

Result<ThermalParameters> read_thermal_parameters(const std::filesystem::path& file) try {
  const YAML::Node root = load_yaml(file);
  Mapping in(file.string(), "", root);
  ThermalParameters out{.chain = static_cast<bool>(root["chain"])};
  if (out.chain) {
    const auto known = read_thermal_chain(file);
    if (!known) return tl::unexpected(known.error());
    if (known->uncertainty) out.surroundings = known->uncertainty->surroundings;
    read_chain_rows(in, out);
  } else {
    auto models = read_thermal(file);
    if (!models) return tl::unexpected(models.error());
    read_joint_rows(in, *models, out);
  }
  out.data = in.texts("data");
  return out;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<std::vector<std::vector<PredictedSession>>> predict_temperatures(const std::filesystem::path& parameters,
                                                                        const ThermalRecordings& recordings) {
  for (const auto& joint : recordings.joints)
    for (const auto& session : joint.sessions)
      if (session.temperature_degC.empty())
        return tl::unexpected(Error(fmt::format("{}: has no column temperature_{}_degC to compare with",
                                                recordings.files[session.file], joint.name)));
  const auto known = read_thermal_parameters(parameters);
  if (!known) return tl::unexpected(known.error());
  const std::vector<bool> seen = of_the_fit(recordings.files, known->data, parameters);
  auto all = known->chain ? of_chain(parameters, recordings, seen) : of_joints(parameters, recordings, seen);
  if (!all) return all;
  for (std::size_t k = 0; k < all->size(); ++k)
    for (std::size_t s = 0; s < (*all)[k].size(); ++s)
      compare((*all)[k][s], recordings.joints[k].sessions[s].temperature_degC);
  return all;
}

std::vector<bool> of_the_fit(const std::vector<std::string>& files, const std::vector<std::string>& data,
                             const std::filesystem::path& parameters) {
  std::vector<bool> out;
  for (const auto& file : files)
    out.push_back(std::ranges::any_of(data, [&](const std::string& name) {
      std::error_code error;
      const auto own = named_file(name, parameters);
      return own && std::filesystem::equivalent(file, *own, error);
    }));
  return out;
}

}  // namespace tribotwin::twin::identification
