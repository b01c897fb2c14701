#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <span>

#include <fmt/format.h>
#include <glib.h>

#include <tribotwin/render/figure/figure.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

/// A literal of gnuplot. All ASCII but letters, digits and spaces is written as octal codes, so that nothing in it ends
/// the literal or is substituted (backquotes are, in double quotes; doubled single quotes do not always work).
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : printable(text)) {
    const auto byte = static_cast<unsigned char>(c);
    const bool harmless =
        byte >= 0x80 || byte == ' ' || (byte >= '0' && byte <= '9') || ((byte | 0x20) >= 'a' && (byte | 0x20) <= 'z');
    if (harmless)
      out += c;
    else
      out += fmt::format("\\{:04o}", byte);
  }
  return out + "\"";
}

/// The text, or as much of its beginning and end as fits into `width` pixels at 13 px.
std::string fitting(const std::string& text, int width) {
  const std::string whole = printable(text);
  const auto length = g_utf8_strlen(whole.c_str(), -1), length_max = std::max<glong>(16, width / 8);
  if (length <= length_max) return whole;
  const auto part = [&](glong from, glong to) {
    const std::unique_ptr<char, decltype(&g_free)> cut(g_utf8_substring(whole.c_str(), from, to), g_free);
    return std::string(cut.get());
  };
  return part(0, length_max / 2) + "…" + part(length - (length_max - length_max / 2) + 1, length);
}

/// Plain text where enhanced text is expected.
std::string plain(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (std::string_view("\\{}@&^_~").find(c) != std::string_view::npos) out += '\\';
    out += c;
  }
  return out;
}

/// `width`: of the place beside the axis [px].
std::string label(const Axis& axis, int width) {
  const int rest = static_cast<int>(axis.unit.size() + 3 + (axis.symbol.empty() ? 0 : 4)) * 8;
  return quoted(fmt::format("{}{}{}{}", plain(fitting(axis.quantity, width - rest)), axis.symbol.empty() ? "" : " ",
                            axis.symbol, axis.unit.empty() ? "" : " [" + plain(axis.unit) + "]"));
}

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double v) {
    if (std::isfinite(v)) low = std::min(low, v), high = std::max(high, v);
  }
};

/// gnuplot widens a range to its tics, and warns about one without extent.
std::string range(const char* name, const Axis& axis, Range r) {
  const double top = axis.to.value_or(r.high);
  const std::string marks = axis.whole && top <= 8 ? fmt::format("set {}tics 1\n", name) : "";
  if (!axis.from && !axis.to && r.low < r.high) return marks;
  double from = axis.from.value_or(r.low), to = axis.to.value_or(r.high);
  if (!(from < to)) {
    const double pad = from == 0 ? 1 : 0.1 * std::abs(from);
    from -= pad, to += pad;
  }
  return marks + fmt::format("set {}range [{}:{}]\n", name, from, to);
}

/// What is wrong with a surface, a matrix or a series; empty where nothing is.
std::string wrong_surface(const Figure& f) {
  const Surface& s = *f.surface;
  if (s.x.size() < 2 || s.y.size() < 2 || s.z.size() != s.y.size() ||
      std::ranges::any_of(s.z, [&](const auto& row) { return row.size() != s.x.size(); }))
    return fmt::format("its surface of {} x {} points has {} rows", s.x.size(), s.y.size(), s.z.size());
  if (!f.z) return "its surface needs a z axis";
  bool any = false;
  for (const auto& row : s.z)
    for (const double v : row) {
      if (std::isinf(v)) return "its surface has an infinite value";
      any |= std::isfinite(v);
    }
  return any ? "" : "its surface has no finite value";
}

std::string wrong_matrix(const Matrix& m) {
  const auto n = m.names.size();
  if (n < 2 || m.values.size() != n || std::ranges::any_of(m.values, [&](const auto& row) { return row.size() != n; }))
    return fmt::format("its matrix has {} names and {} rows", n, m.values.size());
  for (const auto& row : m.values)
    for (const double v : row)
      if (std::abs(v) > 1 + 1e-6) return fmt::format("its matrix has the value {}, beyond -1 .. 1", v);
  return "";
}

std::string wrong_heat_map(const Figure& f) {
  const HeatMap& m = *f.heat_map;
  if (m.columns.empty() || m.values.size() != m.rows.size() || m.rows.empty() ||
      std::ranges::any_of(m.values, [&](const auto& row) { return row.size() != m.columns.size(); }))
    return fmt::format("its heat map has {} columns, {} rows and {} rows of values", m.columns.size(), m.rows.size(),
                       m.values.size());
  return f.colour ? "" : "its heat map needs a colour axis";
}

std::string wrong_ranking(const Ranking& r) {
  if (r.names.empty() || r.bars.empty()) return "its ranking is empty";
  bool any = false;
  for (const auto& b : r.bars) {
    if (b.values.size() != r.names.size() || b.low.size() != r.names.size() || b.high.size() != r.names.size())
      return fmt::format("its ranking has {} names and bars of {}, {} and {} numbers", r.names.size(), b.values.size(),
                         b.low.size(), b.high.size());
    any |= std::ranges::any_of(b.values, [](double x) { return std::isfinite(x); });
  }
  return any ? "" : "its ranking has no finite value";
}

std::string wrong_series(const Figure& f, std::size_t index) {
  const Series& s = f.series[index];
  const std::string name = s.label.empty() ? fmt::format("series {}", index + 1) : fmt::format("series '{}'", s.label);
  const bool bars = s.mark == Mark::error_bars;
  if (s.y.size() != s.x.size() || (bars && s.error.size() != s.x.size()) ||
      (s.shade.size() > 1 && s.shade.size() != s.x.size()))
    return fmt::format("{} has {} x, {} y, {} errors and {} shades", name, s.x.size(), s.y.size(), s.error.size(),
                       s.shade.size());
  if (!s.shade.empty() && !f.colour) return fmt::format("{} has shades but the figure no colour axis", name);
  bool any = false;
  for (std::size_t k = 0; k < s.x.size(); ++k) {
    if (std::isinf(s.x[k]) || std::isinf(s.y[k]) || (bars && std::isinf(s.error[k])))
      return fmt::format("{} has an infinite value at point {}", name, k + 1);
    any |= std::isfinite(s.x[k]) && std::isfinite(s.y[k]);
  }
  return any ? "" : fmt::format("{} has no finite value", name);
}

std::string wrong(const Figure& f) {
  if (f.colour && !(f.colour->from && f.colour->to && *f.colour->from < *f.colour->to))
    return "its colour axis needs limits";
  if (f.surface) return wrong_surface(f);
  if (f.matrix) return wrong_matrix(*f.matrix);
  if (f.heat_map) return wrong_heat_map(f);
  if (f.ranking) return wrong_ranking(*f.ranking);
  if (f.series.empty()) return "has nothing to show";
  for (std::size_t i = 0; i < f.series.size(); ++i)
    if (std::string why = wrong_series(f, i); !why.empty()) return why;
  return "";
}

std::string terminal(Format format, FigureSize size) {
  const auto font = [](int points) { return fmt::format("font '{},{}'", theme::picture_font, points); };
  switch (format) {
    case Format::svg:
      return fmt::format("set terminal svg size {},{} enhanced {} background '{}'\n", size.width, size.height, font(13),
                         hex(theme::paper));
    case Format::png:
      return fmt::format("set terminal pngcairo size {},{} enhanced {} fontscale 2 linewidth 2 pointscale 2\n",
                         2 * size.width, 2 * size.height, font(10));
    case Format::pdf:
      return fmt::format("set terminal pdfcairo size {}in,{}in enhanced {} linewidth 1.4\n", size.width / 96.0,
                         size.height / 96.0, font(10));
  }
  return {};
}

/// Palette, frame, grid and type.
std::string frame(const Figure& f, FigureSize size) {
  std::string s = "set encoding utf8\nset palette defined (";
  constexpr int steps = 32;
  for (int i = 0; i <= steps; ++i)
    s += fmt::format("{}{} '{}'", i ? ", " : "", i, hex(viridis(static_cast<double>(i) / steps)));
  s += ")\n";
  s += fmt::format("set title {} noenhanced textcolor '{}'\n", quoted(fitting(f.title, size.width - 60)),
                   hex(theme::ink));
  for (const char* axis : {"x", "y", "z", "cb"})
    s += fmt::format("set {}tics nomirror textcolor '{}'\n", axis, hex(theme::ink));
  s += fmt::format("set border {} linewidth 1 linecolor '{}'\nset tics out scale 0.6\n", f.surface ? 895 : 3,
                   hex(theme::ink_soft));
  s += fmt::format("set grid linecolor '{}' linetype 1 linewidth 1\n", hex(theme::line));
  s += fmt::format("set key tmargin center horizontal samplen 2.5 textcolor '{}'\n", hex(theme::ink));
  s += fmt::format("set xlabel {} textcolor '{}'\nset ylabel {} textcolor '{}'\n", label(f.x, size.width - 40),
                   hex(theme::ink), label(f.y, size.height - 40), hex(theme::ink));
  if (f.same_scale) s += "set size ratio -1\n";
  return s;
}

/// Characters of the longest number at the marks of an axis.
std::size_t longest_mark(const std::vector<double>& marks) {
  std::size_t longest = 0;
  for (const double mark : marks)
    longest = std::max(longest, fmt::format("{:g}", std::abs(mark) < 1e-12 ? 0 : mark).size());
  return longest;
}

/// Whether gnuplot writes any of the marks as 5×10⁷, whose width it does not know.
bool has_powers(const std::vector<double>& marks) {
  return std::ranges::any_of(marks,
                             [](double mark) { return fmt::format("{:g}", mark).find('e') != std::string::npos; });
}

/// Room for the right half of the last mark on x where marks have powers of ten.
std::string room_for_powers(const Axis& axis, Range r) {
  return has_powers(ticks(axis.from.value_or(r.low), axis.to.value_or(r.high), 5)) ? "set rmargin 6\n" : "";
}

/// Fewer marks on x where gnuplot's own would touch.
std::string marks_that_fit(const Axis& axis, Range r, int width) {
  const double from = axis.from.value_or(r.low), to = axis.to.value_or(r.high);
  if (!(from < to)) return "";
  const auto fits = [&](int count) {
    const auto marks = ticks(from, to, count);
    return static_cast<double>(marks.size() * (9 * longest_mark(marks) + 12)) <= width - 110;
  };
  if (fits(10)) return "";
  for (const int count : {6, 4, 3, 2})
    if (const auto marks = ticks(from, to, count); marks.size() > 1 && (fits(count) || count == 2))
      return fmt::format("set xtics {}\n", marks[1] - marks[0]);
  return "";
}

std::string surface(const Figure& f, FigureSize size) {
  std::string s = "$surface << END\n";
  Range z;
  for (std::size_t i = 0; i < f.surface->y.size(); ++i) {
    for (std::size_t k = 0; k < f.surface->x.size(); ++k) {
      z.add(f.surface->z[i][k]);
      s += fmt::format("{} {} {}\n", f.surface->x[k], f.surface->y[i], f.surface->z[i][k]);
    }
    s += '\n';
  }
  s += "END\n";
  s += fmt::format(
      "set cblabel {} textcolor '{}'\nunset key\nset view 60,325,0.95,1.05\nset xyplane 0\nset pm3d depthorder\nset "
      "lmargin at screen 0.22\nset rmargin at screen 0.70\nset colorbox user origin {},0.2 size 0.025,0.6\n",
      label(*f.z, size.height - 100), hex(theme::ink),
      0.85 - 0.018 * static_cast<double>(std::max<std::size_t>(4, longest_mark(ticks(z.low, z.high, 8))) - 4));
  const auto spaced = [](const char* axis, double from, double to, const char* offset) {
    const auto marks = ticks(from, to, 5);
    return marks.size() > 1 ? fmt::format("set {}tics {} offset {}\n", axis, marks[1] - marks[0], offset) : "";
  };
  if (longest_mark(ticks(z.low, z.high, 8)) > 5) s += "set cblabel offset -1.2,0\n";
  s += spaced("x", f.surface->x.front(), f.surface->x.back(), "0,-0.4") +
       spaced("y", f.surface->y.front(), f.surface->y.back(), "-0.6,-0.4") + spaced("z", z.low, z.high, "0,0.2") +
       spaced("cb", z.low, z.high, "0,0");
  const auto beyond = [](const Axis& axis) {  // half of what does not fit beside the corner
    return 0.5 * static_cast<double>(std::max<std::size_t>(14, axis.quantity.size() + axis.unit.size()) - 14);
  };
  s += fmt::format("set xrange [{}:{}]\nset yrange [{}:{}]\nset xlabel offset {},-1.2\nset ylabel offset {},-2.2\n",
                   f.surface->x.front(), f.surface->x.back(), f.surface->y.front(), f.surface->y.back(), -beyond(f.x),
                   1 + beyond(f.y));
  return s + range("z", *f.z, z) + range("cb", *f.z, z) + "splot $surface using 1:2:3 with pm3d\n";
}

/// Lower half, the first name on top; bold from 0.9.
std::string matrix(const Figure& f, FigureSize size) {
  const Matrix& m = *f.matrix;
  const std::size_t n = m.names.size();
  std::string s = fmt::format(
      "set palette defined (-1 '{}', 0 '{}', 1 '{}')\nset cbrange [-1:1]\nset cbtics 0.5\nset cblabel {} textcolor "
      "'{}'\n",
      hex(diverging(-1)), hex(diverging(0)), hex(diverging(1)), label(f.x, size.height - 40), hex(theme::ink));
  s += "unset grid\nunset border\nset tics scale 0\nunset xlabel\nunset ylabel\n";
  for (const char* axis : {"x", "y"}) {
    s += fmt::format("set {}tics (", axis);
    for (std::size_t i = 0; i < n; ++i) s += fmt::format("{}{} {}", i ? ", " : "", quoted(m.names[i]), i);
    s += fmt::format(") noenhanced textcolor '{}'\n", hex(theme::ink));
  }
  const double end = static_cast<double>(n) - 0.5;
  s += fmt::format("set xrange [-0.5:{0}]\nset yrange [{0}:-0.5]\n", end);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k <= i; ++k) {
      const double v = m.values[i][k], x = static_cast<double>(k), y = static_cast<double>(i);
      const Colour fill = i == k || std::isnan(v) ? theme::grid : diverging(v);
      std::string number = i == k ? "1" : std::isnan(v) ? "–" : correlation(v);
      if (i != k && std::abs(v) >= 0.9) number = fmt::format("{{/:Bold {}}}", number);
      s += fmt::format("set object rectangle from {},{} to {},{} fillcolor rgb '{}' fillstyle solid border rgb '{}'\n",
                       x - 0.48, y - 0.47, x + 0.48, y + 0.47, hex(fill), hex(theme::paper));
      s += fmt::format("set label {} at {},{} center front textcolor '{}'\n", quoted("{/*0.9 " + number + "}"), x, y,
                       hex(theme::ink));
    }
  return s + "plot NaN with lines linecolor palette notitle\n";
}

/// Names at 0, 1, 2, ... of an axis; at most `shown` of them.
std::string named_tics(const char* axis, const std::vector<std::string>& names, std::size_t shown, int width,
                       const char* more = "") {
  std::string s = fmt::format("set {}tics {} (", axis, more);
  const std::size_t step = (names.size() + shown - 1) / shown;
  for (std::size_t i = 0; i < names.size(); i += step)
    s += fmt::format("{}{} {}", i ? ", " : "", quoted(fitting(names[i], width)), i);
  return s + fmt::format(") noenhanced textcolor '{}'\n", hex(theme::ink));
}

/// Where the plot ends beside a colour bar, its numbers and its label: gnuplot leaves too little where the numbers are
/// long.
std::string room_for_colours(const Axis& colour, FigureSize size) {
  const auto marks = ticks(*colour.from, *colour.to, 5);
  if (marks.size() > 1 && has_powers(marks))
    return fmt::format("set rmargin at screen {}\nset cbtics {}\nset cblabel offset 2,0\n", 1 - 140.0 / size.width,
                       marks[1] - marks[0]);
  const std::size_t longest = std::max<std::size_t>(5, longest_mark(ticks(*colour.from, *colour.to, 8)));
  return fmt::format("set rmargin at screen {}\n", 1 - (108.0 + 16.0 * static_cast<double>(longest - 5)) / size.width) +
         (longest > 5 && marks.size() > 1
              ? fmt::format("set cbtics {}\nset cblabel offset -1.2,0\n", marks[1] - marks[0])
              : "");
}

std::string heat_map(const Figure& f, FigureSize size) {
  const HeatMap& m = *f.heat_map;
  const double from = *f.colour->from, to = *f.colour->to;
  const auto share = [&](double v) { return (v - from) / (to - from); };
  const auto colour = [&](double v) {
    if (!std::isfinite(v)) return theme::grid;
    return diverging(m.signed_values ? 2 * share(v) - 1 : share(v));
  };
  std::string s = m.signed_values
                      ? fmt::format("set palette defined (-1 '{}', 0 '{}', 1 '{}')\n", hex(diverging(-1)),
                                    hex(diverging(0)), hex(diverging(1)))
                      : fmt::format("set palette defined (0 '{}', 1 '{}')\n", hex(diverging(0)), hex(diverging(1)));
  s += fmt::format("set cbrange [{}:{}]\nset cblabel {} textcolor '{}'\n", from, to, label(*f.colour, size.height - 40),
                   hex(theme::ink));
  s += "unset grid\nunset border\nunset key\nset tics scale 0\n";
  const auto columns = m.columns.size(), rows = m.rows.size();
  const std::size_t fit_rows = static_cast<std::size_t>(std::max(1, (size.height - 110) / 16)),
                    fit_columns = static_cast<std::size_t>(std::max(1, (size.width - 260) / 16));
  std::size_t longest = 0;
  for (const auto& name : m.columns) longest = std::max(longest, name.size());
  const bool upright = longest * columns * 8 > static_cast<std::size_t>(size.width - 260);
  s += named_tics("x", m.columns, fit_columns, 150, upright ? "rotate by 90 right" : "");
  s += named_tics("y", m.rows, fit_rows, 150);
  s += fmt::format("set xrange [-0.5:{}]\nset yrange [{}:-0.5]\n", static_cast<double>(columns) - 0.5,
                   static_cast<double>(rows) - 0.5);
  s += room_for_colours(*f.colour, size);
  const bool numbers = m.numbers && rows <= fit_rows && static_cast<int>(columns) * 48 <= size.width - 260;
  const double gap_x = columns > 40 ? 0 : 0.02, gap_y = rows > 40 ? 0 : 0.02;
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t k = 0; k < columns; ++k) {
      const double v = m.values[i][k], x = static_cast<double>(k), y = static_cast<double>(i);
      const Colour fill = colour(v);
      s += fmt::format("set object rectangle from {},{} to {},{} fillcolor rgb '{}' fillstyle solid noborder\n",
                       x - 0.5 + gap_x, y - 0.5 + gap_y, x + 0.5 - gap_x, y + 0.5 - gap_y, hex(fill));
      if (numbers)
        s += fmt::format("set label {} at {},{} center front textcolor '{}'\n",
                         quoted(std::isfinite(v) ? fmt::format("{:.{}f}", v, m.decimals) : "–"), x, y, hex(theme::ink));
    }
  for (const auto& [row, column] : m.marked)
    s += fmt::format(
        "set object rectangle from {},{} to {},{} front fillstyle empty border linecolor '{}' linewidth 2\n",
        static_cast<double>(column) - 0.47, static_cast<double>(row) - 0.45, static_cast<double>(column) + 0.47,
        static_cast<double>(row) + 0.45, hex(theme::ink));
  return s + "plot NaN with lines linecolor palette notitle\n";
}

std::string ranking(const Figure& f, FigureSize size) {
  const Ranking& r = *f.ranking;
  std::string s, plot;
  Range x;
  x.add(0);
  const double thick = 0.8 / static_cast<double>(r.bars.size());
  for (std::size_t b = 0; b < r.bars.size(); ++b) {
    s += fmt::format("$r{} << END\n", b);
    const Colour fill = theme::stroke(b ? 4 : 0).colour;
    for (std::size_t i = 0; i < r.names.size(); ++i) {
      const auto& bars = r.bars[b];
      if (!std::isfinite(bars.values[i])) {
        s += "NaN NaN NaN NaN NaN\n";
        continue;
      }
      const double middle = static_cast<double>(i) - 0.4 + (static_cast<double>(b) + 0.5) * thick;
      const double low = std::isfinite(bars.low[i]) ? bars.low[i] : bars.values[i],
                   high = std::isfinite(bars.high[i]) ? bars.high[i] : bars.values[i];
      x.add(bars.values[i]), x.add(low), x.add(high);
      s += fmt::format("{} {} {} {} {}\n", bars.values[i], middle, low, high, 0.45 * thick);
    }
    s += "END\n";
    plot += fmt::format(
        "{} $r{} using (0.5*$1):2:(0):1:($2-$5):($2+$5) with boxxyerror fillstyle solid 0.7 noborder "
        "linecolor rgb '{}' {}",
        b ? "," : "plot", b, hex(fill),
        r.bars.size() > 1 ? "title " + quoted(r.bars[b].label) + " noenhanced" : std::string("notitle"));
    plot += fmt::format(
        ", $r{} using 1:2:3:4 with xerrorbars pointtype 7 pointsize 0.35 linewidth 1.4 linecolor rgb "
        "'{}' notitle",
        b, hex(theme::ink));
  }
  s += named_tics("y", r.names, r.names.size(), std::max(150, size.width / 3));
  s += fmt::format("set yrange [{}:-0.6]\nunset ylabel\n", static_cast<double>(r.names.size()) - 0.4);
  s += fmt::format("set arrow from 0,graph 0 to 0,graph 1 nohead linewidth 1 linecolor '{}'\n", hex(theme::ink_soft));
  return s + range("x", f.x, x) + plot + "\n";
}

struct Ranges {
  Range x, y;
};

/// The colour of a series or, where it has several shades, of its point k.
Colour colour_of(const Figure& f, const Series& c, const theme::Stroke& stroke, std::size_t k) {
  if (c.shade.empty()) return stroke.colour;
  return viridis((c.shade[c.shade.size() > 1 ? k : 0] - *f.colour->from) / (*f.colour->to - *f.colour->from));
}

/// Points so many that they are drawn small and translucent.
bool many(const Series& c) { return c.mark == Mark::points && c.x.size() > 1000; }

/// A data block with a row "x y error rgb" for each point; widens the ranges.
std::string data(const Figure& f, const Series& c, const theme::Stroke& stroke, Ranges& ranges) {
  std::string s;
  for (std::size_t k = 0; k < c.x.size(); ++k) {
    if (!(std::isfinite(c.x[k]) && std::isfinite(c.y[k]))) {
      s += "NaN NaN 0 0\n";
      continue;
    }
    const Colour rgb = colour_of(f, c, stroke, k);
    const double spread = c.mark == Mark::error_bars && std::isfinite(c.error[k]) ? c.error[k] : 0;
    ranges.x.add(c.x[k]), ranges.y.add(c.y[k] - spread), ranges.y.add(c.y[k] + spread);
    s += fmt::format("{} {} {} {}\n", c.x[k], c.y[k], spread,
                     (many(c) ? 0xa0000000U : 0U) | static_cast<unsigned>(rgb.r << 16 | rgb.g << 8 | rgb.b));
  }
  return s;
}

double bar_width(const Series& c) { return c.x.size() > 1 ? std::abs(c.x[1] - c.x[0]) : 1; }

/// Columns of the data block and how they are drawn.
std::string look(const Figure& f, const Series& c, const theme::Stroke& stroke) {
  const std::string colour = fmt::format("'{}'", hex(colour_of(f, c, stroke, 0)));
  switch (c.mark) {
    case Mark::line:
      return fmt::format("1:2 with lines linewidth 1.8 linecolor rgb {} dashtype {}", colour,
                         c.shade.empty() ? stroke.dashes : "solid");
    case Mark::reference:
      return fmt::format("1:2 with lines linewidth 1.2 linecolor rgb {} dashtype (6,5)", colour);
    case Mark::points: {
      static constexpr int types[] = {7, 6, 2, 7};  // gnuplot's, in the order of Shape
      return fmt::format("1:2:4 with points pointtype {} pointsize {} linewidth 1.6 linecolor rgb variable",
                         types[static_cast<int>(c.shape)],
                         many(c)                 ? 0.28
                         : c.shape == Shape::dot ? 0.4
                                                 : 0.9);
    }
    case Mark::error_bars:
      return "1:2:3:4 with yerrorbars pointtype 7 pointsize 0.45 linewidth 1.2 linecolor rgb variable";
    case Mark::bars:
      return fmt::format("1:2:({}) with boxes fillstyle solid 0.75 noborder linecolor rgb {}", 0.92 * bar_width(c),
                         colour);
    case Mark::band:
      return fmt::format("1:2 with filledcurves closed fillstyle transparent solid 0.2 noborder linecolor rgb {}",
                         colour);
    case Mark::area:
      return fmt::format(
          "1:2 with filledcurves closed fillstyle transparent solid 0.12 border linewidth 1.6 linecolor rgb {}",
          colour);
  }
  return "";
}

/// Points of a line that has no finite neighbour on either side, which no stroke of it would show.
Series alone(const Series& c) {
  Series points{.mark = Mark::points};
  if (c.mark != Mark::line && c.mark != Mark::reference) return points;
  const auto there = [&c](std::size_t k) { return k < c.x.size() && std::isfinite(c.x[k]) && std::isfinite(c.y[k]); };
  for (std::size_t k = 0; k < c.x.size(); ++k)
    if (there(k) && !there(k + 1) && !(k > 0 && there(k - 1))) points.x.push_back(c.x[k]), points.y.push_back(c.y[k]);
  if (!c.shade.empty()) points.shade = {c.shade.front()};
  return points;
}

std::string curves(const Figure& f, FigureSize size) {
  std::string s, plot, points;
  Ranges ranges;
  std::size_t strokes = 0;
  for (std::size_t i = 0; i < f.series.size(); ++i) {
    const Series& c = f.series[i];
    const theme::Stroke stroke = theme::stroke(stroke_of(c, strokes));
    s += fmt::format("$s{} << END\n{}END\n", i, data(f, c, stroke, ranges));
    if (c.mark == Mark::bars) {
      ranges.y.add(0);
      ranges.x.add(c.x.front() - bar_width(c) / 2), ranges.x.add(c.x.back() + bar_width(c) / 2);
    }
    plot += fmt::format("{} $s{} using {}", i ? "," : "plot", i, look(f, c, stroke));
    plot +=
        c.label.empty() ? " notitle" : fmt::format(" title {} noenhanced", quoted(fitting(c.label, size.width - 130)));
    if (const Series lone = alone(c); !lone.x.empty()) {
      s += fmt::format("$p{} << END\n{}END\n", i, data(f, lone, stroke, ranges));
      points += fmt::format(", $p{} using {} notitle", i, look(f, lone, stroke));
    }
  }
  plot += points;
  s += room_for_powers(f.x, ranges.x);
  if (f.colour) {
    s += fmt::format("set cblabel {} textcolor '{}'\n", label(*f.colour, size.height - 40), hex(theme::ink)) +
         room_for_colours(*f.colour, size) + range("cb", *f.colour, {});
    plot += ", NaN with lines linecolor palette notitle";  // gnuplot draws the colour bar for this curve
  }
  return s + range("x", f.x, ranges.x) + marks_that_fit(f.x, ranges.x, size.width) + range("y", f.y, ranges.y) + plot +
         "\n";
}

/// The drawing of a script. One gnuplot draws them all: its start takes longer than a figure.
Result<std::string> by_gnuplot(const std::string& script) {
  static constexpr std::string_view end = "tribotwin: end of the figure\n";
  thread_local std::optional<Child> gnuplot;
  if (!gnuplot) {
    auto started = Child::start({{"gnuplot", "-d"}, "gnuplot-nox"}, Child::Stdout::answers);
    if (!started) return tl::unexpected(started.error());
    gnuplot.emplace(std::move(*started));
  }
  auto drawn = gnuplot->answer(fmt::format("reset\nundefine $*\n{}\nset output\nset print '-'\nprint {}\n", script,
                                           quoted(std::string(end.substr(0, end.size() - 1)))),
                               end);
  if (!drawn) gnuplot.reset();
  return drawn;
}

}  // namespace

Result<Format> format_of(std::string_view file) {
  for (const auto& [ending, format] : {std::pair{".svg", Format::svg}, {".png", Format::png}, {".pdf", Format::pdf}})
    if (file.ends_with(ending)) return format;
  return tl::unexpected(fmt::format("{}: the name of a figure must end in .svg, .png or .pdf", file));
}

Result<std::string> draw(const Figure& figure, Format format, FigureSize size) {
  if (const std::string why = wrong(figure); !why.empty())
    return work_failed(fmt::format("figure '{}': {}", figure.title, why));
  const std::string script = terminal(format, size) + frame(figure, size) +
                             (figure.surface    ? surface(figure, size)
                              : figure.matrix   ? matrix(figure, size)
                              : figure.heat_map ? heat_map(figure, size)
                              : figure.ranking  ? ranking(figure, size)
                                                : curves(figure, size));
  auto drawn = by_gnuplot(script);
  if (!drawn) return work_failed(fmt::format("figure '{}': {}", figure.title, drawn.error().message));
  return drawn;
}

}  // namespace tribotwin::render
