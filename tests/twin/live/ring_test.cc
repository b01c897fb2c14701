#include <thread>

#include <gtest/gtest.h>

#include <tribotwin/twin/live/ring.hpp>

namespace tribotwin::twin::live {
namespace {

TEST(RowRing, LosesWhatHasNoRoomAndNumbersIt) {
  RowRing ring(2, 4);
  const auto push = [&](double value) {
    return ring.push([&](std::span<double> row) { row[0] = value, row[1] = -value; });
  };
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(push(i));
  EXPECT_FALSE(push(4));
  EXPECT_FALSE(push(5));
  std::vector<std::uint64_t> numbers;
  const auto take = [&](std::uint64_t number, std::span<const double> row) {
    numbers.push_back(number);
    EXPECT_EQ(row[0], static_cast<double>(number));
    EXPECT_EQ(row[1], -static_cast<double>(number));
  };
  ring.drain(take);
  EXPECT_TRUE(push(6));
  ring.drain(take);
  EXPECT_EQ(numbers, (std::vector<std::uint64_t>{0, 1, 2, 3, 6}));
}

TEST(RowRing, KeepsRowsWholeBetweenThreads) {
  constexpr std::uint64_t count = 300'000;
  RowRing ring(7, 64);
  std::uint64_t lost = 0;
  std::atomic<bool> done = false;
  std::thread writer([&] {
    for (std::uint64_t i = 0; i < count; ++i)
      lost += !ring.push([&](std::span<double> row) { std::ranges::fill(row, static_cast<double>(i)); });
    done = true;
  });
  std::uint64_t got = 0, torn = 0, next = 0, disordered = 0;
  const auto take = [&](std::uint64_t number, std::span<const double> row) {
    ++got;
    for (const double value : row) torn += value != static_cast<double>(number);
    disordered += number < next;
    next = number + 1;
  };
  while (!done) ring.drain(take);
  writer.join();
  ring.drain(take);
  EXPECT_EQ(got + lost, count);
  EXPECT_GT(got, 0);
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(disordered, 0);
}

TEST(Queue, RefusesWhatHasNoRoom) {
  Queue<std::string, 2> queue;
  EXPECT_FALSE(queue.take());
  EXPECT_TRUE(queue.push("a"));
  EXPECT_TRUE(queue.push("b"));
  EXPECT_FALSE(queue.push("c"));
  EXPECT_EQ(queue.take(), "a");
  EXPECT_TRUE(queue.push("d"));
  EXPECT_EQ(queue.take(), "b");
  EXPECT_EQ(queue.take(), "d");
  EXPECT_FALSE(queue.take());
}

TEST(Newest, GivesTheNewestOnceAndWhole) {
  Newest newest(3);
  std::uint64_t got = 0;
  const auto take = [&](std::uint64_t number, std::span<const float> values) {
    got = number;
    for (const float value : values) EXPECT_EQ(value, static_cast<float>(number));
  };
  const auto write = [&](std::uint64_t number) {
    newest.write(number, [&](std::span<float> to) { std::ranges::fill(to, static_cast<float>(number)); });
  };
  EXPECT_FALSE(newest.read(take));
  for (std::uint64_t i = 1; i <= 5; ++i) write(i);
  EXPECT_TRUE(newest.read(take));
  EXPECT_EQ(got, 5);
  EXPECT_FALSE(newest.read(take));
  write(6);
  EXPECT_TRUE(newest.read(take));
  EXPECT_EQ(got, 6);
}

TEST(Newest, IsWholeBetweenThreads) {
  constexpr std::uint64_t count = 300'000;
  Newest newest(7);
  std::thread writer([&] {
    for (std::uint64_t i = 1; i <= count; ++i)
      newest.write(i, [&](std::span<float> to) { std::ranges::fill(to, static_cast<float>(i)); });
  });
  std::uint64_t last = 0, torn = 0, old = 0;
  while (last < count)
    newest.read([&](std::uint64_t number, std::span<const float> values) {
      for (const float value : values) torn += value != static_cast<float>(number);
      old += number <= last;
      last = number;
    });
  writer.join();
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(old, 0);
}

}  // namespace
}  // namespace tribotwin::twin::live
