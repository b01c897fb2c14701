#pragma once

#include <algorithm>
#include <iterator>

#include <gtest/gtest.h>

#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {

inline const DriveParameters parameters{.node = 5,
                                        .name = "joint5",
                                        .gear_ratio = 100,
                                        .rated_torque_nm = 2,
                                        .speed_max_rad_s = 300,
                                        .limited = true,
                                        .position_low_rad = -2,
                                        .position_high_rad = 2};

/// One drive on a simulated bus, and a clock that the test sets.
class OneNode : public testing::Test {
 protected:
  std::vector<Frame> bus;
  bool full = false;
  Node node{parameters, [this](const Frame& frame) {
              if (full) return Sent::busy;
              bus.push_back(frame);
              return Sent::done;
            }};
  std::int64_t now = 0;
  Feedback robot;

  void SetUp() override {
    node.start(now);
    bus.clear();
  }
  void send(std::uint32_t id, std::vector<std::uint8_t> bytes) { node.receive(classic(id, bytes), now); }
  void nmt(std::uint8_t command) { send(0, {command, 5}); }
  void control(std::uint16_t word) {
    send(0x205, {static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8)});
  }
  void wait(std::int64_t milliseconds) {
    for (std::int64_t i = 0; i < milliseconds; ++i) {
      now += ms;
      node.tick(now);
    }
  }
  /// Simulated time [ms].
  void run(int steps) {
    for (int i = 0; i < steps; ++i) obey(node, robot);
  }
  void enable() {
    nmt(1);
    for (const std::uint16_t word : {0x06, 0x07, 0x0F}) control(word);
    ASSERT_EQ(node.state(), DriveState::operation_enabled);
    bus.clear();
  }
  std::uint16_t status() { return static_cast<std::uint16_t>(node.dictionary().get(0x6041)); }
  std::vector<Frame> on(std::uint32_t id) {
    std::vector<Frame> some;
    std::ranges::copy_if(bus, std::back_inserter(some), [&](const Frame& f) { return f.id == id; });
    return some;
  }
  std::uint32_t sdo(std::vector<std::uint8_t> request) {  // 0, or the abort code
    request.resize(8);
    bus.clear();
    send(0x605, request);
    const auto answers = on(0x585);
    if (answers.size() != 1) return 1;
    const auto& d = answers[0].data;
    return d[0] == 0x80 ? static_cast<std::uint32_t>(decode(Type::u32, std::span(d).subspan(4, 4))) : 0;
  }
  std::uint32_t write(std::uint16_t index, std::uint8_t sub, Type type, std::int64_t value) {
    return sdo(download(index, sub, type, value));
  }
};

}  // namespace tribotwin::hil
