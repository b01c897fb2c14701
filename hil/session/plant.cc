#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include <fmt/format.h>

#include <tribotwin/hil/session/plant.hpp>

namespace tribotwin::hil {

std::vector<DriveParameters> drive_parameters(const twin::Scenario& scenario, int first_node, std::uint32_t cycle_us,
                                              const Wiring& wiring) {
  std::vector<DriveParameters> all;
  const mjModel* m = scenario.model->get();
  for (const auto& binding : scenario.model->drives()) {
    const auto& drive = binding.drive;
    const auto rank = static_cast<int>(place_of(wiring, all.size()).rank);
    DriveParameters p{.node = static_cast<std::uint8_t>(first_node + rank),
                      .name = twin::joint_name(m, binding),
                      .gear_ratio = drive.gear_ratio,
                      .rated_torque_nm = drive.torque_max_nm / drive.gear_ratio,
                      .cycle_us = cycle_us,
                      .limited = m->jnt_limited[binding.joint] != 0,
                      .position_low_rad = m->jnt_range[2 * binding.joint],
                      .position_high_rad = m->jnt_range[2 * binding.joint + 1],
                      .start_degC = scenario.temperature_degC[all.size()],
                      .speed_bandwidth_max_rad_s = 1 / m->opt.timestep};
    if (drive.winding.present()) p.winding = {p.start_degC, drive.winding.warning_degC, drive.winding.limit_degC};
    // Two drives of one robot may share a node number, but not a serial number.
    if (wiring.size() > 1) p.serial_number = static_cast<std::uint32_t>(first_node + all.size());
    if (const auto* o = std::get_if<twin::CascadedOptions>(&scenario.control))
      p.gains = o->per_drive.empty()
                    ? twin::LoopGains{o->position_gain_1_s, o->speed_bandwidth_rad_s, o->integral_time_s}
                    : o->per_drive[all.size()];
    // The maximum speed of the identification, where the law states one: motor side.
    if (const double speed = drive.law.range.speed_max_rad_s; std::isfinite(speed))
      p.speed_max_rad_s = speed / drive.speed_scale() * drive.gear_ratio;
    all.push_back(std::move(p));
  }
  return all;
}

Result<void> Plant::record(const std::filesystem::path& directory, twin::Existing existing) {
  auto recorder = twin::Recorder::create(directory, scenario_, false, existing);
  if (!recorder) return tl::unexpected(recorder.error());
  recorder_ = std::move(*recorder);
  return {};
}

Feedback Plant::feedback(std::size_t i) const {
  const auto& binding = twin_.model().drives()[i];
  const mjData* d = twin_.data();
  const auto& s = twin_.drive(i);
  Feedback f{.position_rad = d->qpos[twin::position_address(twin_.model().get(), binding)],
             .velocity_rad_s = d->qvel[binding.dof],
             .torque_nm = s.torque_nm,
             .friction_nm = s.friction_nm,
             .load_nm = twin_.state(i).load_nm,
             .temperature_degC = twin_.temperature_degC(i),
             .winding_degC = binding.drive.winding.present() ? std::optional(twin_.winding_degC(i)) : std::nullopt,
             .limited = twin_.limited(i),
             .safe_torque_off = torque_off_[i]};
  f.temperature_degC = override_degC_[i].value_or(f.temperature_degC);
  if (frozen_rad_[i]) f.position_rad = *frozen_rad_[i], f.velocity_rad_s = 0;
  return f;
}

void Plant::impose(const DriveFault& fault) {
  if (fault.kind == FaultKind::over_temperature) {
    override_degC_[fault.drive] = fault.on ? std::optional(fault.temperature_degC) : std::nullopt;
    return;
  }
  if (fault.kind == FaultKind::safe_torque_off) {
    torque_off_[fault.drive] = fault.on;
    return;
  }
  frozen_rad_[fault.drive].reset();
  if (fault.on) frozen_rad_[fault.drive] = feedback(fault.drive).position_rad;
}

void Plant::happen(const YAML::Node& event) {
  constexpr double longest_s = 1e9;  // a session ends when it is stopped: a fault must not grow beyond its most
  twin::happen(twin_, recorder_.get(), event, longest_s);
}

void Plant::show(std::span<const std::unique_ptr<BusDrive>> drives) {
  for (std::size_t i = 0; i < drives.size(); ++i) drives[i]->feedback(feedback(i), 0);
}

Result<void> Plant::step(std::span<const std::unique_ptr<BusDrive>> drives) {
  const double dt = twin_.model()->opt.timestep;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    twin_.commands()[i] = drives[i]->command(dt);
    if (torque_off_[i]) twin_.commands()[i].mode = twin::DriveCommand::Mode::off;
    twin_.set_brake(i, drives[i]->brake_engaged());
    twin_.set_gains(i, drives[i]->gains());
    const auto measured = drives[i]->measured_temperature_degC();
    if (measured || held_[i]) twin_.set_measured_temperature(i, measured);
    held_[i] = measured.has_value();
  }
  const std::int64_t k = twin_.steps();
  if (auto ok = twin_.step(); !ok) return tl::unexpected(ok.error());
  if (recorder_)
    if (auto ok = recorder_->sample(twin_, k); !ok) {
      record_failure_ = ok.error().message;
      recorder_.reset();
    }
  if (sample_ && k % steps_per_sample_ == 0) sample_(twin_, static_cast<double>(k) * dt);
  for (std::size_t i = 0; i < drives.size(); ++i) drives[i]->feedback(feedback(i), dt);
  return {};
}

Result<void> Plant::advance(std::span<const std::unique_ptr<BusDrive>> drives, std::int64_t us,
                            const std::function<bool()>& stop) {
  const auto step_us = static_cast<std::int64_t>(std::llround(1e6 * twin_.model()->opt.timestep));
  constexpr int ask_stop_steps = 256;  // usual cycles are never cut, so that a replay ends where the session did
  left_us_ += us;
  for (int k = 1; left_us_ >= step_us; left_us_ -= step_us, ++k) {
    if (auto ok = step(drives); !ok) return ok;
    if (k % ask_stop_steps == 0 && stop && stop()) break;
  }
  return {};
}

Result<void> Plant::finish(double wall_s, bool interrupted, const std::vector<std::string>& warnings) {
  if (!record_failure_.empty()) return work_failed(record_failure_);
  if (!recorder_) return {};
  twin::Summary summary = twin::summarize(twin_, wall_s);
  summary.interrupted = interrupted;
  summary.warnings.insert(summary.warnings.end(), warnings.begin(), warnings.end());
  if (interrupted && !recorder_->replaced().empty())
    summary.warnings.push_back(
        fmt::format("the session that this one was to replace is kept in {}", recorder_->replaced().string()));
  return std::exchange(recorder_, nullptr)->finish(summary);
}

}  // namespace tribotwin::hil
