#pragma once

#include <array>
#include <functional>

#include <tribotwin/hil/canopen/cia402.hpp>
#include <tribotwin/hil/canopen/sdo.hpp>
#include <tribotwin/hil/drives/bus_drive.hpp>

/// One drive on the bus: CANopen slave (CiA 301) with the drive profile (CiA 402), free of sockets and clocks: frames
/// and the time of the bus come in, frames go out; set points go to the physics step by step, feedback comes back.
///
/// Lost commands (a PDO's or the SYNC's deadline, a watched heartbeat) and NMT leaving operational take the drive to
/// its reaction 6007h and then to fault, until a fault reset: the last torque never stays.
namespace tribotwin::hil {

enum class Nmt : std::uint8_t { stopped = 0x04, operational = 0x05, pre_operational = 0x7F };

struct NodeCounters {
  std::uint64_t pdo_received = 0, pdo_sent = 0, pdo_short = 0, pdo_late = 0, sdo_requests = 0, sdo_aborts = 0,
                emergencies = 0, heartbeats_lost = 0, syncs_lost = 0,
                foreign = 0;  ///< frames with an identifier that only this node may send: another node has its number
};

class Node final : public BusDrive {
 public:
  Node(const DriveParameters& parameters, Send send);
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  /// Announces itself (boot-up); pre-operational from then on.
  void start(std::int64_t now_ns) override;
  void receive(const Frame& frame, std::int64_t now_ns) override;
  void sync(std::int64_t now_ns) override;
  void tick(std::int64_t now_ns) override;
  void recovered(std::int64_t now_ns) override;  ///< EMCY 8140h
  std::int64_t next_ns() const override;
  bool sends(std::uint32_t id) const override;
  twin::DriveCommand command(double dt_s) override;
  void feedback(const Feedback& feedback, double dt_s) override;
  bool brake_engaged() const override { return !machine_.powered(); }
  /// 2110h, when a bench writes one.
  std::optional<double> measured_temperature_degC() const override;
  std::string state_name() const override { return name_of(machine_.state()); }
  bool enabled() const override { return machine_.state() == DriveState::operation_enabled; }
  bool failed() const override { return machine_.state() == DriveState::fault; }
  std::vector<std::pair<std::string, std::uint64_t>> counts() const override;

  Nmt nmt() const { return nmt_; }
  DriveState state() const { return machine_.state(); }
  std::uint8_t id() const { return id_; }
  const DriveParameters& parameters() const { return parameters_; }
  Dictionary& dictionary() { return dictionary_; }
  const NodeCounters& counters() const { return counters_; }
  std::uint16_t error_code() const { return static_cast<std::uint16_t>(error_code_->value); }
  /// A fault from outside the bus: injected, or of the bench.
  void fail(std::uint16_t code, std::uint8_t register_bits, bool ramp, std::int64_t now_ns);

 private:
  struct Pdo {
    std::uint32_t cob = 0;
    bool exists = false, pending = false, sent_once = false;
    std::uint8_t type = 255, syncs = 0;
    std::int64_t inhibit_ns = 0, timer_ns = 0, last_ns = 0;
    std::vector<Object*> map;  // null: a gap of gap bits
    std::vector<int> sizes;    // bytes
    int size = 0;
    std::array<std::uint8_t, 8> data{};
  };

  tl::expected<void, Abort> may_write(const Object& object, std::int64_t value);
  void written(const Object& object);
  void load(Pdo& pdo, std::uint16_t index);
  void reload();
  tl::expected<int, Abort> mapped_size(std::uint32_t entry, bool receive);

  void network(std::uint8_t command, std::int64_t now_ns);
  void take(Pdo& pdo, std::int64_t now_ns);
  std::array<std::uint8_t, 8> gather(const Pdo& pdo) const;
  void send_pdo(Pdo& pdo, std::int64_t now_ns);
  /// Whether its inhibit time keeps an event PDO from being sent now.
  static bool rests(const Pdo& pdo, std::int64_t now_ns);
  bool send(std::uint32_t id, std::span<const std::uint8_t> bytes);
  void emergency(std::uint16_t code, std::uint8_t register_bits, std::span<const std::uint8_t> extra = {});
  /// An error of the moment: reported, and gone.
  void forward(std::uint16_t code, std::span<const std::uint8_t> extra = {});
  void lose_commands(std::uint16_t code, std::int64_t now_ns);
  void refresh_status();
  void apply_controlword();
  void set_target();
  StopOptions stop_options() const;
  double joint_rad(std::int64_t increments) const { return static_cast<double>(increments) * increment_rad_; }

  DriveParameters parameters_;
  std::uint8_t id_;
  Send send_;
  Dictionary dictionary_;
  SdoServer sdo_;
  StateMachine machine_;
  Nmt nmt_ = Nmt::pre_operational;
  std::array<Pdo, pdo_count> receive_, transmit_;
  NodeCounters counters_;
  Feedback feedback_;
  std::int64_t now_ns_ = 0, heartbeat_ns_ = 0, sync_ns_ = -1;
  struct Watched {
    std::uint8_t node = 0;
    std::int64_t period_ns = 0, last_ns = -1;
  };
  std::array<Watched, 2> watched_;

  // Joint side units per count of the dictionary.
  double increment_rad_, milli_rpm_rad_s_, per_mille_nm_;
  // Set point under way.
  double demand_rad_ = 0, demand_step_rad_s_ = 0, demand_left_s_ = 0, ramp_rad_s_ = 0;
  double following_s_ = 0, standing_s_ = 0;
  bool follows_before_ = false;
  std::array<bool, 3> fresh_{};  // targets written since the drive last took up a mode: position, velocity, torque
  bool changed_ = true;          // something that an event PDO could send
  bool held_back_ = false;       // an inhibit time may keep such a PDO from being sent
  std::uint8_t register_ = 0;

  // Cached objects of the step.
  Object *control_, *status_, *mode_, *mode_shown_, *target_position_, *target_velocity_, *target_torque_, *error_code_,
      *error_register_, *heartbeat_time_, *sync_deadline_;
};

}  // namespace tribotwin::hil
