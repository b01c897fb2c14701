#include <algorithm>
#include <cmath>
#include <random>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/gears/starter_scenario.hpp>

namespace tribotwin::twin {
namespace {

constexpr double torque_share = 0.7, speed_share = 0.5, ramp_s = 0.4;
constexpr double overshoot = 1.05;  ///< of the travel, so that a servo's error ends in no contact
constexpr int samples = 21;         ///< poses of a move at which torques and contacts are looked at

using Pose = std::vector<double>;  ///< one position per drive

struct Need {
  std::string joint;
  double share = 0;  ///< of the torque that the drive can give
  bool contact = false;
};

class Planner {
 public:
  explicit Planner(const RobotWithDrives& robot)
      : robot_(robot), model_(*robot.model), m_(model_.get()), data_(model_.make_data()) {
    for (const AddedDrive& d : robot.drives) speeds_.push_back(speed_share * d.speed_max_rad_s);
  }

  std::size_t size() const { return speeds_.size(); }
  const Pose& speeds() const { return speeds_; }
  void slow_down(double share) {
    for (double& v : speeds_) v *= share;
  }

  std::pair<double, double> range(std::size_t i) const {
    const int j = model_.drives()[i].joint;
    if (!m_->jnt_limited[j]) return {-1e9, 1e9};
    return {m_->jnt_range[2 * j], m_->jnt_range[2 * j + 1]};
  }

  /// Poses to move around: keyframes, the model's zero, the middle of the ranges, and random ones.
  std::vector<Pose> centres() const {
    std::vector<Pose> found;
    const auto add = [&](const mjtNum* qpos) {
      Pose p;
      for (const mujoco::Binding& b : model_.drives()) p.push_back(qpos[b.position]);
      found.push_back(p);
    };
    for (int k = 0; k < m_->nkey; ++k) add(m_->key_qpos + k * m_->nq);
    add(m_->qpos0);
    Pose middle = found.back();
    for (std::size_t i = 0; i < size(); ++i)
      if (const auto [low, high] = range(i); high < 1e8) middle[i] = (low + high) / 2;
    found.push_back(middle);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(0.1, 0.9);
    for (int k = 0; k < 300; ++k) {
      Pose p = middle;
      for (std::size_t i = 0; i < size(); ++i) {
        const auto [low, high] = range(i);
        const bool slide = robot_.drives[i].slide, limited = high < 1e8;
        p[i] = limited ? low + share(random) * (high - low) : slide ? p[i] : (share(random) - 0.5) * 6;
      }
      found.push_back(p);
    }
    return found;
  }

  /// The centre, drawn away from the ends of the ranges, and how far each joint goes to both sides.
  Pose travel(Pose& centre, double share) const {
    Pose half(size());
    for (std::size_t i = 0; i < size(); ++i) {
      const auto [low, high] = range(i);
      const double whole = high - low, wanted = share * std::min(robot_.drives[i].slide ? 0.2 : 0.5, 0.4 * whole);
      centre[i] = std::clamp(centre[i], low + 0.05 * std::min(whole, 10.0) + wanted,
                             high - 0.05 * std::min(whole, 10.0) - wanted);
      half[i] = wanted;
    }
    return half;
  }

  /// What the hardest moment of the move needs.
  Need need(const Pose& centre, const Pose& half, bool touching) {
    Need worst;
    const int allowed = touching ? contacts(centre, half, 0) : 0;
    for (int s = 0; s < samples; ++s) {
      const double place = overshoot * (-1 + 2.0 * s / (samples - 1));
      if (contacts(centre, half, place) > allowed) worst.contact = true;
      for (std::size_t i = 0; i < size(); ++i) {
        const double share = torque_nm(i) / std::max(give_nm(i), 1e-12);
        if (share > worst.share) worst.share = share, worst.joint = robot_.drives[i].joint;
      }
    }
    return worst;
  }

 private:
  /// What the drive can give in its weaker direction.
  double give_nm(std::size_t i) const {
    const mjtNum* limit = m_->actuator_ctrlrange + 2 * model_.drives()[i].control;
    return std::min(-limit[0], limit[1]);
  }

  /// Gravity, springs, speed, friction and the acceleration of all joints together, at the pose and speeds of data.
  double torque_nm(std::size_t i) const {
    const mujoco::Binding& b = model_.drives()[i];
    const double load = std::abs(data_->qfrc_bias[b.dof] - data_->qfrc_passive[b.dof]);
    const double load_norm = load / b.drive.torque_max_nm, T = b.drive.thermal.T_amb_degC;
    const double friction =
        std::max(mujoco::friction_nm(b.drive, speeds_[i], load_norm, T), mujoco::friction_nm(b.drive, 0, load_norm, T));
    return load + std::abs(acceleration_nm_[b.dof]) + friction + std::abs(b.drive.offset_nm);
  }

  /// Contacts of the pose `place` between both ends; data then belong to it.
  int contacts(const Pose& centre, const Pose& half, double place) {
    mju_copy(data_->qpos, m_->nkey > 0 ? m_->key_qpos : m_->qpos0, static_cast<int>(m_->nq));
    mju_zero(data_->qvel, static_cast<int>(m_->nv));
    std::vector<mjtNum> acceleration(static_cast<std::size_t>(m_->nv));
    for (std::size_t i = 0; i < size(); ++i) {
      const mujoco::Binding& b = model_.drives()[i];
      data_->qpos[b.position] = centre[i] + place * half[i];
      data_->qvel[b.dof] = speeds_[i];
      acceleration[b.dof] = speeds_[i] / ramp_s;
    }
    mj_forward(m_, data_.get());
    acceleration_nm_.resize(acceleration.size());
    mj_mulM(m_, data_.get(), acceleration_nm_.data(), acceleration.data());
    int count = 0;
    for (int c = 0; c < data_->ncon; ++c) count += data_->contact[c].dist < 0;
    return count;
  }

  const RobotWithDrives& robot_;
  const mujoco::Model& model_;
  const mjModel* m_;
  mujoco::DataPtr data_;
  std::vector<mjtNum> acceleration_nm_;  ///< at data's pose, of all drives starting together
  Pose speeds_;
};

std::string mapping(const RobotWithDrives& robot, const Pose& values) {
  std::string text;
  for (std::size_t i = 0; i < values.size(); ++i)
    text += fmt::format("{}{}: {:.4g}", i ? ", " : "", robot.drives[i].joint, values[i]);
  return "{" + text + "}";
}

std::string written(const RobotWithDrives& robot, const std::string& model, const Pose& speeds, const Pose& centre,
                    const Pose& half, bool touching) {
  Pose low = centre, high = centre;
  for (std::size_t i = 0; i < centre.size(); ++i) low[i] -= half[i], high[i] += half[i];
  return fmt::format(
      "# Written by tribotwin: a first hour of work, within the joint ranges and 70 % of the torques.\n{}"
      "description: One hour of work, all drives back and forth, multi-rate\n"
      "model: {}\n"
      "duration_s: 3600\n"
      "motion:\n"
      "  type: cycle\n"
      "  speed_rad_s: {}\n"
      "  waypoints:\n"
      "    - position_rad: {}\n"
      "    - position_rad: {}\n"
      "control: {{type: servo}}\n"
      "multirate: {{tolerance_K: 2}}\n"
      "telemetry_rate_hz: 20\n{}",
      touching ? "# The robot touches something in every pose that was tried: contacts take a part of the energy.\n"
               : "",
      model, mapping(robot, speeds), mapping(robot, low), mapping(robot, high),
      touching ? "expects: [contacts]\n" : "");
}

}  // namespace

Result<std::string> starter_scenario(const RobotWithDrives& robot, const std::string& model) {
  const mjModel* m = robot.model->get();
  for (int j = 0; j < m->njnt; ++j)
    if (m->jnt_type[j] == mjJNT_FREE && std::ranges::any_of(robot.model->drives(), [&](const mujoco::Binding& b) {
          return m->body_rootid[m->jnt_bodyid[b.joint]] == m->body_rootid[m->jnt_bodyid[j]];
        }))
      return work_failed("the robot floats, and nothing here keeps its balance; --fix-base puts it on a stand");
  Planner planner(robot);
  Need least{.joint = "", .share = 1e300};
  // Rather a short or slow move without contacts than one with those that the robot has in its pose anyway.
  for (const bool touching : {false, true})
    for (const double share : {1.0, 0.6, 0.3, 0.1}) {
      planner.slow_down(touching && share == 1 ? 8 : share == 1 ? 1 : 0.5);
      for (Pose centre : planner.centres()) {
        const Pose half = planner.travel(centre, share);
        const Need need = planner.need(centre, half, touching);
        if (!need.contact && need.share <= torque_share)
          return written(robot, model, planner.speeds(), centre, half, touching);
        if (need.share < least.share) least = need;
      }
    }
  if (least.share <= torque_share) return work_failed("every motion that was tried ends in a contact");
  return work_failed(
      fmt::format("joint '{}' needs {:.0f} % of its torque in the easiest of the poses that were tried; its effort is "
                  "too small for "
                  "what it carries",
                  least.joint, 100 * least.share));
}

}  // namespace tribotwin::twin
