#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>

#include <fmt/format.h>
#include <glib.h>

#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {

namespace {
Colour mixed(Colour a, Colour b, double share) {
  const auto mix = [share](int from, int to) {
    return static_cast<std::uint8_t>(std::lround(from + share * (to - from)));
  };
  return {mix(a.r, b.r), mix(a.g, b.g), mix(a.b, b.b)};
}
}  // namespace

std::string hex(Colour c) { return fmt::format("#{:02x}{:02x}{:02x}", c.r, c.g, c.b); }

namespace theme {
Stroke stroke(std::size_t index) {
  static constexpr Stroke table[strokes] = {
      {{0x1f, 0x4e, 0x79}, "solid", {0x7f, 0xb2, 0xe5}}, {{0xd1, 0x49, 0x3f}, "(12,4)", {0xff, 0x8a, 0x80}},
      {{0x2a, 0x9d, 0x8f}, "(3,4)", {0x5f, 0xd4, 0xc6}}, {{0x6a, 0x3d, 0x9a}, "(14,4,3,4)", {0xb7, 0x94, 0xf0}},
      {{0xe0, 0x9f, 0x1f}, "solid", {0xf2, 0xbc, 0x57}}, {{0x4a, 0x55, 0x68}, "(26,5)", {0xaa, 0xb4, 0xc3}},
      {{0xb0, 0x5b, 0x9e}, "(2,9)", {0xe2, 0x9b, 0xd3}}, {{0x6b, 0x8e, 0x23}, "(14,4,3,4,3,4)", {0xa8, 0xcc, 0x5a}},
  };
  Stroke stroke = table[index % strokes];
  // From the ninth on colours come again, with the dashes of others; the fifth is solid, as the first is.
  static constexpr std::size_t solid_again = 4, patterns = strokes - 1;
  const std::size_t own = index % strokes, pattern = own < solid_again ? own : own == solid_again ? 0 : own - 1;
  const std::size_t shifted = (pattern + index / strokes) % patterns;
  stroke.dashes = table[shifted < solid_again ? shifted : shifted + 1].dashes;
  return stroke;
}
}  // namespace theme

Colour viridis(double share) {
  static constexpr Colour table[] = {
      {0x44, 0x01, 0x54}, {0x48, 0x18, 0x6a}, {0x47, 0x2d, 0x7b}, {0x42, 0x40, 0x86}, {0x3b, 0x52, 0x8b},
      {0x33, 0x63, 0x8d}, {0x2c, 0x72, 0x8e}, {0x26, 0x82, 0x8e}, {0x21, 0x91, 0x8c}, {0x1f, 0xa0, 0x88},
      {0x28, 0xae, 0x80}, {0x3f, 0xbc, 0x73}, {0x5e, 0xc9, 0x62}, {0x84, 0xd4, 0x4b}, {0xad, 0xdc, 0x30},
      {0xd8, 0xe2, 0x19}, {0xfd, 0xe7, 0x25},
  };
  constexpr int steps = std::size(table) - 1;
  const double at = steps * (share > 0 ? std::min(share, 1.0) : 0.0);  // NaN counts as 0
  const int low = std::min(static_cast<int>(at), steps - 1);
  return mixed(table[low], table[low + 1], at - low);
}

Colour diverging(double value) {
  constexpr Colour below{0x5a, 0x8f, 0xc4}, above{0xe0, 0x71, 0x2f};
  return mixed(theme::paper, value < 0 ? below : above, std::min(std::abs(value), 1.0));
}

std::string printable(std::string_view text, bool keep_breaks) {
  const std::unique_ptr<char, decltype(&g_free)> valid(g_utf8_make_valid(text.data(), static_cast<gssize>(text.size())),
                                                       g_free);
  std::string out;
  for (const char* at = valid.get(); *at; at = g_utf8_next_char(at)) {
    const gunichar c = g_utf8_get_char(at);
    const bool is_break = c == '\n' || c == '\r' || c == '\t';
    if (is_break)
      out += keep_breaks ? static_cast<char>(c) : ' ';
    else if (g_unichar_iscntrl(c) || (c & 0xfffe) == 0xfffe)
      out += "\uFFFD";
    else
      out.append(at, static_cast<std::size_t>(g_utf8_next_char(at) - at));
  }
  return out;
}

std::vector<double> ticks(double from, double to, int count) {
  const double raw = (to - from) / std::max(count, 1);
  if (!(raw > 0) || !std::isfinite(raw)) return {from};
  const double power = std::pow(10, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double factor : {1.0, 2.0, 5.0})
    if (factor * power >= raw * (1 - 1e-9)) {
      step = factor * power;
      break;
    }
  std::vector<double> out;
  for (double i = std::ceil(from / step - 1e-9); i * step <= to + 1e-9 * step; ++i)
    out.push_back(i * step + 0.0);  // never -0
  return out;
}

std::string correlation(double r) {
  const double gap = 1 - std::abs(r);
  const int decimals = gap > 0 && gap < 0.005 ? std::min(5, static_cast<int>(std::ceil(-std::log10(gap)))) : 2;
  const std::string digits = fmt::format("{:.{}f}", std::abs(r), decimals);
  return (r < 0 && digits != "0.00" ? "-" : "") + digits;
}

std::string digits(double value, int count) {
  const double size = std::abs(value);
  std::string shortest = fmt::format("{:.{}g}", value, count);
  if (shortest.find('e') == std::string::npos || size < 1e-6 || size >= 1e7) return shortest;
  shortest = fmt::format("{:.{}f}", value, std::max(0, count - 1 - static_cast<int>(std::floor(std::log10(size)))));
  if (shortest.find('.') != std::string::npos) shortest.erase(shortest.find_last_not_of('0') + 1);
  return shortest;
}

std::string duration(double seconds) {
  if (!std::isfinite(seconds)) return "unknown";
  if (std::abs(seconds) < 60) return fmt::format("{:.2f} s", seconds);
  const auto whole = static_cast<long long>(std::llround(seconds));
  const long long h = whole / 3600, m = whole / 60 % 60, s = whole % 60;
  return h ? fmt::format("{} h {:02} min {:02} s", h, m, s) : fmt::format("{} min {:02} s", m, s);
}

}  // namespace tribotwin::render
