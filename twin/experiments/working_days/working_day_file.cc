#include <algorithm>
#include <cmath>
#include <functional>

#include <tribotwin/twin/experiments/working_days/working_day_file.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/json_input.hpp>

namespace tribotwin::twin::repeatability {

using Json = nlohmann::json;

void to_json(Json& j, const Measured& m) { j = {m.value, std::isfinite(m.sigma) ? Json(m.sigma) : Json(nullptr)}; }
void to_json(Json& j, const Cycle& c) {
  j = {{"start_s", c.start_s}, {"base", c.base}, {"friction", c.friction}, {"level_nm", c.level_nm}};
}
void to_json(Json& j, const Warming& w) {
  j = {{"time_s", w.time_s}, {"power_w", w.power_w}, {"friction_nm", w.friction_nm}};
}
void to_json(Json& j, const Stretch& s) {
  j = {{"time_s", s.time_s}, {"measured_nm", s.measured_nm}, {"predicted_nm", s.predicted_nm}, {"moving", s.moving}};
}
void to_json(Json& j, const WorkingDay& d) {
  j = {{"ambient_degC", d.ambient_degC},
       {"cycles", d.cycles},
       {"warming", d.warming},
       {"base", d.base},
       {"friction", d.friction},
       {"base_of_robot", d.base_of_robot},
       {"friction_of_robot", d.friction_of_robot},
       {"cold", d.cold},
       {"hot", d.hot}};
  if (!d.warnings.empty()) j["warnings"] = d.warnings;
}

std::string to_text(const WorkingDay& day) { return dump_json(Json(day)) + "\n"; }

namespace {

constexpr Bounds times_s{0, 1e9};

Measured measured_of(const JsonInput& in) {
  const auto pair = in.list(2, 2);
  return {pair[0].number(), pair[1].number_or_null({0, 1e12})};
}

std::vector<Measured> measured_of(const JsonInput& in, std::size_t count) {
  std::vector<Measured> all;
  for (const auto& one : in.list(count, count)) all.push_back(measured_of(one));
  return all;
}

/// Of every joint, f1 .. f4.
std::vector<std::vector<Measured>> friction_of(const JsonInput& in, std::size_t joints) {
  std::vector<std::vector<Measured>> all;
  for (const auto& joint : in.list(joints, joints)) all.push_back(measured_of(joint, torque_parameters));
  return all;
}

std::vector<double> increasing(const JsonInput& in, std::size_t minimum) {
  auto all = in.numbers(minimum, static_cast<std::size_t>(-1), times_s);
  if (std::ranges::adjacent_find(all, std::greater_equal{}) != all.end()) in.fail("must increase from entry to entry");
  return all;
}

Warming warming_of(const JsonInput& in) {
  Warming w{.time_s = increasing(in["time_s"], 2)};
  w.power_w = in["power_w"].numbers(w.time_s.size(), w.time_s.size());
  w.friction_nm = in["friction_nm"].numbers(w.time_s.size(), w.time_s.size());
  return w;
}

Stretch stretch_of(const JsonInput& in, std::size_t joints) {
  Stretch s{.time_s = increasing(in["time_s"], 1)};
  const std::size_t n = s.time_s.size();
  for (const auto& joint : in["measured_nm"].list(joints, joints)) s.measured_nm.push_back(joint.numbers(n, n));
  for (const auto& joint : in["predicted_nm"].list(joints, joints)) s.predicted_nm.push_back(joint.numbers(n, n));
  for (const auto& joint : in["moving"].list(joints, joints)) {
    auto& of_joint = s.moving.emplace_back();
    for (const auto& one : joint.list(n, n)) of_joint.push_back(one.truth());
    if (std::ranges::find(of_joint, true) == of_joint.end())
      joint.fail("is false everywhere, but a joint that rests has no friction to predict");
  }
  return s;
}

WorkingDay day_of(const JsonInput& in, const Shape& shape) {
  WorkingDay day{.ambient_degC = in["ambient_degC"].number({-273.15, 1000})};
  for (const auto& cycle : in["cycles"].list(1))
    day.cycles.push_back({.start_s = cycle["start_s"].number(times_s),
                          .base = measured_of(cycle["base"], shape.base),
                          .friction = friction_of(cycle["friction"], shape.joints),
                          .level_nm = measured_of(cycle["level_nm"], shape.joints)});
  for (const auto& joint : in["warming"].list(shape.joints, shape.joints)) day.warming.push_back(warming_of(joint));
  day.base = measured_of(in["base"], shape.base);
  day.friction = friction_of(in["friction"], shape.joints);
  day.base_of_robot = in["base_of_robot"].numbers(shape.base, shape.base);
  for (const auto& joint : in["friction_of_robot"].list(shape.joints, shape.joints))
    day.friction_of_robot.push_back(joint.numbers(torque_parameters, torque_parameters));
  day.cold = stretch_of(in["cold"], shape.joints);
  day.hot = stretch_of(in["hot"], shape.joints);
  if (in.has("warnings"))
    for (const auto& warning : in["warnings"].list(1)) day.warnings.push_back(warning.text());
  return day;
}

}  // namespace

Result<WorkingDay> from_text(const std::string& text, const Shape& shape) {
  const Json root = parse_json(text);
  if (root.is_discarded()) return tl::unexpected(Error("is no JSON within the limits of readers"));
  try {
    return day_of(JsonInput(root, ""), shape);
  } catch (const InputError& e) {
    return tl::unexpected(Error(e.what()));
  }
}

}  // namespace tribotwin::twin::repeatability
