#include <gmock/gmock.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

using testing::HasSubstr;

std::string after(const std::string& yaml, const std::string& setting) {
  YAML::Node root = YAML::Load(yaml);
  try {
    apply_setting(root, setting, "--set seed=7");
  } catch (const InputError& e) {
    return e.what();
  }
  YAML::Emitter out;
  out << YAML::Flow << root;
  return out.c_str();
}

TEST(Setting, DescendsIntoMappingsAndLists) {
  EXPECT_EQ(after("{a: 1}", "a=2"), "{a: 2}");
  EXPECT_EQ(after("{a: {b: 1}}", "a.b=[1, 2]"), "{a: {b: [1, 2]}}");
  EXPECT_EQ(after("{a: 1}", "b.c=x"), "{a: 1, b: {c: x}}");
  EXPECT_EQ(after("{a: [{b: 1}, {b: 2}]}", "a.1.b=3"), "{a: [{b: 1}, {b: 3}]}");
}

TEST(Setting, MistakesAreNamed) {
  EXPECT_EQ(after("{a: 1}", "a"), "--set a: must be key=value, for example --set seed=7");
  EXPECT_THAT(after("{a: 1}", "=1"), HasSubstr("must be key=value"));
  EXPECT_EQ(after("{a: 1}", "a..b=1"), "--set a..b=1: an empty key");
  EXPECT_EQ(after("{a: 1}", "a.b=1"), "--set a.b=1: 'a' is no mapping, so it has no key 'b'");
  EXPECT_EQ(after("{a: [1]}", "a.1=1"), "--set a.1=1: '1' must be a number from 0 to 0, an entry of the list");
  EXPECT_THAT(after("{a: 1}", "a=[1"), HasSubstr("--set a:1: not well-formed YAML ("));
}

TEST(Number, IsTheWholeText) {
  EXPECT_EQ(to_number("-1.5e3"), -1500);
  for (const char* text : {"", "1x", " 1", "1 ", "+1", "0x10", "1,5"}) EXPECT_FALSE(to_number(text)) << text;
  EXPECT_EQ(to_integer<int>("7f", 16), 127);
  EXPECT_FALSE(to_integer<std::uint8_t>("256"));
  EXPECT_FALSE(to_integer<unsigned>("-1"));
}

TEST(Text, FoldersAndMissingFilesAreWrongInput) {
  const auto folder = read_text(TRIBOTWIN_SOURCE_DIR, "a table"),
             missing = read_text(TRIBOTWIN_SOURCE_DIR "/none.csv", "a table");
  ASSERT_TRUE(!folder && !missing);
  EXPECT_THAT(folder.error().message, HasSubstr("is a folder, not a table"));
  EXPECT_THAT(missing.error().message, HasSubstr("none.csv: cannot be read"));
  EXPECT_EQ(missing.error().kind, ErrorKind::input);
  EXPECT_THAT(*read_text(TRIBOTWIN_SOURCE_DIR "/CMakeLists.txt", "a table"), HasSubstr("project(tribotwin"));
}

TEST(Shipped, IsFoundByNameAndByPath) {
  std::filesystem::current_path(testing::TempDir());
  const std::filesystem::path source = TRIBOTWIN_SOURCE_DIR;
  const auto scenario = source / "twin/scenarios/irb6620_hold.yaml", model = source / "mjcf/irb6620.xml";
  EXPECT_EQ(given_or_shipped("irb6620_hold", ".yaml"), scenario);
  EXPECT_EQ(given_or_shipped("twin/scenarios/irb6620_hold.yaml", ".yaml"), scenario);
  EXPECT_EQ(given_or_shipped("irb6620", ".xml"), model);
  EXPECT_EQ(given_or_shipped("mjcf/../mjcf/irb6620.xml", ".xml"), model);
  EXPECT_THAT(shipped_models(), testing::Contains(model));
  EXPECT_THAT(shipped_scenarios(), testing::Contains(scenario));
}

TEST(Shipped, OtherNamesStayAsGiven) {
  std::filesystem::current_path(testing::TempDir());
  for (const std::string given : {"", "none", "/mjcf/irb6620.xml", "../mjcf/irb6620.xml", "mjcf", "mjcf/../../x"})
    EXPECT_EQ(given_or_shipped(given, ".xml"), given);
}

}  // namespace
}  // namespace tribotwin::twin
