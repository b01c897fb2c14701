// Six drives and their master on a CAN bus inside one process: a test of a controller without any CAN interface. The
// SYNC is the clock, so the result is the same in every run, however slow the master is. Argument: a scenario file,
// such as twin/scenarios/irb6620_hold.yaml.
#include <atomic>
#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <numbers>
#include <thread>
#include <vector>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/session/drive.hpp>

using namespace tribotwin;

namespace {

constexpr int node = 1;
constexpr double counts_per_rad = 65536 * 160 / (2 * std::numbers::pi);  // encoder x gear ratio of joint1

/// The next frame with this identifier, or nothing after a second.
bool wait_for(hil::Transport& bus, std::uint32_t id, hil::Frame& frame) {
  const std::int64_t deadline_ns = hil::clock_ns() + 1'000'000'000;
  while (hil::clock_ns() < deadline_ns) {
    while (bus.receive(frame))
      if (frame.id == id) return true;
    bus.wait(deadline_ns);
  }
  return false;
}

void send(hil::Transport& bus, std::uint32_t id, const std::vector<std::uint8_t>& bytes) {
  bus.send(hil::classic(id, bytes));
}

/// Moves joint1 by 0.2 rad in one second. Returns what the drive said last.
bool move(hil::Transport& bus, hil::Frame& said) {
  if (!wait_for(bus, 0x700 + 6, said)) return false;  // the last of six nodes has booted
  send(bus, 0x000, {0x01, node});                     // NMT: operational
  for (const std::uint8_t controlword : std::initializer_list<std::uint8_t>{0x06, 0x07, 0x0F})
    send(bus, 0x200 + node, {controlword, 0});
  for (int cycle = 0; cycle < 500; ++cycle) {
    const double angle_rad = 0.1 * (1 - std::cos(std::numbers::pi * cycle / 500));
    const auto target = static_cast<std::uint32_t>(std::lround(angle_rad * counts_per_rad));
    std::vector<std::uint8_t> bytes{0x0F, 0};
    for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<std::uint8_t>(target >> shift));
    send(bus, 0x400 + node, bytes);
    send(bus, 0x080, {});                                  // SYNC: the robot moves on by 2 ms
    if (!wait_for(bus, 0x380 + node, said)) return false;  // statusword, actual position
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: 06_drives_on_a_bus_in_one_process SCENARIO.yaml\n"), 2;
  const auto scenario = twin::load_scenario(argv[1]);
  if (!scenario) return std::fprintf(stderr, "%s\n", scenario.error().message.c_str()), 2;

  const auto master = hil::open_bus("memory:cell"), robot = hil::open_bus("memory:cell");
  std::atomic<bool> stop = false;
  Result<void> ended;
  hil::DriveOptions options;
  options.stop = [&] { return stop.load(); };
  std::thread drives([&] { ended = hil::drive(*scenario, **robot, options); });
  hil::Frame said;
  const bool moved = move(**master, said);
  stop = true;
  drives.join();
  if (!ended) return std::fprintf(stderr, "%s\n", ended.error().message.c_str()), 1;
  if (!moved) return std::fprintf(stderr, "a drive does not answer\n"), 1;

  std::int32_t counts = 0;
  for (int i = 3; i >= 0; --i)
    counts = static_cast<std::int32_t>(counts * 256U + said.data[2U + static_cast<unsigned>(i)]);
  std::printf("joint1 after 1 s: %.3f rad, statusword %02X%02X\n", counts / counts_per_rad, said.data[1], said.data[0]);
}
