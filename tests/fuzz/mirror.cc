// A mirror drive with random commands, damaged frames and pauses. For libFuzzer, and as a program: fuzz_mirror RUNS
// SEED.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/tests/fuzz/require.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

using namespace tribotwin::hil;

namespace {

const DriveParameters parameters{.node = 1,
                                 .name = "joint1",
                                 .gear_ratio = 100,
                                 .rated_torque_nm = 2,
                                 .limited = true,
                                 .position_low_rad = -1,
                                 .position_high_rad = 1};
constexpr std::int64_t deadline_ns = 20 * ms;

/// Reads the input byte by byte; zeros behind its end.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  bool left() const { return at_ < size_; }
  std::uint8_t next() { return left() ? data_[at_++] : std::uint8_t{0}; }
  std::int32_t next_i32() {
    std::uint32_t value = 0;
    for (int i = 0; i < 4; ++i) value = value << 8 | next();
    return static_cast<std::int32_t>(value);
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_, at_ = 0;
};

/// A drive, its robot, and what a careful reader of its status frames expects.
class Case {
 public:
  void act(Bytes& in) {
    switch (const int what = in.next() % 8; what) {
      case 0:
        return drive_.sync(now_);
      case 1:
        return pass(in.next());
      case 2:
        return damaged(in);
      default:
        return command(in);
    }
  }

 private:
  void command(Bytes& in) {
    constexpr double units[] = {1, 1e-3, 1e-6, 1e-6};
    const int mode = in.next() % 5 == 0 ? in.next() % 16 : in.next() % 4;
    counter_ = static_cast<std::uint8_t>((counter_ + (in.next() % 8 ? 1 : in.next())) & 15);
    const double set_point = units[mode % 4] * in.next_i32();
    drive_.receive(encode(MirrorCommand{counter_, static_cast<MirrorMode>(mode), set_point}, 1), now_);
    pass(1 + in.next() % 3);
  }
  /// One bit of a whole command is wrong: its checksum must say so.
  void damaged(Bytes& in) {
    Frame frame = encode(MirrorCommand{counter_, MirrorMode::torque, 100}, 1);
    const int bit = in.next() % 64;
    frame.data[static_cast<std::size_t>(bit / 8)] ^= static_cast<std::uint8_t>(1 << bit % 8);
    const auto before = drive_.counters().damaged;
    drive_.receive(frame, now_);
    require(drive_.counters().damaged == before + 1, "a damaged frame was taken");
  }
  void pass(int milliseconds) {
    for (int i = 0; i < milliseconds; ++i) {
      now_ += ms;
      drive_.tick(now_);
      step();
    }
  }
  void step() {
    using Mode = tribotwin::twin::DriveCommand::Mode;
    const bool braked = drive_.brake_engaged();
    obey(drive_, robot_);
    require(std::isfinite(robot_.position_rad) && std::isfinite(robot_.torque_nm), "a set point is not finite");
    require(!braked || robot_.torque_nm == 0, "a torque against the brake");
    const auto received = drive_.counters().received;
    if (received != received_) received_ = received, heard_ns_ = now_;
    require(now_ - heard_ns_ <= deadline_ns + 2 * ms || !drive_.enabled(), "a silent master's set point is held");
    auto asked = drive_.command(0);
    require(asked.torque_limit_nm == 200, "the torque is not limited");
    if (asked.mode == Mode::velocity)
      require(std::abs(asked.velocity_rad_s) <= parameters.speed_max_rad_s / 100 + 1e-9 || !drive_.enabled(),
              "faster than the drive can");
  }

  Send send_ = [](const Frame& frame) {
    require(frame.size == 8 && decode_status(frame).has_value(), "a status frame that no reader takes");
    return Sent::done;
  };
  MirrorDrive drive_{parameters, send_};
  Feedback robot_;
  std::int64_t now_ = 0, heard_ns_ = 0;
  std::uint64_t received_ = 0;
  std::uint8_t counter_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes in(data, size);
  for (Case one; in.left();) one.act(in);
  return 0;
}

__attribute__((weak)) int main(int argc, char** argv) {
  const long runs = argc > 1 ? std::atol(argv[1]) : 1000;
  std::mt19937 random(static_cast<unsigned>(argc > 2 ? std::atol(argv[2]) : 1));
  std::vector<std::uint8_t> bytes;
  for (long i = 0; i < runs; ++i) {
    bytes.resize(1 + random() % 64);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  std::printf("%ld runs\n", runs);
}
