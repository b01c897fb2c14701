#include <algorithm>
#include <limits>
#include <utility>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/node.hpp>

namespace tribotwin::hil {

namespace {

/// The serial number must not follow the node number, which LSS may change.
DriveParameters with_serial_number(DriveParameters p) {
  if (p.serial_number == 0) p.serial_number = p.node;
  return p;
}

}  // namespace

Node::Node(const DriveParameters& p, Send send, NodeSetup setup)
    : parameters_(with_serial_number(p)),
      setup_(std::move(setup)),
      context_{.id = first_number(setup_.kept),
               .send_frame = std::move(send),
               .dictionary = factory(first_number(setup_.kept))},
      keeper_(context_, setup_.kept, setup_.keep),
      lss_(context_, setup_.keep ? [this](std::uint8_t number) { return may_keep() && keeper_.keep_number(number); }
                                 : LssSlave::Keep{}),
      emcy_(context_),
      sdo_(context_.dictionary, [this](const SdoServer::Answer& answer) { return answer_sdo(answer); }),
      pdos_(context_, emcy_),
      sync_(context_),
      heartbeat_(context_),
      guard_(context_),
      time_(context_),
      set_points_(context_),
      drive_(context_, emcy_, p) {
  context_.dictionary.may_read = [this](const Object& o) { return may_read(o); };
  context_.dictionary.may_write = [this](const Object& o, std::int64_t value) { return may_write(o, value); };
  context_.dictionary.written = [this](const Object& o) { written(o); };
  configure(NmtCommand::reset_node);
  drive_.refresh_status();
}

// ---- Access by the bus, handed to the service that owns the object.

/// CiA 301, 7.5.2.4: an entry of the history without an error is no data.
tl::expected<void, Abort> Node::may_read(const Object& o) {
  if (o.index == od::store_eds && o.text.empty())
    context_.dictionary.find(o.index, o.sub)->text = eds(factory(context_.id), active_parameters());
  if (o.index == od::time_of_day) time_.show(context_.now_ns);
  if (o.index != od::predefined_error_field || o.sub <= context_.dictionary.get(o.index)) return {};
  return tl::unexpected(Abort::no_data);
}

tl::expected<void, Abort> Node::may_write(const Object& o, std::int64_t value) {
  if (PdoService::owns(o.index)) return pdos_.may_write(o, value);
  if (o.index == od::predefined_error_field && value != 0) return tl::unexpected(Abort::out_of_range);
  if (ParameterKeeper::owns(o.index)) return obey_keeper(o, value);
  if (o.index == od::cob_id_time) return time_.may_write(value);
  if (o.index == od::synchronous_counter_overflow) return may_count_syncs(o, value);
  if (o.index == od::consumer_heartbeat_time) return watched_.may_configure(o, value);
  return drive_.may_write(o, value);
}

tl::expected<void, Abort> Node::obey_keeper(const Object& o, std::int64_t signature) {
  if (auto ok = keeper_.may_obey(o, signature); !ok) return ok;
  if (!may_keep()) return tl::unexpected(Abort::not_now);
  return keeper_.obey(o, defaults());
}

/// CiA 301, 7.5.2.22: not while there is a SYNC; 1 is reserved.
tl::expected<void, Abort> Node::may_count_syncs(const Object& overflow, std::int64_t value) const {
  if (value == 1) return tl::unexpected(Abort::out_of_range);
  if (value != overflow.value && context_.dictionary.get(od::communication_cycle_period) != 0)
    return tl::unexpected(Abort::not_now);
  return {};
}

void Node::written(const Object& o) {
  context_.changed = true;
  if (PdoService::owns(o.index)) return pdos_.reload();
  if (ParameterKeeper::owns(o.index)) return keeper_.show();
  if (o.index == od::predefined_error_field) return emcy_.clear_history();
  if (o.index == od::consumer_heartbeat_time) return watched_.configure(o);
  drive_.written(o);
}

// ---- Network management.

void Node::start(std::int64_t now_ns) {
  context_.now_ns = now_ns;
  context_.nmt = configured() ? Nmt::pre_operational : Nmt::initialising;
  if (configured()) heartbeat_.boot_up(now_ns);
}

void Node::hear_lss(const Frame& frame, std::int64_t now_ns) {
  if (lss_.receive(frame)) reset(NmtCommand::reset_communication, now_ns);
}

DriveParameters Node::with_number(std::uint8_t number) const {
  DriveParameters numbered = parameters_;
  if (number != unconfigured_node) numbered.node = number;
  return numbered;
}

void Node::obey(NmtCommand command, std::int64_t now_ns) {
  const Nmt before = context_.nmt;
  switch (command) {
    case NmtCommand::start:
      context_.nmt = Nmt::operational;
      break;
    case NmtCommand::stop:
      context_.nmt = Nmt::stopped;
      sdo_.reset();  // CiA 301: there is no SDO while stopped
      break;
    case NmtCommand::enter_pre_operational:
      context_.nmt = Nmt::pre_operational;
      break;
    case NmtCommand::reset_node:
    case NmtCommand::reset_communication:
      return reset(command, now_ns);
  }
  if (context_.operational() && before != Nmt::operational) {
    sync_.reset();
    pdos_.start();
    context_.changed = true;
  }
  // Also of a drive that SDOs have enabled before.
  const bool left = !context_.operational() && context_.nmt != before;
  if (left && (before == Nmt::operational || drive_.machine().powered()))
    drive_.lose_commands(ErrorCode::left_operational);
  drive_.refresh_status();
}

/// Objects back to their defaults, by reset communication only those of CiA 301; the physics continues. The drive is as
/// after power-up: the brake holds.
void Node::reset(NmtCommand command, std::int64_t now_ns) {
  context_.id = command == NmtCommand::reset_node ? first_number(keeper_.kept()) : lss_.pending();
  lss_.reset(context_.id);
  const Dictionary fresh = factory(context_.id);
  for (const Object& o : fresh.objects()) {
    // Constant ones of the communication as well: identifiers follow the node number.
    if (od::is_communication(o.index) || (o.access == Access::read_write && command == NmtCommand::reset_node))
      restore(o);
  }
  drive_.reset();
  sdo_.reset();
  watched_ = {};
  guard_.reset();
  emcy_.reset();
  pdos_.reset();
  sync_.reset();
  keeper_.show();
  configure(command);
  start(now_ns);
  drive_.refresh_status();
}

Dictionary Node::factory(std::uint8_t number) const {
  const DriveParameters numbered = with_number(number);
  Dictionary own = drive_dictionary(numbered);
  return setup_.foreign.empty() ? own : with_foreign_objects(own, setup_.foreign, numbered.node);
}

/// Made once per node number: an EDS may have thousands of objects.
const Dictionary& Node::defaults() {
  if (!defaults_ || defaults_of_ != context_.id) {
    defaults_ = factory(context_.id);
    defaults_of_ = context_.id;
    download(*defaults_, setup_.values);
  }
  return *defaults_;
}

void Node::configure(NmtCommand command) {
  refused_.reset();
  for (const std::vector<ObjectValue>* all : {&std::as_const(setup_.values), &keeper_.kept().values}) {
    std::vector<ObjectValue> values;
    for (const ObjectValue& v : *all)
      if (command == NmtCommand::reset_node || od::is_communication(v.index)) values.push_back(v);
    const auto refused = download(context_.dictionary, std::move(values));
    if (!refused_) refused_ = refused;
  }
}

void Node::restore(const Object& fresh) {
  Object& o = *context_.dictionary.find(fresh.index, fresh.sub);
  o.value = fresh.value;
  o.text = fresh.text;
}

// ---- Frames.

bool Node::sends(std::uint32_t id) const {
  if (id == cob::lss_to_master) return true;
  if (!configured()) return false;
  return id == cob::heartbeat + context_.id || id == cob::sdo_to_client + context_.id ||
         id == cob::emcy + context_.id || pdos_.sends(id);
}

bool Node::takes(const Frame& frame) const {
  if (frame.extended || frame.error || frame.fd) return false;
  const std::uint32_t id = frame.id;
  if (frame.remote) return configured() && id == cob::heartbeat + context_.id;
  if (id == cob::lss_to_slave) return true;
  if (!configured()) return false;
  return id == cob::nmt || id == cob::sdo_to_server + context_.id || watched_.watches(id) || time_.takes(id) ||
         pdos_.takes(id);
}

void Node::receive(const Frame& frame, std::int64_t now_ns) {
  context_.now_ns = now_ns;
  if (frame.extended || frame.error || frame.fd) return;
  if (frame.remote) {
    if (configured() && frame.id == cob::heartbeat + context_.id) guard_.asked(now_ns);
    return;
  }
  if (frame.id == cob::lss_to_slave) return hear_lss(frame, now_ns);
  if (!configured()) return;
  if (frame.id == cob::nmt) {
    if (const auto command = nmt_command(frame, context_.id)) obey(*command, now_ns);
    return;
  }
  if (frame.id == cob::sdo_to_server + context_.id) return request_sdo(frame, now_ns);
  if (is_sync(frame)) return sync_.count(frame);
  watched_.hear(frame.id, now_ns);
  time_.hear(frame, now_ns);
  if (frame.id == cob::heartbeat + context_.id || frame.id == cob::sdo_to_client + context_.id ||
      frame.id == cob::emcy + context_.id) {
    ++context_.counters.foreign;
    return;
  }
  if (!context_.operational()) return;
  pdos_.receive(frame, now_ns);
  drive_.refresh_status();
  watch_set_points(now_ns);
}

void Node::request_sdo(const Frame& frame, std::int64_t now_ns) {
  if (context_.nmt == Nmt::stopped) return;
  ++context_.counters.sdo_requests;
  sdo_.request(frame.bytes(), now_ns);
  drive_.refresh_status();
}

bool Node::answer_sdo(const SdoServer::Answer& answer) {
  if (SdoServer::is_abort(answer)) ++context_.counters.sdo_aborts;
  return context_.send(cob::sdo_to_client + context_.id, answer);
}

void Node::sync(std::int64_t now_ns) {
  context_.now_ns = now_ns;
  const auto counter = sync_.take_counter();
  if (!context_.operational()) return;
  check_sync_length(counter.has_value());
  sync_.hear(now_ns);
  set_points_.sync();
  pdos_.sync(now_ns, counter);
  drive_.sync();
  drive_.refresh_status();
  watch_set_points(now_ns);
}

/// CiA 301: EMCY 8240h for a SYNC with a counter that 1019h does not ask for, or without one; once, and it still
/// counts.
void Node::check_sync_length(bool counted) {
  const bool wrong = counted != (context_.dictionary.get(od::synchronous_counter_overflow) != 0);
  if (wrong && !std::exchange(wrong_sync_, true)) emcy_.report(ErrorCode::sync_length);
  wrong_sync_ = wrong;
}

// ---- Timers.

void Node::tick(std::int64_t now_ns) {
  context_.now_ns = now_ns;
  if (!configured()) return;
  sdo_.tick(now_ns);
  heartbeat_.tick(now_ns);
  emcy_.tick(now_ns);
  if (guard_.lost(now_ns)) lose_heartbeat();
  for (int lost = watched_.lost(now_ns); lost > 0; --lost) lose_heartbeat();
  if (!context_.operational()) return;
  watch_deadlines(now_ns);
  pdos_.tick(now_ns);
}

/// Reaction 6007h, and NMT as 1029h says.
void Node::lose_heartbeat() {
  enum ErrorBehavior : std::int64_t { to_pre_operational = 0, no_change = 1, to_stopped = 2 };
  ++context_.counters.heartbeats_lost;
  drive_.lose_commands(ErrorCode::heartbeat_lost);
  const auto behavior = context_.dictionary.get(od::error_behavior, 1);
  if (behavior == to_pre_operational && context_.operational()) context_.nmt = Nmt::pre_operational;
  if (behavior == to_stopped) {
    context_.nmt = Nmt::stopped;
    sdo_.reset();
  }
  drive_.refresh_status();
}

void Node::watch_deadlines(std::int64_t now_ns) {
  for (int late = pdos_.late(now_ns); late > 0; --late) {
    ++context_.counters.pdo_late;
    drive_.lose_commands(ErrorCode::rpdo_timeout);
  }
  watch_set_points(now_ns);
  // Only a drive that gets its set points by SYNC misses it.
  if (sync_.lost(now_ns) && drive_.machine().powered() && pdos_.any_synchronous_rpdo()) {
    ++context_.counters.syncs_lost;
    drive_.lose_commands(ErrorCode::sync_lost);
  }
}

/// After RPDOs were taken.
void Node::watch_set_points(std::int64_t now_ns) {
  const od::Index target = drive_.target();
  set_points_.follow(target, drive_.target_is_cyclic(), drive_.target_is_made_up());
  const PdoDelivery delivery = pdos_.delivery(target, set_points_.held_over());
  if (target != 0 && delivery.exists) {
    set_points_.arrived(delivery, now_ns);
    if (delivery.every_syncs > 0 && drive_.target_is_cyclic()) sync_.took_set_point();
  }
  if (drive_.halted()) set_points_.restart(now_ns);  // a halted drive needs no set points
  if (!set_points_.lost(now_ns)) return;
  ++context_.counters.pdo_late;
  drive_.lose_commands(ErrorCode::rpdo_timeout);
}

std::int64_t Node::next_ns() const {
  if (!configured()) return std::numeric_limits<std::int64_t>::max();
  std::int64_t next =
      std::min({heartbeat_.next_ns(), watched_.next_ns(), sdo_.next_ns(), guard_.next_ns(), emcy_.next_ns()});
  if (!context_.operational()) return next;
  next = std::min({next, sync_.next_ns(), pdos_.next_ns(), set_points_.next_ns()});
  return context_.changed ? context_.now_ns : next;
}

void Node::recovered(std::int64_t now_ns) {
  context_.now_ns = now_ns;
  emcy_.report(ErrorCode::bus_recovered);
}

void Node::fail(std::uint16_t code, std::uint8_t register_bits, bool ramp, std::int64_t now_ns) {
  context_.now_ns = now_ns;
  drive_.fail(code, register_bits, ramp);
}

std::vector<std::pair<std::string, std::uint64_t>> Node::counts() const {
  const NodeCounters& n = context_.counters;
  return {{"node", id()},
          {"error_code", error_code()},
          {"pdo_received", n.pdo_received},
          {"pdo_sent", n.pdo_sent},
          {"pdo_short", n.pdo_short},
          {"pdo_late", n.pdo_late},
          {"sdo_requests", n.sdo_requests},
          {"sdo_aborts", n.sdo_aborts},
          {"emergencies", n.emergencies},
          {"heartbeats_lost", n.heartbeats_lost},
          {"syncs_lost", n.syncs_lost},
          {"foreign", n.foreign}};
}

}  // namespace tribotwin::hil
