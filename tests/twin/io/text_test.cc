#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

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
