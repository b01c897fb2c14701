#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <set>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/tests/allocations.hpp>
#include <tribotwin/twin/simulation/recorder.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path source = TRIBOTWIN_SOURCE_DIR;

struct Folder {
  fs::path path = [] {
    std::string name = (fs::temp_directory_path() / "tribotwin_XXXXXX").string();
    return fs::path(mkdtemp(name.data()));
  }();
  ~Folder() { fs::remove_all(path); }
};

/// Two links of 2 kg and 0.5 m that swing in the vertical plane, with a drive each. A row of `checks` below replaces
/// parts of it.
const std::string model = R"(<mujoco>
  <option timestep="0.001"/>
  <compiler angle="radian"/>
  <size nconmax="20" njmax="100"/>
  <extension>
    <plugin plugin="tribotwin.drive">
      <instance name="a">
        <config key="law" value="stribeck"/> <config key="Fc" value="0.02"/> <config key="Fs" value="0.01"/>
        <config key="vs" value="0.1"/> <config key="alpha" value="1"/> <config key="Fv" value="0.002"/>
        <config key="torque_max_nm" value="50"/> <config key="gear_ratio" value="1"/>
      </instance>
    </plugin>
  </extension>
  <default>
    <joint axis="0 1 0" frictionloss="1" armature="1" solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -1.2"/>
    <body name="upper">
      <joint name="shoulder" limited="true" range="-1 1"/>
      <geom name="upper" type="capsule" fromto="0 0 -.1 0 0 -.5" size=".03" mass="2"/>
      <body name="lower" pos="0 0 -.5">
        <joint name="elbow"/>
        <geom name="lower" type="capsule" fromto="0 0 -.1 0 0 -.5" size=".03" mass="2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <plugin name="shoulder" joint="shoulder" plugin="tribotwin.drive" instance="a" actdim="3" dyntype="user"
        ctrllimited="true" ctrlrange="-60 60"/>
    <plugin name="elbow" joint="elbow" plugin="tribotwin.drive" instance="a" actdim="3" dyntype="user"
        ctrllimited="true" ctrlrange="-60 60"/>
  </actuator>
</mujoco>)";
const std::string scenario = R"(model: model.xml
duration_s: 4
motion: {type: back_and_forth, joint: shoulder, travel_rad: 0.8, speed_rad_s: 0.8, dwell_s: 0.2}
)";

/// Room for fewer contacts than boxes on the floor have. MuJoCo 3 counts bytes, and no contacts any more.
constexpr auto too_small = mjVERSION_HEADER >= 300 ? "memory=\"40K\"" : "nconmax=\"1\" njmax=\"100\"";

std::string boxes_on_the_floor(int count) {
  std::string text;
  for (int i = 0; i < count; ++i)
    text += fmt::format(R"(<body pos="2 {} -1.1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>)", 0.3 * i);
  return text;
}

using Changes = std::vector<std::pair<std::string, std::string>>;

std::string changed(std::string text, const Changes& changes) {
  for (const auto& [from, to] : changes) {
    const std::size_t at = text.find(from);
    if (at == std::string::npos) ADD_FAILURE() << "no '" << from << "' in\n" << text;
    text.replace(at, from.size(), to);
  }
  return text;
}

Result<Scenario> loaded(const Folder& folder, const std::string& mjcf, const std::string& yaml) {
  std::ofstream(folder.path / "model.xml") << mjcf;
  std::ofstream(folder.path / "scenario.yaml") << yaml;
  return load_scenario(folder.path / "scenario.yaml");
}

Summary run_of(const std::string& mjcf, const std::string& yaml) {
  const Folder folder;
  const auto scenario = loaded(folder, mjcf, yaml);
  if (!scenario) throw std::runtime_error(scenario.error().message);
  const auto summary = run(*scenario, {});
  if (!summary) throw std::runtime_error(summary.error().message);
  return *summary;
}

/// The names of the checks that warn, or that say more than `ok`.
std::set<std::string> checks_of(const Summary& s, std::set<Verdict> verdicts = {Verdict::warning}) {
  std::set<std::string> names;
  for (const Finding& f : s.health)
    if (verdicts.contains(f.verdict)) names.insert(f.check);
  return names;
}

std::string line_of(const Summary& s, std::string_view check) {
  for (const HealthLine& line : health_lines(s.health))
    if (line.check == check) return line.text;
  return "nothing";
}

struct Case {
  std::string name, check;
  Changes fires_model, fires_scenario;  ///< with which the check fires, and what its line says
  std::string says;
  Changes not_model, not_scenario;  ///< with which it just does not
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

const std::vector<Case> cases{
    {"Saturation",
     "saturation",
     // Gravity of the stretched arm at 0.4 rad takes some 16 Nm; friction 1.5 Nm each.
     {{"-60 60", "-26 26"}},
     {{"speed_rad_s: 0.8", "speed_rad_s: 0.8, acceleration_rad_s2: 40"}},
     "shoulder: control saturated",
     {{"-60 60", "-26 26"}},
     {}},
    {"Tracking",
     "tracking",
     {},
     {{"motion", "control: {type: servo, position_gain_1_s: 0.2, speed_bandwidth_rad_s: 3}\nmotion"}},
     "tracking error",
     {},
     {{"motion", "control: {type: servo, position_gain_1_s: 5, speed_bandwidth_rad_s: 30}\nmotion"}}},
    {"Damping",
     "damping",
     {{"name=\"elbow\"", "name=\"elbow\" damping=\"0.001\""}},
     {},
     "elbow: damping=\"0.001\" is left beside its drive",
     {{"name=\"elbow\"", "name=\"elbow\" damping=\"0\""}},
     {}},
    {"FrictionOfATendon",
     "damping",
     {{"<actuator>",
       "<tendon><fixed frictionloss=\"0.1\"><joint joint=\"elbow\" coef=\"1\"/></fixed></tendon><actuator>"}},
     {},
     "elbow: a tendon on the joint",
     {{"<actuator>", "<tendon><fixed><joint joint=\"elbow\" coef=\"1\"/></fixed></tendon><actuator>"}},
     {}},
    {"Ctrlrange",
     "ctrlrange",
     {{"-60 60", "-24.9 24.9"}},
     {},
     "shoulder: ctrlrange=\"-24.9 24.9\" limits the drive to 24.9 Nm, but its torque_max_nm is 50 Nm",
     {{"-60 60", "-25 25"}},
     {}},
    {"CtrlrangeAgainstForcerange",
     "ctrlrange",
     {{"-60 60\"", "-60 60\" forcelimited=\"true\" forcerange=\"-121 121\""}},
     {},
     "its forcerange is 121 Nm",
     {{"-60 60\"", "-60 60\" forcelimited=\"true\" forcerange=\"-119 119\""}},
     {}},
    {"CtrlrangeOfOneSide",
     "ctrlrange",
     {{"-60 60", "0 255"}},
     {},
     "ctrlrange=\"0 255\" limits the drive to 0 Nm",
     {{"-60 60", "-255 255"}},
     {}},
    {"Limits",
     "limits",
     {{"range=\"-1 1\"", "range=\"-0.4 0.4\""}},
     {},
     "shoulder: at an end of its range (-0.4 .. 0.4 rad)",
     {{"range=\"-1 1\"", "range=\"-0.42 0.42\""}},
     {}},
    {"Floor", "contacts", {{"0 0 -1.2", "0 0 -1.02"}}, {}, "'floor' and 'lower'", {{"0 0 -1.2", "0 0 -1.035"}}, {}},
    {"Itself",
     "contacts",
     {{"<option timestep=\"0.001\"/>", "<option timestep=\"0.001\"><flag filterparent=\"disable\"/></option>"},
      {"name=\"lower\" type=\"capsule\" fromto=\"0 0 -.1", "name=\"lower\" type=\"capsule\" fromto=\"0 0 -.05"}},
     {},
     "touches itself or its surroundings 100 % of the time ('upper' and 'lower' 100 %)",
     {{"<option timestep=\"0.001\"/>", "<option timestep=\"0.001\"><flag filterparent=\"disable\"/></option>"}},
     {}},
    // A ball that the arm pushes is an object, not a collision; one that hangs in the way is.
    {"Objects",
     "contacts",
     {{"</worldbody>", "<body pos=\".3 0 -.9\"><geom name=\"ball\" size=\".1\"/></body></worldbody>"}},
     {},
     "'ball' and 'lower'",
     {{"</worldbody>",
       "<body pos=\".3 0 -.9\"><joint type=\"slide\" axis=\"1 0 0\" armature=\"0\" frictionloss=\"0\"/>"
       "<geom name=\"ball\" size=\".1\" mass=\"1e-6\"/></body></worldbody>"}},
     {}},
    {"LawRange",
     "law_range",
     {{"key=\"Fc\"", "key=\"speed_max_rad_s\" value=\"0.79\"/> <config key=\"Fc\""}},
     {},
     "shoulder: ",
     {{"key=\"Fc\"", "key=\"speed_max_rad_s\" value=\"2\"/> <config key=\"Fc\""}},
     {}},
    // The energy of a spring of the joint is in no account.
    {"Balance",
     "balance",
     {{"name=\"shoulder\"", "name=\"shoulder\" springref=\"1\" stiffness=\"1\""}},
     {},
     "the mechanical energy balance is off by",
     {{"name=\"shoulder\"", "name=\"shoulder\" springref=\"1\" stiffness=\"0.001\""}},
     {}},
    {"StartingPoints",
     "starting_points",
     {{"</mujoco>", "<custom><text name=\"tribotwin.starting_point.elbow\" data=\"harmonic_30\"/></custom></mujoco>"}},
     {},
     "elbow: friction and heat are guesses, starting points of a gear class",
     {{"</mujoco>", "<custom><text name=\"tribotwin.starting_point.hand\" data=\"harmonic_30\"/></custom></mujoco>"}},
     {}},
    {"Control",
     "control",
     {},
     {{"motion", "control: {type: torque}\nexpects: [limits, balance, contacts]\nmotion"}},
     "control: {type: torque} gives constant torques 100 % of the time, and nothing follows the motion",
     {},
     {{"motion", "control: {type: servo}\nmotion"}}},
    {"Speed",
     "speed",
     {{"</mujoco>", "<custom><numeric name=\"joint_speed_max_rad_s\" data=\"0.7 1\"/></custom></mujoco>"}},
     {},
     "shoulder: the motion asks for more speed than the drive has",
     {{"</mujoco>", "<custom><numeric name=\"joint_speed_max_rad_s\" data=\"0.75 1\"/></custom></mujoco>"}},
     {}},
    // There, a dwell, back, a dwell: 2.56 s.
    {"Idle",
     "idle",
     {},
     {{"dwell_s: 0.2", "dwell_s: 0.2, repeat: false"}},
     "the motion is over after 2.56 of 4 s, and the robot stands still 36 % of the time",
     {},
     {{"dwell_s: 0.2", "dwell_s: 0.2, repeat: false"}, {"duration_s: 4", "duration_s: 2.69"}}},
    {"Engine",
     "engine",
     {{"nconmax=\"20\" njmax=\"100\"", too_small}, {"</worldbody>", boxes_on_the_floor(6) + "</worldbody>"}},
     {},
     "the engine warned",
     {{"nconmax=\"20\"", "nconmax=\"4\""}},
     {}},
};

class Health : public testing::TestWithParam<Case> {
 public:
  static void SetUpTestSuite() { mujoco::install_message_handlers(); }  // full buffers are no text on stderr
};
INSTANTIATE_TEST_SUITE_P(Checks, Health, testing::ValuesIn(cases), [](const auto& info) { return info.param.name; });

TEST_P(Health, FiresAndJustDoesNot) {
  const Case& c = GetParam();
  const std::set<Verdict> said{Verdict::note, Verdict::warning};
  const Summary bad = run_of(changed(model, c.fires_model), changed(scenario, c.fires_scenario));
  EXPECT_THAT(checks_of(bad, said), testing::Contains(c.check));
  EXPECT_THAT(line_of(bad, c.check), HasSubstr(c.says));
  EXPECT_THAT(all_warnings(bad), testing::Contains(line_of(bad, c.check)));
  const Summary good = run_of(changed(model, c.not_model), changed(scenario, c.not_scenario));
  EXPECT_THAT(checks_of(good, said), testing::IsEmpty()) << testing::PrintToString(all_warnings(good));
}

/// The essence of the menagerie's UR5e with drives in place of its position actuators: the default class hands down
/// ctrlrange, forcerange and damping.
const Changes ur5e{{"<default>", "<default><position ctrlrange=\"-6.2831 6.2831\" forcerange=\"-150 150\"/>"},
                   {"frictionloss=\"1\" armature", "frictionloss=\"1\" damping=\"200\" armature"},
                   {"<compiler ", "<compiler autolimits=\"true\" "},
                   {"ctrllimited=\"true\" ctrlrange=\"-60 60\"", "ctrllimited=\"true\" forcelimited=\"true\""},
                   {"ctrllimited=\"true\" ctrlrange=\"-60 60\"", "ctrllimited=\"true\" forcelimited=\"true\""}};

TEST(HealthOfARun, DrivesWithTheDefaultsOfPositionActuatorsAreNamed) {
  const Summary s = run_of(changed(model, ur5e), scenario);
  EXPECT_THAT(checks_of(s), testing::IsSupersetOf({"ctrlrange", "damping", "saturation", "tracking", "balance"}));
  EXPECT_FALSE(as_asked(s.health));
  EXPECT_THAT(
      line_of(s, "ctrlrange"),
      testing::AllOf(HasSubstr("shoulder, elbow: "),
                     HasSubstr("ctrlrange=\"-6.2831 6.2831\" limits the drive to 6.28 Nm, but its forcerange is "
                               "150 Nm (the range looks like angles, as of a position actuator)"),
                     HasSubstr("ctrlrange=\"-150 150\"")));
  EXPECT_THAT(line_of(s, "ctrlrange"), testing::Not(HasSubstr("elbow: give")));
  EXPECT_THAT(line_of(s, "damping"), HasSubstr("damping=\"200\" is left beside its drive"));
  EXPECT_THAT(line_of(s, "saturation"), HasSubstr("(limit 6.283 Nm)"));
}

TEST(HealthOfARun, TheModelIsExaminedBeforeTheRun) {
  const Folder folder;
  const Scenario s = loaded(folder, changed(model, ur5e), scenario).value();
  std::set<std::string> checks;
  for (const HealthLine& line : health_lines(examine({s}))) checks.insert(line.check);
  EXPECT_EQ(checks, (std::set<std::string>{"ctrlrange", "damping"}));
}

/// A swing of the elbow, 6 s at 50 Hz, whose times and angles are in other units than the header says.
std::string swing(double time_unit, double angle_unit, bool with_speed = false) {
  std::string csv = with_speed ? "time_s,position_elbow_rad,velocity_elbow_rad_s\n" : "time_s,position_elbow_rad\n";
  for (int i = 0; i <= 300; ++i) {
    const double t = 0.02 * i;
    csv += fmt::format("{},{}", t * time_unit, 0.8 * std::sin(t) * angle_unit);
    csv += with_speed ? fmt::format(",{}\n", 0.8 * std::cos(t) * angle_unit) : "\n";
  }
  return csv;
}

/// What model and scenario say before the run: the line of the first check, or "nothing".
struct Asked {
  std::string name, csv, rest, says;
};
void PrintTo(const Asked& a, std::ostream* out) { *out << a.name; }

const std::vector<Asked> asked{
    {"AsRecorded", swing(1, 1), "", "nothing"},
    {"WithSpeeds", swing(1, 1, true), "", "nothing"},
    {"AStep", "time_s,position_elbow_rad\n0,0\n0.99,0\n1,0.8\n3,0.8\n", "", "nothing"},
    {"MillisecondsForSeconds", swing(1e-3, 1), "", "speed: elbow: the motion asks for more speed than the drive has 9"},
    {"TheyEndAtOnce", swing(1e-3, 1), "duration_s: 6\nexpects: [speed]\n",
     "idle: the recording is over after 0.006 of 6 s, and the robot stands still 99.9 % of the time"},
    {"DegreesForRadians", swing(1, 57.3), "", "speed: elbow: the motion asks for more speed"},
    {"DegreesWithSpeeds", swing(1, 57.3, true), "", "up to 61.1 rad/s (the model's joint_speed_max_rad_s is 2)"},
    {"Short", swing(1, 1), "duration_s: 60\n", "idle: the recording is over after 6 of 60 s"},
    {"ShortAndSaid", swing(1, 1), "duration_s: 60\nexpects: [idle]\n", "nothing"},
};

class AskedOfTheDrives : public testing::TestWithParam<Asked> {};
INSTANTIATE_TEST_SUITE_P(Motions, AskedOfTheDrives, testing::ValuesIn(asked),
                         [](const auto& i) { return i.param.name; });

TEST_P(AskedOfTheDrives, IsSaidBeforeTheRun) {
  const Folder folder;
  std::ofstream(folder.path / "swing.csv") << GetParam().csv;
  const bool limit = GetParam().name.starts_with("Degrees");  // 46 rad/s over 90 rad are no feat for 60 Nm and 1 kg m^2
  const auto s = loaded(
      folder,
      changed(model, {{"</mujoco>", limit ? "<custom><numeric name=\"joint_speed_max_rad_s\" data=\"2 2\"/></custom>"
                                            "</mujoco>"
                                          : "</mujoco>"}}),
      "model: model.xml\nmotion: {type: recording, file: swing.csv}\n" + GetParam().rest);
  ASSERT_TRUE(s) << s.error().message;
  std::string said = "nothing";
  for (const HealthLine& line : health_lines(examine({*s}))) {
    said = line.check + ": " + line.text;
    break;
  }
  EXPECT_THAT(said, HasSubstr(GetParam().says));
}

/// A gripper may close; its fingers are no obstacles to each other that a motion could avoid.
TEST(HealthOfARun, FingersThatNoDriveMovesMayTouch) {
  const std::string finger =
      "<body pos=\"{} 0 -.6\"><joint type=\"slide\" axis=\"1 0 0\" stiffness=\"500\" damping=\"5\" armature=\"0\" "
      "frictionloss=\"0\"/><geom size=\".05\" mass=\".1\"/></body>";
  const std::string fingers = fmt::format(fmt::runtime(finger), ".04") + fmt::format(fmt::runtime(finger), "-.04");
  const Changes gripper{{"fromto=\"0 0 -.1 0 0 -.5\" size=\".03\" mass=\"2\"/>\n      </body>",
                         "fromto=\"0 0 -.1 0 0 -.3\" size=\".03\" mass=\"2\"/>" + fingers + "\n      </body>"}};
  EXPECT_EQ(line_of(run_of(changed(model, gripper), scenario), "contacts"), "nothing");
  const Changes floor{gripper[0], {"0 0 -1.2", "0 0 -1.12"}};
  EXPECT_TRUE(checks_of(run_of(changed(model, floor), scenario)).contains("contacts"));
}

/// The slowest joint sets the pace: a limit of another one that changes nothing is no setting.
TEST(Settings, OfTheMotionThatChangeNothingAreRefused) {
  const Folder folder;
  ASSERT_TRUE(
      loaded(folder, model,
             "model: model.xml\nduration_s: 4\nmotion: {type: cycle, speed_rad_s: {shoulder: 0.5, elbow: 0.2}, "
             "waypoints: [{position_rad: {shoulder: 0, elbow: 0}}, {position_rad: {shoulder: 0.5, elbow: 1}}]}\n"));
  const auto with = [&](const std::string& setting) {
    const auto s = load_scenario(folder.path / "scenario.yaml", {setting, "duration_s=3"});
    return s ? "accepted" : s.error().message;
  };
  EXPECT_THAT(with("motion.speed_rad_s.shoulder=60"),
              testing::AllOf(HasSubstr("--set motion.speed_rad_s.shoulder=60: changes nothing"),
                             HasSubstr("(shoulder moves at up to 0.1)")));
  for (const char* setting : {"motion.speed_rad_s.shoulder=0.05", "motion.speed_rad_s.elbow=60",
                              "motion.speed_rad_s.shoulder=0.5", "motion.speed_rad_s=60", "motion.ramp_s=1"})
    EXPECT_EQ(with(setting), "accepted") << setting;
}

TEST(HealthOfARun, WhatTheScenarioExpectsIsNoWarning) {
  const Changes low{{"0 0 -1.2", "0 0 -1.02"}};
  const Summary s = run_of(changed(model, low), scenario + "expects: [contacts, saturation, tracking, balance]\n");
  EXPECT_TRUE(as_asked(s.health));
  EXPECT_EQ(checks_of(s, {Verdict::expected}),
            (std::set<std::string>{"contacts", "saturation", "tracking", "balance"}));
  EXPECT_THAT(all_warnings(s), testing::IsEmpty());
  EXPECT_THAT(summary_json(s), HasSubstr("\"verdict\": \"expected\""));
}

TEST(HealthOfARun, TheBalanceHoldsWhereDirectionsDiffer) {
  const std::string key = R"(<config key="gear_ratio" value="1"/>)";
  const Summary s = run_of(
      changed(model, {{key, key + R"(<config key="asymmetry" value="0.4"/><config key="offset_nm" value="2 -1"/>)"}}),
      scenario);
  EXPECT_THAT(checks_of(s), testing::IsEmpty());
  EXPECT_LT(std::abs(s.energy_balance_J), 1e-3 * s.friction_work_J);
  EXPECT_NEAR(s.heat_J, s.friction_work_J, 1e-12 * s.heat_J);
}

TEST(HealthOfARun, AnUnknownExpectationIsRefused) {
  const Folder folder;
  const auto s = loaded(folder, model, scenario + "expects: [contact]\n");
  ASSERT_FALSE(s);
  EXPECT_THAT(s.error().message, testing::AllOf(HasSubstr("scenario.yaml:4"), HasSubstr("did you mean 'contacts'")));
}

/// Six drives outside the ranges of their laws are one line, which joins the joints of one cause.
TEST(HealthOfARun, JointsOfOneCauseShareALine) {
  const auto s = run(load_scenario(source / "twin/scenarios/irb6620_warmup.yaml",
                                   {"duration_s=2", "multirate.enabled=false", "temperature_degC=30"})
                         .value(),
                     {});
  ASSERT_TRUE(s);
  const auto lines = all_warnings(*s);
  ASSERT_EQ(lines.size(), 1u) << testing::PrintToString(lines);
  EXPECT_THAT(lines[0], testing::AllOf(HasSubstr("joint1, joint3, joint4, joint5, joint6: 100 % of the time"),
                                       HasSubstr("; joint2: "), HasSubstr("temperature below 38 degC")));
  EXPECT_TRUE(as_asked(s->health));
}

TEST(HealthOfARun, AFailedJointIsNamedAmongMany) {
  std::vector<Finding> many;
  for (int i = 0; i < 6; ++i)
    many.push_back({.check = "saturation",
                    .joint = "j" + std::to_string(i),
                    .value = 0.1 * i,
                    .threshold = 0.05,
                    .verdict = i == 0 ? Verdict::ok : Verdict::warning,
                    .cause = "cause " + std::to_string(i),
                    .effect = "effect",
                    .remedy = "remedy"});
  const auto lines = health_lines(many);
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(lines[0].text, "j5: cause 5; j4: cause 4; j3: cause 3; and 2 more joints: effect; remedy");
}

/// A robot that stands on its feet touches the ground.
TEST(HealthOfARun, TheGroundOfARobotThatIsNotFixedIsNoCollision) {
  const Changes free{
      {"<body name=\"upper\">",
       "<body name=\"cart\" pos=\"0 0 0\"><joint name=\"way\" type=\"slide\" axis=\"1 0 0\" armature=\"9\"/>"
       "<geom size=\".1\" mass=\"50\"/><body name=\"upper\">"},
      {"</worldbody>", "</body></worldbody>"},
      {"0 0 -1.2", "0 0 -1.02"}};
  EXPECT_FALSE(checks_of(run_of(changed(model, free), scenario)).contains("contacts"));
}

TEST(HealthOfARun, FullBuffersAreCountedAndNumbersThatAreNotFiniteEndIt) {
  Twin twin(load_scenario(source / "twin/scenarios/irb6620_hold.yaml").value());
  ASSERT_TRUE(twin.step());
  twin.data()->warning[mjWARN_CONTACTFULL].number = 3;
  ASSERT_TRUE(twin.step()) << "full buffers are counted";
  const Summary s = summarize(twin, 1);
  EXPECT_EQ(checks_of(s), std::set<std::string>{"engine"});
  EXPECT_THAT(line_of(s, "engine"), HasSubstr("3 times"));
  twin.data()->warning[mjWARN_BADQACC].number = 1;
  EXPECT_FALSE(twin.step());
}

/// Also where everything fires: saturation, contacts, stops, speeds outside the law's range.
TEST(Watch, AllocatesNothing) {
  const Folder folder;
  const Changes all{{"key=\"Fc\"", "key=\"speed_max_rad_s\" value=\"0.1\"/> <config key=\"Fc\""},
                    {"range=\"-1 1\"", "range=\"-0.4 0.4\""},
                    {"0 0 -1.2", "0 0 -1.02"}};
  Twin twin(loaded(folder, changed(model, all), scenario).value());
  const long before = allocations;
  for (int i = 0; i < 3000; ++i)
    if (!twin.step()) FAIL();
  EXPECT_EQ(allocations, before);
  EXPECT_GT(twin.watch().joints()[0].saturated, 0);
  EXPECT_GT(twin.watch().joints()[0].too_fast, 0);
  EXPECT_GT(twin.watch().touched_steps(), 0);
}

TEST(RecordSize, IsPredictedWithinFivePercent) {
  for (const auto& [name, settings] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"irb6620_hold", {"duration_s=60", "telemetry_rate_hz=500"}},
           {"rh380n_tracking", {"duration_s=20"}},
           {"irb6620_warmup", {"duration_s=60", "multirate.enabled=false", "telemetry_rate_hz=500"}}}) {
    const Folder folder;
    const Scenario s = load_scenario(source / "twin/scenarios" / (name + ".yaml"), settings).value();
    ASSERT_TRUE(run(s, {.directory = folder.path}));
    const auto size = static_cast<double>(fs::file_size(folder.path / "telemetry.h5"));
    EXPECT_NEAR(predicted_bytes(s), size, 0.05 * size) << name;
  }
}

TEST(RecordSize, IsANoteAboveAHundredMegabytes) {
  // 6 drives of 7 channels and the time: 344 byte a sample, at 100 Hz; cycles of 2.4 s or so beside them.
  const auto line = [](const char* duration) {
    const Scenario s =
        load_scenario(source / "twin/scenarios/irb6620_warmup.yaml",
                      {std::string("duration_s=") + duration, "multirate.enabled=false", "telemetry_rate_hz=100"})
            .value();
    const auto lines = health_lines(examine({s, nullptr, predicted_bytes(s)}));
    return lines.empty() ? "nothing" : std::string(name(lines[0].verdict)) + ": " + lines[0].text;
  };
  EXPECT_EQ(line("2850"), "nothing");
  EXPECT_THAT(line("28800"), testing::AllOf(HasSubstr("note: telemetry.h5 takes 99"), HasSubstr("multirate"),
                                            HasSubstr("telemetry_rate_hz: 10 takes 9")));
}

TEST(RecordSize, WhatTheDiskCannotHoldIsRefusedBeforeAnythingIsWritten) {
  const Folder folder;
  const Scenario s =
      load_scenario(source / "twin/scenarios/irb6620_hold.yaml", {"duration_s=1e9", "telemetry_rate_hz=1000"}).value();
  const auto refused = run(s, {.directory = folder.path / "run"});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, ErrorKind::work);
  EXPECT_THAT(refused.error().message, testing::AllOf(HasSubstr("No space left"), HasSubstr("telemetry_rate_hz")));
  EXPECT_FALSE(fs::exists(folder.path / "run"));
}

/// Every check has a case above, and its row in the README.
TEST(HealthChecks, AreTestedAndDocumented) {
  std::set<std::string> tested{"record_size"};
  for (const Case& c : cases) tested.insert(c.check);
  for (const HealthCheck& check : health_checks()) EXPECT_TRUE(tested.contains(std::string(check.name))) << check.name;
  std::ifstream file(source / "twin/simulation/README.md");
  const std::string readme(std::istreambuf_iterator<char>(file), {});
  EXPECT_THAT(readme, HasSubstr(health_markdown()));
}

/// Nothing that ships is called wrong. Long ones are cut short.
TEST(Shipped, NoScenarioIsWarnedOf) {
  for (const auto& [name, settings] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"irb6620_warmup", {"duration_s=600"}},
           {"irb6620_hold", {"duration_s=10"}},
           {"br609_test_cycle", {"duration_s=100"}},
           {"er3a_c60_day", {"duration_s=600"}},
           {"rh380n_hysteresis", {"actuators.load.frequency_hz=0.125", "duration_s=8"}},
           {"rh380n_hysteresis", {"actuators.load.frequency_hz=2", "temperature_degC=50", "duration_s=3"}},
           {"rh380n_tracking", {"control.compensation=none", "duration_s=34"}},
           {"rh380n_tracking", {"control.compensation=static", "duration_s=34"}},
           {"rh380n_tracking", {"temperature_degC=35", "duration_s=34"}},
           {"xl330_replay", {}}}) {
    if (name == "xl330_replay" && !fs::exists(source / "../shared/data/bam_xl330")) continue;
    const auto s = run(load_scenario(source / "twin/scenarios" / (name + ".yaml"), settings).value(), {});
    ASSERT_TRUE(s) << name << ": " << s.error().message;
    EXPECT_THAT(checks_of(*s), testing::IsEmpty()) << name << testing::PrintToString(all_warnings(*s));
  }
}

}  // namespace
}  // namespace tribotwin::twin
