#include <cmath>

#include <tribotwin/twin/identification/estimates_file.hpp>
#include <tribotwin/twin/identification/thermal/model_keys.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>

namespace tribotwin::twin::identification {

void write(YAML::Emitter& out, const thermal::Model& model) {
  out << YAML::Key << "thermal" << YAML::Value << std::string(thermal::name(model.order)) << YAML::Key << "T_amb"
      << YAML::Value << model.T_amb_degC;
  const auto values = thermal::values(model);
  for (std::size_t k = 0; k < values.size(); ++k)
    out << YAML::Key << std::string(thermal::parameters(model.order)[k].name) << YAML::Value << values[k];
}

thermal::Model read_model(Mapping& in, std::vector<std::string_view> beside) {
  std::vector<std::string_view> names;  // of models that warm up
  for (const auto& m : thermal::models())
    if (m.nodes > 0) names.push_back(m.name);
  const auto order = thermal::find_model(in.choice("thermal", names))->order;
  beside.insert(beside.end(), {"thermal", "T_amb"});
  for (const auto& p : thermal::parameters(order)) beside.push_back(p.name);
  in.accept(beside);
  std::vector<double> values;
  for (const auto& p : thermal::parameters(order))
    values.push_back(std::max(
        p.minimum, in.number(std::string(p.name), {0, p.maximum})));  // the gain is 0 where the power had no effect
  return thermal::make_model(order, in.number("T_amb", {-100, 300}), values);
}

std::string to_yaml(const std::vector<NamedThermalFit>& joints, const std::vector<std::string>& data) {
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << YAML::BeginMap << YAML::Key << "data" << YAML::Value << YAML::Flow << data << YAML::Key << "joints"
      << YAML::Value << YAML::BeginMap;
  for (const auto& [joint, fit] : joints) {
    out << YAML::Key << joint << YAML::Value << YAML::BeginMap;
    write(out, fit.model);
    out << YAML::Key << "sigma" << YAML::Value << YAML::Flow << YAML::BeginMap;
    for (const auto& e : fit.parameters)
      if (!std::isnan(e.sigma)) out << YAML::Key << e.name << YAML::Value << e.sigma;
    out << YAML::EndMap << YAML::Key << "unidentifiable" << YAML::Value << YAML::Flow << fit.unidentifiable;
    out << YAML::Key << "rms_K" << YAML::Value << fit.rms_K;
    if (fit.uncertainty) write(out, *fit.uncertainty);
    out << YAML::EndMap;
  }
  out << YAML::EndMap << YAML::EndMap;
  return "# Thermal models by tribotwin thermal; names and units as in plugins/README.md\n" + std::string(out.c_str()) +
         "\n";
}

Result<std::vector<NamedThermalModel>> read_thermal(const std::filesystem::path& file) try {
  const YAML::Node root = load_yaml(file);
  refuse_other_kind(root, file.string(), "tribotwin thermal");
  Mapping in(file.string(), "", root);
  in.accept({"data", "joints"});
  auto joints = in.mapping("joints");
  if (!joints) in.fail("joints", "is missing: this is no file of tribotwin thermal");
  std::vector<NamedThermalModel> out;
  for (const auto& name : joints->names()) {
    auto joint = joints->mapping(name);
    auto& one = out.emplace_back(
        NamedThermalModel{name, read_model(*joint, {"sigma", "unidentifiable", "rms_K", "uncertainty"})});
    if (auto known = joint->mapping("uncertainty"))
      one.uncertainty = read_uncertainty(*known, std::ssize(thermal::parameters(one.model.order)) + 1);
  }
  return out;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::identification
