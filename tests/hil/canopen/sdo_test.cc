// SDO block transfers by a client that follows CiA 301, 7.2.4.3.9 to 7.2.4.3.16, on a bus that loses frames.
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/canopen/sdo.hpp>

namespace tribotwin::hil {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Answer = SdoServer::Answer;

constexpr std::int64_t ms = 1'000'000;
constexpr std::uint16_t memory = 0x2180, description = 0x1021, number = 0x1017, constant = 0x1000;

Bytes noise(std::size_t size) {
  std::mt19937 random(static_cast<unsigned>(size) + 1);
  Bytes bytes(size);
  for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
  return bytes;
}

std::uint32_t code(Abort abort) { return static_cast<std::uint32_t>(abort); }

class Blocks : public testing::Test {
 protected:
  Dictionary dictionary{{{constant, 0, "constant", Type::u32, Access::constant, false, 0x12345678},
                         {number, 0, "number", Type::u16, Access::read_write},
                         {description, 0, "description", Type::domain, Access::read_only},
                         {memory, 0, "memory", Type::domain, Access::read_write, false, 0, 0, 5000}}};
  std::vector<Answer> answers;
  std::size_t room = 1 << 20;  // frames that the bus takes
  SdoServer server{dictionary, [this](const Answer& answer) {
                     if (room == 0) return false;
                     --room;
                     answers.push_back(answer);
                     return true;
                   }};
  std::int64_t now = 0;

  void send(Bytes request) {
    request.resize(8);
    server.request(request, now);
  }
  Answer ask(Bytes request) {
    answers.clear();
    send(std::move(request));
    EXPECT_EQ(answers.size(), 1U);
    return answers.empty() ? Answer{} : answers[0];
  }
  static std::uint32_t abort_of(const Answer& a) {
    return a[0] == 0x80 ? static_cast<std::uint32_t>(decode(Type::u32, std::span(a).subspan(4))) : 0;
  }
  void wait(std::int64_t milliseconds) { server.tick(now += milliseconds * ms); }
  Bytes& kept(std::uint16_t index) {
    const std::string& text = dictionary.find(index, 0)->text;
    return copy_ = Bytes(text.begin(), text.end());
  }

  static Bytes initiate(std::uint8_t command, std::uint16_t index, std::size_t size = 0) {
    Bytes request{command, static_cast<std::uint8_t>(index), static_cast<std::uint8_t>(index >> 8), 0, 0, 0, 0, 0};
    encode(static_cast<std::int64_t>(size), std::span(request).subspan(4));
    return request;
  }
  static Bytes segment(const Bytes& data, std::size_t at, std::size_t sequence) {
    const bool last = at + 7 >= data.size();
    Bytes frame{static_cast<std::uint8_t>(sequence | (last ? 0x80 : 0))};
    for (std::size_t i = at; i < std::min(at + 7, data.size()); ++i) frame.push_back(data[i]);
    return frame;
  }
  static Bytes end(const Bytes& data, std::uint16_t crc) {
    const std::size_t unused = data.empty() ? 7 : (7 - data.size() % 7) % 7;
    return {static_cast<std::uint8_t>(0xC1 | unused << 2), static_cast<std::uint8_t>(crc),
            static_cast<std::uint8_t>(crc >> 8)};
  }

  /// Sends the segments; `lost` says which of them the bus swallows.
  void download_segments(const Bytes& data, const std::function<bool()>& lost) {
    std::size_t at = 0, block = answers.at(0)[4];
    do {
      answers.clear();
      std::size_t sent = 0, came = 0;
      for (std::size_t from = at; sent < block && (from < data.size() || (sent == 0 && data.empty())); from += 7) {
        ++sent;
        if (!lost()) send(segment(data, from, sent)), ++came;
      }
      if (came == 0) wait(10);
      if (came == 0) continue;
      if (answers.empty()) wait(500);  // the last one was lost: the server asks
      ASSERT_EQ(answers.size(), 1U);
      ASSERT_EQ(answers[0][0], 0xA2);
      ASSERT_LE(answers[0][1], sent);
      at += std::size_t{7} * answers[0][1];
      block = answers[0][2];
    } while (at < data.size());
  }
  std::uint32_t download(
      std::uint16_t index, const Bytes& data, bool crc, bool sized,
      const std::function<bool()>& lost = [] { return false; }) {
    const auto command = static_cast<std::uint8_t>(0xC0 | (crc ? 4 : 0) | (sized ? 2 : 0));
    const Answer begun = ask(initiate(command, index, sized ? data.size() : 0));
    if (begun[0] == 0x80) return abort_of(begun);
    EXPECT_EQ(begun[0], 0xA4);
    download_segments(data, lost);
    const Answer done = ask(end(data, crc ? sdo_crc(data) : 0));
    if (done[0] != 0x80) {
      EXPECT_EQ(done[0], 0xA1);
    }
    return abort_of(done);
  }

  /// What the client has after it asked for blocks of this size.
  Bytes upload(
      std::uint16_t index, std::uint8_t block, bool crc, const std::function<bool()>& lost = [] { return false; }) {
    const Answer begun = ask({static_cast<std::uint8_t>(0xA0 | (crc ? 4 : 0)), static_cast<std::uint8_t>(index),
                              static_cast<std::uint8_t>(index >> 8), 0, block});
    EXPECT_EQ(begun[0], 0xC6);
    const auto size = static_cast<std::size_t>(decode(Type::u32, std::span(begun).subspan(4)));
    Bytes data;
    answers.clear();
    send({0xA3});
    for (bool last = false; !last;) {
      const auto came = std::exchange(answers, {});
      EXPECT_LE(came.size(), block);
      std::uint8_t good = 0;
      for (const Answer& a : came)
        if (!lost() && (a[0] & 0x7F) == good + 1) {
          ++good;
          data.insert(data.end(), a.begin() + 1, a.end());
          last = a[0] & 0x80;
        }
      send({0xA2, good, block});
    }
    EXPECT_EQ(answers.size(), 1U);
    const Answer& ended = answers.at(0);
    EXPECT_EQ(ended[0] & 0xE3, 0xC1);
    data.resize(data.size() - (ended[0] >> 2 & 7));
    EXPECT_EQ(data.size(), size);
    EXPECT_EQ(ended[1] | ended[2] << 8, crc ? sdo_crc(data) : 0);
    answers.clear();
    send({0xA1});
    EXPECT_TRUE(answers.empty());
    return data;
  }

 private:
  Bytes copy_;
};

TEST(SdoCrc, OfTheStandard) {
  const std::string text = "123456789";
  EXPECT_EQ(sdo_crc(Bytes(text.begin(), text.end())), 0x31C3);
  EXPECT_EQ(sdo_crc({}), 0);
}

TEST_F(Blocks, EverySizeBothWays) {
  for (const std::size_t size : {0, 1, 4, 6, 7, 8, 13, 14, 888, 889, 890, 1778, 4999, 5000})
    for (const bool crc : {false, true})
      for (const bool sized : {false, true}) {
        SCOPED_TRACE(testing::Message() << size << " bytes, crc " << crc << ", sized " << sized);
        const Bytes data = noise(size);
        EXPECT_EQ(download(memory, data, crc, sized), 0U);
        EXPECT_EQ(kept(memory), data);
        EXPECT_EQ(upload(memory, sized ? 127 : 5, crc), data);
      }
}

TEST_F(Blocks, EveryBlockSizeUp) {
  const Bytes data = noise(1000);
  dictionary.find(description, 0)->text.assign(data.begin(), data.end());
  for (std::uint8_t block = 1; block <= 127; ++block) EXPECT_EQ(upload(description, block, true), data) << int{block};
}

TEST_F(Blocks, LostFramesAreSentAgain) {
  for (const double share : {0.02, 0.2, 0.6}) {
    std::mt19937 random(7);
    const auto lost = [&] { return std::bernoulli_distribution(share)(random); };
    for (int run = 0; run < 20; ++run) {
      const Bytes data = noise(500 + static_cast<std::size_t>(run) * 97);
      EXPECT_EQ(download(memory, data, true, run % 2, lost), 0U);
      EXPECT_EQ(kept(memory), data);
      EXPECT_EQ(upload(memory, static_cast<std::uint8_t>(1 + 6 * run), true, lost), data);
    }
  }
}

TEST_F(Blocks, DoubledAndLateSegmentsAreNotTaken) {
  const Bytes data = noise(21);
  ASSERT_EQ(ask(initiate(0xC6, memory, data.size()))[0], 0xA4);
  answers.clear();
  send(segment(data, 0, 1));
  send(segment(data, 0, 1));
  send(segment(data, 7, 2));
  send(segment(data, 0, 1));
  EXPECT_TRUE(answers.empty());
  send(segment(data, 14, 3));
  ASSERT_EQ(answers.size(), 1U);
  EXPECT_EQ(answers[0][1], 3);
  EXPECT_EQ(ask(end(data, sdo_crc(data)))[0], 0xA1);
  EXPECT_EQ(kept(memory), data);
}

TEST_F(Blocks, ABusThatIsFullGetsTheRestLater) {
  const Bytes data = noise(700);
  dictionary.find(description, 0)->text.assign(data.begin(), data.end());
  ask({0xA4, 0x21, 0x10, 0, 127});
  answers.clear();
  room = 30;
  send({0xA3});
  EXPECT_EQ(answers.size(), 30U);
  room = 1000;
  wait(1);
  ASSERT_EQ(answers.size(), 100U);
  for (std::size_t i = 0; i < 100; ++i) EXPECT_EQ(answers[i][0], i + 1 + (i == 99 ? 0x80 : 0));
}

TEST_F(Blocks, SwitchesTheProtocolWhereTheClientAllows) {
  const Bytes seven = noise(7);
  dictionary.find(description, 0)->text.assign(seven.begin(), seven.end());
  EXPECT_EQ(ask({0xA4, 0x21, 0x10, 0, 10, 7})[0], 0x41);  // segmented
  EXPECT_EQ(ask({0xA4, 0x21, 0x10, 0, 10, 6})[0], 0xC6);  // too long for that
  EXPECT_EQ(ask({0xA4, 0x21, 0x10, 0, 10, 0})[0], 0xC6);  // not allowed
  EXPECT_EQ(ask({0xA4, 0x00, 0x10, 0, 10, 4}), (Answer{0x43, 0x00, 0x10, 0, 0x78, 0x56, 0x34, 0x12}));  // expedited
}

TEST_F(Blocks, RefusedWithTheCodeOfTheFault) {
  const Bytes data = noise(20);
  const auto begun = [&] { ask(initiate(0xC6, memory, data.size())); };
  const auto uploading = [&] {
    download(memory, data, true, true);
    ask({0xA4, 0x80, 0x21, 0, 2});
    send({0xA3});
  };
  struct Row {
    const char* what;
    std::function<void()> before;
    Bytes request;
    Abort code;
  } rows[] = {
      {"no object", [] {}, initiate(0xC4, 0x5000), Abort::no_object},
      {"no object to read", [] {}, {0xA4, 0, 0x50, 0, 10}, Abort::no_object},
      {"no sub-index", [] {}, {0xC4, 0x17, 0x10, 1}, Abort::no_sub_index},
      {"read only", [] {}, initiate(0xC4, constant), Abort::read_only},
      {"longer than the object", [] {}, initiate(0xC6, memory, 5001), Abort::too_long},
      {"longer than the number", [] {}, initiate(0xC6, number, 3), Abort::too_long},
      {"shorter than the number", [] {}, initiate(0xC6, number, 1), Abort::too_short},
      {"block size 0", [] {}, {0xA4, 0x21, 0x10, 0, 0}, Abort::block_size},
      {"block size 128", [] {}, {0xA4, 0x21, 0x10, 0, 128}, Abort::block_size},
      {"segment 0", begun, {0x00}, Abort::sequence_number},
      {"end before the last segment", begun, end(data, 0), Abort::timed_out},
      {"end without a transfer", [] {}, end(data, 0), Abort::unknown_command},
      {"start without a transfer", [] {}, {0xA3}, Abort::unknown_command},
      {"acknowledge without a transfer", [] {}, {0xA2, 1, 1}, Abort::unknown_command},
      {"end of no upload", [] {}, {0xA1}, Abort::unknown_command},
      {"more acknowledged than sent", uploading, {0xA2, 3, 2}, Abort::sequence_number},
      {"next block of 0", uploading, {0xA2, 2, 0}, Abort::block_size},
      {"next block of 128", uploading, {0xA2, 2, 128}, Abort::block_size},
      {"started twice", uploading, {0xA3}, Abort::unknown_command},
      {"segments in a block upload", uploading, {0x60}, Abort::unknown_command},
  };
  for (const Row& row : rows) {
    server.reset();
    row.before();
    answers.clear();
    send(row.request);
    if (row.code == Abort::timed_out) wait(1000);
    ASSERT_FALSE(answers.empty()) << row.what;
    EXPECT_EQ(abort_of(answers.back()), code(row.code)) << row.what;
  }
}

TEST_F(Blocks, WrongEndsLeaveTheObject) {
  const Bytes old = noise(9), data = noise(20);
  ASSERT_EQ(download(memory, old, true, true), 0U);
  struct Row {
    const char* what;
    std::size_t announced;
    Bytes end;
    Abort code;
  } rows[] = {{"wrong CRC", 20, end(data, sdo_crc(data) ^ 1), Abort::crc},
              {"shorter than announced", 21, end(data, sdo_crc(data)), Abort::too_short},
              {"longer than announced", 19, end(data, sdo_crc(data)), Abort::too_long}};
  for (const Row& row : rows) {
    ask(initiate(0xC6, memory, row.announced));
    download_segments(data, [] { return false; });
    EXPECT_EQ(abort_of(ask(row.end)), code(row.code)) << row.what;
    EXPECT_EQ(kept(memory), old) << row.what;
  }
}

TEST_F(Blocks, MoreSegmentsThanTheObjectTakes) {
  const Bytes data = noise(5008);
  ask(initiate(0xC4, memory));
  answers.clear();
  for (std::size_t at = 0, sequence = 1; at < data.size() && (answers.empty() || answers.back()[0] == 0xA2); at += 7) {
    send(segment(data, at, sequence));
    sequence = sequence % 127 + 1;
  }
  EXPECT_EQ(abort_of(answers.back()), code(Abort::too_long));
  EXPECT_TRUE(kept(memory).empty());
}

TEST_F(Blocks, SilenceEndsATransferAfterASecond) {
  const Bytes data = noise(20);
  const std::function<void()> steps[] = {
      [&] { ask(initiate(0xC6, memory, data.size())); },
      [&] { ask(initiate(0xC6, memory, data.size())), download_segments(data, [] { return false; }); },
      [&] {
        ask({0xA4, 0x80, 0x21, 0, 2});
      },
      [&] {
        ask({0xA4, 0x80, 0x21, 0, 2}), send({0xA3});
      },
      [&] {
        ask({0xA4, 0x80, 0x21, 0, 2}), send({0xA3}), send({0xA2, 2, 127}), send({0xA2, 1, 127});
      },
  };
  ASSERT_EQ(download(memory, data, true, true), 0U);
  for (std::size_t i = 0; i < std::size(steps); ++i) {
    steps[i]();
    answers.clear();
    EXPECT_EQ(server.next_ns(), now + 1000 * ms) << i;
    wait(999);
    EXPECT_TRUE(answers.empty()) << i;
    wait(1);
    ASSERT_EQ(answers.size(), 1U) << i;
    EXPECT_EQ(abort_of(answers[0]), code(Abort::timed_out)) << i;
    EXPECT_EQ(decode(Type::u16, std::span(answers[0]).subspan(1, 2)), memory) << i;
    wait(5000);
    EXPECT_EQ(answers.size(), 1U) << i;
    EXPECT_EQ(server.next_ns(), std::numeric_limits<std::int64_t>::max()) << i;
  }
}

TEST_F(Blocks, TheClientAborts) {
  for (const bool up : {false, true}) {
    ask(up ? Bytes{0xA4, 0x80, 0x21, 0, 2} : initiate(0xC6, memory, 20));
    answers.clear();
    send({0x80, 0x80, 0x21, 0, 0, 0, 0, 8});
    wait(5000);
    EXPECT_TRUE(answers.empty());
    EXPECT_EQ(ask(initiate(0x40, number))[0], 0x4B);  // a segment no more
  }
}

}  // namespace
}  // namespace tribotwin::hil
