#include <cmath>
#include <cstdlib>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/render/page/figure_data.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::render {
namespace {

using nlohmann::json;

/// null where it is no number.
json rounded(double value) {
  if (!std::isfinite(value)) return nullptr;
  return std::strtod(fmt::format("{:.7g}", value).c_str(), nullptr);
}

json numbers(const std::vector<double>& values) {
  json out = json::array();
  for (const double value : values) out.push_back(rounded(value));
  return out;
}

json axis(const Axis& a) {
  json out{{"quantity", printable(a.quantity)}, {"symbol", a.symbol}, {"unit", printable(a.unit)}};
  if (a.from) out["from"] = rounded(*a.from);
  if (a.to) out["to"] = rounded(*a.to);
  return out;
}

const char* name(Mark mark) {
  switch (mark) {
    case Mark::line:
      return "line";
    case Mark::reference:
      return "reference";
    case Mark::points:
      return "points";
    case Mark::error_bars:
      return "error_bars";
    case Mark::bars:
      return "bars";
    case Mark::area:
      return "area";
    case Mark::band:
      return "band";
  }
  return "";
}

/// Of SVG: "12 4"; empty for a whole line.
std::string dashes(std::string_view gnuplot) {
  std::string out;
  if (gnuplot.starts_with('('))
    for (const char c : gnuplot.substr(1, gnuplot.size() - 2)) out += c == ',' ? ' ' : c;
  return out;
}

json series(const Series& s, std::size_t index) {
  static constexpr const char* shapes[] = {"dot", "circle", "cross", "disc"};  // in the order of Shape
  return {{"mark", name(s.mark)},
          {"label", printable(s.label)},
          {"stroke", index % theme::strokes},
          {"dash", dashes(theme::stroke(index).dashes)},
          {"shape", shapes[static_cast<int>(s.shape)]},
          {"x", numbers(s.x)},
          {"y", numbers(s.y)},
          {"error", numbers(s.error)},
          {"shade", numbers(s.shade)}};
}

}  // namespace

std::string figure_data(const Figure& f) {
  if (f.surface || f.matrix || f.heat_map || f.ranking || f.same_scale) return "";
  json all = json::array();
  std::size_t counted = 0;
  for (const Series& s : f.series) all.push_back(series(s, stroke_of(s, counted)));
  json data{{"title", printable(f.title)}, {"x", axis(f.x)}, {"y", axis(f.y)}, {"series", std::move(all)}};
  if (f.colour) data["colour"] = axis(*f.colour);
  std::string out;
  for (const char c : twin::dump_json(data))
    if (c == '<' || c == '>' || c == '&' || c == '\'')
      out += fmt::format("\\u{:04x}", static_cast<int>(c));
    else
      out += c;
  return out;
}

}  // namespace tribotwin::render
