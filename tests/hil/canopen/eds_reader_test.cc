// EDS and DCF files of other makers (CiA 306): read whole, or refused with file and line; and a drive made from one.
#include <bit>
#include <filesystem>
#include <fstream>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

const std::string foreign = R"(; of another maker
[FileInfo]
FileName=other.eds
[DeviceComissioning]
NodeID=0x5
[1000]
ParameterName=Device type
DataType=0x0007
AccessType=ro
DefaultValue=0xFFFF0192
[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=2
[1018sub0]
ParameterName=Highest
DataType=0x5
AccessType=const
DefaultValue=1
[1018sub1]
ParameterName=Vendor
DataType=7
AccessType=ro
DefaultValue=0xFB
[2500]
ParameterName=Small
DataType=0x2
AccessType=rww
DefaultValue=0xFE
LowLimit=0x80
HighLimit=5
PDOMapping=1
[2501]
ParameterName=Identifier
DataType=7
AccessType=RW
DefaultValue=0x40000180 + $NodeID
ParameterValue=$NODEID+0x200
[2502]
ParameterName=Real
DataType=8
AccessType=rw
DefaultValue=-1.5
[2503]
ParameterName=Text
DataType=9
AccessType=rw
DefaultValue=a = b
[2504]
ParameterName=Octets
DataType=0xA
AccessType=const
DefaultValue=01 0aFF
[2505]
ParameterName=Firmware
ObjectType=2
DataType=0xF
AccessType=wo
[2506]
ParameterName=Table
ObjectType=8
DataType=0x15
AccessType=rw
DefaultValue=-7
CompactSubObj=3
[2506Value]
NrOfEntries=1
2=010
[2506Name]
NrOfEntries=1
3=Third
[2100]
ParameterName=Ours already
ObjectType=9
[2100sub0]
DataType=5
AccessType=ro
DefaultValue=2
[2100sub1]
DataType=3
AccessType=rw
DefaultValue=1
[2100sub2]
DataType=3
AccessType=rw
DefaultValue=9
)";

class Eds : public testing::Test {
 protected:
  std::filesystem::path file = std::filesystem::temp_directory_path() / fmt::format("eds_test_{}", ::getpid());

  void TearDown() override { std::filesystem::remove(file); }
  void put(const std::string& text) { std::ofstream(file, std::ios::binary) << text; }
  /// All that a file goes through: what is wrong, or "".
  std::string problem(const std::string& text) {
    put(text);
    const auto eds = read_eds_file(file);
    if (!eds) return eds.error().message;
    if (const auto objects = eds->defaults(); !objects) return objects.error().message;
    const auto values = eds->values(5);
    return values ? "" : values.error().message;
  }
  EdsFile read(const std::string& text) {
    put(text);
    auto eds = read_eds_file(file);
    EXPECT_TRUE(eds) << eds.error().message;
    return eds ? *eds : EdsFile{};
  }
};

const Object* find(const std::vector<Object>& objects, std::uint16_t index, std::uint8_t sub = 0) {
  const auto found = std::ranges::find_if(objects, [&](const Object& o) { return o.index == index && o.sub == sub; });
  return found == objects.end() ? nullptr : &*found;
}

TEST_F(Eds, AllKindsOfEntries) {
  const EdsFile eds = read(foreign);
  EXPECT_EQ(eds.node_number, 5);
  const auto objects = *eds.defaults();
  EXPECT_EQ(objects.size(), 16U);
  EXPECT_EQ(find(objects, 0x1000)->value, 0xFFFF0192);
  EXPECT_EQ(find(objects, 0x2500)->value, -2);
  EXPECT_EQ(find(objects, 0x2500)->low, -128);
  EXPECT_EQ(find(objects, 0x2500)->high, 5);
  EXPECT_TRUE(find(objects, 0x2500)->mappable);
  EXPECT_EQ(find(objects, 0x2501)->value, 0x40000180);
  EXPECT_TRUE(find(objects, 0x2501)->plus_node);
  EXPECT_EQ(std::bit_cast<float>(static_cast<std::uint32_t>(find(objects, 0x2502)->value)), -1.5F);
  EXPECT_EQ(find(objects, 0x2503)->text, "a = b");
  EXPECT_EQ(find(objects, 0x2504)->text, "\x01\x0a\xff");
  EXPECT_EQ(find(objects, 0x2505)->type, Type::domain);
  EXPECT_EQ(find(objects, 0x2505)->access, Access::write_only);
  EXPECT_EQ(find(objects, 0x2506, 0)->value, 3);
  EXPECT_EQ(find(objects, 0x2506, 3)->value, -7);
  EXPECT_EQ(find(objects, 0x2506, 3)->name, "Third");
  const auto values = *eds.values(5);
  ASSERT_EQ(values.size(), 2U);
  EXPECT_EQ(values[0].index, 0x2501);
  EXPECT_EQ(values[0].bytes, (std::vector<std::uint8_t>{5, 2, 0, 0}));
  EXPECT_EQ(values[0].line, 38);
  EXPECT_EQ(values[1].bytes, (std::vector<std::uint8_t>{8, 0, 0, 0, 0, 0, 0, 0}));  // octal
}

TEST_F(Eds, ReadsWhatWeWrite) {
  const DriveParameters parameters{.node = 7, .name = "joint7", .gear_ratio = 100};
  const Dictionary dictionary = drive_dictionary(parameters);
  const std::string text = eds(dictionary, parameters);
  EXPECT_THAT(text, testing::HasSubstr("DefaultValue=$NODEID+0x200\n"));
  EXPECT_THAT(text, testing::HasSubstr("DefaultValue=$NODEID+0x40000180\n"));
  EXPECT_THAT(text, testing::Not(testing::HasSubstr("DefaultValue=519\n")));  // 207h
  const auto objects = *read(text).defaults();
  ASSERT_EQ(objects.size(), dictionary.objects().size());
  for (const Object& o : objects) {
    const Object& mine = *dictionary.find(o.index, o.sub);
    SCOPED_TRACE(object_name(o.index, o.sub));
    EXPECT_EQ(o.type, mine.type);
    EXPECT_EQ(o.access, mine.access);
    EXPECT_EQ(o.mappable, mine.mappable);
    const bool serial_number = o.index == 0x1018 && o.sub == 4;  // no default
    EXPECT_EQ(o.value + (o.plus_node ? 7 : 0), serial_number ? 0 : mine.value);
    EXPECT_EQ(o.text, mine.text);
    if (mine.access == Access::read_write && is_number(mine.type)) {
      EXPECT_EQ(o.low, mine.low);
      EXPECT_EQ(o.high, mine.high);
    }
  }
}

// Of a maker's own type the length is not known: bytes as they come.
TEST_F(Eds, TypesOfTheMaker) {
  const std::string own = "[2000]\nDataType=0x40\nAccessType=rw\nDefaultValue=0x0\nLowLimit=3\nHighLimit=1\n";
  EXPECT_EQ(read(own).defaults()->at(0).type, Type::domain);
  EXPECT_EQ(problem(own), "");
  EXPECT_THAT(problem("[2000]\nDataType=0x1F\nAccessType=rw\n"), testing::HasSubstr("none of CiA 301"));
  EXPECT_THAT(problem("[2000]\nDataType=0x1000\nAccessType=rw\n"), testing::HasSubstr("none of CiA 301"));
}

// CiA 306 leaves open what equal limits mean: one value, but 0 and 0 are what tools write that know no limits.
TEST_F(Eds, EqualLimits) {
  const struct {
    const char* limits;
    std::int64_t low, high;
  } rows[] = {{"", 0, 255},
              {"LowLimit=7\nHighLimit=7\n", 7, 7},
              {"LowLimit=0\nHighLimit=0\n", 0, 255},
              {"LowLimit=7\n", 7, 255},
              {"HighLimit=7\n", 0, 7}};
  for (const auto& row : rows) {
    const Dictionary d(*read(std::string("[2000]\nDataType=5\nAccessType=rw\n") + row.limits).defaults());
    EXPECT_EQ(d.find(0x2000, 0)->low, row.low) << row.limits;
    EXPECT_EQ(d.find(0x2000, 0)->high, row.high) << row.limits;
  }
}

// ParameterValue before DefaultValue, in the range that the reader asks for, with file and line where it is none.
TEST_F(Eds, NumbersOfEntries) {
  const EdsFile eds = read(foreign + "[DeviceInfo]\nVendorNumber=0xFB\n");
  EXPECT_EQ(eds.device_info.at("vendornumber").text, "0xFB");
  EXPECT_EQ(eds.find(0x2501, 1), nullptr);
  const EdsObject* both = eds.find(0x2501, 0);
  ASSERT_NE(both, nullptr);
  EXPECT_EQ(eds.number(*both->value(), Type::u32, 5, "x"), 0x205);
  EXPECT_EQ(eds.find(0x2505, 0)->value(), nullptr);
  EXPECT_EQ(eds.number(*eds.find(0x2500, 0)->value(), Type::u8, 5, "x"), 0xFE);
  const EdsText last_i64{"$NODEID+0x7FFFFFFFFFFFFFFF", 1}, last_u64{"$NODEID+0xFFFFFFFFFFFFFFFB", 1};
  EXPECT_FALSE(eds.number(last_i64, Type::i64, 5, "x"));
  EXPECT_EQ(eds.number(last_i64, Type::u64, 5, "x"), std::numeric_limits<std::int64_t>::min() + 4);
  EXPECT_EQ(eds.number(last_u64, Type::u64, 4, "x"), -1);
  EXPECT_FALSE(eds.number(last_u64, Type::u64, 5, "x"));
  const auto large = eds.number(*both->value(), Type::u8, 5, "2501h:00");
  ASSERT_FALSE(large);
  EXPECT_EQ(large.error().message, file.string() + ":38: 2501h:00: '$NODEID+0x200' is no u8 from 0 to 255");
}

TEST_F(Eds, SaysWhatIsWrong) {
  const std::string entry = "[2000]\nDataType=5\nAccessType=rw\n";
  const struct {
    std::string text;
    int line;
    const char* says;
  } rows[] = {
      {"x\n", 1, "[SECTION]"},
      {"x=1\n", 1, "[SECTION]"},
      {"[2000\n", 1, "ends with ']'"},
      {"[2000]\nDataType=5\nDataType=6\n", 3, "another value in line 2"},
      {"[2000]\nAccessType=rw\n", 2, "no DataType"},
      {"[2000]\nDataType=5\n", 2, "AccessType is missing"},
      {"[2000]\nDataType=5\nAccessType=r\n", 3, "ro, wo, rw"},
      {"[2000]\nDataType=x\nAccessType=rw\n", 2, "no number"},
      {"[2000]\nDataType=0x0E\nAccessType=rw\n", 2, "none of CiA 301"},
      {"[2000]\nDataType=-5\nAccessType=rw\n", 2, "no number"},
      {"[2000]\nObjectType=256\nDataType=5\nAccessType=rw\n", 2, "0 to 255"},
      {"[2000]\nObjectType=8\nCompactSubObj=255\nDataType=5\nAccessType=rw\n", 3, "0 to 254"},
      {"[2000]\nObjectType=9\n", 2, "[2000sub0]"},
      {entry + "PDOMapping=2\n", 4, "0 to 1"},
      {entry + "DefaultValue=256\n", 4, "u8 from 0 to 255"},
      {entry + "DefaultValue=-1\n", 4, "u8 from 0 to 255"},
      {entry + "DefaultValue=0x\n", 4, "u8 from 0 to 255"},
      {entry + "DefaultValue=09\n", 4, "u8 from 0 to 255"},
      {entry + "DefaultValue=1e3\n", 4, "u8 from 0 to 255"},
      {entry + "DefaultValue=$NODEID+$NODEID\n", 4, "u8 from 0 to 255"},
      {entry + "DefaultValue=1+1\n", 4, "u8 from 0 to 255"},
      {entry + "DefaultValue=99999999999999999999\n", 4, "u8 from 0 to 255"},
      {entry + "LowLimit=300\n", 4, "limit '300'"},
      {entry + "LowLimit=3\nHighLimit=2\n", 4, "LowLimit 3 is above HighLimit 2"},
      {entry + "ParameterValue=256\n", 4, "u8 from 0 to 255"},
      {"[2000]\nDataType=0x15\nAccessType=rw\nDefaultValue=$NODEID+0x7FFFFFFFFFFFFFFF\n", 4, "is no i64"},
      {"[2000]\nDataType=0xA\nAccessType=rw\nDefaultValue=0\n", 4, "pairs of hexadecimal"},
      {entry + "[DeviceComissioning]\nNodeID=0\n", 5, "1 to 127"},
      {entry + "[DeviceComissioning]\nNodeID=128\n", 5, "1 to 127"},
      {entry + "[DeviceComissioning]\nNodeID=$NODEID\n", 5, "1 to 127"},
      {"[" + std::string(5000, 'x') + "]\n", 1, "at most 4096"},
  };
  for (const auto& row : rows) {
    const std::string what = problem(row.text);
    EXPECT_THAT(what, testing::StartsWith(fmt::format("{}:{}: ", file.string(), row.line))) << row.text;
    EXPECT_THAT(what, testing::HasSubstr(row.says)) << row.text;
  }
  EXPECT_THAT(problem(""), testing::HasSubstr("is it an EDS"));
  EXPECT_THAT(problem("[0005]\nObjectType=5\n"), testing::HasSubstr("is it an EDS"));
  EXPECT_FALSE(read_eds_file("/nowhere.eds"));
  EXPECT_FALSE(read_eds_file("/tmp"));
}

// Whatever is in a file: read, or refused in one printable line that names it.
TEST_F(Eds, MutatedFiles) {
  std::mt19937 random(1);
  const DriveParameters parameters{.node = 7, .name = "joint7"};
  const std::string ours = eds(drive_dictionary(parameters), parameters);
  int refused = 0;
  for (int run = 0; run < 800; ++run) {
    std::string text = run % 4 == 0 ? ours.substr(random() % ours.size(), 3000) : foreign;
    for (int k = random() % 6; k >= 0; --k) {
      const std::size_t at = random() % text.size(), length = random() % 40;
      switch (random() % 5) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text.erase(at, length);
          break;
        case 2:
          text.insert(at, text.substr(random() % text.size(), length));
          break;
        case 3:
          text[at] = "0123456789xX-+=$[]\n.,;"[random() % 22];
          break;
        default:
          text.resize(at + 1);
      }
      if (text.empty()) text = "x";
    }
    const std::string what = problem(text);
    if (what.empty()) continue;
    ++refused;
    EXPECT_THAT(what, testing::StartsWith(file.string() + ":"));
    EXPECT_LT(what.size(), 400U);
    for (const char c : what) EXPECT_TRUE(c >= 0x20 && c <= 0x7e) << what;
  }
  EXPECT_GT(refused, 200);
  EXPECT_LT(refused, 799);
}

class ForeignDrive : public Eds {
 protected:
  std::vector<Frame> bus;
  std::unique_ptr<Node> node;

  void SetUp() override {
    NodeSetup setup{.foreign = *read(foreign).defaults()};
    node = std::make_unique<Node>(DriveParameters{.node = 5, .name = "joint5"}, record_in(bus), setup);
    node->start(0);
  }
  std::array<std::uint8_t, 8> ask(std::vector<std::uint8_t> request) {
    request.resize(8);
    bus.clear();
    node->receive(classic(0x600U + node->id(), request), 0);
    std::array<std::uint8_t, 8> answer{};
    if (!bus.empty()) std::ranges::copy(bus[0].bytes(), answer.begin());
    return answer;
  }
  std::uint32_t abort_of(const std::array<std::uint8_t, 8>& a) {
    return a[0] == 0x80 ? static_cast<std::uint32_t>(decode(Type::u32, std::span(a).subspan(4))) : 0;
  }
};

TEST_F(ForeignDrive, AnswersWithItsDefaults) {
  using Answer = std::array<std::uint8_t, 8>;
  EXPECT_EQ(ask({0x40, 0x00, 0x10, 0}), (Answer{0x43, 0x00, 0x10, 0, 0x92, 0x01, 0xFF, 0xFF}));
  EXPECT_EQ(ask({0x40, 0x18, 0x10, 1}), (Answer{0x43, 0x18, 0x10, 1, 0xFB, 0, 0, 0}));
  EXPECT_EQ(ask({0x40, 0x18, 0x10, 4})[4], 5);  // the serial number is the drive's own
  EXPECT_EQ(ask({0x40, 0x00, 0x25, 0}), (Answer{0x4F, 0x00, 0x25, 0, 0xFE}));
  EXPECT_EQ(ask({0x40, 0x01, 0x25, 0}), (Answer{0x43, 0x01, 0x25, 0, 0x85, 0x01, 0, 0x40}));
  EXPECT_EQ(ask({0x40, 0x04, 0x25, 0}), (Answer{0x47, 0x04, 0x25, 0, 1, 0x0A, 0xFF}));
  EXPECT_EQ(ask({0x40, 0x06, 0x25, 1})[0], 0x41);  // 8 bytes
  // Of a record of both: the drive's own sub-indices, and the others.
  EXPECT_EQ(node->dictionary().find(0x2100, 1)->access, Access::read_only);
  EXPECT_EQ(node->dictionary().get(0x2100, 2), 9);
  EXPECT_EQ(node->dictionary().get(0x2100, 0), 2);
}

TEST_F(ForeignDrive, KeepsAccessAndLimits) {
  EXPECT_EQ(abort_of(ask({0x2F, 0x00, 0x25, 0, 5})), 0U);
  EXPECT_EQ(abort_of(ask({0x2F, 0x00, 0x25, 0, 6})), 0x06090031U);
  EXPECT_EQ(node->dictionary().get(0x2500), 5);
  EXPECT_EQ(abort_of(ask({0x40, 0x05, 0x25, 0})), 0x06010001U);  // write only
  EXPECT_EQ(abort_of(ask({0x23, 0x05, 0x25, 0, 1, 2, 3, 4})), 0U);
  EXPECT_EQ(abort_of(ask({0x2F, 0x04, 0x25, 0, 1})), 0x06010002U);  // constant
  EXPECT_EQ(abort_of(ask({0x2F, 0x06, 0x25, 1, 1})), 0x06070013U);  // 8 bytes
  node->receive(classic(0, std::vector<std::uint8_t>{0x81, 5}), 0);
  EXPECT_EQ(node->dictionary().get(0x2500), -2);
}

TEST_F(ForeignDrive, ItsObjectsGoIntoPdosAndIntoItsEds) {
  EXPECT_EQ(abort_of(ask({0x23, 0x03, 0x16, 0})), 0x06070012U);
  EXPECT_EQ(abort_of(ask({0x2F, 0x03, 0x16, 0, 0})), 0U);
  EXPECT_EQ(abort_of(ask({0x23, 0x03, 0x16, 1, 0x08, 0, 0x00, 0x25})), 0U);
  ASSERT_EQ(problem(eds(node->dictionary(), node->parameters())), "");
  const auto again = *read_eds_file(file)->defaults();
  EXPECT_EQ(find(again, 0x2502)->value, node->dictionary().get(0x2502));
  EXPECT_EQ(find(again, 0x2501)->value, 0x40000180);
  EXPECT_EQ(find(again, 0x2504)->text, "\x01\x0a\xff");
  EXPECT_EQ(find(again, 0x2505)->access, Access::write_only);
}

TEST_F(ForeignDrive, FollowsItsNodeNumber) {
  for (const std::vector<std::uint8_t>& request :
       {std::vector<std::uint8_t>{0x04, 1, 0, 0, 0, 0, 0, 0}, {0x11, 9, 0, 0, 0, 0, 0, 0}})
    node->receive(classic(0x7E5, request), 0);
  node->receive(classic(0, std::vector<std::uint8_t>{0x82, 5}), 0);
  EXPECT_EQ(node->id(), 9);
  EXPECT_EQ(node->dictionary().get(0x1200, 1), 0x609);
  node->receive(classic(0, std::vector<std::uint8_t>{0x81, 9}), 0);
  EXPECT_EQ(node->dictionary().get(0x2501), 0x40000185);
}

// The values of a DCF hold after every reset; what is stored wins over them.
TEST_F(Eds, ADcfConfiguresADrive) {
  const std::string dcf =
      "[DeviceComissioning]\nNodeID=5\n[1017]\nDataType=6\nAccessType=rw\nParameterValue=123\n"
      "[605A]\nDataType=3\nAccessType=rw\nParameterValue=6\n[1800]\nObjectType=9\n"
      "[1800sub1]\nDataType=7\nAccessType=rw\nParameterValue=$NODEID+0x280\n"
      "[1A00]\nObjectType=9\n[1A00sub0]\nDataType=5\nAccessType=rw\nParameterValue=2\n"
      "[1A00sub1]\nDataType=7\nAccessType=rw\nParameterValue=0x60410010\n"
      "[1A00sub2]\nDataType=7\nAccessType=rw\nParameterValue=0x60640020\n"
      "[1018sub1]\nDataType=7\nAccessType=ro\nParameterValue=9\n";
  std::vector<Frame> bus;
  KeptParameters memory;
  NodeSetup setup{.values = *read(dcf).values(5), .keep = [&](const KeptParameters& p) { return memory = p, true; }};
  EXPECT_EQ(setup.values.size(), 6U);
  Node node({.node = 5, .name = "joint5"}, record_in(bus), setup);
  node.start(0);
  ASSERT_FALSE(node.refused()) << node.refused()->text();
  const auto get = [&](std::uint16_t index, std::uint8_t sub) { return node.dictionary().get(index, sub); };
  const auto send = [&](std::uint32_t id, std::vector<std::uint8_t> bytes) { node.receive(classic(id, bytes), 0); };
  for (const std::uint8_t reset : {0, 0x81, 0x82}) {
    send(0x605, download(0x1017, 0, Type::u16, 1));
    send(0x605, download(0x605A, 0, Type::i16, 1));
    if (reset == 0) send(0, {0x81, 5});
    send(0, {reset, 5});
    EXPECT_EQ(get(0x1017, 0), 123) << int{reset};
    EXPECT_EQ(get(0x605A, 0), reset == 0x82 ? 1 : 6) << int{reset};
    EXPECT_EQ(get(0x1800, 1), 0x285);
    EXPECT_EQ(get(0x1A00, 2), 0x60640020);
  }
  send(0x605, download(0x1017, 0, Type::u16, 500));  // the factory's
  send(0x605, download(0x1010, 1, Type::u32, 0x65766173));
  send(0, {0x81, 5});
  EXPECT_EQ(get(0x1017, 0), 500);
  EXPECT_EQ(get(0x1800, 1), 0x285);
  send(0x605, download(0x1011, 1, Type::u32, 0x64616F6C));
  send(0, {0x81, 5});
  EXPECT_EQ(get(0x1017, 0), 123);
}

TEST_F(Eds, ADcfThatTheDriveRefuses) {
  const struct {
    std::string entry;
    const char* says;
  } rows[] = {{"[5000]\nDataType=5\nAccessType=rw\nParameterValue=1\n", "5000h:00: this object does not exist"},
              {"[605A]\nDataType=3\nAccessType=rw\nParameterValue=9\n", "605Ah:00: more than its upper limit"},
              {"[605A]\nDataType=4\nAccessType=rw\nParameterValue=1\n", "605Ah:00: more bytes"},
              {"[1A00]\nObjectType=9\n[1A00sub1]\nDataType=7\nAccessType=rw\nParameterValue=0x10080020\n",
               "1A00h:01: names an object that cannot be mapped"}};
  for (const auto& row : rows) {
    std::vector<Frame> bus;
    Node node({.node = 5, .name = "joint5"}, record_in(bus), {.values = *read(row.entry).values(5)});
    ASSERT_TRUE(node.refused()) << row.entry;
    EXPECT_THAT(node.refused()->text(), testing::StartsWith(row.says));
    EXPECT_GT(node.refused()->value.line, 0);
  }
}

}  // namespace
}  // namespace tribotwin::hil
