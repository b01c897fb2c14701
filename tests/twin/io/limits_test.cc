// YAML, JSON and CSV beyond the limits of readers: refused with the place, in no time and with little memory.
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/resource.h>
#include <unistd.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

class Limits : public testing::Test {
 protected:
  void TearDown() override {
    fs::remove(file_);
    rusage usage{};
    ::getrusage(RUSAGE_SELF, &usage);
    EXPECT_LT(usage.ru_maxrss, 512 * 1024) << "KiB";
  }
  std::string refusal(const std::string& yaml) {
    std::ofstream(file_) << yaml;
    try {
      load_yaml(file_);
      return "read";
    } catch (const InputError& e) {
      return e.what();
    }
  }
  fs::path file_ = fs::temp_directory_path() / fmt::format("tribotwin_limits_{}.yaml", ::getpid());
};

/// Lists of ten aliases of the list before: 10^levels values.
std::string bomb(int levels) {
  std::string yaml = "a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]\n";
  for (int i = 1; i < levels; ++i) {
    yaml += fmt::format("a{0}: &a{0} [", i);
    for (int k = 0; k < 10; ++k) yaml += fmt::format("*a{},", i - 1);
    yaml += "]\n";
  }
  return yaml;
}

std::string nested(int levels) { return std::string(levels, '[') + std::string(levels, ']'); }

TEST_F(Limits, OfYaml) {
  EXPECT_EQ(refusal(bomb(5)), "read");
  EXPECT_EQ(refusal(bomb(9)), fmt::format("{}:6: holds more than 1000000 values, aliases counted as what they stand "
                                          "for",
                                          file_.string()));
  EXPECT_THAT(refusal(bomb(60)), HasSubstr("holds more than"));
  EXPECT_THAT(refusal("a: &a [1, *a]"), HasSubstr(":1: an alias stands within what it stands for"));
  EXPECT_THAT(refusal("a: &a {b: 1, <<: *a}"), HasSubstr("an alias stands within"));
  const int deepest = static_cast<int>(limits::yaml_depth) - 1;  // below the mapping of keys
  EXPECT_EQ(refusal("a: " + nested(deepest)), "read");
  EXPECT_THAT(refusal("a: 1\nb: " + nested(deepest + 1)),
              HasSubstr(":2: mappings and lists are nested deeper than 64"));
  EXPECT_THAT(refusal("a: &a " + nested(40) + "\nb: [[[[[[[[[[[[[[[[[[[[[[[[[*a]]]]]]]]]]]]]]]]]]]]]]]]]"),
              HasSubstr(":2: mappings and lists are nested deeper"));
  EXPECT_THAT(refusal("a: " + nested(100000)), HasSubstr("nested deeper"));
  std::string many = "a: [";
  for (std::size_t i = 0; i <= limits::yaml_values; ++i) many += "1,";
  EXPECT_THAT(refusal(many + "]"), HasSubstr("holds more than 1000000 values"));
  EXPECT_THAT(refusal("a: " + std::string(limits::yaml_bytes, 'x')), HasSubstr("at most 16777216 are read of a YAML"));
}

TEST_F(Limits, OfSettings) {
  YAML::Node root = YAML::Load("{a: 1}");
  try {
    apply_setting(root, "a=&x [*x]", "--set seed=7");
    ADD_FAILURE();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("--set a:1: an alias stands within"));
  }
}

TEST_F(Limits, OfTextFiles) {
  std::ofstream(file_) << "x";
  fs::resize_file(file_, limits::text_bytes + 1);
  EXPECT_THAT(read_text(file_, "a table").error().message, HasSubstr("is longer than 67108864 bytes"));
  EXPECT_THAT(refusal("a: 1") + read_text("/dev/zero", "a table").error().message,
              HasSubstr("/dev/zero: is a device, not a table"));
}

TEST(JsonLimits, ValuesAndDepth) {
  const int deepest = static_cast<int>(limits::json_depth);
  EXPECT_FALSE(parse_json(nested(deepest)).is_discarded());
  EXPECT_TRUE(parse_json(nested(deepest + 1)).is_discarded());
  EXPECT_TRUE(parse_ordered_json(nested(deepest + 1)).is_discarded());
  EXPECT_TRUE(parse_json(std::string(1000000, '[')).is_discarded());
  EXPECT_FALSE(parse_json(R"({"a": "[[\"[[[[", "b": "\\"})").is_discarded()) << "brackets in texts do not count";
  EXPECT_TRUE(parse_json("[" + std::string(limits::json_values, ',') + "]").is_discarded());
}

TEST(Json, NamesOfFilesMayBeAnyBytes) {
  EXPECT_EQ(dump_json(nlohmann::json("a\xff")), "\"a\xef\xbf\xbd\"");
  EXPECT_EQ(dump_json(nlohmann::ordered_json{{"b", 1}, {"a", "\xe4"}}), "{\"b\":1,\"a\":\"\xef\xbf\xbd\"}");
  EXPECT_EQ(dump_json(nlohmann::json{{"a", 1}}, 2), "{\n  \"a\": 1\n}");
}

}  // namespace
}  // namespace tribotwin::twin
