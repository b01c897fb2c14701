#include <cstdlib>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/canopen/sdo.hpp>
#include <tribotwin/hil/conform/report.hpp>
#include <tribotwin/tests/hil/conform/one_drive_bus.hpp>

namespace tribotwin::hil {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string content(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The EDS of the test's drive, with lines replaced.
class EdsFile {
 public:
  explicit EdsFile(const std::map<std::string, std::string>& replaced = {}) {
    std::string text = eds(drive_dictionary(test_drive()), test_drive());
    for (const auto& [from, to] : replaced) {
      const auto at = text.find(from);
      EXPECT_NE(at, text.npos) << from;
      if (at != text.npos) text.replace(at, from.size(), to);
    }
    std::ofstream(file_) << text;
  }
  ~EdsFile() { fs::remove(file_); }
  EdsFile(const EdsFile&) = delete;
  EdsFile& operator=(const EdsFile&) = delete;
  const fs::path& file() const { return file_; }

 private:
  fs::path file_ = fs::temp_directory_path() / ("conform_" + std::to_string(::getpid()) + ".eds");
};

Result<ConformReport> run(OneDriveBus& bus, const ConformOptions& options = {}, std::function<bool()> stop = {}) {
  ClientOptions client{.now_ns = [&] { return bus.now_ns(); }};
  if (stop) client.stop = std::move(stop);
  return conform(bus, test_drive().node, options, client);
}

std::vector<std::string> with(const ConformReport& report, Verdict verdict) {
  std::vector<std::string> ids;
  for (const Finding& f : report.findings)
    if (f.verdict == verdict) ids.emplace_back(f.check.id);
  return ids;
}

/// All but the history, the controlword, and the targets, which follow the motor.
std::map<std::string, std::int64_t> writable_values(Node& node) {
  constexpr std::uint16_t left_out[] = {0x1003, 0x6040, 0x6071, 0x607A, 0x60C1, 0x60FF};
  std::map<std::string, std::int64_t> values;
  for (const Object& o : node.dictionary().objects())
    if (o.access == Access::read_write && std::ranges::find(left_out, o.index) == std::end(left_out))
      values[object_name(o.index, o.sub)] = o.value;
  return values;
}

/// What is not as it was: its name and its new value.
std::map<std::string, std::int64_t> changed(const std::map<std::string, std::int64_t>& before, Node& node) {
  auto now = writable_values(node);
  std::erase_if(now, [&](const auto& entry) { return before.at(entry.first) == entry.second; });
  return now;
}

TEST(Conform, OurDrivePassesEveryCheckWithItsEds) {
  const EdsFile file;
  const auto sheet = load_eds(file.file(), test_drive().node);
  ASSERT_TRUE(sheet) << sheet.error().message;
  OneDriveBus bus(test_drive());
  const auto report = run(bus, {.eds = &*sheet, .motion = true, .homing = true});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_THAT(with(*report, Verdict::fail), IsEmpty()) << to_text(*report);
  EXPECT_THAT(with(*report, Verdict::not_run), IsEmpty());
  EXPECT_THAT(report->notes, IsEmpty());
  EXPECT_GE(report->count(Verdict::pass), 160) << to_text(*report);
  EXPECT_EQ(report->findings.size(), all_checks().size());
}

TEST(Conform, OnlyTheNamedChecksAreMade) {
  OneDriveBus bus(test_drive());
  const auto report = run(bus, {.motion = true, .only = {"rpdo.off", "csp", "nmt.start", "rpdo.off"}});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_THAT(with(*report, Verdict::pass), testing::ElementsAre("nmt.start", "rpdo.off", "csp.follows", "csp.status",
                                                                 "csp.position_limit", "csp.disabled"));
  EXPECT_EQ(report->findings.size(), 6U);
  for (const char* wrong : {"", "cs", "csp.", "csp.follow", "rpdo.off,csp"}) {
    const auto none = run(bus, {.only = {wrong}});
    ASSERT_FALSE(none) << wrong;
    EXPECT_EQ(none.error().kind, ErrorKind::input);
    EXPECT_THAT(none.error().message, HasSubstr(std::string("no check is called '") + wrong + "'"));
  }
}

TEST(Conform, WithoutMotionNothingIsEnabled) {
  OneDriveBus bus(test_drive());
  bool enabled = false;
  const auto report = run(bus, {}, [&] { return enabled = enabled || !bus.node().brake_engaged(), false; });
  ASSERT_TRUE(report);
  EXPECT_FALSE(enabled);
  EXPECT_THAT(with(*report, Verdict::fail), IsEmpty());
  EXPECT_GE(report->count(Verdict::not_run), 50);
  EXPECT_GE(report->count(Verdict::pass), 90);
}

TEST(Conform, TheNodeIsAsItWas) {
  OneDriveBus bus(test_drive());
  const auto before = writable_values(bus.node());
  ASSERT_TRUE(run(bus, {.motion = true}));
  EXPECT_THAT(changed(before, bus.node()), IsEmpty());
  EXPECT_EQ(bus.node().state(), DriveState::switch_on_disabled);
  EXPECT_EQ(bus.node().nmt(), Nmt::pre_operational);
}

// Interrupted at any time, also while a motion is under way.
TEST(Conform, InterruptedItLeavesTheDriveWithoutPower) {
  OneDriveBus whole(test_drive());
  const auto begin_ns = whole.now_ns();
  ASSERT_TRUE(run(whole, {.motion = true}));
  const auto duration_ns = whole.now_ns() - begin_ns;
  int powered = 0;
  for (int i = 1; i < 60; ++i) {
    OneDriveBus bus(test_drive());
    const auto before = writable_values(bus.node());
    const auto end_ns = bus.now_ns() + duration_ns * i / 60;
    const auto stop = [&] {
      if (bus.now_ns() < end_ns) return false;
      powered += bus.node().enabled();
      return true;
    };
    const auto report = run(bus, {.motion = true}, stop);
    ASSERT_TRUE(report);
    EXPECT_TRUE(report->interrupted);
    EXPECT_THAT(to_text(*report), HasSubstr("interrupted"));
    EXPECT_TRUE(bus.node().brake_engaged()) << i;
    EXPECT_THAT(changed(before, bus.node()), IsEmpty()) << i;
  }
  EXPECT_GE(powered, 5);  // some of them in the middle of a motion
}

/// A node 5 with an SDO server and boot-up messages, but no drive.
class PlainNode final : public Transport {
 public:
  PlainNode() : Transport("plain") {}
  Sent send(const Frame& frame) override {
    if (frame.id == 0x605) server_.request(frame.bytes(), now_ns_);
    if (frame.id == 0x000 && frame.data[0] > 0x80) inbox_.push_back(classic(0x705, std::vector<std::uint8_t>{0}));
    return Sent::done;
  }
  bool receive(Frame& frame) override {
    if (inbox_.empty()) return false;
    frame = inbox_.front();
    inbox_.pop_front();
    return true;
  }
  void wait(std::int64_t deadline_ns) override {
    if (inbox_.empty()) now_ns_ = std::max(now_ns_, deadline_ns);
  }
  bool up() const override { return true; }
  std::string state() const override { return "up"; }
  std::int64_t now_ns() const { return now_ns_; }

 private:
  std::int64_t now_ns_ = 1'000'000'000;
  std::deque<Frame> inbox_;
  Dictionary dictionary_{{{0x1000, 0, "device type", Type::u32, Access::constant, false, 0x191},
                          {0x1001, 0, "error register", Type::u8, Access::read_only}}};
  SdoServer server_{dictionary_, [this](const SdoServer::Answer& answer) {
                      inbox_.push_back(classic(0x585, answer));
                      return true;
                    }};
};

TEST(Conform, ANodeThatIsNoDriveIsNotCheckedAsOne) {
  PlainNode node;
  const auto report = conform(node, 5, {.motion = true}, {.now_ns = [&] { return node.now_ns(); }});
  ASSERT_TRUE(report) << report.error().message;
  int of_drives = 0;
  for (const Finding& f : report->findings)
    if (std::string(f.check.clause).find("CiA 402") != std::string::npos && f.check.needs != Needs::homing) {
      EXPECT_EQ(f.verdict, Verdict::not_applicable) << f.check.id << ": " << f.seen;
      ++of_drives;
    }
  EXPECT_GE(of_drives, 70);
  EXPECT_THAT(with(*report, Verdict::fail), ::testing::Contains("objects.mandatory"));
  EXPECT_THAT(with(*report, Verdict::pass), ::testing::Contains("sdo.unknown_object"));
}

TEST(Conform, NoNodeAnswers) {
  OneDriveBus bus(test_drive());
  const auto report = conform(bus, 6, {}, {.now_ns = [&] { return bus.now_ns(); }});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().kind, ErrorKind::work);
  EXPECT_THAT(report.error().message, HasSubstr("node 6 does not answer on memory:conform"));
}

TEST(Conform, ADriveThatIsEnabledIsLeftAlone) {
  OneDriveBus bus(test_drive());
  for (const std::uint8_t word : {6, 7, 15}) {
    const std::uint8_t request[] = {0x2B, 0x40, 0x60, 0, word, 0, 0, 0};
    bus.send(classic(0x605, request));
  }
  Frame frame;
  while (bus.receive(frame)) continue;
  ASSERT_TRUE(bus.node().enabled());
  const auto report = run(bus, {.motion = true});
  ASSERT_FALSE(report);
  EXPECT_THAT(report.error().message, HasSubstr("another master drives it"));
  EXPECT_TRUE(bus.node().enabled());
}

// A sheet that promises what the device does not keep.
TEST(Conform, EdsThatDiffersIsFound) {
  const std::string of_1017 = "[1017]\nParameterName=heartbeat time\nObjectType=0x7\n", u16 = "DataType=0x0006\n";
  const struct {
    std::map<std::string, std::string> replaced;
    const char* failed;
  } rows[] = {
      {{{of_1017, "[5FF0]\nParameterName=x\nDataType=0x0007\nAccessType=rw\n\n" + of_1017}}, "eds.exist"},
      {{{of_1017 + u16, of_1017 + "DataType=0x0007\n"}}, "eds.lengths"},
      {{{of_1017 + u16 + "AccessType=rw", of_1017 + u16 + "AccessType=ro"}}, "eds.access"},
      {{{"HighLimit=65535\nDefaultValue=500", "HighLimit=65535\nDefaultValue=$NODEID+0x200"}}, "eds.defaults"},
      {{{"HighLimit=65535\nDefaultValue=500", "HighLimit=1000\nDefaultValue=500"}}, "eds.limits"},
      {{{"ProductNumber=0x7477", "ProductNumber=0x7478"}}, "eds.identity"},
      {{{of_1017, "[2FF0]\nParameterName=heartbeat time\nObjectType=0x7\n"}}, "eds.complete"},
  };
  for (const auto& row : rows) {
    const EdsFile file(row.replaced);
    const auto sheet = load_eds(file.file(), test_drive().node);
    ASSERT_TRUE(sheet) << sheet.error().message;
    OneDriveBus bus(test_drive());
    const auto report = run(bus, {.eds = &*sheet});
    ASSERT_TRUE(report);
    EXPECT_THAT(with(*report, Verdict::fail), ::testing::Contains(row.failed));
  }
}

TEST(Conform, EdsThatIsNoneIsRefused) {
  const auto folder = fs::temp_directory_path();
  const auto message = [](const fs::path& file) {
    const auto sheet = load_eds(file, 1);
    return sheet ? std::string("accepted") : sheet.error().message;
  };
  EXPECT_THAT(message(folder / "nowhere.eds"), HasSubstr("nowhere.eds: cannot be read"));
  const auto file = folder / ("conform_bad_" + std::to_string(::getpid()) + ".eds");
  const std::string object = "[1000]\nDataType=7\nAccessType=rw\n";
  const struct {
    std::string text;
    const char* says;
  } rows[] = {
      {"[1000]\nAccessType=ro\nrubbish\n", ":3: must be [SECTION], or KEY=VALUE in a section, not 'rubbish'"},
      {"[FileInfo]\nFileName=x\n", "no objects ([1000] and so on)"},
      {"[1000]\nDataType=7\n", ":2: AccessType is missing: ro, wo, rw, rwr, rww or const"},
      {object + "DefaultValue=5x\n", ":4: 1000h:00: '5x' is no u32 from 0 to 4294967295"},
      {object + "LowLimit=x\n", ":4: 1000h:00: the limit 'x' is no u32"},
      {object + "[DeviceInfo]\nVendorNumber=ours\n", ":5: VendorNumber: 'ours' is no u32 from 0 to 4294967295"},
      {object + "[DeviceInfo]\nProductNumber=-1\n", ":5: ProductNumber: '-1' is no u32 from 0 to 4294967295"},
  };
  for (const auto& row : rows) {
    std::ofstream(file) << row.text;
    EXPECT_THAT(message(file), HasSubstr(row.says)) << row.text;
  }
  fs::remove(file);
}

TEST(Conform, EdsWithACompactArray) {
  const auto file = fs::temp_directory_path() / ("conform_compact_" + std::to_string(::getpid()) + ".eds");
  std::ofstream(file) << "[1016]\nObjectType=8\nDataType=7\nAccessType=rw\nDefaultValue=0x10\nCompactSubObj=2\n";
  const auto sheet = load_eds(file, 1);
  fs::remove(file);
  ASSERT_TRUE(sheet) << sheet.error().message;
  ASSERT_EQ(sheet->objects.size(), 3U);
  EXPECT_EQ(sheet->objects[2].sub, 2);
  EXPECT_EQ(sheet->objects[2].value, 0x10);
  EXPECT_TRUE(sheet->objects[2].has_default);
}

TEST(Conform, EdsNumbers) {
  using Lines = std::map<std::string, std::string>;
  const EdsFile file(Lines{{"HighLimit=65535\nDefaultValue=500", "HighLimit=0xFFFF\nDefaultValue= $NODEID + 0x80 "}});
  const auto sheet = load_eds(file.file(), 5);
  ASSERT_TRUE(sheet);
  const auto found = std::ranges::find(sheet->objects, 0x1017, &SheetObject::index);
  ASSERT_NE(found, sheet->objects.end());
  EXPECT_EQ(found->value, 0x85);
  EXPECT_EQ(found->high, 0xFFFF);
}

TEST(Conform, ReportAsJsonAndText) {
  OneDriveBus bus(test_drive());
  const auto report = run(bus);
  ASSERT_TRUE(report);
  const auto json = nlohmann::json::parse(to_json(*report));
  EXPECT_EQ(json["node"], 5);
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["checks"].size(), all_checks().size());
  EXPECT_EQ(json["passed"].get<int>() + json["failed"].get<int>() + json["not_applicable"].get<int>() +
                json["not_run"].get<int>(),
            static_cast<int>(all_checks().size()));
  const auto text = to_text(*report);
  for (const Finding& f : report->findings) {
    EXPECT_THAT(text, HasSubstr(f.check.id));
    EXPECT_THAT(text, HasSubstr(f.check.clause));
  }
}

TEST(Conform, EveryCheckHasAnIdOfItsOwnAndAClause) {
  std::set<std::string> ids;
  for (const Check& check : all_checks()) {
    EXPECT_TRUE(ids.insert(check.id).second) << check.id;
    EXPECT_TRUE(std::string(check.clause).starts_with("CiA ")) << check.id;
    EXPECT_TRUE(std::string(check.expected).ends_with(".")) << check.id;
  }
}

// README_RENEW=1 writes the table.
TEST(Conform, ReadmeHasTheTableOfChecks) {
  const fs::path readme = TRIBOTWIN_SOURCE_DIR "/hil/conform/README.md";
  std::string text = content(readme);
  const std::string mark = "<!-- From here on generated from the tables in the code. -->\n\n";
  const auto at = text.find(mark);
  ASSERT_NE(at, text.npos);
  if (std::getenv("README_RENEW")) {
    text = text.substr(0, at + mark.size()) + checks_markdown();
    std::ofstream(readme) << text;
  }
  EXPECT_EQ(text.substr(at + mark.size()), checks_markdown()) << "README_RENEW=1 renews it";
}

}  // namespace
}  // namespace tribotwin::hil
