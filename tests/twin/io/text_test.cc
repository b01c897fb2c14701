#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

TEST(Encoding, OfOtherProgramsBecomesUtf8) {
  const std::string umlaut = "\xC3\xBC", degree = "\xC2\xB0", euro = "\xE2\x82\xAC";
  const struct {
    std::string text, utf8;
  } rows[] = {{"", ""},
              {"plain", "plain"},
              {"\xEF\xBB\xBFtime_s", "time_s"},
              {umlaut + degree + euro + "\xF0\x9F\x98\x80", umlaut + degree + euro + "\xF0\x9F\x98\x80"},
              {"\xFC [\xB0"
               "C]",
               umlaut + " [" + degree + "C]"},
              {"\x80\n" + umlaut + "\n\xB0", euro + "\n" + umlaut + "\n" + degree},  // line by line
              {"\xC3", "\xC3\x83"},                                                  // cut off in a letter
              {"\xC0\xAF", "\xC3\x80\xC2\xAF"},                                      // no UTF-8: too long for '/'
              {"\xED\xA0\x80", "\xC3\xAD\xC2\xA0" + euro}};                          // nor is a surrogate
  for (const auto& row : rows) {
    const auto utf8 = to_utf8(row.text);
    ASSERT_TRUE(utf8) << row.text << utf8.error().message;
    EXPECT_EQ(*utf8, row.utf8);
    EXPECT_EQ(*to_utf8(*utf8), row.utf8);
  }
}

TEST(Encoding, ThatIsNoneIsRefusedWithItsLineAndByte) {
  for (const auto& [text, says] :
       {std::pair<std::string, std::string>{"a\nb\x81", "2: byte 0x81 at 2 is neither UTF-8"},
        {"\xFF\xFEt", "1: is UTF-16"},
        {"\xFE\xFFt", "1: is UTF-16"}}) {
    const auto utf8 = to_utf8(text);
    ASSERT_FALSE(utf8) << text;
    EXPECT_EQ(utf8.error().message.substr(0, says.size()), says);
  }
  EXPECT_EQ(to_utf8("\x9D", 7).error().message.substr(0, 12), "7: byte 0x9D");
}

TEST(Suggestion, CountsTypingErrors) {
  const struct {
    const char *a, *b;
    std::size_t errors;
  } rows[] = {{"", "", 0},           {"drive", "drive", 0}, {"drive", "driv", 1},    {"drive", "drrive", 1},
              {"drive", "drlve", 1}, {"drive", "dirve", 1}, {"shadow", "hsadwo", 2}, {"", "eds", 3},
              {"replay", "rply", 2}, {"ca", "abc", 3}};
  for (const auto& row : rows) {
    EXPECT_EQ(typing_errors(row.a, row.b), row.errors) << row.a << " " << row.b;
    EXPECT_EQ(typing_errors(row.b, row.a), row.errors) << row.b << " " << row.a;
  }
}

TEST(Suggestion, NamesOnlyWhatIsNear) {
  const std::vector<std::string> commands{"drive", "replay", "eds", "dbc", "--cycle", "-o"};
  const struct {
    const char *given, *says;
  } rows[] = {{"dirve", "; did you mean 'drive'?"},
              {"reply", "; did you mean 'replay'?"},
              {"drv", "; did you mean 'drive'?"},
              {"frobnicate", ""},
              {"dbs", "; did you mean 'dbc'?"},
              {"abc", "; did you mean 'dbc'?"},
              {"xyz", ""},
              {"--cylce", "; did you mean '--cycle'?"},
              {"-x", ""},
              {"ed", "; did you mean 'eds'?"}};
  for (const auto& row : rows) EXPECT_EQ(did_you_mean(row.given, commands), row.says) << row.given;
  EXPECT_EQ(did_you_mean("drive", {}), "");
}

}  // namespace
/// What a file holds must not steer a terminal.
TEST(TextTest, MessagesHaveNoControlCharacters) {
  EXPECT_EQ(Error("FILE:1: \x1B[31mred\x7F\r\n\tµ").message, "FILE:1: \\x1b[31mred\\x7f\\x0d\n\tµ");
  EXPECT_STREQ(InputError("FILE:1: \x01").what(), "FILE:1: \\x01");
}

// The memory of this process at address 0: a file that opens, and whose reading fails.
constexpr char not_to_be_read[] = "/proc/self/mem";

TEST(Text, OfAFileThatCannotBeReadIsNotTakenForAnEmptyOne) {
  const auto text = read_text(not_to_be_read, "a file");
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().message, "/proc/self/mem: cannot be read to its end (Input/output error)");
  EXPECT_EQ(text.error().kind, ErrorKind::work);
  const auto bytes = read_bytes(not_to_be_read);
  ASSERT_FALSE(bytes);
  EXPECT_EQ(bytes.error().message, "/proc/self/mem: cannot be read to its end (Input/output error)");
}

}  // namespace tribotwin::twin
