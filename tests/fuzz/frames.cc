// A drive among any frames: NMT, PDOs in any mapping and type, SYNC, TIME, heartbeats and SDO in between. NMT is
// obeyed, what is sent is a frame of CiA 301, set points are numbers, objects keep their limits. For libFuzzer, and as
// a program: fuzz_frames RUNS SEED.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/tests/fuzz/require.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

using namespace tribotwin::hil;

namespace {

constexpr std::size_t act_bytes = 12;  ///< kind, size, pause, number, 8 bytes of data
constexpr std::uint32_t identifiers[] = {0x000, 0x080, 0x100, 0x201, 0x301, 0x401, 0x501,
                                         0x601, 0x181, 0x281, 0x701, 0x702, 0x7E5, 0x301};

const DriveParameters parameters{.node = 1, .name = "joint1", .gear_ratio = 100, .rated_torque_nm = 2};

/// What the counts of a run were good for.
struct Seen {
  long sent = 0, resets = 0, operational = 0, enabled = 0;
};
Seen seen;

class Case {
 public:
  Case() : node_(parameters, [this](const Frame& frame) { return take(frame); }) {
    node_.start(0);
    boots_ = 0;
  }

  void act(const std::uint8_t* in) {
    Frame frame = classic(identifiers[in[0] % std::size(identifiers)], std::span(in + 4, in[1] % 9));
    if (in[0] >= 240) frame.id = static_cast<std::uint32_t>(in[3] << 3 | (in[0] & 7));
    frame.remote = in[1] >= 250;
    frame.extended = in[1] == 249;
    node_.receive(frame, now_ns_);
    if (frame.id == cob::nmt && !frame.remote && !frame.extended) obeyed(frame);
    if (frame.id == cob::sync && !frame.remote && !frame.extended) node_.sync(now_ns_);
    for (int i = 0; i < 1 + in[2] % 4; ++i) step();
  }

  void check_objects() {
    for (const Object& o : node_.dictionary().objects())
      if (is_number(o.type) && o.access == Access::read_write)
        require(o.value >= o.low && o.value <= o.high, "an object is beyond its limits");
  }

 private:
  Sent take(const Frame& frame) {
    require(frame.size <= 8 && !frame.fd && !frame.error, "no frame of CiA 301");
    require(frame.id <= (frame.extended ? cob::id_29_bit : cob::id_11_bit), "an identifier of too many bits");
    ++seen.sent;
    boots_ += frame.id == cob::heartbeat + node_number_ && frame.size == 1 && frame.data[0] == 0;
    return Sent::done;
  }

  /// All drives obey a command to number 0, at once.
  void obeyed(const Frame& frame) {
    const auto command = nmt_command(frame, 0);
    if (!command || node_.id() != node_number_) return;
    const bool reset = *command == NmtCommand::reset_node || *command == NmtCommand::reset_communication;
    const Nmt next = *command == NmtCommand::start  ? Nmt::operational
                     : *command == NmtCommand::stop ? Nmt::stopped
                                                    : Nmt::pre_operational;
    require(node_.nmt() == next, "an NMT command is not obeyed");
    require(!reset || boots_ == 1, "no boot-up message after a reset");
    seen.resets += reset;
    boots_ = 0;
  }

  void step() {
    now_ns_ += ms;
    obey(node_, robot_);
    const auto c = node_.command(1e-3);
    for (const double x : {c.position_rad, c.velocity_rad_s, c.torque_nm, robot_.position_rad, robot_.velocity_rad_s})
      require(std::isfinite(x), "a set point that is no number");
    node_.tick(now_ns_);
    boots_ = 0;
    seen.operational += node_.nmt() == Nmt::operational;
    seen.enabled += node_.enabled();
  }

  static constexpr std::uint8_t node_number_ = 1;
  std::int64_t now_ns_ = 0;
  int boots_ = 0;
  Feedback robot_;
  Node node_;
};

/// An act that some drive could be meant by.
void make_act(std::uint8_t* act, std::mt19937& random) {
  constexpr std::uint16_t indices[] = {0x1400, 0x1401, 0x1402, 0x1600, 0x1601, 0x1800, 0x1801, 0x1A00, 0x1A01, 0x1005,
                                       0x1016, 0x1017, 0x1019, 0x100C, 0x100D, 0x1012, 0x6040, 0x6060, 0x607A, 0x60FF};
  constexpr std::uint8_t commands[] = {1, 1, 1, 2, 128, 129, 130}, words[] = {0, 6, 7, 15, 31, 128, 2, 63};
  for (std::size_t i = 0; i < act_bytes; ++i) act[i] = static_cast<std::uint8_t>(random() % 3 ? random() : 0);
  std::uint8_t* data = act + 4;
  switch (random() % 6) {
    case 0:
      act[0] = 0, act[1] = 2, data[0] = commands[random() % std::size(commands)], data[1] = random() % 2;
      break;
    case 1:
      act[0] = 1, act[1] = random() % 8 ? 0 : 1;
      break;
    case 2: {
      const auto index = indices[random() % std::size(indices)];
      act[0] = 7, act[1] = 8, data[0] = random() % 2 ? 0x22 : 0x2F;
      data[1] = static_cast<std::uint8_t>(index), data[2] = static_cast<std::uint8_t>(index >> 8);
      data[3] = static_cast<std::uint8_t>(random() % 7);
      break;
    }
    case 3:
      act[0] = static_cast<std::uint8_t>(3 + random() % 4), act[1] = static_cast<std::uint8_t>(random() % 9);
      data[0] = words[random() % std::size(words)], data[1] = 0;
      break;
    default:
      break;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Case one;
  for (std::size_t at = 0; at + act_bytes <= std::min<std::size_t>(size, 400 * act_bytes); at += act_bytes)
    one.act(data + at);
  one.check_objects();
  return 0;
}

__attribute__((weak)) int main(int argc, char** argv) {
  const long runs = argc > 1 ? std::atol(argv[1]) : 1000;
  std::mt19937 random(static_cast<unsigned>(argc > 2 ? std::atol(argv[2]) : 1));
  std::vector<std::uint8_t> bytes;
  for (long i = 0; i < runs; ++i) {
    bytes.resize(act_bytes * (1 + random() % 64));
    for (std::size_t at = 0; at < bytes.size(); at += act_bytes) make_act(bytes.data() + at, random);
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  std::printf("%ld runs: %ld frames sent, %ld resets, %ld ms operational, %ld ms enabled\n", runs, seen.sent,
              seen.resets, seen.operational, seen.enabled);
  return seen.sent && seen.resets && seen.operational && seen.enabled ? 0 : 1;
}
