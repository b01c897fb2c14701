#include <algorithm>
#include <array>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/simulation/event.hpp>
#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace tribotwin::twin {
namespace {

void read_payload(Mapping& in, const mujoco::Model& model, double, Event& event) {
  Payload p{.mass_kg = in.number("mass_kg", {0, 1e6})};
  if (in.has("com_m")) {
    const auto com = in.numbers("com_m", {-1e3, 1e3});
    if (com.size() != 3) in.fail("com_m", "must be three numbers [x, y, z]");
    std::ranges::copy(com, p.com_m.begin());
  }
  event.what = PayloadChange{or_wrong_input(with_payload(model, p))};
}

void read_ambient(Mapping& in, const mujoco::Model&, double, Event& event) {
  event.what = AmbientChange{in.number("temperature_degC", {-100, 300})};
}

void read_fault(Mapping& in, const mujoco::Model& model, double duration_s, Event& event) {
  const std::size_t drive = drive_index(model, in, "joint", in.text("joint"));
  const double growth_per_h = in.number_or("growth_per_h", 0, {0, 1e6});
  const auto fault = fault_of(in, "fault", model, drive, growth_per_h * (duration_s - event.time_s) / 3600);
  event.what = FaultChange{drive, fault.type, fault.severity, growth_per_h};
}

/// One row per type of event.
constexpr std::pair<std::string_view, void (*)(Mapping&, const mujoco::Model&, double duration_s, Event&)>
    event_types[] = {
        {"payload", read_payload},
        {"ambient", read_ambient},
        {"wear",
         [](Mapping& in, const mujoco::Model& model, double, Event& event) { event.what = read_wear(in, model); }},
        {"fault", read_fault},
        {"marker",
         [](Mapping& in, const mujoco::Model&, double, Event& event) { event.what = Marker{read_marker(in)}; }},
};

}  // namespace

std::string read_marker(Mapping& in) {
  constexpr std::size_t longest = 200;
  std::string text = in.text("text");
  if (text.size() > longest)
    in.fail("text", fmt::format("is {} bytes long, but at most {} are kept", text.size(), longest));
  return text;
}

Event read_event(Mapping in, const mujoco::Model& model, double duration_s) {
  Event event;
  event.time_s = in.number("time_s", {0, duration_s});
  choice_of(in, "type", event_types)(in, model, duration_s, event);
  in.done();
  return event;
}

std::string with_event(const std::string& resolved_yaml, const YAML::Node& event) {
  YAML::Node root = YAML::Load(resolved_yaml);
  root["events"].push_back(event);
  return to_text(root);
}

Wear read_wear(Mapping& in, const mujoco::Model& model) {
  Wear wear{.joint = in.text("joint")};
  const auto& law = model.drives()[drive_index(model, in, "joint", wear.joint)].drive.law;
  auto factors = in.mapping("factors");
  if (!factors) in.fail("factors", "is missing: a mapping from parameters of the law to factors");
  for (const auto& name : factors->names()) {
    std::vector<std::string_view> accepted;
    for (const auto& p : law.info->parameters) accepted.push_back(p.name);
    if (std::ranges::find(accepted, name) == accepted.end())
      factors->fail(name, fmt::format("is no parameter of law '{}'; did you mean '{}'?", law.info->name,
                                      nearest(name, accepted)));
    wear.factors[name] = factors->number(name, {0, 1000});
  }
  return wear;
}

std::size_t drive_index(const mujoco::Model& model, const Mapping& mapping, const std::string& key,
                        const std::string& joint) {
  const auto found = find_drive(model, joint);
  if (!found) mapping.fail(key, found.error().message);
  return *found;
}

FaultSetting fault_of(Mapping& in, const std::string& type_key, const mujoco::Model& model, std::size_t drive,
                      double growth) {
  std::vector<std::string_view> names;
  for (const auto& fault : drive::faults()) names.push_back(fault.name);
  const drive::FaultInfo* type = drive::find_fault(in.choice(type_key, names));
  const double severity = in.number("severity", {0, type->maximum}), final_severity = severity + growth;
  if (final_severity > type->maximum)
    in.fail("growth_per_h", fmt::format("makes a severity of {:.4g} by the end, but that of '{}' is {:g} at most",
                                        final_severity, type->name, type->maximum));
  drive::Faults faults{};
  type->add(faults, final_severity);
  const auto& binding = model.drives()[drive];
  drive::Drive faulty = binding.drive;
  faulty.law = drive::with_faults(faulty.law, faults);
  if (auto carried = mujoco::bind(model.get(), faulty, binding.actuator); !carried)
    in.fail("severity",
            fmt::format("of {:.4g} is more than can be simulated: {}", final_severity, carried.error().message));
  return {type, severity};
}

}  // namespace tribotwin::twin
