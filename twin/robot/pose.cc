#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/pose.hpp>

namespace tribotwin::twin {
namespace {

constexpr double tolerated = 0.01;  // change of load while measuring, over torque_max_nm, either way

/// `count` angles over a joint's range.
std::vector<double> grid_of(const mjModel* m, int joint, int count) {
  double low = -std::numbers::pi, high = std::numbers::pi;
  if (m->jnt_limited[joint]) {
    low = m->jnt_range[2 * joint];
    high = m->jnt_range[2 * joint + 1];
  }
  std::vector<double> grid;
  for (int i = 0; i < count; ++i) grid.push_back(low + (high - low) * i / (count - 1));
  return grid;
}

}  // namespace

Gravity::Gravity(const mujoco::Model& arm, std::size_t drive, std::vector<double> start_rad)
    : arm_(arm), drive_(drive), start_(std::move(start_rad)), data_(arm.make_data()) {
  const mjModel* m = arm.get();
  const auto drives = arm.drives();
  start_.resize(drives.size());
  // The next joint outward is the driven one whose chain to the root meets this joint first.
  int nearest = 1 << 30;
  const int body = m->jnt_bodyid[drives[drive].joint];
  for (std::size_t i = 0; i < drives.size(); ++i) {
    int steps = 0, b = m->jnt_bodyid[drives[i].joint];
    while (b > 0 && b != body) b = m->body_parentid[b], ++steps;
    if (b == body && steps > 0 && steps < nearest && m->jnt_type[drives[i].joint] == mjJNT_HINGE) {
      nearest = steps;
      outer_ = static_cast<int>(i);
    }
  }
  inner_grid_ = grid_of(m, drives[drive].joint, 241);
  outer_grid_ = outer_ >= 0 ? grid_of(m, drives[static_cast<std::size_t>(outer_)].joint, 81) : std::vector<double>{0};
  std::vector<double> pose = start_;
  for (const double o : outer_grid_) {
    if (outer_ >= 0) pose[static_cast<std::size_t>(outer_)] = o;
    for (const double q : inner_grid_) load_.push_back(load_nm(pose, q));
  }
  const auto [minimum, maximum] = std::ranges::minmax(load_);
  min_nm_ = minimum;
  max_nm_ = maximum;
}

double Gravity::load_nm(std::span<const double> pose_rad, double q_rad) const {
  const mjModel* m = arm_.get();
  const auto drives = arm_.drives();
  for (std::size_t i = 0; i < drives.size(); ++i)
    data_->qpos[position_address(m, drives[i])] = i == drive_ ? q_rad : pose_rad[i];
  mj_kinematics(m, data_.get());
  mj_comPos(m, data_.get());
  return gravity_torque_nm(m, data_.get(), drives[drive_].dof);
}

Pose Gravity::with_width(std::vector<double> pose_rad) const {
  const double q = pose_rad[drive_], limit = tolerated * arm_.drives()[drive_].drive.torque_max_nm,
               here = load_nm(pose_rad, q);
  double half = 1;
  for (double step = 0.5; step > 1e-4; step /= 2) {
    bool good = true;
    for (const double share : {-1.0, -0.5, 0.5, 1.0})
      good = good && std::abs(load_nm(pose_rad, q + share * half) - here) <= limit;
    half += good ? step : -step;
  }
  return {std::move(pose_rad), 2 * half};
}

Result<Pose> Gravity::pose_for(double load_nm) const {
  struct Crossing {
    double q, outer, slope;
  };
  std::optional<Crossing> best;
  const std::size_t n = inner_grid_.size();
  for (std::size_t o = 0; o < outer_grid_.size(); ++o)
    for (std::size_t i = 1; i < n; ++i) {
      const double before = load_[o * n + i - 1] - load_nm, here = load_[o * n + i] - load_nm;
      if (before * here > 0) continue;
      const double slope = std::abs(here - before);
      if (best && slope >= best->slope) continue;
      best = {
          inner_grid_[i - 1] + (before == here ? 0 : before / (before - here)) * (inner_grid_[i] - inner_grid_[i - 1]),
          outer_grid_[o], slope};
    }
  const double torque_max = arm_.drives()[drive_].drive.torque_max_nm;
  if (!best)
    return tl::unexpected(fmt::format(
        "no pose of this joint and the next one outward gives the load {:.3g}; gravity gives {:.3g} .. {:.3g}",
        load_nm / torque_max, min_nm_ / torque_max, max_nm_ / torque_max));
  std::vector<double> pose = start_;
  if (outer_ >= 0) pose[static_cast<std::size_t>(outer_)] = best->outer;
  const double cell = inner_grid_[1] - inner_grid_[0];
  double a = best->q - 0.5 * cell, c = best->q + 0.5 * cell, fa = this->load_nm(pose, a) - load_nm;
  if (fa * (this->load_nm(pose, c) - load_nm) <= 0)
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (a + c), f = this->load_nm(pose, middle) - load_nm;
      if (fa * f <= 0)
        c = middle;
      else
        a = middle, fa = f;
      best->q = 0.5 * (a + c);
    }
  pose[drive_] = best->q;
  return with_width(std::move(pose));
}

}  // namespace tribotwin::twin
