#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/working_days/day_recording.hpp>
#include <tribotwin/twin/experiments/working_days/working_day.hpp>
#include <tribotwin/twin/identification/samples/recording.hpp>
#include <tribotwin/twin/simulation/health.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

namespace tribotwin::twin::repeatability {
namespace {

using namespace identification;
using Eigen::Index, Eigen::VectorXd;

constexpr std::uint64_t of_sensors = 100;  ///< purpose of the seed

/// The excitation and the way back to its start, repeated.
Motion cycle_of(const Campaign& c, const Regressor& regressor, const Excitation& e) {
  const auto joints = static_cast<std::size_t>(regressor.joints());
  std::vector<SetPoint> points(joints);
  const auto split = [&](double time_s) {
    e.at(time_s, points);
    std::pair<std::vector<double>, std::vector<double>> out;
    for (const auto& p : points) out.first.push_back(p.position_rad), out.second.push_back(p.velocity_rad_s);
    return out;
  };
  const std::vector<double> start = split(0).first;
  Motion motion(start);
  const auto pieces = static_cast<int>(std::ceil(e.inertia_s * 250));
  for (int i = 1; i < pieces; ++i) {
    auto [q, qd] = split(e.inertia_s * i / pieces);
    motion.pass_through(e.inertia_s * i / pieces, std::move(q), std::move(qd));
  }
  motion.pass_through(e.inertia_s, start, std::vector<double>(joints, 0.0)).then(e.rest);
  const MotionLimits limits = motion_limits(*c.model, regressor, c.excitation.share);
  const VectorXd approach = 0.3 * limits.speed;
  const auto values = [](const VectorXd& v) {
    return std::span<const double>(v.data(), static_cast<std::size_t>(v.size()));
  };
  return motion.dwell(0.3)
      .move_to(start, values(approach), values(limits.acceleration))
      .dwell(0.5)
      .repeat((*c.model)->opt.timestep);
}

RobotRecording part_of(const std::vector<JointRecording>& joints, std::size_t first, std::size_t past) {
  RobotRecording r;
  const auto& time = joints.front().time_s;
  r.time_s.assign(time.begin() + static_cast<std::ptrdiff_t>(first), time.begin() + static_cast<std::ptrdiff_t>(past));
  r.position.resize(static_cast<Index>(joints.size()), static_cast<Index>(past - first));
  r.torque.resizeLike(r.position);
  for (std::size_t j = 0; j < joints.size(); ++j)
    for (std::size_t i = first; i < past; ++i) {
      r.position(static_cast<Index>(j), static_cast<Index>(i - first)) = joints[j].position_rad[i];
      r.torque(static_cast<Index>(j), static_cast<Index>(i - first)) = joints[j].torque_nm[i];
    }
  return r;
}

/// The robot's own friction and the faults of the test, as wear. Wear replaces earlier wear: the factors of a fault are
/// multiplied with the robot's own.
std::vector<Event> events_of(const Campaign& c, std::size_t test, const Individual& robot) {
  const auto drives = robot.model->drives();
  std::vector<Event> events;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    Wear own{.joint = joint_name(robot.model->get(), drives[i])};
    for (std::size_t p = 0; p < torque_parameters; ++p)
      own.factors[std::string(drives[i].drive.law.info->parameters[p].name)] = robot.friction[i];
    events.push_back({0, own});
    for (const Fault& fault : c.faults) {
      if (fault.robot != c.robot_of(test) || fault.day != c.day_of(test) || fault.wear.joint != own.joint) continue;
      Wear broken = own;
      for (const auto& [name, factor] : fault.wear.factors)
        broken.factors.try_emplace(name, 1.0).first->second *= factor;
      events.push_back({fault.time_s, broken});
    }
  }
  std::ranges::stable_sort(events, {}, &Event::time_s);
  return events;
}

Scenario scenario_of(const Campaign& c, const Excitation& e, std::size_t test, const Individual& robot, double ambient,
                     const Regressor& regressor) {
  Scenario s;
  s.model = robot.model;
  s.ambient_degC = ambient;
  s.motion = cycle_of(c, regressor, e);
  s.duration_s = c.duration_s;
  s.start_rad.assign(s.motion->start_rad().begin(), s.motion->start_rad().end());
  s.temperature_degC.assign(robot.friction.size(), ambient);
  s.control = CascadedOptions{};
  s.events = events_of(c, test, robot);
  return s;
}

}  // namespace

Result<SimulatedDay> simulated(const Campaign& c, const Excitation& e, std::size_t test, const Individual& robot,
                               double ambient, const Regressor& regressor) {
  const Scenario s = scenario_of(c, e, test, robot, ambient, regressor);
  const auto drives = robot.model->drives();
  const double dt = (*robot.model)->opt.timestep, period = s.motion->period_s();
  const auto cycles = static_cast<std::size_t>(c.duration_s / period + 1e-9);
  if (cycles < 1)
    return tl::unexpected(
        Error(fmt::format("duration_s {:g} is shorter than a cycle of the motion, {:.0f} s", c.duration_s, period)));
  const auto steps = std::llround(period / dt), every = std::max(1LL, std::llround(1 / (c.sampling_hz * dt)));
  Sensors sensors{.encoder_increments_per_turn = c.encoder_increments_per_turn,
                  .sampling_hz = 1 / (static_cast<double>(every) * dt)};
  Twin twin(s);
  SimulatedDay out;
  for (std::size_t k = 0; k < cycles; ++k) {
    std::vector<JointRecording> signals(drives.size());
    for (long long i = 0; i < steps; ++i) {
      const double time = twin.time_s();
      if (auto ok = twin.step(); !ok) return tl::unexpected(ok.error());
      if (i % every) continue;
      for (std::size_t j = 0; j < drives.size(); ++j) {
        signals[j].time_s.push_back(time);
        signals[j].position_rad.push_back(twin.position_rad(j));
        signals[j].torque_nm.push_back(twin.drive(j).torque_nm);
      }
    }
    for (std::size_t j = 0; j < drives.size(); ++j) {
      sensors.torque_noise_nm = c.torque_noise_share * drives[j].drive.torque_max_nm;
      signals[j] = sensed(signals[j], sensors, seed_for(c, of_sensors + test, k * drives.size() + j));
    }
    const auto& time = signals.front().time_s;
    const auto heating =
        static_cast<std::size_t>(std::ranges::lower_bound(time, time.front() + e.friction_s) - time.begin());
    out.cycles.push_back({part_of(signals, 0, heating), part_of(signals, heating, time.size())});
  }
  for (const HealthLine& line : health_lines(examine({twin.scenario(), &twin})))
    if (line.verdict == Verdict::warning) out.warnings.push_back(line.text);
  return out;
}

}  // namespace tribotwin::twin::repeatability
