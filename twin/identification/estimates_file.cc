#include <cmath>
#include <limits>

#include <fmt/format.h>

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

void refuse_other_kind(const YAML::Node& root, const std::string& file, std::string_view writer) {
  static constexpr struct {
    std::string_view writer, key, beside;
  } kinds[] = {{"tribotwin identify", "law", "parameters"},
               {"tribotwin dynamics", "base_parameters", "friction"},
               {"tribotwin thermal --chain", "chain", "exchange"},
               {"tribotwin thermal", "joints", "data"},
               {"tribotwin diagnose learn", "thresholds", "indicators"},
               {"a scenario of tribotwin run", "model", "duration_s"}};
  if (!root.IsMap()) return;
  for (const auto& kind : kinds)
    if (root[std::string(kind.key)] && root[std::string(kind.beside)]) {
      if (kind.writer == writer) return;
      throw InputError(fmt::format("{}: is {}{}; a file of {} is needed here", file,
                                   kind.writer.starts_with("a ") ? "" : "a file of ", kind.writer, writer));
    }
}

double read_estimate(Mapping& in, const std::string& name, Bounds bounds, double* sigma) {
  auto entry = in.mapping(name);
  if (!entry) in.fail(name, "is missing");
  entry->accept({"value", "sigma", "unit", "group"});
  if (sigma)
    *sigma = entry->has("sigma") ? entry->number("sigma", {0, 1e300}) : std::numeric_limits<double>::quiet_NaN();
  return entry->number("value", bounds);
}

}  // namespace tribotwin::twin::identification
