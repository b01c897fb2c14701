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

std::string label(const Axis& axis) {
  return quoted(
      fmt::format("{}{}{} [{}]", plain(axis.quantity), axis.symbol.empty() ? "" : " ", axis.symbol, plain(axis.unit)));
}

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double v) {
    if (std::isfinite(v)) low = std::min(low, v), high = std::max(high, v);
  }
};

/// gnuplot widens a range to its tics, and warns about one without extent.
std::string range(const char* name, const Axis& axis, Range r) {
  if (!axis.from && !axis.to && r.low < r.high) return "";
  double from = axis.from.value_or(r.low), to = axis.to.value_or(r.high);
  if (!(from < to)) {
    const double pad = from == 0 ? 1 : 0.1 * std::abs(from);
    from -= pad, to += pad;
  }
  return fmt::format("set {}range [{}:{}]\n", name, from, to);
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
  s += fmt::format("set xlabel {} textcolor '{}'\nset ylabel {} textcolor '{}'\n", label(f.x), hex(theme::ink),
                   label(f.y), hex(theme::ink));
  if (f.same_scale) s += "set size ratio -1\n";
  return s;
}

std::string surface(const Figure& f) {
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
      "lmargin at screen 0.22\nset rmargin at screen 0.70\nset colorbox user origin 0.85,0.2 size 0.025,0.6\n",
      label(*f.z), hex(theme::ink));
  const auto spaced = [](const char* axis, double from, double to, const char* offset) {
    const auto marks = ticks(from, to, 5);
    return marks.size() > 1 ? fmt::format("set {}tics {} offset {}\n", axis, marks[1] - marks[0], offset) : "";
  };
  s += spaced("x", f.surface->x.front(), f.surface->x.back(), "0,-0.4") +
       spaced("y", f.surface->y.front(), f.surface->y.back(), "-0.6,-0.4") + spaced("z", z.low, z.high, "0,0.2") +
       spaced("cb", z.low, z.high, "0,0");
  s += fmt::format("set xrange [{}:{}]\nset yrange [{}:{}]\nset xlabel offset 0,-1.2\nset ylabel offset 1,-2.2\n",
                   f.surface->x.front(), f.surface->x.back(), f.surface->y.front(), f.surface->y.back());
  return s + range("z", *f.z, z) + range("cb", *f.z, z) + "splot $surface using 1:2:3 with pm3d\n";
}

/// Lower half, the first name on top; bold from 0.9.
std::string matrix(const Figure& f) {
  const Matrix& m = *f.matrix;
  const std::size_t n = m.names.size();
  std::string s = fmt::format(
      "set palette defined (-1 '{}', 0 '{}', 1 '{}')\nset cbrange [-1:1]\nset cbtics 0.5\nset cblabel {} textcolor "
      "'{}'\n",
      hex(diverging(-1)), hex(diverging(0)), hex(diverging(1)), label(f.x), hex(theme::ink));
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
      if (i != k && std::abs(v) >= 0.9) number = "{/:Bold " + number + "}";
      s += fmt::format("set object rectangle from {},{} to {},{} fillcolor rgb '{}' fillstyle solid border rgb '{}'\n",
                       x - 0.48, y - 0.47, x + 0.48, y + 0.47, hex(fill), hex(theme::paper));
      s += fmt::format("set label {} at {},{} center front textcolor '{}'\n", quoted("{/*0.9 " + number + "}"), x, y,
                       hex(theme::ink));
    }
  return s + "plot NaN with lines linecolor palette notitle\n";
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
      static constexpr int types[] = {7, 6, 2};  // gnuplot's, in the order of Shape
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
    case Mark::area:
      return fmt::format(
          "1:2 with filledcurves closed fillstyle transparent solid 0.12 border linewidth 1.6 linecolor rgb {}",
          colour);
  }
  return "";
}

std::string curves(const Figure& f, FigureSize size) {
  std::string s, plot;
  Ranges ranges;
  std::size_t strokes = 0;
  for (std::size_t i = 0; i < f.series.size(); ++i) {
    const Series& c = f.series[i];
    const theme::Stroke stroke = theme::stroke(c.stroke ? *c.stroke : c.label.empty() ? strokes : strokes++);
    s += fmt::format("$s{} << END\n{}END\n", i, data(f, c, stroke, ranges));
    if (c.mark == Mark::bars) {
      ranges.y.add(0);
      ranges.x.add(c.x.front() - bar_width(c) / 2), ranges.x.add(c.x.back() + bar_width(c) / 2);
    }
    plot += fmt::format("{} $s{} using {}", i ? "," : "plot", i, look(f, c, stroke));
    plot +=
        c.label.empty() ? " notitle" : fmt::format(" title {} noenhanced", quoted(fitting(c.label, size.width - 130)));
  }
  if (f.colour) {
    // Room for the bar, its numbers and its label: gnuplot leaves too little where the numbers are long.
    s += fmt::format("set cblabel {} textcolor '{}'\nset rmargin at screen {}\n", label(*f.colour), hex(theme::ink),
                     1 - 108.0 / size.width) +
         range("cb", *f.colour, {});
    plot += ", NaN with lines linecolor palette notitle";  // gnuplot draws the colour bar for this curve
  }
  return s + range("x", f.x, ranges.x) + range("y", f.y, ranges.y) + plot + "\n";
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
                             (figure.surface  ? surface(figure)
                              : figure.matrix ? matrix(figure)
                                              : curves(figure, size));
  auto drawn = run({{"gnuplot", "-d"}, "gnuplot-nox"}, script);
  if (!drawn) return work_failed(fmt::format("figure '{}': {}", figure.title, drawn.error().message));
  return drawn;
}

}  // namespace tribotwin::render
