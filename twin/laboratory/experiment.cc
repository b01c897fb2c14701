#include <tribotwin/twin/laboratory/experiment.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include <fmt/format.h>

#include <tribotwin/twin/servo/servo.hpp>

namespace tribotwin::twin {
namespace {

/// A run at constant speed through the measuring angle.
struct Level {
  double torque_nm, load_nm, torque_variance, samples;
};

class Bench {
 public:
  Bench(std::shared_ptr<const mujoco::Model> model, std::size_t drive, const ExperimentOptions& options)
      : model_(std::move(model)), b_(model_->drives()[drive]), options_(options), random_(options.seed) {}

  /// Angle within the joint's range at which gravity loads it by `load_nm`, or the loads that angles give.
  tl::expected<double, std::string> angle_for(double load_nm, const mjModel* limits) {
    const mujoco::DataPtr d = model_->make_data();
    const int address = position_address(model_->get(), b_);
    double low = -3.14159, high = 3.14159;
    if (limits->jnt_limited[b_.joint]) {
      low = limits->jnt_range[2 * b_.joint];
      high = limits->jnt_range[2 * b_.joint + 1];
    }
    const auto load_at = [&](double q) {
      d->qpos[address] = q;
      mj_kinematics(model_->get(), d.get());
      mj_comPos(model_->get(), d.get());
      return gravity_torque_nm(model_->get(), d.get(), b_.dof);
    };
    constexpr int grid = 400;
    std::optional<double> found;
    double least = 1e300, most = -1e300, q_before = low, load_before = load_at(low), steepest = 1e300;
    for (int i = 0; i <= grid; ++i) {
      const double q = low + (high - low) * i / grid, load = load_at(q);
      least = std::min(least, load);
      most = std::max(most, load);
      if (i && (load_before - load_nm) * (load - load_nm) <= 0) {
        // Of all crossings the flattest: there the load changes least while the joint runs through it.
        const double slope = std::abs(load - load_before);
        if (slope < steepest) {
          steepest = slope;
          double a = q_before, c = q;
          const double sign = load >= load_before ? 1 : -1;
          for (int n = 0; n < 60; ++n) {
            const double mid = 0.5 * (a + c);
            (sign * (load_at(mid) - load_nm) < 0 ? a : c) = mid;
          }
          found = 0.5 * (a + c);
        }
      }
      q_before = q;
      load_before = load;
    }
    if (found) return *found;
    return tl::unexpected(fmt::format("no pose of this joint gives the load {:.3g}; its gravity gives {:.3g} .. {:.3g} (other joints at 0)",
                                      load_nm / b_.drive.torque_max_nm, least / b_.drive.torque_max_nm, most / b_.drive.torque_max_nm));
  }

  static constexpr double settle_s = 1.0, ramp_s = 0.3;
  /// Joint angle run through while measuring.
  double window_rad(double speed) const {
    const double radians = options_.load_by == LoadBy::pose ? 20 / b_.drive.gear_ratio : 1e300;   // 20 motor rad
    return std::min({std::abs(speed) * 0.5, radians});
  }
  double run_up_rad(double speed) const { return std::abs(speed) * (settle_s + 0.5 * ramp_s) + 0.5 * window_rad(speed); }

  tl::expected<Level, std::string> run(double speed, double angle, double external_nm) {
    const mjModel* m = model_->get();
    const mujoco::DataPtr d = model_->make_data();
    const int address = position_address(m, b_);
    const double direction = speed > 0 ? 1 : -1;
    d->qpos[address] = angle - direction * run_up_rad(speed);
    mj_forward(m, d.get());
    for (const auto& other : model_->drives()) {
      drive::Scratch& s = mujoco::scratch(d.get(), other);
      s = {};
      s.temperature_held = 1;
      drive::set_temperature(other.drive, mujoco::memory(d.get(), other), options_.temperature_degC);
      if (other.dof != b_.dof) s.brake_engaged = 1e6;   // braked hard: the others stand
    }
    d->qfrc_applied[b_.dof] = -external_nm;
    // The start is quasi-static: the load is there before the joint moves.
    mujoco::memory(d.get(), b_).load_nm = external_nm + gravity_torque_nm(m, d.get(), b_.dof);

    loop_ = {.speed_gain = 60 * inertia_kg_m2(m, d.get(), b_.dof), .external_nm = external_nm, .bench = this};
    const double window = window_rad(speed), start = angle - direction * 0.5 * window;
    // At crawling speed the integral part needs its time to break the joint away.
    const double windup_s = mujoco::friction_nm(b_.drive, 0, options_.load_norm, options_.temperature_degC) / (loop_.speed_gain / 0.1 * std::abs(speed));
    const double deadline_s = (run_up_rad(speed) + window) / std::abs(speed) * 1.5 + 2 + 2 * windup_s;
    const auto no_level = [&](std::string_view why) {
      return tl::unexpected(fmt::format("no steady motion at {:g} motor rad/s ({}); such low speeds stick and slip, measure at higher ones",
                                        std::abs(speed) * b_.drive.gear_ratio, why));
    };
    if (windup_s > 60) return no_level("the servo would need more than a minute to break the joint away");
    double sum = 0, squares = 0, load_sum = 0, count = 0;
    std::normal_distribution<double> noise(0, options_.noise_nm);
    while (direction * (d->qpos[address] - start) < window) {
      if (d->time > deadline_s) return no_level("the joint did not get through in time");
      const double t = d->time + m->opt.timestep;
      loop_.speed = speed * std::min(1.0, t / ramp_s);
      const bool inside = direction * (d->qpos[address] - start) >= 0;
      loop_.fresh = true;
      model_->step(d.get(), {[](void* loop, const mjModel* mm, mjData* dd) { static_cast<Loop*>(loop)->control(mm, dd); }, &loop_});
      for (int w = 0; w < mjNWARNING; ++w)
        if (d->warning[w].number) return tl::unexpected(fmt::format("the simulation diverged: {}", mju_warningText(w, static_cast<std::size_t>(d->warning[w].lastinfo))));
      if (!inside) continue;
      if (std::abs(d->qvel[b_.dof] - speed) > 0.02 * std::abs(speed)) return no_level("the speed was off by more than 2 % while measuring");
      const drive::Scratch& s = mujoco::scratch(d.get(), b_);
      const double torque = s.torque_nm + (options_.noise_nm > 0 ? noise(random_) : 0);
      sum += torque;
      squares += torque * torque;
      load_sum += s.load_used_nm;
      ++count;
    }
    const double mean = sum / count;
    return Level{mean, load_sum / count, std::max(0.0, squares / count - mean * mean), count};
  }

 private:
  struct Loop {
    double speed_gain = 0, external_nm = 0, speed = 0, integral_nm = 0;
    bool fresh = true;
    Bench* bench = nullptr;
    void control(const mjModel* m, mjData* d) {
      if (!std::exchange(fresh, false)) return;
      const auto& b = bench->b_;
      const double error = speed - d->qvel[b.dof];
      integral_nm += speed_gain / 0.1 * error * m->opt.timestep;
      d->ctrl[b.control] = (speed_gain * error + integral_nm + external_nm + gravity_torque_nm(m, d, b.dof)) / b.gear;
    }
  };
  std::shared_ptr<const mujoco::Model> model_;
  const mujoco::Binding& b_;
  const ExperimentOptions& options_;
  std::mt19937_64 random_;
  Loop loop_;
};

}  // namespace

std::vector<CurvePoint> law_curve(const drive::Drive& drive, std::span<const double> speeds, double load_norm, double temperature_degC) {
  std::vector<CurvePoint> points;
  for (const double speed : speeds) {
    const double nm = std::copysign(mujoco::friction_nm(drive, speed / drive.gear_ratio, load_norm, temperature_degC), speed);
    points.push_back({speed, load_norm, temperature_degC, nm / drive.torque_max_nm, nm, 0});
  }
  return points;
}

tl::expected<std::vector<CurvePoint>, std::string> measure_curve(const mujoco::Model& model, std::size_t drive_index,
                                                                 std::span<const double> speeds, const ExperimentOptions& options) {
  const bool pose = options.load_by == LoadBy::pose;
  auto bench_model = mujoco::variant(model, [pose](mjModel* m) {
    if (!pose) mju_zero3(m->opt.gravity);
    // The run-up may need more room than the joint has; a bench has no end stops.
    for (int j = 0; j < m->njnt; ++j) m->jnt_limited[j] = 0;
    for (int i = 0; i < m->nu; ++i) m->actuator_ctrllimited[i] = 0;
  });
  if (!bench_model) return tl::unexpected(bench_model.error());
  const drive::Drive& drive = model.drives()[drive_index].drive;
  Bench bench(*bench_model, drive_index, options);
  std::vector<CurvePoint> points;
  for (const double speed : speeds) {
    const double joint_speed = std::abs(speed) / drive.gear_ratio;
    double angle = 0;
    if (pose) {
      const auto found = bench.angle_for(options.load_norm * drive.torque_max_nm, model.get());
      if (!found) return tl::unexpected(found.error());
      angle = *found;
    }
    const double external = pose ? 0 : options.load_norm * drive.torque_max_nm;
    const auto forward = bench.run(joint_speed, angle, external);
    if (!forward) return tl::unexpected(forward.error());
    const auto backward = bench.run(-joint_speed, angle, external);
    if (!backward) return tl::unexpected(backward.error());
    const double friction = 0.5 * (forward->torque_nm - backward->torque_nm);
    const double load = 0.25 * (std::abs(forward->load_nm) + std::abs(backward->load_nm)) * 2 * (options.load_norm < 0 ? -1 : 1);
    const double error = 0.5 * std::sqrt(forward->torque_variance / forward->samples + backward->torque_variance / backward->samples);
    points.push_back({speed, load / drive.torque_max_nm, options.temperature_degC,
                      std::copysign(friction, speed) / drive.torque_max_nm, std::copysign(friction, speed), error});
    if (options.progress) options.progress(static_cast<double>(points.size()) / static_cast<double>(speeds.size()));
  }
  return points;
}

}  // namespace tribotwin::twin
