// Recordings of joints in MCAP as tables: which topic, which time, which columns.
#include <cmath>
#include <filesystem>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/tests/twin/io/mcap/mcap_bytes.hpp>
#include <tribotwin/tests/twin/io/tables/table_files.hpp>
#include <tribotwin/twin/io/mcap/joint_states.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin {
namespace {

using namespace mcap_bytes;
using testing::AllOf, testing::ElementsAre, testing::HasSubstr;

const std::string joint_state_type = "sensor_msgs/msg/JointState";
const std::string dynamic_type = "control_msgs/msg/DynamicJointState";
constexpr std::uint64_t epoch = 1'700'000'000'000'000'000;

std::string joints(const std::string& topic = "/joint_states", std::uint16_t id = 1,
                   const std::string& type = joint_state_type, const std::string& encoding = "cdr") {
  return schema(id, type) + channel(id, id, topic, encoding);
}

/// A DynamicJointState of one joint.
std::string dynamic(double time_s, const std::string& joint, const Texts& interfaces, const Doubles& values) {
  const auto ns = static_cast<std::int64_t>(time_s * 1e9 + 0.5);
  return Cdr()
      .add(static_cast<std::int32_t>(ns / 1000000000))
      .add(static_cast<std::uint32_t>(ns % 1000000000))
      .add(std::string())
      .add(Texts{joint})
      .add(std::uint32_t{1})
      .add(interfaces)
      .add(values);
}

class McapTables : public TableFiles {
 protected:
  using Columns = std::vector<std::vector<double>>;

  Result<Numbers> read(const std::string& data, const std::vector<std::string>& wanted, TableOptions options = {}) {
    return read_numbers(write("a.mcap", file(data)), wanted, options);
  }
  Columns columns(const std::string& data, const std::vector<std::string>& wanted, TableOptions options = {}) {
    auto table = read(data, wanted, std::move(options));
    EXPECT_TRUE(table) << table.error().message;
    if (!table) return {};
    notes_ = table->notes.empty() ? "" : table->notes.front();
    return std::move(table->columns);
  }
  std::string refusal(const std::string& data, TableOptions options = {}) {
    const auto table = read(data, {"time_s", "position_a_rad"}, std::move(options));
    return table ? "was read" : table.error().message;
  }
  std::string notes_;
};

const std::vector<std::string> arm{"time_s",         "position_a_rad",   "velocity_a_rad_s", "torque_a_nm",
                                   "position_b_rad", "velocity_b_rad_s", "torque_b_nm"};

TEST_F(McapTables, JointStatesOfEveryEncoding) {
  const Texts ab{"a", "b"};
  // ROS 1: a sequence number in the header, no alignment, texts without NUL.
  const auto ros1 = [&](double time_s, const Doubles& q, const Doubles& v, const Doubles& e) {
    std::string out = le(std::uint32_t{9}) + le(static_cast<std::uint32_t>(time_s)) +
                      le(static_cast<std::uint32_t>(std::lround((time_s - std::floor(time_s)) * 1e9))) + text("base") +
                      le(std::uint32_t{2}) + text("a") + text("b");
    for (const auto& numbers : {q, v, e}) {
      out += le(static_cast<std::uint32_t>(numbers.size()));
      for (const double x : numbers) out += le(x);
    }
    return out;
  };
  const auto json = [](const char* stamp, const char* rest) {
    return fmt::format(R"({{"header": {{"stamp": {}}}, "name": ["a", "b"], {}}})", stamp, rest);
  };
  const struct {
    const char* name;
    std::string type, encoding, first, second;
  } cases[] = {
      {"little-endian", joint_state_type, "cdr", joint_state(1, ab, {1, 2}, {3, 4}, {5, 6}),
       joint_state(1.25, ab, {7, 8}, {9, 10}, {11, 12})},
      {"big-endian", joint_state_type, "cdr", joint_state(1, ab, {1, 2}, {3, 4}, {5, 6}, true),
       joint_state(1.25, ab, {7, 8}, {9, 10}, {11, 12}, true)},
      {"joints in another order", joint_state_type, "cdr", joint_state(1, ab, {1, 2}, {3, 4}, {5, 6}),
       joint_state(1.25, {"b", "a"}, {8, 7}, {10, 9}, {12, 11})},
      {"ROS 1", "sensor_msgs/JointState", "ros1", ros1(1, {1, 2}, {3, 4}, {5, 6}),
       ros1(1.25, {7, 8}, {9, 10}, {11, 12})},
      {"JSON", joint_state_type, "json",
       json(R"({"sec": 1, "nanosec": 0})", R"("position": [1, 2], "velocity": [3, 4], "effort": [5, 6])"),
       json(R"({"sec": 1, "nsec": 250000000})", R"("position": [7, 8], "velocity": [9, 10], "effort": [11, 12])")},
  };
  for (const auto& c : cases) {
    const auto out =
        columns(joints("/js", 1, c.type, c.encoding) + message(1, 5, c.first) + message(1, 9, c.second), arm);
    EXPECT_THAT(out, ElementsAre(ElementsAre(1, 1.25), ElementsAre(1, 7), ElementsAre(3, 9), ElementsAre(5, 11),
                                 ElementsAre(2, 8), ElementsAre(4, 10), ElementsAre(6, 12)))
        << c.name;
    EXPECT_THAT(notes_, HasSubstr("topic '/js', 2 messages; time is header.stamp")) << c.name;
  }
}

TEST_F(McapTables, AFileOfOurOwn) {
  const Texts names{"a", "b"}, interfaces{"temperature_degC", "friction_nm"};
  std::string data = joints() + joints("/dynamic_joint_states", 2, dynamic_type);
  for (int i = 0; i < 3; ++i) {
    const double t = 0.001 * i;
    const std::int64_t ns = 1'000'000 * i;
    data += message(1, static_cast<std::uint64_t>(ns),
                    mcap::encode_joint_state(ns, names, Doubles{t, 0.5}, Doubles{}, Doubles{M_PI * t, 0.25}));
    data += message(2, static_cast<std::uint64_t>(ns),
                    mcap::encode_dynamic_joint_state(ns, names, interfaces, Doubles{20 + t, NAN, 30, 0.125}));
  }
  const auto out = columns(data, {"time_s", "position_a_rad", "torque_a_nm", "temperature_a_degC", "friction_b_nm"});
  EXPECT_THAT(out, ElementsAre(ElementsAre(0, 0.001, 0.002), ElementsAre(0, 0.001, 0.002),
                               ElementsAre(0, M_PI * 0.001, M_PI * 0.002), ElementsAre(20, 20.001, 20.002),
                               ElementsAre(0.125, 0.125, 0.125)));
  const auto holes = read(data, {"time_s", "friction_a_nm"});
  ASSERT_TRUE(holes);
  EXPECT_EQ(holes->left_out, 3u);
  EXPECT_THAT(columns(data, {"time_s", "temperature_degC"}, {.joint = "b", .topic = "/dynamic_joint_states"}),
              ElementsAre(ElementsAre(0, 0.001, 0.002), ElementsAre(30, 30, 30)));
}

TEST_F(McapTables, TimeIsThatOfTheHeaderWhereItRises) {
  const auto two = [&](double first_s, double second_s) {
    return joints() + message(1, 2'000'000'000, joint_state(first_s, {"a"}, {1})) +
           message(1, 3'500'000'000, joint_state(second_s, {"a"}, {2}));
  };
  const struct {
    double first_s, second_s, from, to;
    const char* says;
  } cases[] = {{1, 1.25, 1, 1.25, "time is header.stamp"},
               {0, 0.5, 0, 0.5, "time is header.stamp"},
               {0, 0, 2, 3.5, "time is log_time, because header.stamp is not set"},
               {1, 1, 2, 3.5, "time is log_time, because header.stamp does not rise"},
               {1.25, 1, 2, 3.5, "time is log_time, because header.stamp does not rise"}};
  for (const auto& c : cases) {
    EXPECT_THAT(columns(two(c.first_s, c.second_s), {"time_s"}), ElementsAre(ElementsAre(c.from, c.to))) << c.says;
    EXPECT_THAT(notes_, HasSubstr(c.says));
  }
  // Messages in the order of their log time, as a player sends them; seconds since 1970 from a whole second on.
  const std::string later = message(1, epoch + 300, joint_state(0, {"a"}, {2})),
                    sooner = message(1, epoch + 100, joint_state(0, {"a"}, {1}));
  EXPECT_THAT(columns(joints() + later + sooner, {"time_s", "position_a_rad"}),
              ElementsAre(ElementsAre(1e-7, 3e-7), ElementsAre(1, 2)));
  EXPECT_THAT(notes_, HasSubstr("from 1700000000 s on"));
}

TEST_F(McapTables, SeveralPublishersOfOneTopic) {
  std::string data = joints();
  for (int i = 0; i < 4; ++i) {
    const double t = 1 + 0.1 * i;
    data += message(1, static_cast<std::uint64_t>(1e8 * i), joint_state(t, {"a"}, {t}));
    data += message(1, static_cast<std::uint64_t>(1e8 * i) + 5, joint_state(t, {"finger"}, {-t}));
  }
  const auto table = read(data, {"time_s", "position_a_rad"});
  ASSERT_TRUE(table);
  EXPECT_EQ(table->left_out, 0u);
  EXPECT_EQ(table->columns[0].size(), 4u);
  EXPECT_THAT(table->notes.front(), HasSubstr("4 messages; time is header.stamp"));
  EXPECT_EQ(read(data, {"time_s", "position_a_rad", "position_finger_rad"})->left_out, 8u);
}

TEST_F(McapTables, ASlideIsInMetresForWhoAsks) {
  const std::string data = joints() + message(1, 1, joint_state(1, {"rail"}, {1}, {2}, {3})) +
                           message(1, 2, joint_state(2, {"rail"}, {4}, {5}, {6}));
  EXPECT_THAT(columns(data, {"time_s", "position_rail_m", "velocity_rail_m_s", "torque_rail_n"}),
              ElementsAre(ElementsAre(1, 2), ElementsAre(1, 4), ElementsAre(2, 5), ElementsAre(3, 6)));
  EXPECT_THAT(columns(data, {"time_s", "position_rad"}), ElementsAre(ElementsAre(1, 2), ElementsAre(1, 4)));
}

TEST_F(McapTables, ForeignNamesAreMapped) {
  const std::string data = joints() + joints("/dynamic_joint_states", 2, dynamic_type) +
                           message(1, 1, joint_state(1, {"a"}, {1}, {}, {2})) +
                           message(2, 1, dynamic(1, "a", {"temperature", "position"}, {300, 9}));
  const auto map = write("map.yaml",
                         "temperature_elbow_degC: {from: a.temperature, unit: K}\n"
                         "position_elbow_rad: a.position_rad\ncurrent_elbow_a: {from: a.torque_nm, unit: mA}\n");
  const auto out =
      columns(data, {"time_s", "position_elbow_rad", "temperature_elbow_degC", "current_elbow_a"}, {.columns = map});
  ASSERT_EQ(out.size(), 4u);
  EXPECT_THAT(out[1], ElementsAre(1));
  EXPECT_NEAR(out[2].at(0), 26.85, 1e-12);
  EXPECT_NEAR(out[3].at(0), 2e-3, 1e-15);
  EXPECT_THAT(read(data, {"time_s", "temperature_a_degC"}).error().message, HasSubstr("'a.temperature'"));
}

TEST_F(McapTables, WhatIsWrongIsRefused) {
  const std::string one = joints() + message(1, 1, joint_state(1, {"a"}, {1}));
  const std::string two = one + joints("/command", 2) + message(2, 1, joint_state(1, {"a"}, {1}));
  EXPECT_THAT(refusal(two), AllOf(HasSubstr("joints on the topics /command, /joint_states"), HasSubstr("--topic")));
  EXPECT_EQ(refusal(two, {.topic = "/command"}), "was read");
  EXPECT_THAT(refusal(two, {.topic = "/x"}), AllOf(HasSubstr("--topic '/x'"), HasSubstr("/command, /joint_states")));
  EXPECT_THAT(read_numbers(write("a.csv", "time_s\n1\n"), {"time_s"}, {.topic = "/x"}).error().message,
              HasSubstr("--topic is for MCAP"));

  const std::string whole = joint_state(1, {"a", "b"}, {1, 2});
  const auto with = [&](const std::string& data, const std::string& encoding = "cdr") {
    return joints("/joint_states", 1, joint_state_type, encoding) + message(1, 1, data);
  };
  std::string xcdr2 = whole, many = whole;
  xcdr2[1] = 7;
  many[4 + 8 + 4 + 5 + 3] = '\xff';  // the number of names: behind stamp and frame_id
  const struct {
    const char* name;
    std::string data, says;
  } cases[] = {
      {"no joints", schema(1, "std_msgs/msg/String") + channel(1, 1, "/chatter") + message(1, 1, "x"),
       "its topics are /chatter of std_msgs/msg/String"},
      {"nothing", "", "its topics are none"},
      {"XCDR2", with(xcdr2), "message 1 of '/joint_states' is CDR of representation 0x0007"},
      {"no CDR", with("abc"), "shorter than the header of CDR"},
      {"cut off", with(whole.substr(0, whole.size() - 9)), "ends within its fields"},
      {"more names than bytes", with(many), "ends within its fields"},
      {"numbers without names", with(joint_state(1, {"a"}, {1, 2})), "1 names but 2 of position"},
      {"a joint twice", with(joint_state(1, {"a", "a"}, {1, 2})), "has 'position' of 'a' twice"},
      {"protobuf", with("x", "protobuf"), "is encoded as 'protobuf'; read are cdr, ros1 and json"},
      {"no JSON", with("{", "json"), "is no JSON object"},
      {"JSON of something else", with(R"({"name": [1]})", "json"), "name must hold texts"},
      {"JSON without a list", with(R"({"name": "a"})", "json"), "name must be a list"},
      {"JSON of other lengths", with(R"({"name": ["a"], "effort": [1, 2]})", "json"), "1 names but 2 of effort"},
      {"JSON of a far time", with(R"({"header": {"stamp": {"sec": 1e18, "nanosec": 0}}})", "json"), "sec"},
      {"a log time beyond", joints() + message(1, ~0ull, whole), "the log_time 18446744073709551615 ns"},
  };
  for (const auto& c : cases) EXPECT_THAT(refusal(c.data), AllOf(HasSubstr("a.mcap: "), HasSubstr(c.says))) << c.name;
}

/// Every number of a record is in its export, to the last bit.
TEST_F(McapTables, ARecordIsTheSameAsItsExport) {
  TelemetryOptions options{.attributes = {{"engine", "a test"}},
                           .joints = {"a", "left/b 1"},
                           .joint_attributes = {{{"gear_ratio", 100}}, {}},
                           .channels = {{"position_rad", "rad", ""},
                                        {"torque_nm", "Nm", ""},
                                        {"motor_torque_nm", "Nm", ""},
                                        {"temperature_degC", "degC", ""}},
                           .cycle_channels = {{"cycle_temperature_degC", "degC", ""}}};
  {
    auto record = Telemetry::create(folder_ / "telemetry.h5", options);
    ASSERT_TRUE(record) << record.error().message;
    for (int i = 0; i < 9000; ++i) {  // more than is in memory at once
      const double t = 0.002 * i, x = std::sin(t);
      ASSERT_TRUE(record->append(t, Doubles{x, 1e-7 * x, x / 3, 20 + t, -x, x * x, i == 5 ? NAN : 0, 30.1}));
      if (i % 3000 == 0) ASSERT_TRUE(record->append_cycle(t, Doubles{21 + t, 22 + t}));
    }
    ASSERT_TRUE(record->finish());
  }
  const auto mcap_file = folder_ / "b.mcap";
  ASSERT_TRUE(export_mcap(folder_, mcap_file, Existing::refuse, McapMessages::ros2));
  EXPECT_THAT(export_mcap(folder_, mcap_file, Existing::refuse, McapMessages::ros2).error().message,
              HasSubstr("b.mcap"));
  std::vector<std::string> wanted{"time_s"};
  for (const char* joint : {"a", "left/b 1"})
    for (const char* quantity : {"position_{}_rad", "torque_{}_nm", "motor_torque_{}_nm", "temperature_{}_degC"})
      wanted.push_back(fmt::format(fmt::runtime(quantity), joint));
  const auto here = read_numbers(folder_, wanted), there = read_numbers(mcap_file, wanted);
  ASSERT_TRUE(here && there) << there.error().message;
  EXPECT_EQ(here->columns.size(), 9u);
  EXPECT_EQ(here->columns[0].size(), 8999u);
  EXPECT_EQ(here->left_out, there->left_out);
  for (std::size_t c = 1; c < wanted.size(); ++c) EXPECT_TRUE(here->columns[c] == there->columns[c]) << wanted[c];
  // 0.002 i is a multiple of a nanosecond but for its last bit.
  for (std::size_t i = 0; i < 8999; ++i) ASSERT_NEAR(here->columns[0][i], there->columns[0][i], 1e-14);
  const auto cycles = read_numbers(mcap_file, {"time_s", "temperature_a_degC"}, {.topic = "/cycle_states"});
  ASSERT_TRUE(cycles) << cycles.error().message;
  EXPECT_THAT(cycles->columns, ElementsAre(ElementsAre(0, 6, 12), ElementsAre(21, 27, 33)));
}

TEST_F(McapTables, TheBagOfARecorder) {
  const std::string one = file(joints() + message(1, 1, joint_state(1, {"a"}, {2})));
  std::filesystem::create_directory(folder_ / "bag");
  write("bag/metadata.yaml", "rosbag2_bagfile_information:\n");
  EXPECT_THAT(read_numbers(folder_ / "bag", {"time_s"}).error().message, HasSubstr("is a folder"));
  write("bag/bag_0.mcap", one);
  const auto table = read_numbers(folder_ / "bag", {"time_s", "position_a_rad"});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_THAT(table->columns, ElementsAre(ElementsAre(1), ElementsAre(2)));
  write("bag/bag_1.mcap", one);
  EXPECT_THAT(read_numbers(folder_ / "bag", {"time_s"}).error().message,
              AllOf(HasSubstr("several recordings"), HasSubstr("bag_0.mcap"), HasSubstr("bag_1.mcap")));
  EXPECT_THAT(read_numbers(write("a.mcap.zstd", packed("zstd", one)), {"time_s"}).error().message,
              HasSubstr("unpack it first: zstd -d"));
}

TEST_F(McapTables, ACutRecordingIsReadAndSaidToBeCut) {
  const std::string begin =
      magic + header +
      chunk("zstd", joints() + message(1, 1, joint_state(1, {"a"}, {1})) + message(1, 2, joint_state(2, {"a"}, {2})));
  const auto table = read_numbers(write("cut.mcap", begin + chunk("zstd", message(1, 3, "")).substr(0, 50)),
                                  {"time_s", "position_a_rad"});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_THAT(table->columns, ElementsAre(ElementsAre(1, 2), ElementsAre(1, 2)));
  ASSERT_EQ(table->notes.size(), 2u);
  EXPECT_THAT(table->notes[1], AllOf(HasSubstr("cut.mcap: IS CUT OFF"), HasSubstr("missing")));
}

}  // namespace
}  // namespace tribotwin::twin
