#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/page/kernel.hpp>
#include <tribotwin/render/page/what_if.hpp>

namespace tribotwin::render {
namespace {

static_assert(std::endian::native == std::endian::little, "pages carry numbers as browsers have them");

/// Of the two inputs of a law those that can be chosen, with what the curve is drawn at.
struct Inputs {
  Choice temperature, load;

  bool warms() const { return temperature.high > temperature.low; }
  bool loads() const { return load.high > load.low; }
  double temperature_degC() const { return (temperature.low + temperature.high) / 2; }
  double load_norm() const { return (load.low + load.high) / 2; }
  std::string label(double T, double l) const {
    std::string text = warms() ? fmt::format("{:.1f} °C", T) : "";
    if (loads()) text += fmt::format("{}load {:.2f}", text.empty() ? "" : ", ", l);
    return text;
  }
};

/// The end of an axis from 0 that holds y: two digits, rounded up.
double axis_end(double y) {
  if (!(y > 0)) return 1;
  const double digit = std::pow(10, std::floor(std::log10(y)) - 1);
  return digit * std::ceil(y / digit);
}

/// The curve at the middle of both inputs, between those at the ends of the first one that can be chosen.
Figure curves(const drive::Drive& drive, double speed_max_rad_s, const Inputs& in) {
  const double T = in.temperature_degC(), l = in.load_norm();
  const auto at_temperatures = [&](double load) {
    return friction_against_temperature(drive, "What if: friction over speed", speed_max_rad_s, load,
                                        std::array{in.temperature.low, T, in.temperature.high});
  };
  Figure f = in.warms() ? at_temperatures(l)
                        : friction_against_load(drive, "What if: friction over speed", speed_max_rad_s, T,
                                                std::array{in.load.low, l, in.load.high});
  f.colour.reset();
  const std::array<std::string, 3> labels = {in.label(in.temperature.low, in.warms() ? l : in.load.low), in.label(T, l),
                                             in.label(in.temperature.high, in.warms() ? l : in.load.high)};
  for (std::size_t i = 0; i < f.series.size(); ++i) {
    f.series[i].shade.clear();
    f.series[i].mark = i == 1 ? Mark::line : Mark::reference;
    f.series[i].label = labels[i];
    f.series[i].stroke = i == 1 ? 0 : i + 2;
  }
  double highest = 0;
  for (const double load : {in.load.low, in.load.high})
    for (const auto& s : in.warms() ? at_temperatures(load).series : f.series)
      highest = std::max(highest, std::ranges::max(s.y));
  f.y.from = 0;
  f.y.to = axis_end(highest);
  return f;
}

}  // namespace

void add_sliders(IllustratedPage& page, pugi::xml_node grid, const char* kind, std::span<const Slider> sliders,
                 std::span<const std::string_view> numbers, const nlohmann::json& more) {
  nlohmann::json all{{"kind", kind}, {"more", more}};
  for (const Slider& s : sliders)
    all["sliders"].push_back({{"name", s.name},
                              {"unit", s.unit},
                              {"from", s.from},
                              {"to", s.to},
                              {"value", s.value},
                              {"decimals", s.decimals}});
  for (const auto bytes : numbers) all["numbers"].push_back(base64(bytes));
  auto figure = grid.last_child();
  figure.append_attribute("data-kernel") = base64(kernel_files()[0].content).c_str();
  figure.append_attribute("data-what-if") = all.dump().c_str();
  page.allow_kernel();
}

Result<void> show_what_if(IllustratedPage& page, const drive::Drive& drive, double speed_max_rad_s, Choice temperature,
                          Choice load) {
  const Inputs in{temperature, load};
  if (kernel_files().empty() || (!in.warms() && !in.loads())) return {};
  page.add(page.body(), "h2", "What if");
  auto grid = page.add(page.body(), "div", {}, "figures");
  if (auto ok = page.show(
          grid, curves(drive, speed_max_rad_s, in), "what_if",
          fmt::format("Law '{}' as 'tribotwin curve' evaluates it. On a screen with scripts, sliders move the whole "
                      "line; the dashed lines stay.",
                      drive.law.info->name),
          Width::wide);
      !ok)
    return ok;
  const auto numbers = kernel::numbers_of(drive.law);
  const std::string_view bytes(reinterpret_cast<const char*>(&numbers), sizeof numbers);
  const std::array sliders{Slider{"temperature", "°C", temperature.low, temperature.high, in.temperature_degC(), 1},
                           Slider{"load", "", load.low, load.high, in.load_norm(), 2}};
  add_sliders(page, grid, "law", sliders, std::array{bytes});
  return {};
}

}  // namespace tribotwin::render
