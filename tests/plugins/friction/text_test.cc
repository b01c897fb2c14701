#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/plugins/friction/text.hpp>

namespace tribotwin {
namespace {

using namespace std::string_literals;

TEST(Encoding, WhatIsNoUtf8IsTakenByItsBytes) {
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
              {"\xED\xA0\x80", "\xC3\xAD\xC2\xA0" + euro},                           // nor is a surrogate
              {"\xE0\x80\xA0", "\xC3\xA0" + euro + "\xC2\xA0"},
              {"\xF0\x82\x82\xA0", "\xC3\xB0\xE2\x80\x9A\xE2\x80\x9A\xC2\xA0"},  // too long
              {"\xF4\xA0\x80\xA0", "\xC3\xB4\xC2\xA0" + euro + "\xC2\xA0"},      // beyond Unicode
              {"\xF5\x80\x80\x80", "\xC3\xB5" + euro + euro + euro},
              {"\xE2\x82(", "\xC3\xA2\xE2\x80\x9A("},
              {"\xBF", "\xC2\xBF"}};
  for (const auto& row : rows) {
    const auto utf8 = to_utf8(row.text);
    ASSERT_TRUE(utf8) << row.text << utf8.error().message;
    EXPECT_EQ(*utf8, row.utf8);
    EXPECT_EQ(*to_utf8(*utf8), row.utf8);
  }
}

TEST(Encoding, Windows1252BecomesUtf8LineByLine) {
  std::string given = "plain\n", becomes = given;
  for (int byte = 0x80; byte <= 0xFF; ++byte)
    if (std::ranges::count(std::array{0x81, 0x8D, 0x8F, 0x90, 0x9D}, byte) == 0) given += static_cast<char>(byte);
  becomes += "€‚ƒ„…†‡ˆ‰Š‹ŒŽ‘’“”•–—˜™š›œžŸ";
  for (int code = 0xA0; code <= 0xFF; ++code)
    becomes += {static_cast<char>(code < 0xC0 ? 0xC2 : 0xC3), static_cast<char>(0x80 | (code & 0x3F))};
  const std::string already = "\nµ, €, 𝄞 and é\n", end = "end \xB5";  // a line of UTF-8, a last one without its end
  EXPECT_EQ(to_utf8(given + already + end).value(), becomes + already + "end µ");
}

TEST(Encoding, BytesThatAreNoLettersAreRefusedWithTheirPlace) {
  for (const char byte : {'\x81', '\x8D', '\x8F', '\x90', '\x9D'}) {
    const auto refused = to_utf8("é\n\xE9"s + byte, 7);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message, testing::StartsWith("8: byte 0x"));
    EXPECT_THAT(refused.error().message, testing::HasSubstr(" at 2 is neither UTF-8 nor Windows-1252"));
  }
  for (const std::string mark : {"\xFF\xFE", "\xFE\xFF"})
    EXPECT_EQ(to_utf8(mark + "a", 3).error().message, "3: is UTF-16; save the file as UTF-8");
}

/// The UTF-8 of a number of so many bytes, whether or not it may be written like that.
std::string written(unsigned code, int bytes) {
  std::string text(static_cast<std::size_t>(bytes), '\0');
  for (int i = bytes - 1; i > 0; --i, code >>= 6)
    text[static_cast<std::size_t>(i)] = static_cast<char>(0x80 | (code & 0x3F));
  text[0] = static_cast<char>((0xF00 >> bytes & 0xFF) | code);
  return text;
}

TEST(Encoding, EveryCharacterOfUnicodeStays) {
  std::string all = "\xEF\xBB\xBF";  // a byte order mark, which does not
  for (unsigned code = 0x80; code <= 0x10FFFF; code += code < 0x3000 ? 1 : 0x7F)
    if (code < 0xD800 || code > 0xDFFF) all += written(code, code < 0x800 ? 2 : code < 0x10000 ? 3 : 4);
  for (const auto& [code, bytes] : {std::pair(0xD7FFu, 3), {0xE000u, 3}, {0xFFFFu, 3}, {0x10000u, 4}, {0x10FFFFu, 4}})
    all += written(code, bytes);
  EXPECT_TRUE(to_utf8(all).value() == all.substr(3));
}

/// By its definition.
std::size_t errors_by_recursion(std::string_view a, std::string_view b) {
  if (a.empty() || b.empty()) return a.size() + b.size();
  const auto less = [](std::string_view text, std::size_t n) { return text.substr(0, text.size() - n); };
  std::size_t least = std::min({errors_by_recursion(less(a, 1), b) + 1, errors_by_recursion(a, less(b, 1)) + 1,
                                errors_by_recursion(less(a, 1), less(b, 1)) + (a.back() != b.back())});
  if (a.size() > 1 && b.size() > 1 && a.back() == b[b.size() - 2] && b.back() == a[a.size() - 2])
    least = std::min(least, errors_by_recursion(less(a, 2), less(b, 2)) + 1);
  return least;
}

TEST(TypingErrors, AreTheFewestChangesBetweenTheTexts) {
  for (const auto& [a, b, errors] : {std::tuple("", "abc", 3u),
                                     {"load", "", 4u},
                                     {"kitten", "sitting", 3u},
                                     {"stribeck", "stirbeck", 1u},
                                     {"ca", "abc", 3u},
                                     {"M*", "M*", 0u}})
    EXPECT_EQ(typing_errors(a, b), errors) << a << ", " << b;
  const auto text_of = [](unsigned k) {  // all of up to four of the letters a to c
    std::string text;
    for (; k > 0; k = (k - 1) / 3) text += static_cast<char>('a' + (k - 1) % 3);
    return text;
  };
  for (unsigned i = 0; i < 121; ++i)
    for (unsigned k = 0; k < 121; ++k) {
      const std::string a = text_of(i), b = text_of(k);
      ASSERT_EQ(typing_errors(a, b), errors_by_recursion(a, b)) << a << ", " << b;
    }
}

TEST(TypingErrors, TheNearestNameIsTheFirstOfEqualOnes) {
  const std::string_view names[] = {"coulomb", "load", "lead", "stribeck"};
  EXPECT_EQ(nearest("stribek", names), "stribeck");
  EXPECT_EQ(nearest("lad", names), "load");
}

}  // namespace
}  // namespace tribotwin
