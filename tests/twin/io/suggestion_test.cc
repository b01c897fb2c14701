#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <tribotwin/twin/io/command_line/suggestion.hpp>

namespace tribotwin::twin {
namespace {

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
}  // namespace tribotwin::twin
