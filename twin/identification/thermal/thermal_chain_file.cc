#include <tribotwin/twin/identification/estimates_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain_file.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin::identification {

std::string to_yaml(const ThermalChainFit& fit, const std::vector<std::string>& data) {
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << YAML::BeginMap << YAML::Key << "data" << YAML::Value << YAML::Flow << data << YAML::Key << "rms_K"
      << YAML::Value << fit.rms_K;
  out << YAML::Key << "unidentifiable" << YAML::Value << YAML::Flow << fit.unidentifiable;
  write(out, fit.exchange);
  if (fit.chain.winding != ChainWinding{})
    out << YAML::Key << "winding" << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "winding_s"
        << YAML::Value << fit.chain.winding.winding_s << YAML::Key << "copper_1_K" << YAML::Value
        << fit.chain.winding.copper_1_K << YAML::EndMap;
  out << YAML::Key << "chain" << YAML::Value << YAML::BeginMap;
  for (std::size_t j = 0; j < fit.parameters.size(); ++j) {
    out << YAML::Key << fit.chain.joints[j] << YAML::Value << YAML::BeginMap;
    for (const auto& e : fit.parameters[j]) write(out, e);
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
  if (fit.uncertainty) write(out, *fit.uncertainty);
  out << YAML::EndMap;
  return "# A chain of joints that warm each other, by tribotwin thermal --chain\n" + std::string(out.c_str()) + "\n";
}

Result<KnownThermalChain> read_thermal_chain(const std::filesystem::path& file) try {
  Mapping in(file.string(), "", load_yaml(file));
  in.accept({"data", "rms_K", "unidentifiable", "exchange", "winding", "chain", "uncertainty"});
  ThermalChain chain{.exchange_1_s = read_estimate(in, "exchange", {0, 1})};
  if (auto winding = in.mapping("winding")) {
    winding->accept({"winding_s", "copper_1_K"});
    chain.winding = {winding->number("winding_s", {0, 1e6}), winding->number("copper_1_K", {0, 0.02})};
  }
  auto joints = in.mapping("chain");
  if (!joints) in.fail("chain", "is missing: this is no file of tribotwin thermal --chain");
  for (const auto& name : joints->names()) {
    auto joint = joints->mapping(name);
    joint->accept({"gain", "t", "T_amb"});
    chain.joints.push_back(name);
    chain.gain_K_J.push_back(read_estimate(*joint, "gain", {0, 1e9}));
    chain.t_s.push_back(read_estimate(*joint, "t", {1e-3, 1e9}));
    chain.ambient_degC.push_back(read_estimate(*joint, "T_amb", {lowest_ambient_degC, highest_ambient_degC}));
  }
  KnownThermalChain out{std::move(chain)};
  if (auto known = in.mapping("uncertainty"))
    out.uncertainty = read_uncertainty(*known, 1 + 3 * std::ssize(out.chain.joints));
  return out;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::identification
