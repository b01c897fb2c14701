// The file beside a log, and what a session measures.
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/session/session_file.hpp>

namespace tribotwin::hil {
namespace {

using testing::HasSubstr;

class SessionFile : public testing::Test {
 protected:
  std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name();
  std::filesystem::path file = folder / "s.log.session";
  void SetUp() override {
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
  }
  void TearDown() override { std::filesystem::remove_all(folder); }
  void put(std::string_view text) { std::ofstream(file) << text; }
};

TEST_F(SessionFile, WhatIsWrittenIsRead) {
  const SessionHead head{.realtime = true,
                         .cycle_us = 1500,
                         .start_ns = 1'700'000'000'123'456'000,
                         .scenario = 0x00C0FFEE,
                         .conditions = {.unconfigured = true,
                                        .files = {{StartFile::Kind::store, "a store", std::nullopt},
                                                  {StartFile::Kind::dcf, "1.dcf", "turns\nend\r\n\n"},
                                                  {StartFile::Kind::dcf, "2.dcf", ""},
                                                  {StartFile::Kind::eds, "x.eds", std::string("\0\xFF[", 3)}}},
                         .wiring = {{2, 0}, {1}}};
  const std::vector<Turn> turns{{.time_ns = head.start_ns + 1000, .steps = 1},
                                {.time_ns = head.start_ns + 2'001'000, .misleading = {0, 7}, .recovered = {0, 1}},
                                {.time_ns = head.start_ns + 4'000'000},
                                {.time_ns = head.start_ns + 4'001'000, .not_kept = {0, 2}},
                                {.time_ns = head.start_ns + 4'002'000, .events = {"a: 1%\nb: \"\xC2\xB0 =\"\n", ""}},
                                {.time_ns = head.start_ns + 4'003'000, .hold = 0},
                                {.time_ns = head.start_ns + 4'004'000, .events = {"a"}, .hold = 1'000'000},
                                {.time_ns = head.start_ns + 4'005'000, .hold = Turn::goes_on},
                                {.time_ns = head.start_ns + 5'000'000'000'000},  // the machine slept
                                {.time_ns = head.start_ns + 5'000'000'001'000,
                                 .steps = 200,
                                 .faults = {{3, {FaultKind::encoder_freeze, 0, true}},
                                            {Turn::at_end, {FaultKind::encoder_freeze, 0, false}},
                                            {1, {FaultKind::safe_torque_off, 2, true}},
                                            {2, {FaultKind::safe_torque_off, 2, false}},
                                            {0, {FaultKind::over_temperature, 5, true, 0.1 + 0.2}},
                                            {12, {FaultKind::over_temperature, 5, false}}}}};
  auto writer = SessionWriter::create(file, head);
  ASSERT_TRUE(writer) << writer.error().message;
  for (const Turn& turn : turns) ASSERT_TRUE(writer->write(turn));
  ASSERT_TRUE(writer->finish());
  auto reader = SessionReader::open(file);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->head(), head);
  EXPECT_TRUE(reader->head().complete);
  for (const Turn& turn : turns) {
    Turn read;
    EXPECT_FALSE(reader->complete());
    ASSERT_EQ(reader->next(read), true);
    EXPECT_EQ(read, turn);
  }
  Turn none;
  EXPECT_EQ(reader->next(none), false);
  EXPECT_TRUE(reader->complete());
}

// The log loses its last lines with a killed session; so does the file beside it.
TEST_F(SessionFile, HasNoEndAfterAKill) {
  const std::string head = "tribotwin-hil session 1\nclock lockstep\ncycle_us 2000\nstart_us 5\n";
  for (const std::string rest : {"", "10 steps=1\n", "10 steps=1\n10 st", "10 steps=1\n10 steps=1"}) {
    put(head + rest);
    auto reader = SessionReader::open(file);
    ASSERT_TRUE(reader) << reader.error().message;
    Turn turn;
    EXPECT_EQ(reader->next(turn), rest.size() > 10);
    if (rest.size() > 10) EXPECT_EQ(reader->next(turn), false);
    EXPECT_FALSE(reader->complete());
  }
}

TEST_F(SessionFile, WhatIsNoneIsRefusedWithItsPlace) {
  const std::string first = "tribotwin-hil session 1\n", head = first + "clock realtime\ncycle_us 2000\nstart_us 5\n";
  const std::string second = "tribotwin-hil session 2\nclock realtime\ncycle_us 2000\nstart_us 5\n",
                    files = second + "scenario 00C0FFEE\n";
  for (const auto& [text, says] : std::initializer_list<std::pair<std::string, std::string>>{
           {"", "is empty"},
           {"(1.0) can0 080#\n", ":1: is not 'tribotwin-hil session 2'"},
           {"tribotwin-hil session 3\n", ":1: "},
           {second, ":5: is not 'scenario CHECKSUM'"},
           {second + "scenario 1\n", ":5: "},
           {files, ":6: is not 'unconfigured', 'turns' or"},
           {files + "10 steps=1\n", ":6: "},
           {files + "bus 1 0\n", ":6: is not 'unconfigured', 'turns' or"},
           {files + "bus 1 2\nbus x\n", ":7: "},
           {files + "eds x a.eds\n", ":6: is not 'eds BYTES NAME'"},
           {files + "eds absent a.eds\n", ":6: "},
           {files + "eds 99999999999 a.eds\n", ":6: is not 'eds BYTES NAME' with at most"},
           {files + "eds 5 a.eds\nab\nc", ":6: 5 bytes of a file"},
           {files + "eds 5 a.eds\nab\ncd\nef\n", ":9: is not"},
           {files + "eds 5 a.eds\nab\ncd\nturns\nx\n", ":10: 'x'"},
           {files + "turns\n1 not_kept=x\n", ":7: "},
           {files + "turns\n1 event=a%2\n", ":7: "},
           {files + "turns\n1 event=a%xx\n", ":7: "},
           {files + "turns\n1 pause\n", ":7: "},
           {files + "turns\n1 pause=-1\n", ":7: "},
           {files + "turns\n1 pause=1000001\n", ":7: "},
           {files + "turns\n1 resume=1\n", ":7: "},
           {first, ":2: is not 'clock realtime|lockstep'"},
           {first + "clock sun\n", ":2: "},
           {first + "clock realtime\ncycle_us 0\n", ":3: is not 'cycle_us NUMBER'"},
           {first + "clock realtime\ncycle_us 2000\nstart_us -1\n", ":4: "},
           {first + "clock realtime\ncycle_us 2000\nstart_us 99999999999999999\n", ":4: "},
           {head + "x\n", ":5: 'x'"},
           {head + "-1 steps=1\n", ":5: "},
           {head + "9223372036854775 steps=1\n", ":5: "},
           {head + "1 over_temperature=1:1:nan\n", ":5: "},
           {head + "1\n\n", ":6: ''"},
           {head + "1 steps\n", ":5: "},
           {head + "1 steps=0\n", ":5: "},
           {head + "1 misleading=x\n", ":5: "},
           {head + "1 encoder_freeze=1:0:on\n", ":5: "},
           {head + "1 encoder_freeze=1:1:140\n", ":5: "},
           {head + "1 safe_torque_off=1:1:140\n", ":5: "},
           {head + "1 over_temperature=1:1:on\n", ":5: "},
           {head + "1 over_temperature=1:1\n", ":5: "}}) {
    SCOPED_TRACE(text);
    put(text);
    std::string said;
    auto reader = SessionReader::open(file);
    if (!reader) said = reader.error().message;
    Turn turn;
    for (bool more = bool(reader); more;) {
      const auto next = reader->next(turn);
      if (!next) said = next.error().message;
      more = next && *next;
    }
    EXPECT_THAT(said, HasSubstr(file.string()));
    EXPECT_THAT(said, HasSubstr(says));
  }
}

// Logs of older versions are read: what they do not say comes from the options of the replay.
TEST_F(SessionFile, OfAnOlderVersion) {
  put("tribotwin-hil session 1\nclock lockstep\ncycle_us 2000\nstart_us 5\n10 steps=1\nend\n");
  auto reader = SessionReader::open(file);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_FALSE(reader->head().complete);
  Turn turn;
  EXPECT_EQ(reader->next(turn), true);
  EXPECT_EQ(turn.steps, 1);
}

TEST_F(SessionFile, LiesBesideRegularFilesOnly) {
  EXPECT_EQ(session_file_of(folder / "s.log"), file);
  put("");
  EXPECT_EQ(session_file_of(file), file.string() + ".session");
  for (const char* none : {"", "/dev/null", "/tmp"}) EXPECT_EQ(session_file_of(none), "");
}

TEST_F(SessionFile, ThatCannotBeReadIsNoEmptyOne) {
  const auto session = SessionReader::open("/proc/self/mem");  // address 0: reading fails
  ASSERT_FALSE(session);
  EXPECT_THAT(session.error().message, HasSubstr("cannot be read to its end (Input/output error)"));
}

}  // namespace
}  // namespace tribotwin::hil
