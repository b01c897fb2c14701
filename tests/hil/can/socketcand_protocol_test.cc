#include <random>

#include <gtest/gtest.h>

#include <tribotwin/hil/can/socketcand_protocol.hpp>
#include <tribotwin/hil/can/words.hpp>

namespace tribotwin::hil::socketcand {
namespace {

std::vector<std::string_view> between(std::string_view command) {
  const auto begin = command.find('<') + 1;
  return words(command.substr(begin, command.find('>') - begin));
}

TEST(SocketcandProtocol, EveryFrameComesBack) {
  std::mt19937 random(5);
  for (int run = 0; run < 10'000; ++run) {
    Frame frame{.extended = random() % 2 == 0, .size = static_cast<std::uint8_t>(random() % 9)};
    frame.id = random() & (frame.extended ? 0x1FFFFFFF : 0x7FF);
    for (std::size_t i = 0; i < frame.size; ++i) frame.data[i] = static_cast<std::uint8_t>(random());
    frame.time_ns = 1'700'000'000'000'000'000 + 1000 * static_cast<std::int64_t>(random());
    const std::string sent = send_command(frame), served = frame_command(frame);
    ASSERT_EQ(parse_send(between(sent)), frame) << sent;
    ASSERT_EQ(parse_frame(between(served)), frame) << served;
    ASSERT_EQ(parse_frame(between(served))->time_ns, frame.time_ns) << served;
  }
}

TEST(SocketcandProtocol, WhatIsNoFrame) {
  for (const char* command : {"send", "send 123", "send 123 1", "send 123 1 0 0", "send 123 9 0 0 0 0 0 0 0 0 0",
                              "send 20000000 0", "send 000000123 0", "send x 0", "send 123 1 100", "send 123 x"})
    EXPECT_FALSE(parse_send(words(command))) << command;
  for (const char* command : {"frame 123", "frame x 1.0 00", "frame 20000000 1.0", "frame 123 1.0 0",
                              "frame 123 1.0 0g", "frame 123 1.0 001122334455667788"})
    EXPECT_FALSE(parse_frame(words(command))) << command;
  EXPECT_EQ(parse_frame(words("frame 123 x 00 1122"))->size, 3);
  EXPECT_EQ(parse_frame(words("frame 123 x 00"))->time_ns, 0);
  EXPECT_TRUE(parse_send(words("send 12345 0"))->extended);  // as python-can sends it
}

}  // namespace
}  // namespace tribotwin::hil::socketcand
