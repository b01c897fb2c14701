#pragma once

#include <cmath>
#include <random>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

/// Sessions of a robot and its master on an imaginary bus, as a logger beside them would have them. No clock, no
/// socket: the same session gives the same frames.
namespace tribotwin::hil {

struct SessionPlan {
  Profile profile = Profile::cia402;
  std::uint32_t cycle_us = 2000;
  double seconds = 8;
  bool lockstep = true;         ///< else the robot moves with the clock, in steps of 1 ms
  bool enabled = true;          ///< else the brakes hold the arm
  bool torque = true;           ///< TPDO4 carries 6077h
  double amplitude_rad = 0.12;  ///< of every joint, at 0.5 Hz
  double sync_jitter_s = 0;     ///< of the master: each SYNC is late by up to this; once in 200 by ten times as much
  double load_nm = 0;           ///< on joint 2 from 4 s on, as something that the arm leans against
};

class RecordedSession {
 public:
  RecordedSession(const twin::Scenario& scenario, const SessionPlan& plan)
      : plan_(plan),
        scenario_(scenario),
        bench_(scenario, {.profile = plan.profile, .cycle_us = plan.cycle_us, .lockstep = plan.lockstep},
               [this](const Frame& f) {
                 log(f);
                 return Sent::done;
               }) {
    bench_.start(now_);
    if (plan.profile == Profile::cia402) prepare();
    const auto cycles = static_cast<int>(plan.seconds * 1e6 / plan.cycle_us);
    for (int k = 0; k < cycles; ++k) cycle(k);
  }
  std::vector<Frame> frames;

 private:
  void log(Frame frame) {
    frame.time_ns = now_;
    frames.push_back(frame);
  }
  void master(const Frame& frame) {
    log(frame);
    if (!bench_.receive(frame, now_)) throw std::runtime_error("the simulation failed");
  }
  void master(std::uint32_t id, std::vector<std::uint8_t> bytes) { master(classic(id, bytes)); }
  std::uint32_t joints() const { return static_cast<std::uint32_t>(scenario_.start_rad.size()); }

  void prepare() {
    for (std::uint32_t n = 1; n <= joints() && plan_.torque; ++n)
      for (const auto& [index, sub, type, value] : {std::tuple{od::tpdo_mapping + 3, 0, Type::u8, 0L},
                                                    {od::tpdo_mapping + 3, 1, Type::u32, 0x60770010L},
                                                    {od::tpdo_mapping + 3, 0, Type::u8, 1L},
                                                    {od::tpdo_communication + 3, 2, Type::u8, 1L},
                                                    {od::tpdo_communication + 3, 1, Type::u32, 0x480L + n}})
        master(cob::sdo_to_server + n,
               download(static_cast<std::uint16_t>(index), static_cast<std::uint8_t>(sub), type, value));
    master(cob::nmt, {1, 0});
    for (const std::uint8_t word : {0x06, 0x07, 0x0F})
      for (std::uint32_t n = 1; n <= joints() && plan_.enabled; ++n) master(cob::rpdo(0) + n, {word, 0});
  }

  double target_rad(std::size_t joint, double time_s) const {
    const double moving_s = std::max(0.0, time_s - 0.5);
    return scenario_.start_rad[joint] + plan_.amplitude_rad / 2 * (1 - std::cos(M_PI * moving_s));
  }

  void set_points(int cycle) {
    const double time_s = 1e-6 * plan_.cycle_us * cycle;
    for (std::uint32_t n = 1; n <= joints() && plan_.enabled; ++n) {
      const double target = target_rad(n - 1, time_s);
      if (plan_.profile == Profile::mirror) {
        master(encode(MirrorCommand{static_cast<std::uint8_t>(cycle & 15), MirrorMode::position, target},
                      static_cast<int>(n)));
        continue;
      }
      const double gear = scenario_.model->drives()[n - 1].drive.gear_ratio;
      std::vector<std::uint8_t> bytes{0x0F, 0, 0, 0, 0, 0};
      encode(std::llround(target * gear * 65536 / (2 * M_PI)), std::span(bytes).subspan(2));
      master(cob::rpdo(2) + n, bytes);
    }
  }

  void cycle(int k) {
    std::uniform_real_distribution<double> share(0, 1);
    const double late_s = plan_.sync_jitter_s * share(random_) * (share(random_) < 0.005 ? 10 : 1);
    const std::int64_t sync_ns = (k + 1) * 1000LL * plan_.cycle_us + std::llround(1e9 * late_s);
    if (!plan_.lockstep)
      for (; moved_ns_ + ms <= sync_ns; moved_ns_ += ms) {
        now_ = std::max(now_, moved_ns_ + ms);
        if (!bench_.tick(now_) || !bench_.plant().step(bench_.drives()))
          throw std::runtime_error("the simulation failed");
      }
    now_ = std::max(now_, sync_ns);
    if (now_ >= 4'000 * ms) bench_.plant().twin().data()->qfrc_applied[1] = plan_.load_nm;
    set_points(k);
    master(cob::sync, {});
  }

  SessionPlan plan_;
  const twin::Scenario& scenario_;
  Bench bench_;
  std::int64_t now_ = 0, moved_ns_ = 0;
  std::mt19937_64 random_{7};
};

}  // namespace tribotwin::hil
