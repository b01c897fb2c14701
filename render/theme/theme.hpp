#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

/// The look of figures, poses and pages: one set of colours, fonts and number formats.
namespace tribotwin::render {

struct Colour {
  std::uint8_t r = 0, g = 0, b = 0;
  bool operator==(const Colour&) const = default;
};

/// "#rrggbb"
std::string hex(Colour colour);

namespace theme {
inline constexpr Colour ink{0x1a, 0x20, 0x2c};       ///< text
inline constexpr Colour ink_soft{0x4a, 0x55, 0x68};  ///< captions; 7.5:1 on paper
inline constexpr Colour paper{0xff, 0xff, 0xff};
inline constexpr Colour page{0xf6, 0xf8, 0xfb};
inline constexpr Colour line{0xdd, 0xe3, 0xea};
inline constexpr Colour grid{0xe9, 0xed, 0xf2};
inline constexpr Colour good{0x1d, 0x74, 0x44};
inline constexpr Colour warn{0x8a, 0x5a, 0x00};  ///< 5.5:1 on page
inline constexpr Colour bad{0xb4, 0x23, 0x18};
inline constexpr Colour accent{0x2b, 0x5f, 0x8a};
/// For figures in a page: what the reader's system has, sans serif.
inline constexpr std::string_view page_font = "Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
/// For pictures drawn here.
inline constexpr std::string_view picture_font = "DejaVu Sans";

/// Line `index` of a figure without colour bar. Its lightness and its dashes differ from its neighbours', so that
/// it is recognised in greyscale. After eight colours come again, each time with other dashes, 56 in all.
struct Stroke {
  Colour colour;
  std::string_view dashes;  ///< gnuplot's dashtype
  Colour on_dark;           ///< the same hue, where the page is dark
};
inline constexpr std::size_t strokes = 8;
Stroke stroke(std::size_t index);
/// The look of a dark page.
namespace dark {
inline constexpr Colour ink{0xe6, 0xea, 0xf0}, ink_soft{0xb3, 0xbd, 0xca}, paper{0x1b, 0x21, 0x2a},
    page{0x12, 0x16, 0x1c}, line{0x3a, 0x44, 0x52}, good{0x6f, 0xd3, 0x9a}, warn{0xf0, 0xc0, 0x60},
    bad{0xff, 0x9a, 0x90};
}  // namespace dark
}  // namespace theme

/// viridis (van der Walt 2015, CC0), perceptually uniform and monotone in lightness; share is clamped to
/// 0..1.
Colour viridis(double share);

/// From blue at -1 over paper at 0 to orange at 1: as dark on both sides, so that in greyscale the tone is the
/// magnitude. Ink on it keeps a contrast of 5:1.
Colour diverging(double value);

/// The text with every byte sequence that is no UTF-8, and every control character, replaced by U+FFFD. Line ends and
/// tabs stay with `keep_breaks` and become spaces without.
std::string printable(std::string_view text, bool keep_breaks = false);

/// Round tick marks within from..to: about `count`.
std::vector<double> ticks(double from, double to, int count);

/// "-0.93", near 1 with enough digits to differ from 1: "0.9987"
std::string correlation(double r);

/// With so many digits (1 .. 17), as "{:.3g}" has them, but without a power of ten from 1e-6 to 1e7, where people need
/// none: "1234", not "1.23e+03".
std::string digits(double value, int count);

/// "12.30 s", "1 h 23 min 05 s"
std::string duration(double seconds);

}  // namespace tribotwin::render
