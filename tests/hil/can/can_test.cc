#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <linux/can/netlink.h>
#include <linux/rtnetlink.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

#include <tribotwin/hil/can/bit_rate.hpp>
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/can/record_file.hpp>
#include <tribotwin/hil/can/transport.hpp>

namespace tribotwin::hil {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::HasSubstr;

std::int64_t in(std::chrono::nanoseconds time) {
  return (std::chrono::steady_clock::now().time_since_epoch() + time).count();
}

Frame frame_of(std::uint32_t id, std::vector<std::uint8_t> bytes = {}) { return classic(id, bytes); }

Frame fd_frame(std::uint8_t size) {
  Frame frame{.id = 0x123, .fd = true, .bit_rate_switch = true, .size = size};
  for (std::uint8_t i = 0; i < size; ++i) frame.data[i] = i;
  return frame;
}

// Frames

TEST(Frame, HasTheLengthsOfItsFormat) {
  std::vector<int> classic_sizes, fd_sizes;
  for (int n = 0; n < 256; ++n) {
    if (valid_size(false, static_cast<std::uint8_t>(n))) classic_sizes.push_back(n);
    if (valid_size(true, static_cast<std::uint8_t>(n))) fd_sizes.push_back(n);
  }
  EXPECT_THAT(classic_sizes, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8));
  EXPECT_THAT(fd_sizes, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64));
}

TEST(Frame, EqualityIgnoresTimeAndWhatIsBehindTheData) {
  Frame a = frame_of(0x123, {1, 2}), b = a;
  b.time_ns = 7;
  b.data[2] = 9;
  EXPECT_EQ(a, b);
  b.data[1] = 9;
  EXPECT_NE(a, b);
  a.remote = b.remote = true;
  EXPECT_EQ(a, b);
  b.size = 3;
  EXPECT_NE(a, b);
  for (bool Frame::*flag :
       {&Frame::extended, &Frame::remote, &Frame::error, &Frame::fd, &Frame::bit_rate_switch, &Frame::error_passive}) {
    b = a;
    b.*flag = !(a.*flag);
    EXPECT_NE(a, b);
  }
}

TEST(Frame, TextIsCandumps) {
  EXPECT_EQ(text(frame_of(0x601, {0x40, 0x41, 0x60, 0, 0, 0, 0, 0})), "601#4041600000000000");
  EXPECT_EQ(text(frame_of(0x80)), "080#");
  EXPECT_EQ(text({.id = 0x123, .fd = true, .bit_rate_switch = true, .size = 2, .data = {0xAA, 0xBB}}), "123##1AABB");
  EXPECT_EQ(text({.id = 0x123, .fd = true, .error_passive = true}), "123##2");
  EXPECT_EQ(text({.id = 0x12345678, .extended = true, .remote = true, .size = 8}), "12345678#R8");
  EXPECT_EQ(text({.id = 0x12, .remote = true}), "012#R");
  EXPECT_EQ(text({.id = 0x12, .extended = true, .size = 1, .data = {0xF}}), "00000012#0F");
  EXPECT_EQ(text({.id = 0x88, .error = true, .size = 2}), "20000088#0000");
}

TEST(Frame, BitsOnTheWireAreThoseOfTheBusLoadTable) {
  for (int n = 0; n <= 8; ++n) {
    EXPECT_EQ(classic_bits(n).min, 47 + 8 * n);
    EXPECT_EQ(classic_bits(n).max, 47 + 8 * n + (34 + 8 * n - 1) / 4);
  }
  // Cycles of six drives; the table's second row is right for a SYNC with its counter byte.
  const auto cycle = [](int sync, int four, int eight) {
    return std::pair(classic_bits(sync).min + four * classic_bits(4).min + eight * classic_bits(8).min,
                     classic_bits(sync).max + four * classic_bits(4).max + eight * classic_bits(8).max);
  };
  EXPECT_EQ(cycle(0, 0, 12), std::pair(1379, 1675));
  EXPECT_EQ(cycle(1, 6, 6), std::pair(1195, 1445));
  EXPECT_EQ(cycle(0, 0, 24), std::pair(2711, 3295));
}

// Logs

class Log : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "tribotwin_can_XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path file(std::string_view content) {
    const auto path = folder_ / "a.log";
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }
  std::filesystem::path folder_;
};

TEST_F(Log, EveryKindOfLineParses) {
  struct Case {
    const char *line, *text;
    std::int64_t time_ns;
  };
  for (const auto& [line, expected, time_ns] : std::initializer_list<Case>{
           {"(1700000000.123456) vcan0 601#4041600000000000", "601#4041600000000000", 1'700'000'000'123'456'000},
           {"(0000000000.000001)   can0  123#", "123#", 1000},
           {"(1.5) can0 123#AB T", "123#AB", 1'500'000'000},
           {"(1.123456789) can0 123#ab R", "123#AB", 1'123'456'789},
           {"(12) can0 123#AB\r", "123#AB", 12'000'000'000},
           {"(12.0) can0 00000123#AB T\r\n", "00000123#AB", 12'000'000'000},
           {"(1.0) can0 1FFFFFFF#1122334455667788", "1FFFFFFF#1122334455667788", 1'000'000'000},
           {"(1.0) can0 123#R", "123#R", 1'000'000'000},
           {"(1.0) can0 123#R0", "123#R", 1'000'000'000},
           {"(1.0) can0 123#R3", "123#R3", 1'000'000'000},
           {"(1.0) can0 12345678#R8 R", "12345678#R8", 1'000'000'000},
           {"(1.0) can0 123##0", "123##0", 1'000'000'000},
           {"(1.0) can0 123##1AABB", "123##1AABB", 1'000'000'000},
           {"(1.0) can0 123##5AABB", "123##1AABB", 1'000'000'000},
           {"(1.0) can0 123##7AABB", "123##3AABB", 1'000'000'000},
           {"(1.0) can0 123##0000102030405060708090A0B", "123##0000102030405060708090A0B", 1'000'000'000},
           {"(1.0) can0 20000088#0000000000000000", "20000088#0000000000000000", 1'000'000'000},
       }) {
    std::string bus;
    const auto frame = parse_log_line(line, bus);
    ASSERT_TRUE(frame) << line << ": " << frame.error().message;
    EXPECT_EQ(text(*frame), expected) << line;
    EXPECT_EQ(frame->time_ns, time_ns) << line;
    EXPECT_EQ(bus, std::string_view(line).find("vcan") == std::string_view::npos ? "can0" : "vcan0");
  }
}

TEST_F(Log, TextAndLinesAreInverse) {
  std::vector<Frame> frames{fd_frame(64),
                            fd_frame(0),
                            {.id = 0x1ABCDEF0, .extended = true, .size = 3, .data = {1, 2, 3}},
                            {.id = 5, .extended = true, .remote = true, .size = 4},
                            {.id = 0x1FFFFFFF, .error = true, .size = 8}};
  for (std::uint8_t n = 0; n <= 8; ++n) frames.push_back(frame_of(0x700u + n, std::vector<std::uint8_t>(n, 0xA5)));
  for (const auto& frame : frames) {
    std::string bus;
    const auto again = parse_log_line("(1.0) can0 " + text(frame), bus);
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_EQ(*again, frame) << text(frame);
  }
}

TEST_F(Log, WhatIsNoFrameIsRefusedWithTheReason) {
  for (const auto& [line, reason] : std::initializer_list<std::pair<const char*, const char*>>{
           {"hello", "'hello' is not '(time) bus frame'"},
           {"(1.0) can0", "is not '(time) bus frame'"},
           {"(1.0) can0 123#00 T T", "is not '(time) bus frame'"},
           {"(1.0) can0 123#00 X", "'X' after the frame"},
           {"1.0 can0 123#00", "the time is '1.0'"},
           {"(1.) can0 123#00", "the time is '(1.)'"},
           {"(.5) can0 123#00", "the time is '(.5)'"},
           {"() can0 123#00", "the time is '()'"},
           {"(-1.0) can0 123#00", "the time is '(-1.0)'"},
           {"(1.-5) can0 123#00", "the time is '(1.-5)'"},
           {"(1.0000000001) can0 123#00", "up to 9 decimals"},
           {"(99999999999.0) can0 123#00", "after the year 2262"},
           {"(99999999999999999999999.0) can0 123#00", "the time is"},
           {"(1.0) can0 123", "has no '#'"},
           {"(1.0) can0 #00", "the identifier is ''"},
           {"(1.0) can0 1234#00", "the identifier is '1234', not 3 or 8"},
           {"(1.0) can0 12G#00", "the identifier is '12G'"},
           {"(1.0) can0 800#00", "above 7FF"},
           {"(1.0) can0 40000000#00", "more than 29 bits"},
           {"(1.0) can0 FFFFFFFF#00", "more than 29 bits"},
           {"(1.0) can0 123#0", "odd number of digits"},
           {"(1.0) can0 123#0G", "not hexadecimal"},
           {"(1.0) can0 123#0.11", "not hexadecimal"},
           {"(1.0) can0 123#001122334455667788", "9 data bytes; a classic frame has 0..8"},
           {"(1.0) can0 123##0001122334455667788", "9 data bytes; an FD frame has"},
           {"(1.0) can0 123##", "the FD flags are ''"},
           {"(1.0) can0 123##800", "the FD flags are '8'"},
           {"(1.0) can0 123##G00", "the FD flags are 'G'"},
           {"(1.0) can0 20000088##000", "an error frame cannot be an FD frame"},
           {"(1.0) can0 20000088#R", "an error frame cannot be a remote frame"},
           {"(1.0) can0 123#R9", "not 'R9'"},
           {"(1.0) can0 123#R8_B", "not 'R8_B'"},
           {"(1.0) can0 123#RR", "not 'RR'"},
           {"(1.0) c\x01n0 123#00", "the bus name 'c?n0' has control characters"},
       }) {
    std::string bus;
    const auto frame = parse_log_line(line, bus);
    ASSERT_FALSE(frame) << line;
    EXPECT_THAT(frame.error().message, HasSubstr(reason)) << line;
  }
}

TEST_F(Log, ReaderNamesFileAndLineAndGoesOn) {
  auto log = LogReader::open(file("(1.0) can0 123#01\n\n  \r\nnonsense\n" + std::string(5000, 'x') +
                                  "\n(2.0) can1 20000004#0004 R\r\n(3.0) can0 123##1AABB"));
  ASSERT_TRUE(log);
  Frame frame;
  ASSERT_EQ(log->next(frame), true);
  EXPECT_EQ(frame, frame_of(0x123, {1}));
  EXPECT_EQ(log->bus(), "can0");
  EXPECT_EQ(log->line(), 1u);
  EXPECT_EQ(log->next(frame).error().message,
            (folder_ / "a.log").string() + ":4: 'nonsense' is not '(time) bus frame'");
  EXPECT_EQ(
      log->next(frame).error().message,
      (folder_ / "a.log").string() + ":5: longer than 4095 characters; a line of a candump log is '(time) bus frame'");
  ASSERT_EQ(log->next(frame), true);
  EXPECT_TRUE(frame.error);
  EXPECT_EQ(log->bus(), "can1");
  EXPECT_EQ(log->line(), 6u);
  ASSERT_EQ(log->next(frame), true);
  EXPECT_TRUE(frame.fd);
  EXPECT_EQ(log->next(frame), false);
  EXPECT_EQ(log->next(frame), false);
}

TEST_F(Log, ReaderSaysWhyAFileCannotBeRead) {
  EXPECT_THAT(LogReader::open(folder_).error().message, HasSubstr("is a folder"));
  EXPECT_EQ(LogReader::open("/no/such.log").error().message,
            "/no/such.log: cannot be read (No such file or directory)");
  auto empty = LogReader::open(file(""));
  Frame frame;
  EXPECT_EQ(empty->next(frame), false);
}

TEST_F(Log, WriterWritesWhatCandumpWrites) {
  const auto path = folder_ / "written.log";
  {
    auto log = LogWriter::create(path, "vcan0");
    ASSERT_TRUE(log);
    Frame frame = frame_of(0x601, {0x40, 0x41});
    frame.time_ns = 1'700'000'000'123'456'789;
    ASSERT_TRUE(log->write(frame));
    frame = fd_frame(2);
    frame.time_ns = 1999;
    ASSERT_TRUE(log->write(frame));
    frame.time_ns = -1;
    EXPECT_THAT(log->write(frame).error().message, HasSubstr("has no line in a candump log"));
    ASSERT_TRUE(log->flush());
    auto moved = std::move(*log);
    ASSERT_TRUE(moved.write(frame_of(0x80)));
  }
  std::ifstream in(path);
  EXPECT_EQ(
      std::string(std::istreambuf_iterator(in), {}),
      "(1700000000.123456) vcan0 601#4041\n(0000000000.000001) vcan0 123##10001\n(0000000000.000000) vcan0 080#\n");
}

TEST_F(Log, WriterNamesTheFileThatCannotBeWritten) {
  EXPECT_EQ(LogWriter::create("/no/such/folder/a.log", "can0").error().message,
            "/no/such/folder/a.log: cannot be written (No such file or directory)");
  for (const char* bus : {"", "two words", " can0", "can0\n"})
    EXPECT_THAT(LogWriter::create(folder_ / "b.log", bus).error().message, HasSubstr("one word")) << bus;
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  auto full = LogWriter::create("/dev/full", "can0");
  ASSERT_TRUE(full);
  ASSERT_TRUE(full->write(frame_of(1)));
  EXPECT_EQ(full->flush().error().message, "/dev/full: cannot be written (No space left on device)");
  EXPECT_THAT(full->write(frame_of(1)).error().message, HasSubstr("/dev/full: cannot be written"));
  auto buffered = LogWriter::create("/dev/full", "can0");
  Result<void> good;
  for (int i = 0; good && i < 100'000; ++i) good = buffered->write(frame_of(1));
  EXPECT_EQ(good.error().message, "/dev/full: cannot be written (No space left on device)");
}

// Files that grow during a session

std::string content_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator(in), {}};
}

TEST_F(Log, ARecordIsNeverReplacedUnasked) {
  const auto path = file("somebody's\n");
  EXPECT_EQ(RecordFile::create(path).error().message,
            path.string() + ": exists already; give another name, or --force to replace it");
  EXPECT_EQ(content_of(path), "somebody's\n");
  {
    auto replacing = RecordFile::create(path, {.replace = true});
    ASSERT_TRUE(replacing);
    EXPECT_THAT(RecordFile::create(path, {.replace = true}).error().message,
                HasSubstr("another session is writing it"));
  }
  EXPECT_EQ(content_of(path), "somebody's\n") << "nothing was written, so nothing is replaced";
  auto replacing = RecordFile::create(path, {.replace = true});
  ASSERT_TRUE(replacing->append("new\n"));
  ASSERT_TRUE(replacing->finish());
  EXPECT_EQ(content_of(path), "new\n");
  ASSERT_TRUE(RecordFile::create(path, {.replace = true})->finish());
  EXPECT_EQ(content_of(path), "") << "an empty record is a record too";
  auto empty = RecordFile::create(path);
  ASSERT_TRUE(empty) << empty.error().message;
  EXPECT_THAT(RecordFile::create(path).error().message, HasSubstr("another session is writing it"));
  ASSERT_TRUE(RecordFile::create(folder_ / "unused"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "unused"));
}

TEST_F(Log, AFullDiskLeavesWholeLines) {
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{.rlim_cur = 100, .rlim_max = before.rlim_max};
  auto record = RecordFile::create(folder_ / "full.log");
  ASSERT_TRUE(record->append("0123456789\n"));
  ASSERT_TRUE(record->flush());
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(record->append("0123456789\n"));
  ::setrlimit(RLIMIT_FSIZE, &small);
  const auto written = record->flush();
  ::setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_EQ(written.error().message, (folder_ / "full.log").string() + ": cannot be written (File too large)");
  EXPECT_EQ(content_of(folder_ / "full.log").size(), 99U);
  EXPECT_EQ(record->append("more\n").error().message, written.error().message) << "a record has no gaps";
  EXPECT_EQ(record->finish().error().message, written.error().message);
  EXPECT_EQ(content_of(folder_ / "full.log").size(), 99U);
}

TEST_F(Log, APipeHoldsNobody) {
  const auto pipe = folder_ / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(RecordFile::create(pipe).error().message, HasSubstr("this pipe has no reader"));
  bool stopped = false;
  auto reader = LogReader::open(pipe, [&] { return std::exchange(stopped, true); });
  ASSERT_TRUE(reader);
  Frame frame;
  EXPECT_EQ(reader->next(frame), false) << "stopped while there was no writer";
  auto record = RecordFile::create(pipe);
  ASSERT_TRUE(record);
  Result<void> written;
  for (int i = 0; written && i < 100; ++i) written = record->append(std::string(9999, 'x') + "\n");
  EXPECT_THAT(written.error().message, HasSubstr("the reader of this pipe is too slow"));
}

TEST_F(Log, ReaderTakesLinesInPieces) {
  const auto pipe = folder_ / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  auto log = LogReader::open(pipe);
  std::thread writer([&] {
    std::ofstream out(pipe);
    for (const char* piece : {"(1.0) can0 12", "3#01\n(2.0) ca", "n0 124#\n(3.0) can0 125#"}) {
      out << piece << std::flush;
      std::this_thread::sleep_for(20ms);
    }
  });
  Frame frame;
  for (const std::uint32_t id : {0x123U, 0x124U, 0x125U}) {
    EXPECT_EQ(log->next(frame), true);
    EXPECT_EQ(frame.id, id);
  }
  EXPECT_EQ(log->next(frame), false);
  writer.join();
}

TEST_F(Log, AFileWithoutLineEndsIsNoLog) {
  auto log = LogReader::open("/dev/zero");
  Frame frame;
  EXPECT_THAT(log->next(frame).error().message, HasSubstr("/dev/zero:1: longer than 4095 characters"));
}

// The bus within a process

std::vector<std::uint32_t> identifiers_at(Transport& end) {
  std::vector<std::uint32_t> out;
  for (Frame frame; end.receive(frame);) out.push_back(frame.id);
  return out;
}

TEST(MemoryBus, AllOthersReceiveWhatOneSends) {
  const auto a = open_memory("three", {}), b = open_memory("three", {}), c = open_memory("three", {}),
             other = open_memory("another", {});
  const Frame sent = frame_of(0x123, {1, 2, 3});
  EXPECT_EQ(a->send(sent), Sent::done);
  Frame got;
  for (auto* end : {b.get(), c.get()}) {
    ASSERT_TRUE(end->receive(got));
    EXPECT_EQ(got, sent);
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    EXPECT_LT(std::chrono::abs(now - std::chrono::nanoseconds(got.time_ns)), 60s);
    EXPECT_FALSE(end->receive(got));
    EXPECT_EQ(end->counters().received, 1u);
  }
  EXPECT_FALSE(a->receive(got));
  EXPECT_FALSE(other->receive(got));
  EXPECT_EQ(a->counters().sent, 1u);
  EXPECT_TRUE(a->up());
  EXPECT_EQ(a->name(), "three");
}

TEST(MemoryBus, IsForgottenWithItsLastEnd) {
  auto a = open_memory("short-lived", {}), b = open_memory("short-lived", {});
  b.reset();
  a->send(frame_of(1));
  b = open_memory("short-lived", {});
  EXPECT_THAT(identifiers_at(*b), ElementsAre());
  a.reset();
  b.reset();
  a = open_memory("short-lived", {});
  EXPECT_THAT(identifiers_at(*a), ElementsAre());
}

TEST(MemoryBus, FiltersAndRefuses) {
  const auto any = open_memory("filters", {.fd = true}), plain = open_memory("filters", {}),
             ears = open_memory("filters", {.listen_only = true}),
             few = open_memory("filters", {.identifiers = {0x80, 0x181}});
  for (const auto& frame : {frame_of(0x80), frame_of(0x81), frame_of(0x181), Frame{.id = 0x80, .extended = true},
                            Frame{.id = 0x80, .remote = true}, Frame{.id = 4, .error = true, .size = 8}, fd_frame(12)})
    EXPECT_EQ(any->send(frame), Sent::done);
  EXPECT_THAT(identifiers_at(*few), ElementsAre(0x80, 0x181, 4));
  EXPECT_THAT(identifiers_at(*plain), ElementsAre(0x80, 0x81, 0x181, 0x80, 0x80, 4));
  EXPECT_EQ(few->counters().error_frames, 1u);

  EXPECT_EQ(ears->send(frame_of(1)), Sent::refused);
  EXPECT_EQ(plain->send(fd_frame(12)), Sent::refused);
  EXPECT_EQ(any->send(fd_frame(13)), Sent::refused);
  EXPECT_EQ(any->send({.id = 0x800}), Sent::refused);
  EXPECT_EQ(any->send({.id = 1, .size = 9}), Sent::refused);
  EXPECT_EQ(any->counters().send_refused, 3u);
  EXPECT_THAT(identifiers_at(*plain), ElementsAre());
}

TEST(MemoryBus, CountsWhatAnEndThatNobodyReadsLoses) {
  const auto a = open_memory("full", {}), b = open_memory("full", {});
  for (int i = 0; i < 70'000; ++i) ASSERT_EQ(a->send(frame_of(1)), Sent::done);
  EXPECT_EQ(identifiers_at(*b).size(), 65'536u);
  EXPECT_EQ(b->counters().receive_lost, 70'000u - 65'536u);
}

TEST(MemoryBus, ConcurrentEndsSeeOneOrder) {
  constexpr std::uint32_t each = 2000;
  const auto a = open_memory("order", {}), b = open_memory("order", {});
  std::array<std::vector<std::uint32_t>, 2> seen;
  const auto listen = [](Transport& end, std::vector<std::uint32_t>& out) {
    for (const auto deadline = in(30s); out.size() < 2 * each && in(0s) < deadline;) {
      end.wait(deadline);
      for (Frame frame; end.receive(frame);) out.push_back(frame.data[0] * 256u + frame.data[1] + (frame.id << 16));
    }
  };
  const auto talk = [](Transport& end, std::uint32_t id) {
    for (std::uint32_t i = 0; i < each; ++i)
      end.send(frame_of(id, {static_cast<std::uint8_t>(i >> 8), static_cast<std::uint8_t>(i)}));
  };
  {
    std::vector<std::jthread> threads;
    threads.emplace_back([&] { listen(*a, seen[0]); });
    threads.emplace_back([&] { listen(*b, seen[1]); });
    for (std::uint32_t id : {1u, 2u}) threads.emplace_back([&, id] { talk(*open_memory("order", {}), id); });
  }
  ASSERT_EQ(seen[0].size(), 2 * each);
  EXPECT_EQ(seen[0], seen[1]);
}

TEST(MemoryBus, ConcurrentWaitWakesUp) {
  const auto a = open_memory("wake", {}), b = open_memory("wake", {});
  const auto start = in(0s);
  for (std::uint32_t round = 0; round < 200; ++round) {
    const std::jthread answer([&] {
      Frame frame;
      while (!b->receive(frame)) b->wait(in(30s));
      b->send(frame_of(frame.id + 1));
    });
    ASSERT_EQ(a->send(frame_of(round)), Sent::done);
    Frame frame;
    for (const auto deadline = in(30s); !a->receive(frame) && in(0s) < deadline;) a->wait(deadline);
    EXPECT_EQ(frame.id, round + 1);
  }
  // 2 to 50 ms; without being woken up, each round would take the 20 ms after which `wait` looks for signals.
  EXPECT_LT(in(0s) - start, std::chrono::nanoseconds(2s).count());
}

TEST(MemoryBus, WaitReturnsAtTheDeadlineAndSoonForSignals) {
  const auto end = open_memory("deadline", {});
  end->wait(in(-1s));
  const auto deadline = in(10ms);
  end->wait(deadline);
  EXPECT_GE(in(0s), deadline);
  const auto start = in(0s);
  end->wait(in(60s));
  EXPECT_LT(in(0s) - start, std::chrono::nanoseconds(30s).count());
}

// Bit rate

/// What the kernel answers to RTM_GETLINK: IFLA_LINKINFO { IFLA_INFO_KIND `kind`, IFLA_INFO_DATA { IFLA_CAN_STATE,
/// IFLA_CAN_BITTIMING } }, behind the interface's name.
class LinkAnswer {
 public:
  LinkAnswer(std::string_view kind, std::uint32_t bit_rate) {
    const can_bittiming timing{.bitrate = bit_rate};
    const std::uint32_t state = CAN_STATE_ERROR_ACTIVE;
    const auto data =
        joined({attribute(IFLA_CAN_STATE, bytes_of(state)), attribute(IFLA_CAN_BITTIMING, bytes_of(timing))});
    const auto info = joined({attribute(IFLA_INFO_KIND, text(kind)), attribute(IFLA_INFO_DATA, data)});
    const auto all = joined({attribute(IFLA_IFNAME, text("can0")), attribute(IFLA_LINKINFO, info)});
    const auto size = static_cast<std::uint32_t>(NLMSG_LENGTH(sizeof(ifinfomsg)) + all.size());
    bytes = joined({bytes_of(nlmsghdr{.nlmsg_len = size, .nlmsg_type = RTM_NEWLINK}), bytes_of(ifinfomsg{}), all});
  }
  std::vector<std::byte> bytes;

 private:
  using Bytes = std::vector<std::byte>;
  template <typename Value>
  static Bytes bytes_of(const Value& value) {
    const auto raw = std::as_bytes(std::span(&value, 1));
    return {raw.begin(), raw.end()};
  }
  static Bytes text(std::string_view name) {
    Bytes bytes(name.size() + 1);
    std::memcpy(bytes.data(), name.data(), name.size());
    return bytes;
  }
  static Bytes attribute(int type, const Bytes& content) {
    Bytes bytes =
        bytes_of(rtattr{static_cast<unsigned short>(RTA_LENGTH(content.size())), static_cast<unsigned short>(type)});
    bytes.insert(bytes.end(), content.begin(), content.end());
    bytes.resize(RTA_ALIGN(bytes.size()));
    return bytes;
  }
  static Bytes joined(std::initializer_list<Bytes> parts) {
    Bytes all;
    for (const Bytes& part : parts) all.insert(all.end(), part.begin(), part.end());
    return all;
  }
};

TEST(BitRate, IsThatOfTheDevice) {
  EXPECT_EQ(bit_rate_in(LinkAnswer("can", 500'000).bytes), 500'000);
  EXPECT_EQ(bit_rate_in(LinkAnswer("can", 0).bytes), std::nullopt);  // not configured
  for (const char* kind : {"vcan", "vxcan", "canal", "ca", ""})
    EXPECT_EQ(bit_rate_in(LinkAnswer(kind, 500'000).bytes), std::nullopt) << kind;
  for (const char* interface : {"lo", "no_such0", ""}) EXPECT_EQ(bit_rate_of(interface), std::nullopt) << interface;
}

TEST(BitRate, NoAnswerReadsBeyondItsEnd) {
  const auto whole = LinkAnswer("can", 500'000).bytes;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::vector<std::byte> cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(bit_rate_in(cut), std::nullopt) << size;
  }
  for (std::size_t i = 0; i < whole.size(); ++i)
    for (const int value : {0, 1, 3, 0x7F, 0xFF}) {
      auto damaged = whole;
      damaged[i] = static_cast<std::byte>(value);
      (void)bit_rate_in(damaged);  // the sanitizers watch
    }
}

// socketcand

/// Our end of a socketcand bus: reads while it waits, as a program's loop does.
struct Served {
  std::unique_ptr<Transport> bus;
  std::vector<Frame> got = {};

  int port() const {
    const auto state = bus->state();
    return std::stoi(state.substr(state.find("127.0.0.1:") + 10));
  }
  void step() {
    bus->wait(in(2ms));
    for (Frame frame; bus->receive(frame);) got.push_back(frame);
  }
  template <typename Condition>
  bool until(Condition condition) {
    for (const auto deadline = in(30s); in(0s) < deadline; step())
      if (condition()) return true;
    return false;
  }
};

Served served(const OpenOptions& options = {}) {
  auto bus = open_bus("socketcand://127.0.0.1:0/can0", options);
  if (!bus) throw std::runtime_error(bus.error().message);
  return {std::move(*bus)};
}

class Client {
 public:
  explicit Client(Served& server, int receive_buffer = 0) : server_(server), fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    if (receive_buffer) ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(server.port()));
    if (::connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0)
      throw std::runtime_error("cannot connect");
  }
  ~Client() { close(); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  bool try_say(std::string_view words) {
    return ::send(fd_, words.data(), words.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(words.size());
  }
  void say(std::string_view words) { EXPECT_TRUE(try_say(words)); }
  /// Whether the server says this next, and nothing else in the same moment.
  bool hears(std::string_view words) {
    const bool came = server_.until([&] { return read().size() >= words.size(); });
    const auto heard = std::exchange(heard_, {});
    EXPECT_EQ(heard, words);
    return came && heard == words;
  }
  bool hears_something_with(std::string_view words) {
    const bool came = server_.until([&] { return read().find(words) != std::string::npos; });
    EXPECT_TRUE(came) << heard_;
    heard_.clear();
    return came;
  }
  bool closed() {
    return server_.until([&] { return read(), closed_; });
  }
  /// With the usual handshake behind it.
  Client& joined() {
    hears("< hi >");
    say("< open can0 >");
    hears("< ok >");
    say("< rawmode >");
    hears("< ok >");
    return *this;
  }
  const std::string& read() {
    std::array<char, 65536> buffer;
    const auto n = ::recv(fd_, buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (n > 0) heard_.append(buffer.data(), static_cast<std::size_t>(n));
    if (n == 0 || (n < 0 && errno != EAGAIN)) closed_ = true;
    return heard_;
  }
  void forget() { heard_.clear(); }
  /// As when the program is killed with unread data.
  void reset() {
    const linger at_once{.l_onoff = 1, .l_linger = 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    close();
  }
  void close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  }

 private:
  Served& server_;
  int fd_;
  bool closed_ = false;
  std::string heard_;
};

TEST(Socketcand, HandshakeOneStepPerSegment) {
  auto server = served();
  Client client(server);
  EXPECT_TRUE(client.hears("< hi >"));
  client.say("< open can0 >");
  EXPECT_TRUE(client.hears("< ok >"));
  client.say("< rawmode >");
  EXPECT_TRUE(client.hears("< ok >"));
  client.say("< echo >");
  EXPECT_TRUE(client.hears("< echo >"));
  EXPECT_THAT(server.bus->state(), testing::MatchesRegex("serving bus can0 on 127.0.0.1:[0-9]+, 1 client"));
  EXPECT_EQ(server.bus->name(), "can0");
  EXPECT_TRUE(server.bus->up());
}

TEST(Socketcand, FramesBothWays) {
  auto server = served();
  Client client(server);
  client.joined().say("< send 601 8 40 41 60 0 0 0 0 ff >< send 12345 2 1 f1 >\r\n< send 00000123 0 >< send 7FF 0  >");
  ASSERT_TRUE(server.until([&] { return server.got.size() == 4; }));
  EXPECT_EQ(server.got[0], frame_of(0x601, {0x40, 0x41, 0x60, 0, 0, 0, 0, 0xFF}));
  EXPECT_EQ(server.got[1], (Frame{.id = 0x12345, .extended = true, .size = 2, .data = {1, 0xF1}}));
  EXPECT_EQ(server.got[2], (Frame{.id = 0x123, .extended = true}));
  EXPECT_EQ(server.got[3], frame_of(0x7FF));
  EXPECT_LT(std::chrono::abs(std::chrono::system_clock::now().time_since_epoch() -
                             std::chrono::nanoseconds(server.got[0].time_ns)),
            60s);

  EXPECT_EQ(server.bus->send(frame_of(0x23, {0x1A, 0x22, 0x03, 0x44})), Sent::done);
  EXPECT_EQ(server.bus->send({.id = 0x123, .extended = true}), Sent::done);
  ASSERT_TRUE(server.until([&] { return std::ranges::count(client.read(), '>') == 2; }));
  EXPECT_THAT(
      client.read(),
      testing::MatchesRegex(
          " < frame 023 [0-9]+\\.[0-9][0-9][0-9][0-9][0-9][0-9] 1A220344 > < frame 00000123 [0-9]+\\.[0-9]+  >"));
  EXPECT_EQ(server.bus->counters().sent, 2u);
  EXPECT_EQ(server.bus->counters().received, 4u);
}

TEST(Socketcand, CommandsInPiecesAndManyAtOnce) {
  auto server = served();
  Client client(server);
  client.hears("< hi >");
  for (const char c : std::string_view("< open can0 >< rawmode >")) {
    client.say({&c, 1});
    server.step();
  }
  EXPECT_TRUE(client.hears("< ok >< ok >"));
  std::string all;
  for (int i = 0; i < 1000; ++i) all += fmt::format("< send {:X} 1 {:x} >", i, i % 256);
  client.say(all);
  ASSERT_TRUE(server.until([&] { return server.got.size() == 1000; }));
  for (std::uint32_t i = 0; i < 1000; ++i) EXPECT_EQ(server.got[i], frame_of(i, {static_cast<std::uint8_t>(i)}));
}

TEST(Socketcand, FirstFramesComeAfterTheAnswerToRawmode) {
  auto server = served();
  Client client(server);
  client.hears("< hi >");
  client.say("< open can0 >");
  client.hears("< ok >");
  client.say("< rawmode >");
  // Frames sent in the moment in which the client joins.
  server.until([&] { return server.bus->send(frame_of(1)), !client.read().empty(); });
  EXPECT_TRUE(client.hears("< ok >"));
  for (int i = 0; i < 3000; ++i)
    server.bus->send(frame_of(1, {1, 2, 3, 4, 5, 6, 7, 8}));  // more than is kept: not the client's fault
  EXPECT_TRUE(client.hears_something_with("< frame 001"));
  EXPECT_THAT(server.bus->state(), HasSubstr("1 client"));
}

TEST(Socketcand, WhatIsNoCommandIsAnsweredWithAnError) {
  auto server = served();
  Client client(server);
  client.hears("< hi >");
  client.say("< send 123 0 >");
  client.hears_something_with("< error unknown command, open a bus first >");
  client.say("< open can0 >");
  client.hears("< ok >");
  const std::vector<const char*> wrong{"send 123",
                                       "send 123 1",
                                       "send 123 0 1",
                                       "send 123 9 1 2 3 4 5 6 7 8 9",
                                       "send 123 1 100",
                                       "send 12G 0",
                                       "send 20000000 0",
                                       "send 123456789 0",
                                       "send 123 -1",
                                       "subscribe 0 0 123",
                                       "rawmode now",
                                       "",
                                       "<"};
  for (const char* words : wrong) {
    client.say(fmt::format("< {} >", words));
    EXPECT_TRUE(client.hears_something_with("< error ")) << words;
  }
  EXPECT_EQ(server.bus->counters().malformed, wrong.size() + 1);
  client.say("< echo >");
  EXPECT_TRUE(client.hears("< echo >"));
  EXPECT_THAT(server.got, ElementsAre());
}

TEST(Socketcand, WrongBusIsRefused) {
  auto server = served();
  Client client(server);
  client.hears("< hi >");
  client.say("< open can7 >");
  EXPECT_TRUE(client.hears("< error could not open bus, the one here is can0 >"));
  EXPECT_TRUE(client.closed());
}

TEST(Socketcand, GarbageClosesOnlyItsClient) {
  auto server = served();
  Client good(server), noise(server), endless(server), browser(server);
  good.joined();
  noise.joined();
  endless.joined();
  noise.say(std::string(10'000, '\xFF'));
  endless.say("< send " + std::string(300, '1'));
  browser.say("POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n< open can0 >< send 000 2 1 0 >");
  EXPECT_TRUE(noise.closed());
  EXPECT_TRUE(endless.closed());
  EXPECT_TRUE(browser.closed());
  good.say("< echo >");
  EXPECT_TRUE(good.hears("< echo >"));
  EXPECT_EQ(server.bus->counters().malformed, 3u);
  EXPECT_THAT(server.got, ElementsAre());
  EXPECT_THAT(server.bus->state(), HasSubstr("1 client"));
}

TEST(Socketcand, ClientsHearEachOtherButNotThemselves) {
  auto server = served();
  Client a(server), b(server), waiting(server);
  a.joined();
  b.joined();
  waiting.hears("< hi >");
  a.say("< send 111 1 1 >");
  EXPECT_TRUE(b.hears_something_with("< frame 111"));
  b.say("< send 222 1 2 >");
  EXPECT_TRUE(a.hears_something_with("< frame 222"));
  ASSERT_TRUE(server.until([&] { return server.got.size() == 2; }));
  a.say("< bcmmode >");
  EXPECT_TRUE(a.hears("< ok >"));
  server.bus->send(frame_of(0x333));
  EXPECT_TRUE(b.hears_something_with("< frame 333"));
  a.say("< echo >");
  EXPECT_TRUE(a.hears("< echo >"));
  waiting.say("< echo >");
  EXPECT_TRUE(waiting.hears("< echo >"));
}

TEST(Socketcand, ClientThatDoesNotReadIsDroppedAndBlocksNobody) {
  auto server = served();
  Client slow(server, 4096), quick(server);
  slow.joined();
  quick.joined();
  ASSERT_TRUE(server.until([&] { return server.bus->state().find("2 clients") != std::string::npos; }));
  std::size_t heard = 0, sent = 0;
  const auto count = [&] {
    heard += static_cast<std::size_t>(std::ranges::count(quick.read(), '>'));
    quick.forget();
    return heard == sent;
  };
  while (server.bus->state().find("2 clients") != std::string::npos && sent < 100'000) {
    ASSERT_EQ(server.bus->send(frame_of(0x123, {1, 2, 3, 4, 5, 6, 7, 8})), Sent::done);
    ++sent;
    if (sent % 100 == 0) {
      ASSERT_TRUE(server.until(count));
    }
  }
  EXPECT_THAT(server.bus->state(), HasSubstr("1 client"));
  EXPECT_GE(server.bus->counters().send_busy, 1000u);  // in a row, and maybe some before
  EXPECT_TRUE(server.until(count)) << heard << " of " << sent;
}

TEST(Socketcand, BusyWhenTheOnlyClientDoesNotRead) {
  auto server = served();
  Client slow(server, 4096);
  slow.joined();
  Sent last = Sent::done;
  for (int i = 0; i < 100'000 && last == Sent::done; ++i) last = server.bus->send(frame_of(1));
  EXPECT_EQ(last, Sent::busy);
  EXPECT_EQ(server.bus->counters().send_busy, 1u);
  // It is not closed yet; what it reads now are whole frames.
  std::string all;
  server.until([&] {
    all += slow.read();
    slow.forget();
    return server.bus->counters().sent == static_cast<std::uint64_t>(std::ranges::count(all, '>'));
  });
  EXPECT_EQ(std::ranges::count(all, '<'), std::ranges::count(all, '>'));
  EXPECT_EQ(server.bus->send(frame_of(1)), Sent::done);
}

TEST(Socketcand, VanishingClientsAreForgotten) {
  auto server = served();
  for (int round = 0; round < 40; ++round) {
    Client client(server);
    client.joined();
    if (round % 2)
      client.reset();
    else
      client.close();
    EXPECT_EQ(server.bus->send(frame_of(2)), Sent::done);
    EXPECT_EQ(server.bus->send(frame_of(3)), Sent::done);
    ASSERT_TRUE(server.until([&] { return server.bus->state().find("0 clients") != std::string::npos; }));
  }
}

TEST(Socketcand, SixteenClientsAndNoMore) {
  auto server = served();
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 16; ++i) clients.emplace_back(std::make_unique<Client>(server))->joined();
  Client extra(server);
  EXPECT_TRUE(extra.hears("< error 16 clients are connected already >"));
  EXPECT_TRUE(extra.closed());
  server.bus->send(frame_of(0x42));
  for (auto& client : clients) EXPECT_TRUE(client->hears_something_with("< frame 042"));
  clients.pop_back();
  ASSERT_TRUE(server.until([&] { return server.bus->state().find("15 clients") != std::string::npos; }));
  Client again(server);
  again.joined();
}

// Whoever connects and says nothing does not lock others out.
TEST(Socketcand, IdleConnectionsMakeRoomForClients) {
  auto server = served();
  std::vector<std::unique_ptr<Client>> idle;
  for (int i = 0; i < 16; ++i) ASSERT_TRUE(idle.emplace_back(std::make_unique<Client>(server))->hears("< hi >"));
  idle[0]->say("< open can0 >");  // so that another one is the longest idle
  EXPECT_TRUE(idle[0]->hears("< ok >"));
  Client first(server), second(server);
  first.joined();
  second.joined();
  for (const std::size_t dropped : {1u, 2u}) {
    EXPECT_TRUE(idle[dropped]->hears_something_with("< error dropped, because 16 clients are connected"));
    EXPECT_TRUE(idle[dropped]->closed());
  }
  for (const std::size_t left : {0u, 3u, 15u}) {
    idle[left]->say("< echo >");
    EXPECT_TRUE(idle[left]->hears("< echo >")) << left;
  }
}

TEST(Socketcand, WhoDoesNotJoinIsDropped) {
  auto server = served({.handshake_ns = std::chrono::nanoseconds(100ms).count()});
  Client listener(server), talker(server);
  listener.joined();
  talker.hears("< hi >");
  talker.say("< open can0 >< send 80 0 >");  // a client without raw mode
  talker.hears("< ok >");
  for (const char* said : {"", "< open can0 >", "< ope"}) {
    SCOPED_TRACE(said);
    Client silent(server);
    EXPECT_TRUE(silent.hears_something_with("< hi >"));
    silent.say(said);
    EXPECT_TRUE(silent.hears_something_with("< error no open and rawmode for 0.1 s >"));
    EXPECT_TRUE(silent.closed());
  }
  const auto later = in(300ms);
  server.until([&] { return in(0s) > later; });
  EXPECT_THAT(server.bus->state(), HasSubstr("2 clients"));  // who joined may be silent
  server.bus->send(frame_of(0x42));
  EXPECT_TRUE(listener.hears_something_with("< frame 042"));
}

TEST(Socketcand, DeadPeersAreNoticed) {
  auto server = served();
  Client client(server);
  client.joined();
  int watched = 0;
  for (int fd = 0; fd < 1024; ++fd) {
    sockaddr_in own{};
    socklen_t size = sizeof own;
    int on = 0, listens = 1;
    socklen_t length = sizeof on;
    if (::getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) != 0 || ntohs(own.sin_port) != server.port() ||
        ::getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &length) != 0 || listens)
      continue;
    EXPECT_EQ(::getsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, &length), 0);
    EXPECT_EQ(on, 1);
    ++watched;
  }
  EXPECT_EQ(watched, 1);
}

TEST(Socketcand, FloodingClientCannotHoldTheLoop) {
  auto server = served();
  Client client(server);
  client.joined();
  std::string many;
  for (int i = 0; i < 1000; ++i) many += "< send 1 0 >";
  std::thread flood([&] {
    while (client.try_say(many)) {
    }
  });
  std::size_t frames = 0;
  for (int round = 0; round < 50 || frames < 50'000; ++round) {
    server.bus->wait(in(1s));
    for (Frame frame; server.bus->receive(frame);) ++frames;  // ends although there is always more
  }
  server.bus.reset();  // which ends the flood
  flood.join();
}

TEST(Socketcand, FiltersAndRefuses) {
  auto server = served({.listen_only = true, .identifiers = {0x80}});
  Client client(server);
  client.joined().say("< send 80 0 >< send 81 0 >< send 00000080 0 >< send 80 1 9 >");
  ASSERT_TRUE(server.until([&] { return server.got.size() == 2; }));
  EXPECT_EQ(server.got[1], frame_of(0x80, {9}));
  EXPECT_EQ(server.bus->send(frame_of(1)), Sent::refused);
  auto talking = served();
  for (const auto& frame : {fd_frame(8), Frame{.id = 1, .remote = true}, Frame{.id = 1, .error = true},
                            Frame{.id = 0x800}, Frame{.id = 1, .size = 9}})
    EXPECT_EQ(talking.bus->send(frame), Sent::refused) << text(frame);
  EXPECT_EQ(talking.bus->counters().send_refused, 5u);
}

TEST(Socketcand, WaitReturnsAtTheDeadlineAndForSignals) {
  auto server = served();
  const auto deadline = in(30ms);
  server.bus->wait(deadline);
  EXPECT_GE(in(0s), deadline);
  server.bus->wait(in(-1s));

  const auto before = std::signal(SIGALRM, [](int) {});
  const itimerval soon{.it_interval = {}, .it_value = {.tv_sec = 0, .tv_usec = 30'000}};
  ::setitimer(ITIMER_REAL, &soon, nullptr);
  const auto start = in(0s);
  server.bus->wait(in(60s));
  EXPECT_LT(in(0s) - start, std::chrono::nanoseconds(30s).count());
  std::signal(SIGALRM, before);
}

TEST(Socketcand, OnlyFreePortsOfThisMachineAreServed) {
  auto server = served();
  const auto taken = open_socketcand("127.0.0.1", server.port(), "can1", {});
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().message,
            fmt::format(
                "socketcand://127.0.0.1:{0}/can1: port {0} is taken by another program; end it or choose another port",
                server.port()));
  for (const char* host : {"0.0.0.0", "192.168.1.7", "128.0.0.1", "::", "example.org", ""}) {
    const auto refused = open_socketcand(host, 29536, "can0", {});
    ASSERT_FALSE(refused) << host;
    EXPECT_THAT(refused.error().message, HasSubstr("is no loopback address")) << host;
  }
  EXPECT_THAT(open_socketcand("127.0.0.1", 65536, "can0", {}).error().message, HasSubstr("1..65535"));
  EXPECT_THAT(open_socketcand("127.0.0.1", 0, "can 0", {}).error().message, HasSubstr("one word"));
  EXPECT_THAT(open_socketcand("127.0.0.1", 0, "can0", {.fd = true}).error().message, HasSubstr("classic frames only"));
  EXPECT_TRUE(open_socketcand("localhost", 0, "can0", {}));
}

TEST(Socketcand, PortIsFreeAgainAfterAServerWithClientsEnded) {
  auto server = std::make_unique<Served>(served());
  const int port = server->port();
  Client client(*server);
  client.joined();
  server->bus = nullptr;
  const auto again = open_socketcand("127.0.0.1", port, "can0", {});
  EXPECT_TRUE(again) << again.error().message;
}

// Addresses

TEST(OpenBus, KnowsItsForms) {
  const auto a = open_bus("memory:forms"), b = open_bus("memory:forms");
  ASSERT_TRUE(a && b);
  (*a)->send(frame_of(7));
  EXPECT_THAT(identifiers_at(**b), ElementsAre(7));
  const auto served = open_bus("socketcand://127.0.0.1:0/can0");
  ASSERT_TRUE(served);
  EXPECT_EQ((*served)->name(), "can0");
  EXPECT_THAT(open_bus("log:run.log").error().message,
              "'log:run.log' is a log, not a bus: replay reads logs, --record writes them");
  for (const char* address : {"socketcand://127.0.0.1:0", "socketcand://127.0.0.1/can0",
                              "socketcand://127.0.0.1:x/can0", "socketcand://:1/can0", "socketcand://127.0.0.1:1/",
                              "socketcand://", "socketcand://127.0.0.1:99999999999/can0"})
    EXPECT_THAT(open_bus(address).error().message, HasSubstr("is not of the form socketcand://127.0.0.1:29536/NAME"))
        << address;
  EXPECT_THAT(open_bus("socketcand://10.0.0.1:29536/can0").error().message, HasSubstr("is no loopback address"));
  for (const char* address : {"", "memory:", "socketcan:", "http://localhost/", "two words",
                              "an_interface_name_too_long", "/dev/ttyACM0", "udp:can0"}) {
    const std::string message = open_bus(address).error().message;
    for (const char* form : {"can0", "socketcan:NAME", "socketcand://127.0.0.1:29536/NAME", "memory:NAME"})
      EXPECT_THAT(message, HasSubstr(form)) << address;
    EXPECT_EQ(message.find('\n'), std::string::npos);
  }
}

TEST(OpenBus, ServesIpv6LoopbackWhereThereIsOne) {
  const auto bus = open_bus("socketcand://[::1]:0/can0");
  if (!bus && bus.error().message.find("cannot listen") != std::string::npos) GTEST_SKIP() << bus.error().message;
  ASSERT_TRUE(bus) << bus.error().message;
  EXPECT_THAT((*bus)->state(), HasSubstr("[::1]:"));
}

}  // namespace
}  // namespace tribotwin::hil
