#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/estimates_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_prediction.hpp>
#include <tribotwin/twin/io/input.hpp>
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
    const std::string& joint = named.first;
    const thermal::Model& model = named.second;
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

using Temperatures = std::vector<std::vector<double>>;  // per session

Result<std::vector<Temperatures>> of_chain(const std::filesystem::path& file, const ThermalRecordings& recordings) {
  const auto chain = read_thermal_chain(file);
  if (!chain) return tl::unexpected(chain.error());
  const auto& joints = recordings.joints;
  if (!std::ranges::equal(joints, chain->joints, {}, &JointHeat::name))
    return tl::unexpected(Error(fmt::format("{}: chain: its joints are {}, those of {} are not, in this order",
                                            file.string(), joined(chain->joints), recordings.files.front())));
  std::vector<Temperatures> out(joints.size());
  for (std::size_t s = 0; s < joints.front().sessions.size(); ++s) {
    const auto predicted = predicted_temperatures(*chain, joints, s);
    for (std::size_t k = 0; k < joints.size(); ++k) {
      const auto own = predicted.row(static_cast<Eigen::Index>(k));
      out[k].emplace_back(own.begin(), own.end());
    }
  }
  return out;
}

Result<std::vector<Temperatures>> of_joints(const std::filesystem::path& file, const ThermalRecordings& recordings) {
  const auto models = read_thermal(file);
  if (!models) return tl::unexpected(models.error());
  std::vector<Temperatures> out;
  for (const auto& joint : recordings.joints) {
    const auto model = std::ranges::find(*models, joint.name, [](const auto& m) { return m.first; });
    if (model == models->end())
      return tl::unexpected(Error(fmt::format("{}: joints: has no '{}', of which {} has a temperature", file.string(),
                                              joint.name, recordings.files[joint.sessions.front().file])));
    auto& own = out.emplace_back();
    for (const auto& session : joint.sessions) own.push_back(predicted_temperature(model->second, session));
  }
  return out;
}

PredictedSession compared(std::vector<double> predicted, const std::vector<double>& recorded) {
  PredictedSession out{.temperature_degC = std::move(predicted)};
  double squares = 0;
  for (std::size_t i = 0; i < recorded.size(); ++i) {
    const double error = out.temperature_degC[i] - recorded[i];
    squares += error * error;
    out.largest_K = std::max(out.largest_K, std::abs(error));
  }
  out.rms_K = std::sqrt(squares / static_cast<double>(recorded.size()));
  return out;
}

}  // namespace

Result<ThermalParameters> read_thermal_parameters(const std::filesystem::path& file) try {
  const YAML::Node root = load_yaml(file);
  Mapping in(file.string(), "", root);
  ThermalParameters out;
  const bool chain = static_cast<bool>(root["chain"]);
  if (chain) {
    if (auto right = read_thermal_chain(file); !right) return tl::unexpected(right.error());
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
  const auto chain = is_thermal_chain(parameters);
  if (!chain) return tl::unexpected(chain.error());
  auto all = *chain ? of_chain(parameters, recordings) : of_joints(parameters, recordings);
  if (!all) return tl::unexpected(all.error());
  std::vector<std::vector<PredictedSession>> out(all->size());
  for (std::size_t k = 0; k < all->size(); ++k)
    for (std::size_t s = 0; s < (*all)[k].size(); ++s)
      out[k].push_back(compared(std::move((*all)[k][s]), recordings.joints[k].sessions[s].temperature_degC));
  return out;
}

}  // namespace tribotwin::twin::identification
