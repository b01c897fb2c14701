#include <cmath>
#include <cstdlib>
#include <future>
#include <numbers>
#include <optional>
#include <random>
#include <span>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/control/compensated_servo.hpp>
#include <tribotwin/twin/control/external_torque.hpp>
#include <tribotwin/twin/control/temperature_observer.hpp>
#include <tribotwin/twin/control/tracking.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::twin {
namespace {

std::shared_ptr<const mujoco::Model> bench() {
  const auto model = mujoco::load_file(std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/rh380n_bench.xml");
  EXPECT_TRUE(model.has_value()) << model.error().message;
  return *model;
}

TEST(HysteresisInverse, GivesBackTheTorsionOfAnyWay) {
  const auto model = bench();
  const transmission::Hysteresis& h = model->springs()[0].hysteresis;
  for (const double temperature : {20.0, 47.0}) {
    HysteresisInverse inverse(h);
    double x = 0, last = 0;
    for (int i = 1; i <= 4000; ++i) {
      const double t = 0.004 * i, torsion = 1.4e-3 * std::sin(t) + 4e-4 * std::sin(7.3 * t);
      x = transmission::advance(h, x, torsion - last);
      last = torsion;
      ASSERT_NEAR(inverse.update(transmission::torque_nm(h, torsion, x, temperature), temperature), torsion, 1e-9) << i;
    }
  }
}

TEST(MomentumObserver, SeesAnUnknownTorqueThroughItsLag) {
  MomentumObserver observer(40);
  const double dt = 5e-4, unknown = 3;
  double momentum = 0;
  observer.update(0, momentum, dt);
  for (int i = 1; i <= 200; ++i) {
    const double known = std::sin(0.1 * i);
    momentum += (known - unknown) * dt;
    ASSERT_NEAR(observer.update(known, momentum, dt), unknown * -std::expm1(-40 * dt * i), 1e-9);
  }
}

// An encoder's speed settles on the true one and one count at rest shows as no more than the header says.
TEST(Encoder, TracksSpeedOfWholeCounts) {
  const double resolution = 2 * std::numbers::pi / 8192, dt = 5e-4;
  Encoder moving(8192, 1, 220), resting(8192, 1, 220);
  double max_rad_s = 0;
  for (int i = 0; i < 4000; ++i) {
    moving.read(5.0 * i * dt, 5.0, dt);
    resting.read(i < 100 ? 0 : resolution, 0, dt);
    ASSERT_LT(std::abs(std::remainder(moving.angle_rad(), resolution)), 1e-12);
    max_rad_s = std::max(max_rad_s, resting.speed_rad_s());
  }
  EXPECT_NEAR(moving.speed_rad_s(), 5.0, 0.05);
  EXPECT_LE(max_rad_s, 0.74 * 220 * resolution);
  EXPECT_NEAR(resting.speed_rad_s(), 0, 1e-9);
}

TEST(TrackingError, TellsOscillationFromTheWayOfTheLoad) {
  TrackingError slow, swinging;
  for (int i = 0; i < 20000; ++i) {
    const double t = 5e-4 * i, way = 1.5e-3 * std::sin(2 * std::numbers::pi / 16 * t);
    slow.add(0, way, true, 5e-4);
    swinging.add(0, way + 5e-6 * std::sin(100 * t), true, 5e-4);
  }
  EXPECT_LT(slow.standstill_pp_mrad(), 5e-4);
  EXPECT_NEAR(swinging.standstill_pp_mrad(), 1e-2, 1.5e-3);
  EXPECT_NEAR(
      slow.l1_mrad(),
      1.5 * (3 - std::cos(2 * std::numbers::pi * 10 / 16 - std::numbers::pi)) / (2 * std::numbers::pi * 10 / 16), 0.01);
}

struct Tracked {
  double none = 0, fixed = 0, proposed = 0, oscillation = 0;
};

/// rh380n_tracking at one temperature, mean over seeds of the identification error; oscillation: of the first, the
/// shipped one.
Tracked tracked(double temperature, std::span<const int> seeds) {
  const auto run_one = [&](const char* compensation, int seed) {
    return std::async(std::launch::async, [=] {
      const Scenario scenario =
          load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/rh380n_tracking.yaml",
                        {fmt::format("temperature_degC={}", temperature),
                         fmt::format("control.compensation={}", compensation), fmt::format("seed={}", seed)})
              .value();
      const auto summary = run(scenario, {});
      EXPECT_TRUE(summary.has_value()) << summary.error().message;
      return summary->tracking.at(0);
    });
  };
  Tracked mean;
  const auto n = static_cast<double>(seeds.size());
  for (const int seed : seeds) {
    auto none = run_one("none", seed), fixed = run_one("static", seed), proposed = run_one("proposed", seed);
    mean.none += none.get().l1_mrad / n;
    mean.fixed += fixed.get().l1_mrad / n;
    const TrackingSummary p = proposed.get();
    mean.proposed += p.l1_mrad / n;
    if (seed == seeds.front()) mean.oscillation = p.standstill_pp_mrad;
  }
  return mean;
}

// RH380-N study section 5.3. The controller's model has an error of 1 % in every number, different for every seed: the
// shipped one by day, the mean of three by night.
TEST(Compensation, CutsTheTrackingErrorAsInPaper4) {
  constexpr int all_seeds[] = {1, 2, 3};
  const auto seeds = std::span(all_seeds).first(std::getenv("TRIBOTWIN_NIGHTLY") ? 3 : 1);
  const Tracked cold = tracked(20, seeds), warm = tracked(35, seeds);
  EXPECT_LE(cold.fixed, (1 - 0.81) * cold.none);
  EXPECT_LE(cold.proposed, (1 - 0.56) * cold.fixed);
  EXPECT_LT(warm.proposed / warm.fixed, cold.proposed / cold.fixed) << "the advantage grows with temperature";
  const double two_counts_mrad = 1e3 * 2 * 2 * std::numbers::pi / 8192 / 185;
  EXPECT_LT(std::max(cold.oscillation, warm.oscillation), two_counts_mrad);
  fmt::print(
      "20 degC: {:.3f} -> {:.3f} -> {:.3f} mrad, 35 degC: {:.3f} -> {:.3f} -> {:.3f} mrad, oscillation {:.4f} mrad\n",
      cold.none, cold.fixed, cold.proposed, warm.none, warm.fixed, warm.proposed,
      std::max(cold.oscillation, warm.oscillation));
}

/// A joint that warms up by its own friction; its heat and steady rise differ by 10 % from the observer's model.
double error_after_one_time_constant(double start_error_K, double heat_factor, double time_factor) {
  const auto model = mujoco::load_file(std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/irb6620.xml");
  const drive::Drive believed = (*model)->drives()[1].drive;
  thermal::Model real = believed.thermal;
  real.t_s[0] *= time_factor;
  real.gain_K_J[0] *= heat_factor / time_factor;
  const double dt = 1, start = 45;
  TemperatureObserver observer(believed, {.start_degC = start + start_error_K,
                                          .start_sigma_K = 15,
                                          .friction_sigma_nm = 0.02 * believed.torque_max_nm * 0.1,
                                          .correlation_s = 1});
  thermal::Rise rise = thermal::steady_rise(real, start - real.T_amb_degC);
  const thermal::Decay decay = thermal::decay(real, dt);
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0, 0.02 * believed.torque_max_nm * 0.1);
  for (double t = 0; t < believed.thermal.t_s[0]; t += dt) {
    const double temperature = real.T_amb_degC + rise.total_K(), speed = 1.2 * std::sin(0.7 * t),
                 load = 0.3 * believed.torque_max_nm;
    const double friction = std::copysign(mujoco::friction_nm(believed, speed, 0.3, temperature), speed);
    thermal::step(real, decay, friction * speed, 0, rise);
    observer.update({.speed_rad_s = speed,
                     .load_nm = load,
                     .friction_nm = friction + noise(random),
                     .ambient_degC = real.T_amb_degC},
                    dt);
  }
  const double error = observer.temperature_degC() - (real.T_amb_degC + rise.total_K());
  EXPECT_LT(std::abs(error), 3 * observer.sigma_K() + 0.1);
  return std::abs(error);
}

TEST(TemperatureObserver, FindsTheTemperatureFromFriction) {
  for (const double start : {-15.0, 15.0})
    for (const double heat : {0.9, 1.1})
      for (const double time : {0.9, 1.1})
        EXPECT_LT(error_after_one_time_constant(start, heat, time), 2) << start << ' ' << heat << ' ' << time;
}

struct Felt {
  double joint3_nm;
  std::array<double, 6> wrench;  ///< at the flange
};

/// The estimate 0.1 s after 5 Nm were put on joint 3, or `push` (force and torque, world axes) on the flange, of a
/// moving ER3A, with its gears at `real` degC and estimated with `believed` degC.
Felt felt(double real_degC, double believed_degC, std::optional<std::array<double, 6>> push = {}) {
  const auto loaded = mujoco::load_file(std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/er3a_c60.xml");
  const auto model = *loaded;
  const auto drives = model->drives();
  const auto d = model->make_data();
  for (const auto& drive : drives) drive::set_temperature(drive.drive, mujoco::state(d.get(), drive), real_degC);
  mj_forward(model->get(), d.get());
  DriveServo servo(*model, d.get(), {});
  auto sensor = ExternalTorque::make(model, 60);
  EXPECT_TRUE(sensor.has_value()) << sensor.error().message;
  const double dt = (*model)->opt.timestep;
  std::vector<DriveCommand> commands(drives.size());
  std::vector<double> q(drives.size()), qd(drives.size()), torque(drives.size()),
      temperature(drives.size(), believed_degC);
  const std::size_t joint = 2;
  const int flange = mj_name2id(model->get(), mjOBJ_SITE, "flange");
  Felt felt{};
  struct Loop {
    DriveServo& servo;
    std::vector<DriveCommand>& commands;
  } loop{servo, commands};
  for (int i = 0; i * dt < 1.1; ++i) {
    for (std::size_t k = 0; k < drives.size(); ++k)
      commands[k] = {.mode = DriveCommand::Mode::velocity, .velocity_rad_s = 0.5};
    mju_zero(d->qfrc_applied, (*model)->nv);
    if (i * dt >= 1 && !push) d->qfrc_applied[drives[joint].dof] = 5;
    if (i * dt >= 1 && push)
      mj_applyFT(model->get(), d.get(), push->data(), push->data() + 3, d->site_xpos + 3 * flange,
                 (*model)->site_bodyid[flange], d->qfrc_applied);
    model->step(d.get(), {[](void* self, const mjModel* m, mjData* data) {
                            static_cast<Loop*>(self)->servo.control(m, data, static_cast<Loop*>(self)->commands);
                          },
                          &loop});
    for (std::size_t k = 0; k < drives.size(); ++k) {
      q[k] = d->qpos[drives[k].position];
      qd[k] = d->qvel[drives[k].dof];
      torque[k] = mujoco::workspace(d.get(), drives[k]).torque_nm;
    }
    sensor->update(q, qd, torque, temperature, dt);
    felt = {sensor->torque_nm()[joint], sensor->wrench(flange)};
  }
  return felt;
}

TEST(ExternalTorque, FeelsFiveNewtonMetresColdAndHotIfItKnowsTheTemperature) {
  EXPECT_NEAR(felt(20, 20).joint3_nm, 5, 0.75);
  EXPECT_NEAR(felt(45, 45).joint3_nm, 5, 0.75);
  EXPECT_GT(std::abs(felt(20, 45).joint3_nm - 5), 0.75) << "an isothermal model must not do";
  EXPECT_GT(std::abs(felt(45, 20).joint3_nm - 5), 0.75) << "an isothermal model must not do";
}

TEST(ExternalTorque, FeelsForceAndTorqueAtTheToolColdAndHotIfItKnowsTheTemperature) {
  // Of any component over what was applied; 1 N beside a torque counts as 1 Nm.
  const auto largest_error = [](double real_degC, double believed_degC, const std::array<double, 6>& push) {
    const auto wrench = felt(real_degC, believed_degC, push).wrench;
    double error = 0, size = 0;
    for (std::size_t k = 0; k < 6; ++k)
      error = std::max(error, std::abs(wrench[k] - push[k])), size = std::max(size, std::abs(push[k]));
    fmt::print("{} at {} degC by a model of {} degC: {:.3f}\n", fmt::join(push, ", "), real_degC, believed_degC,
               fmt::join(wrench, ", "));
    return error / size;
  };
  for (const std::array<double, 6>& push : {std::array<double, 6>{20, 0, 0, 0, 0, 0}, {0, 0, 0, 0, 5, 0}}) {  // N, Nm
    for (const double temperature : {20.0, 45.0}) EXPECT_LT(largest_error(temperature, temperature, push), 0.15);
    EXPECT_GT(largest_error(20, 45, push), 0.15) << "an isothermal model must not do";
    EXPECT_GT(largest_error(45, 20, push), 0.15) << "an isothermal model must not do";
  }
}

}  // namespace
}  // namespace tribotwin::twin
