// The set-point handshake of profile position (CiA 402-2, mode 1) with random masters: every set point is acknowledged
// once and reached, within the limits of the profile. For libFuzzer, and as a program: fuzz_profile_position ACTS SEED.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <random>

#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/hil/cia402/words.hpp>
#include <tribotwin/tests/fuzz/require.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

using namespace tribotwin::hil;

namespace {

constexpr double gear = 100, step_s = 1e-3, low_rad = -1, high_rad = 1;
constexpr double per_rad = 65536 * gear / (2 * std::numbers::pi), per_rad_s = 60e3 * gear / (2 * std::numbers::pi);
const DriveParameters parameters{.node = 1, .name = "joint1", .gear_ratio = gear, .rated_torque_nm = 2};
constexpr std::size_t act_bytes = 4;

struct Seen {
  long taken = 0, waited = 0, at_once = 0, relative = 0, cut = 0, halted = 0, settled = 0;
};
Seen seen;

/// What a set point brought with it, as a reader of the objects knows it. Joint side.
struct SetPoint {
  double rad = 0, end_speed_rad_s = 0;
  bool known = false;  ///< else it counts from a place that no object tells
  bool cut = false;
};

/// One drive, its robot, which follows exactly, and the expectations of a master that knows CiA 402-2 alone.
class Case {
 public:
  /// `fixed`: the ramps stay, so that the position never leaves 607Dh, and the jerk is that of 60A4h.
  explicit Case(std::uint8_t kind) : fixed_(kind & 1), smooth_(kind & 2) {
    node_.start(0);
    write(0x605C, 0, 0);
    write(0x6065, 0, DriveObjects::window_off);
    write(0x2120, 1, 0);
    write(0x2121, 1, 0);
    write(0x607D, 1, std::llround(low_rad * per_rad));
    write(0x607D, 2, std::llround(high_rad * per_rad));
    write(0x6086, 0, smooth_ ? 3 : 0);
    write(0x6060, 0, 1);
    for (int what = 0; what < 6; ++what) set_ramp(what, static_cast<std::uint8_t>(kind * (2 * what + 1)));
    if (!(kind & 4)) write(0x6082, 0, 0);
    const std::uint8_t start[] = {1, 0};
    send(0, start);
    wake();
  }

  void act(const std::uint8_t* in) {
    const int pause = in[3] % 16 == 0 ? in[3] : in[3] % 4;
    switch (in[0] % 16) {
      case 0:
        if (in[0] >= 64) break;
        trouble(in[1], pause);
        return wake();
      case 1:
        if (!fixed_) set_ramp(in[1] % 6, in[2]);
        break;
      case 2:
        halt_or_go(in[1]);
        break;
      case 3:
      case 4:
      case 5:
        aim(in);
        break;
      default:
        say(static_cast<std::uint16_t>(0x0F | (in[1] & 0x70) | halt_));
    }
    for (int i = 0; i < pause; ++i) step();
  }

  /// The master gives no more set points: the last one is reached.
  void settle() {
    halt_ = 0;
    say(0x0F);
    const auto moves = [&] { return robot_.velocity_rad_s != 0 || acknowledged() || !(status() & target_reached); };
    for (int k = 0; k < 20 || (moves() && k < 20'000); ++k) step();
    require(robot_.velocity_rad_s == 0, "the drive does not stop");
    require(!acknowledged(), "a set point waits for ever");
    if (!taken_) return;
    require(status() & target_reached, "a set point is not reached");
    if (!last_.known) return;
    require(bool(status() & internal_limit_active) == last_.cut, "bit 11 does not say whether a set point was cut");
    if (last_.end_speed_rad_s != 0) return;
    require(std::abs(robot_.position_rad - last_.rad) < 1e-9, "the drive stands elsewhere");
    ++seen.settled;
  }

 private:
  // ---- The master.

  void aim(const std::uint8_t* in) {
    const auto counts = std::llround(1.3 * per_rad * (in[2] - 127.5) / 127.5);
    const auto word = static_cast<std::uint16_t>(0x0F | (in[1] & 0x70) | halt_);
    if (in[0] & 0x10) {  // position and controlword in one PDO
      std::uint8_t data[6] = {static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8)};
      encode(counts, std::span(data).subspan(2));
      return say(word, data);
    }
    write(0x607A, 0, counts);
    say(word);
  }
  void halt_or_go(std::uint8_t what) {
    halt_ = halt_ == 0 ? halt : 0;
    if (halt_) write(0x605D, 0, 1 + what % 2);
    seen.halted += halt_ != 0;
    jerks_ = true;
    say(static_cast<std::uint16_t>((word() & 0x7F) | halt_));
  }
  void trouble(std::uint8_t what, int pause) {
    constexpr std::uint16_t words[] = {0x00, 0x02, 0x06, 0x07};
    if (what % 8 < 4) say(words[what % 4]);
    if (what % 8 == 4) node_.fail(0x5000, 1, what & 8, 0), left();
    if (what % 8 > 4) write(0x6060, 0, 8), left();
    for (int i = 0; i < pause; ++i) step();
  }
  /// Enabled, in the mode, from whatever state.
  void wake() {
    halt_ = 0;
    if (node_.dictionary().get(0x6060) != 1) {
      write(0x6060, 0, 1);
      if (active()) entered();
    }
    if (active()) return;
    while (node_.state() == DriveState::fault_reaction_active) step();
    for (const std::uint16_t word : {0x80, 0x00, 0x06, 0x07, 0x0F}) say(word);
    require(active(), "the drive cannot be enabled");
  }
  void set_ramp(int what, std::uint8_t value) {
    constexpr std::uint16_t objects[] = {0x6081, 0x6082, 0x6083, 0x6084, 0x607F, 0x60A4};
    constexpr double least[] = {1, 0.1, 20, 20, 1, 500}, span[] = {20, 50, 10, 10, 20, 100};
    double rad_s = least[what] * std::pow(span[what], value / 255.0);
    if (objects[what] == 0x6082 && value % 4) rad_s = 0;
    if (robot_.velocity_rad_s != 0 || fastest_rad_s_ != 0) strict_ = false;  // set points keep what they came with
    write(objects[what], objects[what] == 0x60A4, std::llround(rad_s * per_rad_s));
  }

  // ---- The bus.

  void write(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
    const Object* o = node_.dictionary().find(index, sub);
    std::uint8_t bytes[4];
    const auto size = static_cast<std::size_t>(size_of(o->type));
    encode(value, std::span(bytes).first(size));
    require(node_.dictionary().write(index, sub, std::span(bytes).first(size)).has_value(), "a value is refused");
  }
  void send(std::uint32_t id, std::span<const std::uint8_t> data) { node_.receive(classic(id, data), 0); }

  void say(std::uint16_t word) {
    const std::uint8_t data[] = {static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8)};
    say(word, data);
  }
  void say(std::uint16_t word, std::span<const std::uint8_t> data) {
    const std::int64_t before = this->word();
    const bool followed = active(), full = acknowledged();
    const bool idle = !(before & halt) && (status() & target_reached);
    send(data.size() == 2 ? 0x201 : 0x401, data);
    if (data.size() != 2) node_.sync(0);
    require(this->word() == word, "a controlword is not taken");
    if (!followed || !active()) return active() ? entered() : left();
    if (before & ~word & halt) released();
    const bool edge = word & ~before & operation_specific, at_once = word & change_immediately;
    const bool taken = edge && (at_once || !full);
    if (taken) take(word, idle || at_once);
    require(acknowledged() <= (taken || full), "a set point is acknowledged without a rising edge of bit 4");
    require(acknowledged() >= taken, "a set point is not acknowledged");
    if (word & operation_specific) require(acknowledged() >= full, "bit 12 falls before bit 4");
    if (!(word & operation_specific)) require(acknowledged() <= waits_, "bit 12 does not follow bit 4");
    if (taken && !halt_) require(!(status() & target_reached), "a new set point is reached at once");
    if (!acknowledged()) waits_ = false;
    look();
  }

  // ---- What the master knows.

  std::uint16_t status() { return static_cast<std::uint16_t>(node_.dictionary().get(0x6041)); }
  std::int64_t word() { return node_.dictionary().get(0x6040); }
  bool acknowledged() { return status() & mode_bit_12; }
  bool active() { return node_.enabled() && node_.dictionary().get(0x6061) == 1; }
  double rad_s(std::uint16_t index) { return static_cast<double>(node_.dictionary().get(index)) / per_rad_s; }
  double speed_max_rad_s() {
    return std::min(rad_s(0x607F), static_cast<double>(node_.dictionary().get(0x6080)) * 1e3 / per_rad_s);
  }
  double hardest_now() {
    return std::max(std::min(rad_s(0x6083), rad_s(0x60C5)), std::min(rad_s(0x6084), rad_s(0x60C6)));
  }

  void entered() {
    taken_ = waits_ = false;
    last_ = {.rad = robot_.position_rad, .known = robot_.velocity_rad_s == 0};
    fastest_rad_s_ = 0;
    hardest_rad_s2_ = hardest_now();
    if (robot_.velocity_rad_s != 0) strict_ = false;
  }
  void left() {
    taken_ = waits_ = false;
    strict_ = strict_ && robot_.velocity_rad_s == 0;
  }
  void released() {
    hardest_rad_s2_ = std::max(hardest_rad_s2_, hardest_now());
    if (!taken_ && robot_.velocity_rad_s != 0) last_.known = false;  // it stops first
    if (!taken_ && robot_.velocity_rad_s == 0) last_.rad = robot_.position_rad, last_.known = true;
  }
  void take(std::uint16_t word, bool starts) {
    const bool counts_on = word & relative;
    const double target = static_cast<double>(node_.dictionary().get(0x607A)) / per_rad;
    const double asked = target + (counts_on ? last_.rad : 0);
    last_ = {.rad = std::clamp(asked, low_rad_, high_rad_),
             .end_speed_rad_s = rad_s(0x6082),
             .known = !counts_on || last_.known,
             .cut = asked < low_rad_ || asked > high_rad_};
    waits_ = !starts;
    taken_ = true;
    fastest_rad_s_ = std::max(fastest_rad_s_, std::min(rad_s(0x6081), speed_max_rad_s()));
    hardest_rad_s2_ = std::max(hardest_rad_s2_, hardest_now());
    ++seen.taken;
    seen.waited += waits_;
    seen.at_once += bool(word & change_immediately);
    seen.relative += counts_on;
    seen.cut += last_.cut;
  }

  void step() {
    const double speed = robot_.velocity_rad_s, position = robot_.position_rad, acceleration = acceleration_rad_s2_;
    const bool followed = active(), full = acknowledged();
    obey(node_, robot_);
    acceleration_rad_s2_ = (robot_.velocity_rad_s - speed) / step_s;
    require(std::isfinite(robot_.position_rad) && std::isfinite(robot_.velocity_rad_s), "a set point is not finite");
    if (!followed || !active()) return;
    require(acknowledged() <= full, "a step acknowledges a set point");
    if (full && !acknowledged()) require(waits_ && !(word() & operation_specific), "bit 12 falls by itself");
    if (!acknowledged()) waits_ = false;
    const double allowed = std::max(std::min(fastest_rad_s_, speed_max_rad_s()), std::abs(speed));
    require(std::abs(robot_.velocity_rad_s) <= allowed * (1 + 1e-9) + 1e-9, "faster than the profile");
    const double halting = word() & halt ? std::max(rad_s(0x6084), rad_s(0x6085)) : 0;
    require(std::abs(acceleration_rad_s2_) <= std::max(hardest_rad_s2_, halting) * (1 + 1e-6) + 1e-6,
            "harder than the profile");
    require(std::abs(robot_.position_rad - position) <= step_s * allowed + 1e-9, "the position jumps");
    if (smooth_ && strict_ && !jerks_)
      require(std::abs(acceleration_rad_s2_ - acceleration) <= step_s * rad_s_of_jerk() * (1 + 1e-6) + 1e-3,
              "a jerk beyond 60A4h");
    look();
  }
  double rad_s_of_jerk() { return static_cast<double>(node_.dictionary().get(0x60A4, 1)) / per_rad_s; }
  void look() {
    const bool reached = status() & target_reached && !halt_;
    const double off_rad = std::abs(robot_.position_rad - last_.rad);
    const bool tells = taken_ && last_.known && last_.end_speed_rad_s == 0;
    if (reached && tells)
      require(off_rad <= static_cast<double>(node_.dictionary().get(0x6067)) / per_rad + 1e-9,
              "bit 10 beyond the window");
    if (strict_ && fixed_ && !(smooth_ && jerks_))  // released from a halt, a smooth stop needs more way
      require(robot_.position_rad >= low_rad_ - 1e-9 && robot_.position_rad <= high_rad_ + 1e-9, "beyond 607Dh");
    const bool stands = robot_.velocity_rad_s == 0 && acceleration_rad_s2_ == 0;
    if (!reached || !tells || !stands || acknowledged() || off_rad > 1e-9) return;
    fastest_rad_s_ = 0;  // until the next set point
    jerks_ = false;
  }

  const bool fixed_, smooth_;
  Send send_ = [](const Frame&) { return Sent::done; };
  Node node_{parameters, send_};
  Feedback robot_;
  const double low_rad_ = static_cast<double>(std::llround(low_rad * per_rad)) / per_rad;
  const double high_rad_ = static_cast<double>(std::llround(high_rad * per_rad)) / per_rad;
  std::uint16_t halt_ = 0;
  SetPoint last_;
  bool taken_ = false;  // since the drive entered the mode
  bool waits_ = false;  // the last one may wait for the one before
  bool strict_ = true;  // nothing but the profile has moved the drive
  bool jerks_ = false;
  double fastest_rad_s_ = 0, hardest_rad_s2_ = 0, acceleration_rad_s2_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  Case one(data[0]);
  for (std::size_t at = 1; at + act_bytes <= size; at += act_bytes) one.act(data + at);
  one.settle();
  return 0;
}

__attribute__((weak)) int main(int argc, char** argv) {
  const long acts = argc > 1 ? std::atol(argv[1]) : 1000;
  std::mt19937 random(static_cast<unsigned>(argc > 2 ? std::atol(argv[2]) : 1));
  constexpr long acts_per_run = 100;
  std::vector<std::uint8_t> bytes(1 + act_bytes * acts_per_run);
  long done = 0;
  for (; done < acts; done += acts_per_run) {
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  std::printf(
      "%ld acts: %ld set points, %ld at once, %ld relative, %ld cut, %ld may wait; %ld halts; %ld times at rest\n",
      done, seen.taken, seen.at_once, seen.relative, seen.cut, seen.waited, seen.halted, seen.settled);
  return seen.settled > 0 || acts == 0 ? 0 : 1;
}
