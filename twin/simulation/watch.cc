#include <algorithm>
#include <cmath>
#include <utility>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/simulation/twin.hpp>
#include <tribotwin/twin/simulation/watch.hpp>

namespace tribotwin::twin {
namespace {

/// Past the end of a range by less is rounding [rad; m].
constexpr double rounding = 1e-9;

void narrow(ControlRange& range, double low, double high) {
  range = {std::max(range.low, low), std::min(range.high, high)};
}

}  // namespace

ControlRange control_range(const mujoco::Model& model, std::size_t drive) {
  const mjModel* m = model.get();
  const mujoco::Binding& b = model.drives()[drive];
  ControlRange range{-friction::unlimited, friction::unlimited};
  if (m->actuator_ctrllimited[b.actuator])
    narrow(range, m->actuator_ctrlrange[2 * b.control], m->actuator_ctrlrange[2 * b.control + 1]);
  if (m->actuator_forcelimited[b.actuator])
    narrow(range, m->actuator_forcerange[2 * b.actuator], m->actuator_forcerange[2 * b.actuator + 1]);
  const double gear = std::abs(b.gear);
  constexpr double any = 1e300;  // what the engine leaves of it is the range
  narrow(range, mujoco::engine::within_joint_range(m, b.joint, -any) / gear,
         mujoco::engine::within_joint_range(m, b.joint, any) / gear);
  return range;
}

ControlRange control_range(const Scenario& scenario, std::size_t drive) {
  ControlRange range = control_range(*scenario.model, drive);
  const double gear = std::abs(scenario.model->drives()[drive].gear);
  if (const auto* servo = std::get_if<std::vector<DcPositionOptions>>(&scenario.control))
    narrow(range, -(*servo)[drive].torque_limit_nm / gear, (*servo)[drive].torque_limit_nm / gear);
  return range;
}

Watch::Watch(const Scenario& scenario, bool follows) : model_(scenario.model->get()), follows_(follows) {
  const auto drives = scenario.model->drives();
  joints_.resize(drives.size());
  touched_.reserve(pairs_named);
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const auto& b = drives[i];
    const auto& law = b.drive.law;
    const bool ranged = model_->jnt_limited[b.joint] != 0;
    const auto [low, high] = control_range(scenario, i);
    constexpr double at = 1 - 1e-9;  // a limit that was multiplied and divided by the gear
    const bool warm = law.info->temperature_dependent;
    bounds_.push_back({.control = b.control,
                       .control_low = at * low,
                       .control_high = at * high,
                       .position_low = ranged ? model_->jnt_range[2 * b.joint] - rounding : -friction::unlimited,
                       .position_high = ranged ? model_->jnt_range[2 * b.joint + 1] + rounding : friction::unlimited,
                       .speed_scale = b.drive.speed_scale(),
                       .speed_max_rad_s = law.range.speed_max_rad_s,
                       .load_max_nm = law.range.load_max * b.drive.torque_max_nm,
                       .temperature_min_degC = warm ? law.range.temperature_min_degC : -friction::unlimited,
                       .temperature_max_degC = warm ? law.range.temperature_max_degC : friction::unlimited});
  }
  // Bodies come after their parents.
  parts_.assign(static_cast<std::size_t>(model_->nbody), Part::none);
  moved_by_.assign(static_cast<std::size_t>(model_->nbody), 0);
  for (int body = 1; body < model_->nbody; ++body) {
    Part& part = parts_[static_cast<std::size_t>(body)];
    part = parts_[static_cast<std::size_t>(model_->body_parentid[body])];
    const auto drives_body = [&](const mujoco::Binding& b) { return model_->jnt_bodyid[b.joint] == body; };
    const bool driven = std::ranges::any_of(drives, drives_body);
    moved_by_[static_cast<std::size_t>(body)] =
        driven ? body : moved_by_[static_cast<std::size_t>(model_->body_parentid[body])];
    if (part != Part::none || !driven) continue;
    const int parent = model_->body_parentid[body];
    part = model_->body_weldid[parent] == 0 ? Part::fixed : Part::free;
  }
}

void Watch::add(const Twin& twin) {
  const mjData* d = twin.data();
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    const Bounds& b = bounds_[i];
    JointWatch& j = joints_[i];
    const double control = d->ctrl[b.control], position = twin.position_rad(i);
    j.saturated += control >= b.control_high || control <= b.control_low;
    j.beyond_range += position > b.position_high || position < b.position_low;
    if (follows_) {
      const double error = twin.set_point(i).position_rad - position;
      j.error_squared_sum += error * error;
      j.error_max = std::max(j.error_max, std::abs(error));
    }
    const drive::Workspace& s = twin.drive(i);
    if (s.outside == 0) continue;
    j.too_fast += std::abs(twin.velocity_rad_s(i) * b.speed_scale) > b.speed_max_rad_s;
    j.overloaded += std::abs(s.load_used_nm) > b.load_max_nm;
    j.too_cold += s.temperature_degC < b.temperature_min_degC;
    j.too_hot += s.temperature_degC > b.temperature_max_degC;
  }
  if (d->ncon > 0) add_contacts(twin);
}

void Watch::add_contacts(const Twin& twin) {
  const mjData* d = twin.data();
  bool any = false;
  for (int c = 0; c < d->ncon; ++c) {
    const mjContact& contact = d->contact[c];
    if (contact.efc_address < 0 || contact.geom1 < 0 || contact.geom2 < 0) continue;
    if (!unwanted(contact.geom1, contact.geom2)) continue;
    any = true;
    count(contact.geom1, contact.geom2, twin.steps_computed());
  }
  touched_steps_ += any;
}

/// A robot may not touch itself or another one, nor, if it stands on the ground, what does not move. Fingers that no
/// drive moves against each other may close.
bool Watch::unwanted(int geom1, int geom2) const {
  const int body1 = model_->geom_bodyid[geom1], body2 = model_->geom_bodyid[geom2];
  const Part part1 = parts_[static_cast<std::size_t>(body1)], part2 = parts_[static_cast<std::size_t>(body2)];
  if (part1 != Part::none && part2 != Part::none)
    return moved_by_[static_cast<std::size_t>(body1)] != moved_by_[static_cast<std::size_t>(body2)];
  return (part1 == Part::fixed && model_->body_weldid[body2] == 0) ||
         (part2 == Part::fixed && model_->body_weldid[body1] == 0);
}

void Watch::count(int geom1, int geom2, std::int64_t step) {
  for (TouchedGeoms& pair : touched_)
    if (pair.geom1 == geom1 && pair.geom2 == geom2) {
      pair.steps += pair.last_step != step;
      pair.last_step = step;
      return;
    }
  if (touched_.size() < pairs_named) touched_.push_back({geom1, geom2, 1, step});
}

template <class Self, class Each>
void Watch::each_sum(Self& self, Each each) {
  for (auto& j : self.joints_)
    for (auto* count :
         {&j.saturated, &j.beyond_range, &j.too_fast, &j.overloaded, &j.too_cold, &j.too_hot, &j.error_squared_sum})
      each(*count);
  each(self.touched_steps_);
  for (auto& pair : self.touched_) each(pair.steps);
}

void Watch::append_sums(std::vector<double>& sums) const {
  each_sum(*this, [&](double count) { sums.push_back(count); });
}

void Watch::add_sums(std::span<const double> sums) {
  const double* next = sums.data();
  each_sum(*this, [&](double& count) { count += *next++; });
}

void Watch::state(StateNumbers& s) {
  for (JointWatch& j : joints_) {
    s(j.saturated), s(j.beyond_range), s(j.too_fast), s(j.overloaded), s(j.too_cold), s(j.too_hot);
    s(j.error_squared_sum), s(j.error_max);
  }
  s(touched_steps_);
  // As many numbers for any number of pairs.
  std::size_t count = touched_.size();
  s(count);
  touched_.resize(pairs_named);
  for (TouchedGeoms& pair : touched_) s(pair.geom1), s(pair.geom2), s(pair.steps), s(pair.last_step);
  touched_.resize(std::min(count, pairs_named));
  const auto known = [&](int geom) { return geom >= 0 && geom < model_->ngeom; };
  std::erase_if(touched_, [&](const TouchedGeoms& pair) { return !known(pair.geom1) || !known(pair.geom2); });
}

}  // namespace tribotwin::twin
