#include <gtest/gtest.h>

#include <tribotwin/hil/session/expected_frames.hpp>

namespace tribotwin::hil {
namespace {

Frame numbered(std::uint32_t id, std::uint8_t number) { return classic(id, std::array{number}); }

TEST(ExpectedFrames, ComeInTheirOrder) {
  ExpectedFrames frames;
  EXPECT_TRUE(frames.empty());
  EXPECT_FALSE(frames.pop(0x181));
  for (std::uint8_t k = 0; k < 3; ++k) frames.push(numbered(0x181, k)), frames.push(numbered(0x182, k));
  EXPECT_EQ(frames.pop(0x181), numbered(0x181, 0));
  EXPECT_EQ(frames.pop(0x181), numbered(0x181, 1));
  EXPECT_EQ(frames.pop(0x182), numbered(0x182, 0));
  const auto left = frames.left();
  ASSERT_EQ(left.size(), 2U);
  EXPECT_EQ(left.at(0x181).count, 1U);
  EXPECT_EQ(left.at(0x182).count, 2U);
  EXPECT_EQ(left.at(0x182).last, numbered(0x182, 2));
}

// A log of hours without the frames of a drive: memory stays, the count goes on.
TEST(ExpectedFrames, AreBoundedAndCounted) {
  ExpectedFrames frames;
  constexpr std::size_t said = 100 * ExpectedFrames::longest;
  for (std::size_t k = 0; k < said; ++k) frames.push(numbered(0x181, static_cast<std::uint8_t>(k)));
  EXPECT_EQ(frames.size(), ExpectedFrames::longest);
  EXPECT_EQ(frames.left().at(0x181).count, said);
  EXPECT_EQ(frames.left().at(0x181).last, numbered(0x181, static_cast<std::uint8_t>(said - 1)));
  for (std::size_t k = 0; k < ExpectedFrames::longest; ++k) EXPECT_TRUE(frames.pop(0x181));
  EXPECT_FALSE(frames.pop(0x181));
  EXPECT_EQ(frames.left().at(0x181).count, said - ExpectedFrames::longest);
}

}  // namespace
}  // namespace tribotwin::hil
