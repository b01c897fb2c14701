#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/robot/coupling/coupling.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::Index, Eigen::VectorXd;

std::vector<std::string_view> joint_names(const Regressor& robot) {
  std::vector<std::string_view> names;
  for (Index j = 0; j < robot.joints(); ++j) names.push_back(robot.joint_name(j));
  return names;
}

/// A motor's name may not be a joint's: both name columns, parameters and friction.
std::string motor_name(std::string name, const Regressor& robot) {
  while (std::ranges::count(joint_names(robot), name)) name.insert(0, "motor_");
  return name;
}

/// Of a fixed tendon; empty for a spatial one.
VectorXd coefficients(const mjModel* m, int tendon) {
  VectorXd out = VectorXd::Zero(m->nv);
  for (int w = m->tendon_adr[tendon]; w < m->tendon_adr[tendon] + m->tendon_num[tendon]; ++w) {
    if (m->wrap_type[w] != mjWRAP_JOINT) return {};
    out(m->jnt_dofadr[m->wrap_objid[w]]) += m->wrap_prm[w];
  }
  return out;
}

/// Inertia that turns with a tendon; 2.2.2 and early 3.x have none.
template <class M>
double armature(const M* m, int tendon) {
  if constexpr (requires { m->tendon_armature; })
    return m->tendon_armature[tendon];
  else
    return 0;
}

/// Reads "SUM" of joints with coefficients.
class SumReader {
 public:
  SumReader(std::string_view text, const Regressor& robot) : rest_(text), robot_(robot) {}

  Result<VectorXd> read() {
    VectorXd sum = VectorXd::Zero(robot_.joints());
    for (bool first = true; skip_blanks(), first || !rest_.empty(); first = false) {
      double factor = 1;
      if (take('-'))
        factor = -1;
      else if (!take('+') && !first)
        return tl::unexpected(fmt::format("'+' or '-' was expected before '{}'", rest_));
      skip_blanks();
      if (const auto number = take_factor()) factor *= *number;
      const auto joint = take_joint();
      if (!joint) return tl::unexpected(joint.error());
      sum(*joint) += factor;
    }
    return sum;
  }

 private:
  void skip_blanks() {
    while (!rest_.empty() && std::isspace(static_cast<unsigned char>(rest_.front()))) rest_.remove_prefix(1);
  }
  bool take(char c) {
    if (!rest_.starts_with(c)) return false;
    rest_.remove_prefix(1);
    return true;
  }

  /// "0.5 *", where it stands.
  std::optional<double> take_factor() {
    double number = 0;
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), number);
    if (error != std::errc{}) return {};
    const std::string_view before = rest_;
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    skip_blanks();
    if (take('*')) {
      skip_blanks();
      return number;
    }
    rest_ = before;  // the name of a joint may begin with a digit
    return {};
  }

  /// The longest name that stands here in full.
  Result<Index> take_joint() {
    Index found = -1;
    std::size_t length = 0;
    for (Index j = 0; j < robot_.joints(); ++j) {
      const std::string_view name = robot_.joint_name(j);
      if (!rest_.starts_with(name) || name.size() < length) continue;
      if (name.size() < rest_.size() && std::string_view(" \t+-").find(rest_[name.size()]) == std::string_view::npos)
        continue;
      found = j, length = name.size();
    }
    if (found < 0) {
      const std::string_view word = rest_.substr(0, rest_.find_first_of(" \t+*"));
      const auto names = joint_names(robot_);
      return tl::unexpected(
          word.empty() ? "a joint is missing"
                       : fmt::format("'{}' is no joint of the model; did you mean '{}'?", word, nearest(word, names)));
    }
    rest_.remove_prefix(length);
    return found;
  }

  std::string_view rest_;
  const Regressor& robot_;
};

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t"), last = text.find_last_not_of(" \t");
  return first == std::string_view::npos ? std::string_view{} : text.substr(first, last - first + 1);
}

}  // namespace

std::vector<CoupledMotor> motors_on_tendons(const Regressor& robot) {
  const mjModel* m = robot.model();
  std::vector<bool> has_motor(static_cast<std::size_t>(m->nv)), used(static_cast<std::size_t>(m->ntendon));
  for (int a = 0; a < mujoco::engine::actuator_count(m); ++a)
    if (m->actuator_trntype[a] == mjTRN_JOINT || m->actuator_trntype[a] == mjTRN_JOINTINPARENT)
      has_motor[static_cast<std::size_t>(m->jnt_dofadr[m->actuator_trnid[2 * a]])] = true;
  std::vector<CoupledMotor> out;
  for (int a = 0; a < mujoco::engine::actuator_count(m); ++a) {
    const int tendon = m->actuator_trntype[a] == mjTRN_TENDON ? m->actuator_trnid[2 * a] : -1;
    if (tendon < 0 || used[static_cast<std::size_t>(tendon)]) continue;
    VectorXd turns_with = coefficients(m, tendon);
    if ((turns_with.array() != 0).count() < 2) continue;
    used[static_cast<std::size_t>(tendon)] = true;
    int joint = -1, last = -1;
    for (int j = 0; j < m->nv; ++j)
      if (turns_with(j) != 0) {
        last = j;
        if (!has_motor[static_cast<std::size_t>(j)]) joint = j;
      }
    if (joint < 0) joint = last;
    has_motor[static_cast<std::size_t>(joint)] = true;
    const char* name = mj_id2name(m, mjOBJ_ACTUATOR, a);
    out.push_back({.name = motor_name(name ? name : fmt::format("motor_{}", robot.joint_name(joint)), robot),
                   .joint = joint,
                   .turns_with = std::move(turns_with),
                   .rotor_inertia = armature(m, tendon)});
  }
  return out;
}

Result<CoupledMotor> coupled_motor(std::string_view option, const std::string& text, const Regressor& robot) {
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(Error(fmt::format(
        "{} '{}': {}{} Give JOINT=SUM, the joints with which the motor of a joint turns: \"joint6 = joint5 + joint6\"",
        option, text, why, why.ends_with('?') ? "" : ".")));
  };
  const auto equals = text.find('=');
  if (equals == std::string::npos) return fail("there is no '='");
  const std::string_view joint = trimmed(std::string_view(text).substr(0, equals));
  const auto names = joint_names(robot);
  const auto own = std::ranges::find(names, joint);
  if (own == names.end())
    return fail(fmt::format("'{}' is no joint of the model; did you mean '{}'?", joint, nearest(joint, names)));
  auto sum = SumReader(std::string_view(text).substr(equals + 1), robot).read();
  if (!sum) return fail(sum.error().message);
  CoupledMotor motor{.name = motor_name(fmt::format("motor_{}", joint), robot),
                     .joint = static_cast<int>(own - names.begin()),
                     .turns_with = *std::move(sum)};
  if (!motor.turns_with.allFinite()) return fail("its factors must be finite numbers");
  if (motor.turns_with(motor.joint) == 0) return fail(fmt::format("the motor of {0} does not turn with {0}", joint));
  if ((motor.turns_with.array() != 0).count() < 2)
    return fail(fmt::format("the motor turns with {} alone, which is no coupling", joint));
  return motor;
}

std::string sum_of(const CoupledMotor& motor, const Regressor& robot) {
  std::string text;
  for (Index j = 0; j < robot.joints(); ++j) {
    const double c = motor.turns_with(j), size = std::abs(c);
    if (c == 0) continue;
    const char* sign = text.empty() ? (c < 0 ? "-" : "") : (c < 0 ? " - " : " + ");
    text += fmt::format("{}{}{}", sign, size == 1 ? "" : fmt::format("{:g}*", size), robot.joint_name(j));
  }
  return text;
}

std::vector<CoupledMotor> conceivable_motors(const Regressor& robot) {
  const mjModel* m = robot.model();
  constexpr Index wrist = 3;
  std::vector<CoupledMotor> out;
  for (Index j = robot.joints() - 1; j > 0 && j >= robot.joints() - wrist; --j) {
    if (m->dof_parentid[j] != j - 1) continue;  // of another branch
    if (robot.is_slide(j) != robot.is_slide(j - 1)) continue;
    for (const double sign : {1.0, -1.0}) {
      CoupledMotor motor{.name = motor_name(fmt::format("motor_{}", robot.joint_name(j)), robot),
                         .joint = static_cast<int>(j),
                         .turns_with = VectorXd::Zero(robot.joints())};
      motor.turns_with(j) = 1, motor.turns_with(j - 1) = sign;
      out.push_back(std::move(motor));
    }
  }
  return out;
}

}  // namespace tribotwin::twin
