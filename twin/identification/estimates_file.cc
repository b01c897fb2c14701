#include <cmath>

#include <tribotwin/twin/identification/estimates_file.hpp>

namespace tribotwin::twin::identification {

void write(YAML::Emitter& out, const Estimate& e, const std::string& group) {
  out << YAML::Key << e.name << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "value" << YAML::Value
      << e.value;
  if (!std::isnan(e.sigma)) out << YAML::Key << "sigma" << YAML::Value << e.sigma;
  out << YAML::Key << "unit" << YAML::Value << e.unit;
  if (!group.empty()) out << YAML::Key << "group" << YAML::Value << YAML::DoubleQuoted << group;
  out << YAML::EndMap;
}

double read_estimate(Mapping& in, const std::string& name, Bounds bounds) {
  auto entry = in.mapping(name);
  if (!entry) in.fail(name, "is missing");
  entry->accept({"value", "sigma", "unit", "group"});
  return entry->number("value", bounds);
}

}  // namespace tribotwin::twin::identification
