#include <algorithm>
#include <cmath>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/robot/native_model.hpp>

namespace tribotwin::twin {
namespace {

constexpr int speed_count = 200;

/// frictionloss F and damping D, both >= 0, that come nearest to the friction at these speeds.
Eigen::Vector2d fitted(const Eigen::ArrayXd& speed, const Eigen::ArrayXd& friction) {
  Eigen::MatrixXd basis(speed.size(), 2);
  basis << Eigen::VectorXd::Ones(speed.size()), speed.matrix();
  const Eigen::Vector2d both = least_squares_solution(basis, friction.matrix());
  if (both[1] < 0) return {friction.mean(), 0};
  if (both[0] < 0) return {0, (speed * friction).sum() / speed.square().sum()};
  return both;
}

Result<NativeFriction> fit(const mujoco::Binding& b, const std::string& joint, std::optional<double> temperature_degC,
                           std::optional<double> speed_max_rad_s) {
  const friction::Range& range = b.drive.law.range;
  NativeFriction n{.joint = joint, .temperature_degC = temperature_degC.value_or(b.drive.thermal.T_amb_degC)};
  if (b.drive.law.info->temperature_dependent) {
    const double low = range.temperature_min_degC, high = range.temperature_max_degC;
    if (!temperature_degC) n.temperature_degC = std::clamp(n.temperature_degC, low, high);
    if (!(n.temperature_degC >= low && n.temperature_degC <= high))
      return tl::unexpected(
          fmt::format("joint '{}': the law is identified for {:g} .. {:g} degC, not for {:g} degC; "
                      "choose a temperature within (--temperature)",
                      joint, low, high, n.temperature_degC));
  }
  n.speed_max_rad_s = speed_max_rad_s.value_or(range.speed_max_rad_s / b.drive.speed_scale());
  if (!std::isfinite(n.speed_max_rad_s))
    return tl::unexpected(
        fmt::format("joint '{}': its law has no end of speed; give the fastest joint speed (--joint-speed)", joint));
  const Eigen::ArrayXd speed =
      Eigen::ArrayXd::LinSpaced(speed_count, n.speed_max_rad_s / speed_count, n.speed_max_rad_s);
  drive::Drive symmetric = b.drive;
  symmetric.asymmetry = 0;
  const Eigen::ArrayXd friction =
      speed.unaryExpr([&](double qd) { return mujoco::friction_nm(symmetric, qd, 0, n.temperature_degC); });
  const Eigen::Vector2d native = fitted(speed, friction);
  // Native elements know neither directions nor an offset: those are errors, of opposite sign in the two directions.
  const Eigen::ArrayXd error = native[0] + native[1] * speed - friction,
                       of_direction = b.drive.asymmetry * friction + b.drive.offset_nm;
  n.frictionloss_nm = native[0];
  n.damping_nm_s_rad = native[1];
  n.rms_error_nm = std::sqrt((error.square() + of_direction.square()).mean());
  n.max_error_nm = (error.abs() + of_direction.abs()).maxCoeff();
  n.friction_min_nm = friction.minCoeff();
  n.friction_max_nm = friction.maxCoeff();
  return n;
}

void set(pugi::xml_node element, const char* attribute, double value) {
  element.remove_attribute(attribute);
  element.append_attribute(attribute) = fmt::format("{:.6g}", value).c_str();
}

pugi::xml_node named(const pugi::xml_document& document, const char* path, const std::string& name) {
  for (const auto& match : document.select_nodes(path))
    if (match.node().attribute("name").value() == name) return match.node();
  return {};
}

void remove_all(pugi::xml_document& document, const char* path) {
  for (const auto& match : document.select_nodes(path)) match.node().parent().remove_child(match.node());
}

std::string comment(const NativeFriction& n) {
  return fmt::format(
      " Friction of the drive without load at {:g} degC, {:.4g} .. {:.4g} Nm up to {:.4g} rad/s, as frictionloss and "
      "damping: error {:.3g} Nm rms, {:.3g} Nm at most. It changes with neither load nor temperature. ",
      n.temperature_degC, n.friction_min_nm, n.friction_max_nm, n.speed_max_rad_s, n.rms_error_nm, n.max_error_nm);
}

std::string name_of(const mjModel* m, int type, int id) {
  const char* name = mj_id2name(m, type, id);
  return name ? name : "";
}

}  // namespace

Result<NativeModel> native_model(const std::filesystem::path& file, std::optional<double> temperature_degC,
                                 std::optional<double> speed_max_rad_s) {
  const auto loaded = mujoco::load_file(file);
  if (!loaded) return tl::unexpected(loaded.error());
  const mjModel* m = (*loaded)->get();
  if ((*loaded)->drives().empty()) return tl::unexpected(file.string() + ": has no tribotwin.drive");
  const auto merged = mujoco::load_merged(file);
  if (!merged) return tl::unexpected(merged.error());
  pugi::xml_document& document = **merged;

  NativeModel native;
  for (const mujoco::Binding& b : (*loaded)->drives()) {
    const std::string joint = name_of(m, mjOBJ_JOINT, b.joint);
    const auto friction = fit(b, joint, temperature_degC, speed_max_rad_s);
    if (!friction) return tl::unexpected(fmt::format("{}: {}", file.string(), friction.error().message));
    pugi::xml_node element = named(document, "//worldbody//joint", joint);
    set(element, "frictionloss", friction->frictionloss_nm);
    set(element, "damping", m->dof_damping[b.dof] + friction->damping_nm_s_rad);
    element.parent().insert_child_before(pugi::node_comment, element).set_value(comment(*friction).c_str());
    mujoco::make_native(named(document, "//actuator/plugin", name_of(m, mjOBJ_ACTUATOR, b.actuator)), b.drive);
    native.joints.push_back(*friction);
  }
  for (const mujoco::Spring& s : (*loaded)->springs()) {
    const double T = temperature_degC.value_or(s.drive.drive.thermal.T_amb_degC);
    set(named(document, "//tendon/fixed", name_of(m, mjOBJ_TENDON, s.tendon)), "stiffness",
        s.hysteresis.stiffness(0, T));
  }
  remove_all(document, "//actuator/plugin[@plugin='tribotwin.hysteresis']");
  remove_all(document, "//sensor/plugin[@plugin='tribotwin.sensor']");
  mujoco::remove_extensions(document);
  for (const auto& match : document.select_nodes("//keyframe/key")) match.node().remove_attribute("act");
  if (document.select_node("//asset/*[@file] | //asset/*[@fileright]"))
    mujoco::make_asset_folders_absolute(document, file.parent_path());

  native.xml = mujoco::text_of(document);
  if (const auto readable = mujoco::load_string(native.xml); !readable)
    return work_failed(
        fmt::format("{}: without drives it does not load ({})", file.string(), readable.error().message));
  return native;
}

}  // namespace tribotwin::twin
