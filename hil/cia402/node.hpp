#pragma once

#include <tribotwin/hil/canopen/emcy.hpp>
#include <tribotwin/hil/canopen/heartbeat.hpp>
#include <tribotwin/hil/canopen/nmt.hpp>
#include <tribotwin/hil/canopen/node_context.hpp>
#include <tribotwin/hil/canopen/pdo.hpp>
#include <tribotwin/hil/canopen/sdo.hpp>
#include <tribotwin/hil/canopen/setup/lss.hpp>
#include <tribotwin/hil/canopen/setup/parameter_keeper.hpp>
#include <tribotwin/hil/canopen/sync.hpp>
#include <tribotwin/hil/canopen/time_stamp.hpp>
#include <tribotwin/hil/cia402/drive_profile.hpp>
#include <tribotwin/hil/cia402/set_point_watch.hpp>
#include <tribotwin/hil/drives/bus_drive.hpp>

namespace tribotwin::hil {

/// How a node starts.
struct NodeSetup {
  bool unconfigured = false;        ///< without a node number; a master gives it one (LSS)
  std::vector<Object> foreign;      ///< objects of another maker's drive (EDS), see with_foreign_objects
  std::vector<ObjectValue> values;  ///< its configuration (DCF), written over the defaults by every reset
  KeptParameters kept;              ///< what it kept when it was on before
  ParameterKeeper::Keep keep;
  std::function<bool()> may_keep;  ///< of the bench: whether it can wait for `keep` now; empty: always
};

/// One drive on the bus: the services of CANopen (CiA 301) wired to the drive profile (CiA 402), free of sockets and
/// clocks. Frames and the time of the bus come in, frames go out; set points go to the physics step by step, feedback
/// comes back.
///
/// Lost commands (a deadline of a PDO, of set points or of the SYNC, a watched heartbeat) and NMT leaving operational
/// start the reaction 6007h and end in the state fault, until a fault reset: the last torque never stays.
class Node final : public BusDrive {
 public:
  Node(const DriveParameters& parameters, Send send, NodeSetup setup = {});
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  /// Sends the boot-up message; pre-operational from then on.
  void start(std::int64_t now_ns) override;
  void receive(const Frame& frame, std::int64_t now_ns) override;
  void sync(std::int64_t now_ns) override;
  void tick(std::int64_t now_ns) override;
  void recovered(std::int64_t now_ns) override;  ///< sends EMCY 8140h
  std::int64_t next_ns() const override;
  bool sends(std::uint32_t id) const override;
  bool takes(const Frame& frame) const override;
  twin::DriveCommand command(double dt_s) override { return drive_.command(dt_s); }
  void feedback(const Feedback& feedback, double dt_s) override { drive_.feedback(feedback, dt_s); }
  twin::LoopGains gains() const override { return drive_.gains(); }
  bool brake_engaged() const override { return drive_.brake_engaged(); }
  std::optional<double> measured_temperature_degC() const override { return drive_.measured_temperature_degC(); }
  std::string state_name() const override { return name_of(state()); }
  bool enabled() const override { return state() == DriveState::operation_enabled; }
  bool failed() const override { return state() == DriveState::fault; }
  bool stops_alone() const override { return drive_.stops_alone(); }
  std::vector<std::pair<std::string, std::uint64_t>> counts() const override;

  Nmt nmt() const { return context_.nmt; }
  DriveState state() const { return drive_.machine().state(); }
  std::uint8_t id() const { return context_.id; }
  const DriveParameters& parameters() const { return parameters_; }
  Dictionary& dictionary() { return context_.dictionary; }
  const NodeCounters& counters() const { return context_.counters; }
  std::uint16_t error_code() const { return drive_.error_code(); }
  /// A value of the setup that an object refused, if there is one; those after it were not written.
  const std::optional<RefusedValue>& refused() const { return refused_; }
  /// A fault from outside the bus: injected, or of the bench. `register_bits`: of 1001h.
  void fail(std::uint16_t code, std::uint8_t register_bits, bool ramp, std::int64_t now_ns);

 private:
  tl::expected<void, Abort> may_read(const Object& object);
  tl::expected<void, Abort> may_write(const Object& object, std::int64_t value);
  tl::expected<void, Abort> may_count_syncs(const Object& overflow, std::int64_t value) const;
  void written(const Object& object);

  /// The drive's parameters with the node number that it has now.
  DriveParameters active_parameters() const { return with_number(context_.id); }
  DriveParameters with_number(std::uint8_t number) const;
  void hear_lss(const Frame& frame, std::int64_t now_ns);
  void obey(NmtCommand command, std::int64_t now_ns);
  void reset(NmtCommand command, std::int64_t now_ns);
  void restore(const Object& fresh);
  /// The objects as they left the factory.
  Dictionary factory(std::uint8_t number) const;
  /// The same with the configuration: what a reset brings, but for what is kept.
  const Dictionary& defaults();
  tl::expected<void, Abort> obey_keeper(const Object& object, std::int64_t signature);
  bool may_keep() const { return !drive_.machine().powered() && (!setup_.may_keep || setup_.may_keep()); }
  /// Writes the values of the setup and those kept, over the defaults.
  void configure(NmtCommand reset);
  /// The node number after power-up; FFh: none.
  std::uint8_t first_number(const KeptParameters& kept) const {
    return kept.node_number.value_or(setup_.unconfigured ? unconfigured_node : parameters_.node);
  }
  bool configured() const { return context_.id != unconfigured_node; }
  void request_sdo(const Frame& frame, std::int64_t now_ns);
  bool answer_sdo(const SdoServer::Answer& answer);
  void lose_heartbeat();
  void check_sync_length(bool counted);
  void watch_deadlines(std::int64_t now_ns);
  void watch_set_points(std::int64_t now_ns);

  DriveParameters parameters_;
  NodeSetup setup_;
  NodeContext context_;
  ParameterKeeper keeper_;
  LssSlave lss_;
  std::optional<RefusedValue> refused_;
  std::optional<Dictionary> defaults_;  // of the node number defaults_of_
  std::uint8_t defaults_of_ = 0;
  Emcy emcy_;
  SdoServer sdo_;
  PdoService pdos_;
  SyncConsumer sync_;
  HeartbeatProducer heartbeat_;
  HeartbeatConsumer watched_;
  NodeGuard guard_;
  TimeConsumer time_;
  bool wrong_sync_ = false;  // the last SYNC had a counter that 1019h does not ask for, or none
  SetPointWatch set_points_;
  DriveProfile drive_;
};

}  // namespace tribotwin::hil
