#include <gtest/gtest.h>

#include <tribotwin/twin/io/text_table.hpp>

namespace tribotwin::twin {
namespace {

TEST(TextTable, WidthIsCountedInCharacters) {
  const struct {
    const char* text;
    std::size_t width;
  } rows[] = {{"", 0},      {"joint2", 6}, {"längsachse", 10}, {"a\u0308", 1},   {"関節", 4},
              {"°C µm", 5}, {"\xff", 1},   {"\xc3", 1},        {"\xe9\x96x", 3}, {"😀", 2}};
  for (const auto& row : rows) EXPECT_EQ(display_width(row.text), row.width) << row.text;
}

// Whatever the cells hold, columns are aligned and two blanks apart.
TEST(TextTable, ColumnsAreAlignedAndApart) {
  constexpr auto left = TextTable::left, right = TextTable::right;
  TextTable table{{left("joint"), right("rms"), right("max"), left("remark")}};
  table.add({"längsachse_des_portals", "1.234e-05", "-1.5e+300", "ü"});
  table.add({"関節", "2", "3", ""});
  table.add({"q", "does not move, and says so at length"});
  EXPECT_EQ(table.text(),
            "joint                         rms        max  remark\n"
            "längsachse_des_portals  1.234e-05  -1.5e+300  ü\n"
            "関節                            2          3\n"
            "q                       does not move, and says so at length\n");
}

TEST(TextTable, NoHeadsNoLineOfThem) {
  TextTable table{{TextTable::left(), TextTable::left()}};
  table.add({"a", "b"});
  EXPECT_EQ(table.text(), "a  b\n");
}

}  // namespace
}  // namespace tribotwin::twin
