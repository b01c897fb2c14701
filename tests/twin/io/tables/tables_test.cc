// Names of columns, CSV in its dialects, --columns.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/tests/twin/io/tables/table_files.hpp>
#include <tribotwin/twin/io/tables/column_map.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/tables/table.hpp>

namespace tribotwin::twin {
namespace {

using testing::AllOf, testing::ElementsAre, testing::HasSubstr, testing::Not;
namespace fs = std::filesystem;

constexpr double degree = std::numbers::pi / 180;

class Tables : public TableFiles {
 protected:
  /// The columns of a CSV file of this text.
  Result<Numbers> read(const std::string& text, const std::vector<std::string>& wanted,
                       const TableOptions& options = {}) {
    return read_numbers(write("table.csv", text), wanted, options);
  }
  std::string refusal(const std::string& text, const std::vector<std::string>& wanted,
                      const TableOptions& options = {}) {
    const auto table = read(text, wanted, options);
    return table ? "was read" : table.error().message;
  }
};

TEST(Column, NamesAreTakenApart) {
  const struct {
    const char *header, *name, *joint;
  } cases[] = {
      {"time_s", "time_s", ""},
      {"time_ms", "time_s", ""},
      {"position_rad", "position_rad", ""},
      {"position_joint1_rad", "position_joint1_rad", "joint1"},
      {"position_joint1_deg", "position_joint1_rad", "joint1"},
      {"joint1.position_rad", "position_joint1_rad", "joint1"},
      {"joint1/position_deg", "position_joint1_rad", "joint1"},
      {"left.arm.joint1.velocity_rad_s", "velocity_left.arm.joint1_rad_s", "left.arm.joint1"},
      {"velocity_shoulder_pan_joint_rad_s", "velocity_shoulder_pan_joint_rad_s", "shoulder_pan_joint"},
      {"velocity_shoulder_pan_joint_rpm", "velocity_shoulder_pan_joint_rad_s", "shoulder_pan_joint"},
      {"torque_j_2_nm", "torque_j_2_nm", "j_2"},
      {"torque_j_2_mNm", "torque_j_2_nm", "j_2"},
      // Joints that are called like units and quantities.
      {"position_rad_rad", "position_rad_rad", "rad"},
      {"position_deg_rad", "position_deg_rad", "deg"},
      {"velocity_m_rad_s", "velocity_m_rad_s", "m"},
      {"velocity_rad_m_s", "velocity_rad_m_s", "rad"},
      {"velocity_rad_s_rad_s", "velocity_rad_s_rad_s", "rad_s"},
      {"torque_torque_nm", "torque_torque_nm", "torque"},
      {"position_velocity_rad", "position_velocity_rad", "velocity"},
      {"nm.torque_nm", "torque_nm_nm", "nm"},
      {"load_cell_nm", "load_cell_nm", "cell"},
      {"friction_power_nm", "friction_power_nm", "power"},
      // The longest quantity applies.
      {"motor_torque_joint1_nm", "motor_torque_joint1_nm", "joint1"},
      {"arm_position_joint1_rad", "arm_position_joint1_rad", "joint1"},
      {"friction_forward_norm", "friction_forward_norm", ""},
      {"set_point_joint1_deg", "set_point_joint1_rad", "joint1"},
      // Former spellings.
      {"power_w_arm", "power_arm_w", "arm"},
      {"joint2.measured_nm", "torque_joint2_nm", "joint2"},
      {"joint2.cycle_friction_power_W", "power_joint2_w", "joint2"},
      {"joint2.cycle_temperature_degC", "temperature_joint2_degC", "joint2"},
      // Units in brackets.
      {"position_joint1 [deg]", "position_joint1_rad", "joint1"},
      {"velocity_joint1 (deg/s)", "velocity_joint1_rad_s", "joint1"},
      {"temperature_joint1 [\xC2\xB0"
       "C]",
       "temperature_joint1_degC", "joint1"},
      {"temperature_joint1_K", "temperature_joint1_degC", "joint1"},
      {"curve", "curve", ""},
  };
  for (const auto& c : cases) {
    const auto column = parse_column(c.header);
    ASSERT_TRUE(column) << c.header << ": " << column.error().message;
    ASSERT_TRUE(*column) << c.header;
    EXPECT_EQ((*column)->text(), c.name) << c.header;
    EXPECT_EQ((*column)->joint, c.joint) << c.header;
  }
}

TEST(Column, OtherNamesAreNone) {
  for (const char* header : {"", "Num", "Timestamp", "cycle ", "q1", "q[:,0]", "positions_rad", "mytime_s", "curves",
                             "torques_joint1_nm", "rad", "_rad", "."}) {
    const auto column = parse_column(header);
    ASSERT_TRUE(column) << header << ": " << column.error().message;
    EXPECT_FALSE(*column) << header;
  }
}

TEST(Column, UnknownAndAmbiguousUnitsAreNamed) {
  const struct {
    const char* header;
    std::vector<std::string> says;
  } cases[] = {
      {"torque_joint1_a", {"'torque_joint1_a'", "'a' is a unit of a current", "nm, Nm", "--torque-constant"}},
      {"joint1.torque_A", {"'joint1.torque_A'", "'A' is a unit of a current"}},
      {"position_joint1", {"'position_joint1'", "ends with no unit", "rad, mrad, deg"}},
      {"position_joint1_grad", {"'position_joint1_grad'", "ends with no unit", "rad, mrad, deg"}},
      {"position_joint1_nm", {"'nm' is a unit of a torque"}},
      {"time", {"'time'", "s, ms, us"}},
      {"temperature_joint1_F", {"degC, degF, K"}},
      {"torque_joint1_MNm", {"nm, Nm, mnm, mNm"}},
      {"position_a.position_rad", {"of joint 'position_a'", "of joint 'a.position'", "QUANTITY_JOINT_UNIT"}},
      {"position_\x1b[31m\n", {"'position_?[31m?'"}},
  };
  for (const auto& c : cases) {
    const auto column = parse_column(c.header);
    ASSERT_FALSE(column) << c.header;
    for (const auto& says : c.says) EXPECT_THAT(column.error().message, HasSubstr(says)) << c.header;
  }
}

TEST(Column, EveryNameOfTheTableIsReadBack) {
  for (const auto& quantity : column_quantities())
    for (const std::string joint : {"", "joint1", "shoulder_pan_joint", "j_2", "rad", "arm.elbow", "torque", "m_s"})
      for (const auto& unit : units()) {
        if (std::ranges::find(quantity.dimensions, unit.dimension) == quantity.dimensions.end()) continue;
        const std::string middle = joint.empty() ? "" : "_" + joint,
                          header = std::string(quantity.name) + middle + "_" + std::string(unit.name);
        const auto column = parse_column(header);
        ASSERT_TRUE(column && *column) << header;
        EXPECT_EQ((*column)->joint, joint) << header;
        EXPECT_EQ((*column)->quantity, &quantity) << header;
        EXPECT_EQ((*column)->unit, &unit) << header;
        if (joint.empty()) continue;
        for (const char separator : {'.', '/'}) {
          const auto other =
              parse_column(joint + separator + std::string(quantity.name) + "_" + std::string(unit.name));
          ASSERT_TRUE(other && *other) << header;
          EXPECT_EQ((*other)->text(), (*column)->text());
        }
      }
}

TEST(Column, UnitsConvert) {
  const struct {
    const char* unit;
    double number, base;
  } cases[] = {{"deg", 180, std::numbers::pi},
               {"rpm", 60, 2 * std::numbers::pi},
               {"mNm", 1500, 1.5},
               {"kNm", 2, 2000},
               {"Ncm", 50, 0.5},
               {"mA", 250, 0.25},
               {"us", 2e6, 2},
               {"ns", 3e9, 3},
               {"min", 2, 120},
               {"degF", 212, 100},
               {"degF", -40, -40},
               {"K", 273.15, 0},
               {"deg_s", 90, 0.5 * std::numbers::pi},
               {"percent", 30, 0.3},
               {"mm", 12, 0.012}};
  for (const auto& c : cases) {
    const Unit* unit = find_unit(c.unit);
    ASSERT_TRUE(unit) << c.unit;
    EXPECT_NEAR(unit->factor * c.number + unit->offset, c.base, 1e-12 * (1 + std::abs(c.base))) << c.unit;
  }
}

TEST_F(Tables, DialectsAreFound) {
  const std::vector<std::string> wanted{"time_s", "position_j_rad"};
  const std::string bom = "\xEF\xBB\xBF";
  for (const std::string& text :
       {std::string("time_s,position_j_rad\n0,1.5\n0.25,-2500\n"),
        bom + "time_s,position_j_rad\r\n0,1.5\r\n0.25,-2500\r\n",
        std::string("time_s;position_j_rad\n0;1.5\n0.25;-2500\n"),
        std::string("time_s;position_j_rad\n0;1,5\n0,25;-2500\n"),
        bom + "time_s;position_j_rad;;;\r\n0;+1,5;;;\r\n\r\n0,25;-2,5E3;;;\r\n",
        std::string("time_s\tposition_j_rad\n0\t1,5\n0,25\t-2500\n"),
        std::string("time_s , position_j_rad\n 0, 1.5\n0.25 ,-2500"),
        std::string("\"time_s\",\"position_j_rad\"\n\"0\",\"1,5\"\n\"0,25\",\"-2500\"\n"),
        std::string("sep=;\r\ntime_s;position_j_rad\r\n0;1,5\r\n0,25;-2500\r\n"),
        std::string("# time_s,position_j_rad\n0,1.5\n0.25,-2500\n"),
        std::string("time_s,position_j_rad,x,x\n0,1.5,7,8\n0.25,-2500,7,8\n"),
        std::string("time_s,position_j_rad\r0,1.5\r0.25,-2500\r"),
        std::string("time_s;position_j_rad;\xD6l\n0;1,5;\xFC\n0,25;-2500;\xB0\n"),
        std::string("time_ms;\"position, of the arm\";position_j_rad\n0;x;1,5\n250;y;-2500\n")}) {
    const auto table = read(text, wanted);
    ASSERT_TRUE(table) << text << table.error().message;
    EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 0.25), ElementsAre(1.5, -2500))) << text;
    EXPECT_EQ(table->left_out, 0u);
  }
}

TEST_F(Tables, WhatIsAmbiguousIsRefusedWithItsLine) {
  const std::vector<std::string> wanted{"time_s", "torque_j_nm"};
  const struct {
    const char *name, *text;
    std::vector<std::string> says;
  } cases[] = {
      {"both decimal signs",
       "time_s;torque_j_nm\n0;1,25\n1;2.5\n",
       {"table.csv:3: ", "'torque_j_nm'", "'2.5'", "line 2"}},
      {"both, the other way", "time_s;torque_j_nm\n0.5;1\n1;2,25\n", {"table.csv:3: ", "'2,25'", "line 2"}},
      {"thousands", "time_s;torque_j_nm\n0;1.234,5\n", {"table.csv:2: ", "'1.234,5'", "thousands"}},
      {"two commas", "time_s;torque_j_nm\n0;1,234,567\n", {"table.csv:2: ", "'1,234,567'"}},
      {"nothing decides", "time_s;torque_j_nm\n0;5\n1;1,234\n2;-12,500\n", {"table.csv:3: ", "'1,234'", "may be 1234"}},
      {"separators", "time_s;torque_j_nm,x\n0;1,2\n", {"table.csv:1: ", "separator"}},
      {"decimal commas between commas", "time_s,torque_j_nm\n0,5,1,5\n", {"table.csv:2: ", "4 cells but 2", "';'"}},
      {"no number", "time_s;torque_j_nm\n0;1\n1;1x\n", {"table.csv:3: ", "'torque_j_nm'", "'1x'", "not a number"}},
      {"control bytes", "time_s,torque_j_nm\n0,\x1b[2J\n", {"table.csv:2: ", "'?[2J'"}},
      {"control bytes of the header", "time_s,torque_j_\x1b[2J\n0,1\n", {"table.csv:1: ", "torque_j_?[2J"}},
      {"quotes", "time_s,torque_j_nm\n0,\"1\n", {"table.csv:2: ", "not closed"}},
      {"UTF-16", "\xFF\xFEt\n", {"table.csv:1: ", "UTF-16"}},
      {"code page 850", "time_s;torque_j_nm\n0;1\n1;2\x81\n", {"table.csv:3: ", "byte 0x81 at 4", "UTF-8"}},
      {"twice", "time_s,torque_j_nm,j.torque_mnm\n0,1,2\n", {"table.csv:1: ", "'torque_j_nm'", "'j.torque_mnm'"}},
      {"beyond any", "time_s,torque_j_knm\n0,1e9\n", {"table.csv:2: ", "'torque_j_knm'", "1e+12 Nm", "within"}},
      {"a line before the header",
       "of robot 5\ntime_s,torque_j_nm\n0,1\n",
       {"table.csv:2: ", "2 cells but 1", "lines before"}},
      {"no number behind Excel's line", "sep=;\ntime_s;torque_j_nm\n0;1x\n", {"table.csv:3: ", "'1x'"}},
      {"amperes", "time_s,torque_j_a\n0,1\n", {"table.csv:1: ", "'torque_j_a'", "current", "--torque-constant"}},
      {"no unit", "time,torque_j_nm\n0,1\n", {"table.csv:1: ", "'time'", "s, ms"}},
  };
  for (const auto& c : cases)
    for (const auto& says : c.says) EXPECT_THAT(refusal(c.text, wanted), HasSubstr(says)) << c.name;
}

/// Windows writes names in its own encoding; the file of --columns may be in either.
TEST_F(Tables, NamesInLatin1AreThoseOfUtf8) {
  const std::string table =
      "Zeit;Moment \xD6l;temperature_j [\xB0"
      "C]\n0;1,5;20\n1;2,5;21\n";
  for (const std::string name : {"\xD6l", "\xC3\x96l"}) {
    const auto map = write("columns.yaml", "# \xB0\ntime_s: Zeit\ntorque_j_nm: 'Moment " + name + "'\n");
    const auto read_one = read(table, {"time_s", "torque_j_nm", "temperature_j_degC"}, {.columns = map});
    ASSERT_TRUE(read_one) << read_one.error().message;
    EXPECT_THAT(read_one->columns, ElementsAre(ElementsAre(0, 1), ElementsAre(1.5, 2.5), ElementsAre(20, 21)));
  }
  const auto names = read("time_s;position_\xD6l_rad\n0;1\n", {"time_s"})->names;
  EXPECT_THAT(names, ElementsAre("time_s", "position_\xC3\x96l_rad"));
  // Code page 850: its sign of degrees is a letter.
  EXPECT_THAT(refusal("temperature_j [\xF8"
                      "C]\n20\n",
                      {"temperature_j_degC"}),
              AllOf(HasSubstr("table.csv:1: "), HasSubstr("degC, degF, K")));
  EXPECT_THAT(read_column_map(write("columns.yaml", "time_s: t\n# \x81\n")).error().message,
              AllOf(HasSubstr("columns.yaml:2: "), HasSubstr("0x81")));
  EXPECT_THAT(read_column_map(write("columns.yaml", "\xFF\xFEt\n")).error().message, HasSubstr("UTF-16"));
}

/// What a table is for follows from its header, which a pipe gives once.
TEST_F(Tables, ColumnsAreChosenByTheHeader) {
  auto table = OpenTable::open(write("table.csv", "time_s,arm.position_rad,speed_rad_s\n0,1,2\n"));
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_THAT(table->header()->names, ElementsAre("time_s", "position_arm_rad", "speed_rad_s"));
  EXPECT_TRUE(table->header({"time_s", "position_rad"})->has("position_rad"));
  EXPECT_FALSE(table->header({"friction_nm"})->has("position_rad"));
  EXPECT_TRUE(table->header()->lines.empty());
  const auto numbers = table->read({"time_s", "position_rad"});
  ASSERT_TRUE(numbers) << numbers.error().message;
  EXPECT_THAT(numbers->columns, ElementsAre(ElementsAre(0), ElementsAre(1)));
}

TEST_F(Tables, TheSameContentIsFoundUnderAnyName) {
  const auto a = write("a.csv", "time_s\n0\n"), b = write("b.csv", "time_s\n1\n"), c = write("c.csv", "time_s\n0\n");
  EXPECT_FALSE(given_twice({a, b, folder_ / "none.csv", "/dev/null", "/dev/null"}));
  for (const auto& [one, other] : {std::pair{a, c}, {a, a}, {a, folder_ / "." / "a.csv"}}) {
    const auto why = given_twice({b, one, other});
    ASSERT_TRUE(why) << one << other;
    EXPECT_THAT(*why, AllOf(HasSubstr(one.string()), HasSubstr(other.string()), HasSubstr("same content")));
  }
  for (const char* run : {"one", "other"}) {
    fs::create_directory(folder_ / run);
    write(std::string(run) + "/telemetry.h5", "x");
  }
  EXPECT_TRUE(given_twice({folder_ / "one", folder_ / "other"}));
}

TEST_F(Tables, NoTextIsRefused) {
  const std::string zero("time_s,torque_j_nm\n0,1\0\n", 25);
  EXPECT_THAT(refusal(zero, {"time_s"}), AllOf(HasSubstr("table.csv:2: "), HasSubstr("NUL")));
  EXPECT_THAT(refusal("", {"time_s"}), HasSubstr("is empty"));
  EXPECT_THAT(refusal("\n", {"time_s"}), HasSubstr("is empty"));
  EXPECT_THAT(read_numbers(folder_, {"time_s"}).error().message, HasSubstr("is a folder"));
  EXPECT_THAT(read_numbers(folder_ / "none.csv", {"time_s"}).error().message, HasSubstr("none.csv"));
}

TEST_F(Tables, OneWithDecimalsDecidesForAll) {
  const auto table = read("time_s;torque_j_nm\n0;1,234\n1;0,125\n", {"torque_j_nm"});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_THAT(table->columns[0], ElementsAre(1.234, 0.125));
}

TEST_F(Tables, WithoutAHeaderColumnsHaveNumbers) {
  const auto map = write("columns.yaml", "time_s: column 1\ntorque_j_nm: {from: column 3, scale: 2}\n");
  for (const char* text : {"0,7,1.5\n1,7,2.5\n2,7,3.5\n", "0;7;1,5\r\n1;7;2,5\r\n\r\n2;7;3,5\r\n"}) {
    const auto table = read(text, {"time_s", "torque_j_nm"}, {.columns = map});
    ASSERT_TRUE(table) << table.error().message;
    EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 1, 2), ElementsAre(3, 5, 7))) << text;
    EXPECT_EQ(table->lines.front(), 1u);
  }
  EXPECT_EQ(read("0,1\n", {"time_s"})->header, "column 1, column 2");
  EXPECT_THAT(read("0,1,2\n", {"torque_j_nm"}, {.columns = map})->columns, ElementsAre(ElementsAre(4)));
}

TEST_F(Tables, RowsWithoutNumbersAreLeftOut) {
  const auto table = read("time_s;torque_j_nm\n0;1\n1;\n2;NaN\n3;4\n", {"time_s", "torque_j_nm", "position_j_rad"});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 3), ElementsAre(1, 4), testing::IsEmpty()));
  EXPECT_EQ(table->left_out, 2u);
  EXPECT_EQ(table->first_left_out, 3u);
  EXPECT_THAT(table->lines, ElementsAre(2, 5));
}

TEST_F(Tables, OneJointIsChosen) {
  const std::vector<std::string> wanted{"time_s", "position_rad"};
  const std::string two = "time_s,a.position_deg,b.position_rad\n0,180,2\n";
  EXPECT_THAT(refusal(two, wanted), AllOf(HasSubstr("a, b"), HasSubstr("--joint")));
  EXPECT_THAT(refusal(two, wanted, {.joint = "c"}), AllOf(HasSubstr("'c'"), HasSubstr("a, b")));
  EXPECT_DOUBLE_EQ(read(two, wanted, {.joint = "a"})->columns[1][0], std::numbers::pi);
  EXPECT_DOUBLE_EQ(read(two, wanted, {.joint = "b"})->columns[1][0], 2);
  EXPECT_DOUBLE_EQ(read("time_s,a.position_rad\n0,3\n", wanted)->columns[1][0], 3);
  // And the other way: one joint is wanted, the table names none.
  EXPECT_DOUBLE_EQ(read("time_s,position_rad\n0,3\n", {"time_s", "position_a_rad"})->columns[1][0], 3);
}

TEST_F(Tables, CurrentsBecomeTorques) {
  const std::vector<std::string> wanted{"time_s", "torque_a_nm", "torque_b_nm"};
  const std::string text = "time_s;current_a_a;current_b_mA\n0;2;500\n";
  TableOptions options{.torque_constant = PerJoint::of("", {"0.1", "b=0.2"}).value(),
                       .gear_ratio = PerJoint::of("", {"100", "b=50"}).value()};
  const auto table = read(text, wanted, options);
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_DOUBLE_EQ(table->columns[1][0], 20);
  EXPECT_DOUBLE_EQ(table->columns[2][0], 5);
  // Without the constant a current is no torque.
  EXPECT_TRUE(read(text, wanted)->columns[1].empty());
  EXPECT_THAT(read(text, wanted)->hint("torque_a_nm"),
              AllOf(HasSubstr("current_a_a"), HasSubstr("--torque-constant a=")));
  EXPECT_EQ(read(text, wanted)->hint("torque_c_nm") + read(text, wanted)->hint("time_s"), "");
  options.gear_ratio = {};
  EXPECT_THAT(refusal(text, wanted, options), AllOf(HasSubstr("'current_a_a'"), HasSubstr("--gear-ratio")));
  options.gear_ratio.set_all(1);
  EXPECT_THAT(refusal("time_s,torque_a_nm,current_a_a\n0,1,2\n", wanted, options),
              AllOf(HasSubstr("torque_a_nm"), HasSubstr("'current_a_a'")));
  EXPECT_THAT(refusal("time_s,torque_a_nm\n0,1\n", wanted, options), HasSubstr("no column current_JOINT_a"));
  for (const char* wrong : {"", "x", "0", "-1", "nan", "inf", "=1", "a=", "a=x"})
    EXPECT_FALSE(PerJoint::of("--torque-constant", {wrong})) << wrong;
  EXPECT_FALSE(PerJoint::of("--torque-constant", {"a=1", "a=2"}));
}

TEST_F(Tables, ForeignNamesAreMapped) {
  const auto map = write("columns.yaml",
                         "time_s: {from: Timestamp, unit: iso8601}\n"
                         "position_a_rad: {from: 'Achse 1', unit: deg, sign: -1, offset: 90}\n"
                         "torque_a_nm: {from: I1, scale: 0.5}\n"
                         "temperature_a_degC: T1\n");
  const std::string text =
      "Timestamp;Achse 1;I1;T1;torque_a_nm\n2022-10-26T08:17:21.5Z;90;2,5;27,125;0\n"
      "2022-10-26T09:17:23.75+01:00;0;-2;28;0\n";
  const auto table = read(text, {"time_s", "position_a_rad", "torque_a_nm", "temperature_a_degC"}, {.columns = map});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_DOUBLE_EQ(table->columns[0][0], 1666772241.5);
  EXPECT_DOUBLE_EQ(table->columns[0][1] - table->columns[0][0], 2.25);
  EXPECT_NEAR(table->columns[1][0], 0, 1e-15);
  EXPECT_NEAR(table->columns[1][1], 90 * degree, 1e-15);
  EXPECT_THAT(table->columns[2], ElementsAre(1.25, -1));
  EXPECT_THAT(table->columns[3], ElementsAre(27.125, 28));
  EXPECT_THAT(refusal("q;w\n1;2\n", {"time_s"}, {.columns = map}),
              AllOf(HasSubstr("columns.yaml: time_s"), HasSubstr("'Timestamp'"), HasSubstr("q, w")));
  EXPECT_THAT(refusal("Timestamp;Achse 1;I1;T1\nyesterday;0;0;0\n", {"time_s"}, {.columns = map}),
              AllOf(HasSubstr("table.csv:2: "), HasSubstr("'yesterday'"), HasSubstr("2022-10-26T08")));
}

TEST_F(Tables, PatternsMapJointByJoint) {
  const auto map = write("columns.yaml", "position_joint*_rad: {from: 'q(*)', unit: deg}\ntime_s: t\n");
  const auto table =
      read("t;q(1);q(2);q(x)y\n0;180;90;5\n", {"position_joint1_rad", "position_joint2_rad"}, {.columns = map});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_NEAR(table->columns[0][0], std::numbers::pi, 1e-15);
  EXPECT_NEAR(table->columns[1][0], std::numbers::pi / 2, 1e-15);
  EXPECT_THAT(refusal("t;p(1)\n0;1\n", {"time_s"}, {.columns = map}),
              AllOf(HasSubstr("position_joint*_rad"), HasSubstr("no column like 'q(*)'"), HasSubstr("t, p(1)")));
}

TEST_F(Tables, TimeMayFollowFromTheRate) {
  const auto map = write("columns.yaml", "time_s: {rate_hz: 4}\nposition_a_rad: q\n");
  const auto table = read("q,x\n1,0\n2,0\n,0\n4,0\n", {"time_s", "position_a_rad"}, {.columns = map});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 0.25, 0.75), ElementsAre(1, 2, 4)));
}

TEST_F(Tables, MapsThatAreWrongAreRefused) {
  const struct {
    const char *text, *says;
  } cases[] = {{"foo: bar\n", "columns.yaml:1: foo"},
               {"position_j: q\n", "ends with no unit"},
               {"time_s: {from: t, rate_hz: 5}\n", "rate_hz"},
               {"position_j_rad: {rate_hz: 5}\n", "rate_hz"},
               {"time_s: {rate_hz: 0}\n", "rate_hz"},
               {"position_a_rad: {from: q, unit: nm}\n", "accepted are rad, mrad, deg, rev"},
               {"position_a_rad: {from: q, unit: iso8601}\n", "accepted are rad"},
               {"position_a_rad: {unit: deg}\n", "from"},
               {"position_a_rad: {from: q, sign: 2}\n", "sign"},
               {"position_a_rad: {from: q, sign: 0.5}\n", "must be 1 or -1"},
               {"position_a_rad: {from: q, scale: 0}\n", "must not be 0"},
               {"position_a_rad: {from: q, scale: .nan}\n", "scale"},
               {"position_a_rad: {from: q, factor: 2}\n", "factor"},
               {"position_a_rad: [q]\n", "position_a_rad"},
               {"position_a_rad: q\na.position_deg: p\n", "is mapped from 'q' already"},
               {"position_*_rad: q\n", "one * in the joint's name and one in the foreign name, 'q'"},
               {"position_**_rad: q*\n", "one * in the joint's name"},
               {"{}\n", "maps no column"},
               {"- a\n", "columns.yaml"}};
  for (const auto& c : cases) {
    const auto map = read_column_map(write("columns.yaml", c.text));
    ASSERT_FALSE(map) << c.text;
    EXPECT_THAT(map.error().message, AllOf(HasSubstr("columns.yaml"), HasSubstr(c.says))) << c.text;
  }
  EXPECT_THAT(read_column_map(folder_ / "none.yaml").error().message, HasSubstr("none.yaml"));
}

TEST_F(Tables, OfTextsHasALimit) {
  const auto file = write("a.csv", "name,note\n");
  const std::string row = "a," + std::string(limits::csv_line_bytes - 8, 'x') + '\n';
  std::ofstream more(file, std::ios::app);
  for (std::uintmax_t bytes = 0; bytes <= limits::csv_text_bytes; bytes += row.size()) more << row;
  more.close();
  const auto table = read_table(file);
  ASSERT_FALSE(table);
  EXPECT_THAT(table.error().message, HasSubstr("a.csv:18: is beyond 268435456 bytes"));
}

TEST(Failure, OfReadingIsNoEndOfTheTable) {
  const auto table = read_numbers("/proc/self/mem", {"time_s"});  // address 0: reading fails
  ASSERT_FALSE(table);
  EXPECT_THAT(table.error().message, HasSubstr("cannot be read to its end (Input/output error)"));
  EXPECT_EQ(table.error().kind, ErrorKind::work);
}

}  // namespace
}  // namespace tribotwin::twin
