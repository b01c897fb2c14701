// What pages record and export: files of a server with rows that have random bits.
#include <atomic>
#include <fstream>
#include <limits>
#include <random>
#include <thread>

#include "client.hpp"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <tribotwin/tests/small_disk.hpp>
#include <tribotwin/twin/io/mcap/joint_states.hpp>
#include <tribotwin/twin/live/live_file.hpp>
#include <tribotwin/twin/live/row_memory.hpp>

namespace tribotwin::twin::live {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre, testing::HasSubstr, testing::IsEmpty;
using Json = nlohmann::json;

constexpr std::size_t joints = 2, channels = 4, columns = 1 + joints * channels;

/// Times are n / 1000 s, the other values any doubles.
std::vector<double> row_of(std::uint64_t n) {
  std::mt19937_64 random(n);
  std::vector<double> row{static_cast<double>(n) / 1000};
  while (row.size() < columns) row.push_back(std::bit_cast<double>(random() >> 2 | 1ull << 61));  // finite
  return row;
}

TEST(RowMemory, HoldsTheLastRowsInABoundedMemory) {
  RowMemory memory(columns, 4 << 20);
  EXPECT_TRUE(memory.empty());
  const std::size_t capacity = memory.capacity();
  EXPECT_NEAR(static_cast<double>(capacity), (4 << 20) / (8. * columns + 8), 10);
  for (std::uint64_t n = 0; n < 3 * capacity; ++n) {
    if (n == 2 * capacity + 5) continue;  // is lost
    memory.add(n, row_of(n));
    if (n > 0 && n % 10'007 == 0) {
      const auto rows = memory.last(1e9);
      EXPECT_LE(rows.size(), capacity);
      EXPECT_GE(rows.size(), std::min<std::size_t>(n, capacity - capacity / 4));
      EXPECT_EQ(rows.last_s(), row_of(n)[0]);
    }
  }
  std::uint64_t next = 3 * capacity - 100;
  const auto rows = memory.last(0.1);
  EXPECT_EQ(rows.size(), 100U);
  EXPECT_EQ(rows.missing(), 0U);
  EXPECT_EQ(rows.first_s(), row_of(next)[0]);
  EXPECT_TRUE(rows.each([&](std::span<const double> row) {
    const auto expected = row_of(next++);
    return std::ranges::equal(row, expected);
  }));
  EXPECT_EQ(next, 3 * capacity);
  EXPECT_EQ(memory.last(1e9).missing(), 1U);
  // What was taken stays.
  for (std::uint64_t n = 0; n < 2 * capacity; ++n) memory.add(next + n, row_of(next + n));
  std::size_t count = 0;
  EXPECT_FALSE(rows.each([&](std::span<const double> row) { return ++count < 7 && row[0] == rows.first_s() + 0; }));
}

class RowFiles : public testing::Test {
 protected:
  fs::path folder = fs::path(testing::TempDir()) / "tribotwin_row_files" /
                    testing::UnitTest::GetInstance()->current_test_info()->name();
  std::unique_ptr<Server> server;
  std::unique_ptr<Client> client;
  std::uint64_t pushed = 0;
  int asked = 0;
  std::atomic<std::uintmax_t> room = std::numeric_limits<std::uintmax_t>::max();

  void SetUp() override {
    fs::remove_all(folder);
    fs::create_directories(folder);
  }
  void TearDown() override {
    client.reset();
    server.reset();
    fs::remove_all(folder);
  }
  void start(bool readonly = false) {
    Hello hello{.program = "run",
                .version = "1",
                .scenario = "test",
                .step_s = 0.001,
                .commands = {"pause"},
                .joints = {{"j1", "extended", 80}, {"j2", "", {}}},
                .columns = std::vector<Column>(columns, {"", "time_s", "s"})};
    hello.head = TelemetryOptions{.attributes = {{"scenario", "test"}},
                                  .joints = {"j1", "j2"},
                                  .channels = {{"position_rad", "rad", "angle"},
                                               {"velocity_rad_s", "rad/s", "speed"},
                                               {"torque_nm", "Nm", "torque"},
                                               {"friction_nm", "Nm", "friction"}}};
    ServerOptions options;
    options.address.port = 0;
    options.readonly = readonly;
    options.folder = folder;
    options.room = [this](const fs::path&) { return room.load(); };
    options.limits.messages_per_s = 1000;
    server = std::move(Server::start(options, hello).value());
    client = std::make_unique<Client>(port_of(*server));
    ASSERT_TRUE(client->watch());
    commands = Json::parse(client->hear_text("hello"))["commands"];
  }
  void push(std::uint64_t rows) {
    for (const std::uint64_t end = pushed + rows; pushed < end; ++pushed) {
      while (!server->rows().push([&](std::span<double> to) { std::ranges::copy(row_of(pushed), to.begin()); }))
        FAIL() << "a row was lost";
      if (pushed % 4000 == 3999) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the server takes them 60 times a second
  }
  Json ask(const std::string& command) {
    client->say(fmt::format(R"({{"type":"command","id":{},{}}})", ++asked, command));
    for (Json done; !(done = Json::parse(client->hear_text("done"))).is_null();)
      if (done["id"] == asked) return done;
    return {};
  }
  std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename().string());
    std::ranges::sort(names);
    return names;
  }
  /// The times of its joint states, and whether all their values are those of row_of.
  std::vector<std::uint64_t> recorded(const std::string& name) const {
    std::vector<std::uint64_t> rows;
    const auto contents = mcap::read(folder / name, [&](const mcap::Channel& channel, std::uint64_t ns,
                                                        std::string_view data) {
      mcap::JointNumbers numbers;
      EXPECT_TRUE(mcap::decode(channel, data, numbers));
      const bool state = channel.topic == "/joint_states";
      if (state) rows.push_back((ns + 500'000) / 1'000'000);
      const auto row = row_of((ns + 500'000) / 1'000'000);
      EXPECT_EQ(numbers.values.size(), state ? 6U : 2U);
      for (const auto& [joint, interface, value] : numbers.values) {
        const std::size_t c = interface == "position" ? 0 : interface == "velocity" ? 1 : interface == "effort" ? 2 : 3;
        EXPECT_EQ(value, row[1 + (joint == "j2") * channels + c]) << joint << interface;
      }
      return Result<void>{};
    });
    EXPECT_TRUE(contents) << contents.error().message;
    if (contents) EXPECT_EQ(contents->cut_off, "");
    return rows;
  }
  Json commands;
};

TEST_F(RowFiles, RecordsFromNowOn) {
  start();
  EXPECT_EQ(commands, Json({"pause", "record", "export"}));
  push(100);
  const Json on = ask(R"("do":"record","on":true)");
  EXPECT_EQ(on["ok"], true) << on;
  EXPECT_EQ(on["message"], "recording live-0000.1s.mcap");
  EXPECT_THAT(files(), ElementsAre(HasSubstr(".partial-")));
  push(20'000);  // several chunks
  server->tell(Status{.simulated_s = 20});
  const Json status = Json::parse(client->hear_text("status"));
  EXPECT_EQ(status["recording"], true);
  EXPECT_EQ(status["file"]["name"], "live-0000.1s.mcap");
  EXPECT_EQ(status["file"]["rows"], 20'000);
  const Json off = ask(R"("do":"record","on":false)");
  EXPECT_EQ(off["ok"], true) << off;
  EXPECT_EQ(off["message"], "live-0000.1s.mcap: 20000 rows, from 0.100 s to 20.099 s");
  EXPECT_EQ(off["file"]["rows"], 20'000);
  EXPECT_EQ(off["file"]["lost_rows"], 0);
  push(10);
  EXPECT_THAT(files(), ElementsAre("live-0000.1s.mcap"));
  const auto rows = recorded("live-0000.1s.mcap");
  ASSERT_EQ(rows.size(), 20'000U);
  EXPECT_EQ(rows.front(), 100U);
  EXPECT_EQ(rows.back(), 20'099U);
  server->tell(Status{.simulated_s = 21});
  EXPECT_EQ(Json::parse(client->hear_text("status"))["file"], nullptr);
}

TEST_F(RowFiles, ExportsTheLastMinutes) {
  start();
  push(30'000);
  const Json h5 = ask(R"("do":"export","minutes":0.1,"format":"h5")");
  EXPECT_EQ(h5["ok"], true) << h5;
  EXPECT_EQ(h5["message"], "live-0030.0s.h5: 6000 rows, from 24.000 s to 29.999 s, 0.1 of 0.1 min asked for");
  const Json mcap = ask(R"("do":"export","minutes":10,"format":"mcap")");
  EXPECT_EQ(mcap["message"], "live-0030.0s.mcap: 30000 rows, from 0.000 s to 29.999 s, 0.5 of 10 min asked for");
  EXPECT_NEAR(mcap["file"]["minutes"].get<double>(), 0.5, 1e-3);
  EXPECT_THAT(files(), ElementsAre("live-0030.0s.h5", "live-0030.0s.mcap"));
  EXPECT_EQ(recorded("live-0030.0s.mcap").size(), 30'000U);
  const auto read = read_telemetry(folder / "live-0030.0s.h5");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->joints, (std::vector<std::string>{"j1", "j2"}));
  EXPECT_FALSE(read->complete);
  ASSERT_EQ(read->time_s.size(), 6000U);
  for (std::size_t i = 0; i < 6000; ++i) {
    const auto row = row_of(24'000 + i);
    ASSERT_EQ(read->time_s[i], row[0]);
    for (std::size_t j = 0; j < joints; ++j)
      for (std::size_t c = 0; c < channels; ++c) ASSERT_EQ(read->values[j][c][i], row[1 + j * channels + c]);
  }
}

TEST_F(RowFiles, ReplacesNoFile) {
  const auto put = [&](const char* name) { std::ofstream(folder / name) << "precious"; };
  put("live-0000.0s.mcap");
  start();
  EXPECT_EQ(ask(R"("do":"record","on":true)")["message"], "recording live-0000.0s-2.mcap");
  put("live-0000.0s-2.mcap");  // while it is written
  push(1);
  EXPECT_EQ(ask(R"("do":"export","minutes":1,"format":"mcap")")["file"]["name"], "live-0000.0s-3.mcap");
  EXPECT_EQ(ask(R"("do":"record","on":false)")["file"]["name"], "live-0000.0s-4.mcap");
  EXPECT_EQ(recorded("live-0000.0s-4.mcap").size(), 1U);
  for (const char* name : {"live-0000.0s.mcap", "live-0000.0s-2.mcap"}) {
    std::ifstream file(folder / name);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(file), {}), "precious");
  }
  EXPECT_EQ(files().size(), 4U);
}

TEST_F(RowFiles, LeavesNothingOnAFullDisk) {
  start();
  push(30'000);
  const SmallDisk disk(100'000);
  for (const char* format : {"h5", "mcap"}) {
    const Json done = ask(fmt::format(R"("do":"export","minutes":1,"format":"{}")", format));
    EXPECT_EQ(done["ok"], false);
    EXPECT_THAT(done["message"].get<std::string>(), HasSubstr("File too large")) << done;
    EXPECT_THAT(done["message"].get<std::string>(), testing::Not(HasSubstr("/"))) << done;
    EXPECT_THAT(client->hear_text("event"), HasSubstr("File too large"));
    EXPECT_THAT(files(), IsEmpty());
  }
  ASSERT_EQ(ask(R"("do":"record","on":true)")["ok"], true);
  EXPECT_THAT(client->hear_text("event"), HasSubstr("recording live-0030.0s.mcap"));
  push(20'000);
  EXPECT_THAT(client->hear_text("event"), HasSubstr("File too large"));
  const Json off = ask(R"("do":"record","on":false)");
  EXPECT_EQ(off["ok"], false);
  EXPECT_THAT(off["message"].get<std::string>(), HasSubstr("nothing is left of the recording of"));
  EXPECT_THAT(files(), IsEmpty());
}

TEST_F(RowFiles, LeaveTheRestOfTheDiskToTheRecordOfTheProgram) {
  constexpr auto reason = "what is left of the disk is for the record of the program";
  start();
  ASSERT_EQ(ask(R"("do":"record","on":true)")["ok"], true);
  EXPECT_THAT(client->hear_text("event"), HasSubstr("recording live-0000.0s.mcap"));
  push(1000);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  room = 0;
  push(1000);
  const std::string ended = client->hear_text("event");
  EXPECT_THAT(ended, HasSubstr("recorded live-0000.0s.mcap: 1"));
  EXPECT_THAT(ended, HasSubstr(reason));
  const auto rows = recorded("live-0000.0s.mcap");
  EXPECT_GE(rows.size(), 1U);
  EXPECT_LT(rows.size(), 2000U);
  EXPECT_THAT(ended, HasSubstr(fmt::format("{} row", rows.size())));
  const Json off = ask(R"("do":"record","on":false)");
  EXPECT_EQ(off["ok"], false);
  EXPECT_THAT(off["message"].get<std::string>(), HasSubstr(reason));
  EXPECT_THAT(ask(R"("do":"record","on":true)")["message"].get<std::string>(), HasSubstr(reason));
  room = 1000;
  const std::string refused = ask(R"("do":"export","minutes":1,"format":"h5")")["message"];
  EXPECT_THAT(refused, HasSubstr("export: 2000 rows may take 1 MiB, and there is room for 0; "));
  EXPECT_THAT(files(), ElementsAre("live-0000.0s.mcap"));
}

TEST(RoomForPages, IsWithinTheDisk) {
  const auto disk = fs::space(testing::TempDir());
  EXPECT_LT(room_for_pages(testing::TempDir()), disk.available);
  EXPECT_GT(room_for_pages("/no/such/folder"), disk.capacity);
}

TEST_F(RowFiles, SayWhatWouldBeRight) {
  start();
  const struct {
    std::string command, says;
  } cases[] = {
      {R"("do":"record")", "record: on: is missing: true starts a recording, false ends it"},
      {R"("do":"record","on":7)", "record: on: must be true or false"},
      {R"("do":"record","on":[true])", "record: on: must be a number or a text"},
      {R"("do":"record","on":true,"file":"x")", "record: file: is not known"},
      {R"("do":"record","on":true,"messages":"xml")", "record: messages: 'xml' is not known"},
      {R"("do":"record","on":false,"messages":"json")", "record: messages: is said when a recording starts"},
      {R"("do":"record","on":false)", "record: nothing is recorded"},
      {R"("do":"export")", "export: minutes: is missing"},
      {R"("do":"export","minutes":0,"format":"h5")", "export: minutes: is 0 but must be within"},
      {R"("do":"export","minutes":1)", "export: format: is missing"},
      {R"("do":"export","minutes":1,"format":"csv")", "export: format: 'csv' is not known"},
      {R"("do":"export","minutes":1,"format":"h5","folder":"/tmp")", "export: folder: is not known"},
      {R"("do":"export","minutes":1,"format":"h5","messages":"ros2")", "export: messages: is said of the format mcap"},
      {R"("do":"export","minutes":1,"format":"h5")", "export: there are no rows yet"},
  };
  for (const auto& c : cases) {
    const Json done = ask(c.command);
    EXPECT_EQ(done["ok"], false) << c.command;
    EXPECT_THAT(done["message"].get<std::string>(), HasSubstr(c.says)) << c.command;
  }
  EXPECT_EQ(ask(R"("do":"record","on":true)")["ok"], true);
  EXPECT_EQ(ask(R"("do":"record","on":true)")["message"], "record: live-0000.0s.mcap is recorded already");
  EXPECT_FALSE(server->take());
}

TEST_F(RowFiles, AreRefusedWhenReadOnly) {
  start(true);
  EXPECT_THAT(commands, IsEmpty());
  for (const char* command : {R"("do":"record","on":true)", R"("do":"export","minutes":1,"format":"h5")"})
    EXPECT_THAT(ask(command)["message"].get<std::string>(), HasSubstr("read-only")) << command;
  EXPECT_THAT(files(), IsEmpty());
}

TEST_F(RowFiles, AreWholeWhenTheServerEnds) {
  start();
  ASSERT_EQ(ask(R"("do":"record","on":true)")["ok"], true);
  push(5000);
  client->say(R"({"type":"command","id":"end","do":"export","minutes":1,"format":"h5"})");
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  server.reset();
  EXPECT_EQ(client->hear_end(), 1001);
  EXPECT_THAT(files(), ElementsAre("live-0000.0s.mcap", "live-0005.0s.h5"));
  EXPECT_EQ(recorded("live-0000.0s.mcap").size(), 5000U);
  EXPECT_EQ(read_telemetry(folder / "live-0005.0s.h5").value().time_s.size(), 5000U);
}

}  // namespace
}  // namespace tribotwin::twin::live
