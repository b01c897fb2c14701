#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>
#include <tribotwin/twin/simulation/scenario_mark.hpp>

namespace tribotwin::twin {
namespace {

/// Keys whose values are files, by section; what these hold is added in their place.
constexpr std::pair<std::string_view, std::string_view> file_keys[] = {
    {"", "model"}, {"baseline", "model"}, {"motion", "file"}, {"motion", "columns"}};

void add(Fingerprint& mark, double value) { mark.add(std::span(&value, 1)); }

void add_keys(Fingerprint& mark, const std::string& resolved_yaml) {
  YAML::Node root = YAML::Load(resolved_yaml);
  for (const auto& [section, key] : file_keys) {
    YAML::Node in = section.empty() ? root : root.IsMap() ? root[std::string(section)] : YAML::Node();
    if (in.IsDefined() && in.IsMap()) in.remove(std::string(key));
  }
  mark.add(YAML::Dump(root));
}

/// With all arrays that the engine compiled: shapes, actuators and constraints, too.
void add(Fingerprint& mark, const mujoco::Model& model) {
  add(mark, static_cast<double>(fingerprint(model) >> 12));
  mark.add(std::string_view(static_cast<const char*>(model->buffer), static_cast<std::size_t>(model->nbuffer)));
}

void add(Fingerprint& mark, const SetPoints& points) {
  mark.add(points.time_s);
  for (const auto* columns : {&points.position_rad, &points.velocity_rad_s, &points.command_rad_s, &points.command_nm})
    for (const auto& column : *columns) mark.add(column);
  for (const bool on : points.torque_on) mark.add(on ? "1" : "0");
  for (const auto& [name, value] : points.numbers) mark.add(name), add(mark, value);
}

void add(Fingerprint& mark, const LoopGains& g) {
  for (const double x : {g.position_gain_1_s, g.speed_bandwidth_rad_s, g.integral_time_s, g.speed_gain_nm_s_rad,
                         g.torque_limit_nm, g.torque_gain})
    add(mark, x);
}

void add(Fingerprint& mark, const CascadedOptions& o) {
  add(mark, static_cast<double>(o.mode));
  for (const double x : {o.position_gain_1_s, o.speed_bandwidth_rad_s, o.integral_time_s, o.encoder_counts,
                         o.speed_filter_rad_s, o.gravity ? 1.0 : 0.0})
    add(mark, x);
  for (const LoopGains& gains : o.per_drive) add(mark, gains);
}

void add(Fingerprint& mark, const CompensatedOptions& o) {
  add(mark, o.loops);
  add(mark, o.identification_error);
}

void add(Fingerprint& mark, const std::vector<double>& values) { mark.add(values); }

void add(Fingerprint& mark, const std::vector<DcPositionOptions>& all) {
  static_assert(sizeof(DcPositionOptions) % sizeof(double) == 0);
  mark.add(std::span(reinterpret_cast<const double*>(all.data()), all.size() * sizeof(all[0]) / sizeof(double)));
}

void add(Fingerprint& mark, const PayloadChange& change) { add(mark, *change.model); }
void add(Fingerprint& mark, const AmbientChange& change) { add(mark, change.temperature_degC); }
void add(Fingerprint& mark, const Wear& wear) {
  mark.add(wear.joint);
  for (const auto& [name, factor] : wear.factors) mark.add(name), add(mark, factor);
}
void add(Fingerprint& mark, const FaultChange& fault) {
  mark.add(fault.type->name);
  for (const double x : {static_cast<double>(fault.drive), fault.severity, fault.growth_per_h}) add(mark, x);
}
void add(Fingerprint& mark, const Marker& marker) { mark.add(marker.text); }

}  // namespace

std::uint64_t scenario_mark(const Scenario& s) {
  Fingerprint mark;
  mark.add(mj_versionString());
  add_keys(mark, s.resolved_yaml);
  mark.add(s.name);
  for (const double x : {s.duration_s, static_cast<double>(s.seed), s.ambient_degC.value_or(-1e9)}) add(mark, x);
  mark.add(s.start_rad), mark.add(s.temperature_degC);
  add(mark, *s.model);
  add(mark, static_cast<double>(s.control.index()));
  std::visit([&](const auto& control) { add(mark, control); }, s.control);
  if (s.recording) add(mark, *s.recording);
  for (const Wave& w : s.waves)
    for (const double x : {static_cast<double>(w.control), w.offset, w.amplitude, w.frequency_hz, w.phase_rad})
      add(mark, x);
  for (const Event& event : s.events) {
    for (const double x : {event.time_s, static_cast<double>(event.what.index())}) add(mark, x);
    std::visit([&](const auto& what) { add(mark, what); }, event.what);
  }
  return mark.value();
}

}  // namespace tribotwin::twin
