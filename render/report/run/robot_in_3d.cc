#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/render/report/run/robot_in_3d.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/live/protocol/geometry.hpp>

namespace tribotwin::render {
namespace {

using Json = nlohmann::json;

constexpr std::size_t moments_shown = 60, moments_of_a_cycle = 12;
constexpr std::size_t triangles = 20'000, shapes = 4'000;

/// To a hundred-thousandth: 0.01 mm.
double rounded(double value) { return std::round(1e5 * value) / 1e5; }

Json moment_json(const mujoco::Model& model, mjData* d, const PoseState& state) {
  std::ranges::copy(state.qpos, d->qpos);
  pose_kinematics(model.get(), d);
  std::vector<float> pose(twin::live::pose_numbers * static_cast<std::size_t>(model.get()->nbody));
  twin::live::read_poses(model.get(), d, pose);
  Json numbers = Json::array(), degC = Json::array();
  for (const float value : pose) numbers.push_back(rounded(static_cast<double>(value)));
  for (const JointState& joint : state.joints)
    degC.push_back(std::isfinite(joint.temperature_degC) ? Json(rounded(joint.temperature_degC)) : Json(nullptr));
  return {{"time", duration(*state.time_s)},
          {"time_s", *state.time_s},
          {"degC", std::move(degC)},
          {"pose", std::move(numbers)}};
}

bool has_shapes(const Json& geometry) {
  return std::ranges::any_of(geometry["bodies"], [](const Json& body) { return !body["geoms"].empty(); });
}

std::string caption_of(const Json& geometry, std::size_t moments, bool strobes) {
  std::string text =
      moments == 1
          ? "The only moment of the run, with its pose and temperatures."
          : fmt::format("{} moments from the beginning to the end, each with its own pose and temperatures.", moments);
  if (strobes) text += " Each is in a later work cycle than the one before, and farther in it.";
  std::size_t simplified = 0;
  for (const Json& mesh : geometry["meshes"]) simplified += mesh["faces"].size() / 3 < mesh["faces_of_model"];
  if (simplified > 0) text += fmt::format(" {} of {} meshes are simplified.", simplified, geometry["meshes"].size());
  if (const std::size_t left_out = geometry["left_out"]; left_out > 0)
    text += fmt::format(" {} shapes are left out.", left_out);
  return text +
         " Drag, pinch or use the keys to turn and zoom; a click names the joint of a part, and lets the "
         "wheel zoom.";
}

}  // namespace

void show_robot(Page& page, pugi::xml_node to, const mujoco::Model& model, const Moments& moments, Scale scale) {
  const auto refuse = [&](const std::string& why) {
    page.add(to, "p", fmt::format("The robot is not shown in 3-D: {}.", why), "soft");
  };
  const twin::live::GeometryLimits limits{.triangles = triangles, .geoms = shapes, .groups = groups_shown(model.get())};
  Json all{{"geometry", Json::parse(twin::live::geometry_json(model, limits))}, {"scale", {scale.from, scale.to}}};
  if (!has_shapes(all["geometry"])) return refuse("its model has no visible shape");
  const auto data = model.make_data();
  const std::vector<double> times = moments.strobe_times(moments_shown, moments_of_a_cycle);
  Json& shown = all["moments"];
  for (const double time_s : times) {
    Json moment = moment_json(model, data.get(), moments.at(time_s));
    if (shown.empty() || shown.back()["time_s"] < moment["time_s"]) shown.push_back(std::move(moment));
  }
  for (const JointState& joint : moments.at(moments.begin_s()).joints) all["joints"].push_back(joint.name);
  const std::string packed = deflated(twin::dump_json(all));
  if (packed.size() > robot_bytes_max)
    return refuse(fmt::format("its shapes and poses need {} kB compressed, a page has at most {} kB for them",
                              packed.size() / 1000, robot_bytes_max / 1000));
  const bool strobes = times.size() > 1 && moments.period_s() > 0 && times[1] - times[0] > moments.period_s();
  page.add_robot(to, packed, caption_of(all["geometry"], shown.size(), strobes));
}

}  // namespace tribotwin::render
