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
#include <tribotwin/twin/io/json.hpp>

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

/// The whole line, which sliders move, with its band between lines at the ends of the first input that can be chosen.
class Curves {
 public:
  Curves(const drive::Drive& drive, double speed_max_rad_s, const Inputs& in, const friction::Uncertainty* uncertainty)
      : drive_(drive), speed_max_(speed_max_rad_s), in_(in), uncertainty_(uncertainty) {}

  Figure figure() const {
    const double T = in_.temperature_degC(), l = in_.load_norm();
    Figure f = in_.warms() ? at_temperatures(std::array{in_.temperature.low, T, in_.temperature.high}, l, nullptr)
                           : at_loads(std::array{in_.load.low, l, in_.load.high}, T);
    f.colour.reset();
    const std::array<std::string, 3> labels = {in_.label(in_.temperature.low, in_.warms() ? l : in_.load.low),
                                               in_.label(T, l),
                                               in_.label(in_.temperature.high, in_.warms() ? l : in_.load.high)};
    for (std::size_t i = 0; i < f.series.size(); ++i) {
      f.series[i].shade.clear();
      f.series[i].mark = i == 1 ? Mark::line : Mark::reference;
      f.series[i].label = labels[i];
      f.series[i].stroke = i == 1 ? 0 : i + 2;
    }
    f.y.from = 0;
    f.y.to = axis_end(highest());
    if (uncertainty_) f.series.insert(f.series.begin(), band(T, l));
    return f;
  }

 private:
  Figure at_temperatures(std::span<const double> temperatures, double load, const friction::Uncertainty* sure) const {
    return friction_against_temperature(drive_, "What if: friction over speed", speed_max_, load, temperatures, {},
                                        sure);
  }
  Figure at_loads(std::span<const double> loads, double temperature) const {
    return friction_against_load(drive_, "What if: friction over speed", speed_max_, temperature, loads);
  }

  Series band(double temperature, double load) const {
    Series band = at_temperatures(std::array{temperature}, load, uncertainty_).series.front();
    band.shade.clear();
    return band;
  }

  /// Wherever the sliders are; bands as far as they are not wider than their curves are high.
  double highest() const {
    double line = 0, any = 0;
    for (const double load : {in_.load.low, in_.load.high})
      for (const auto& s :
           at_temperatures(std::array{in_.temperature.low, in_.temperature_degC(), in_.temperature.high}, load,
                           uncertainty_)
               .series) {
        any = std::max(any, std::ranges::max(s.y));
        if (s.mark == Mark::line) line = std::max(line, std::ranges::max(s.y));
      }
    return std::min(any, 2 * line);
  }

  const drive::Drive& drive_;
  double speed_max_;
  const Inputs& in_;
  const friction::Uncertainty* uncertainty_;
};

/// As the kernel takes numbers.
template <class Numbers>
std::string_view bytes_of(const Numbers& numbers) {
  return {reinterpret_cast<const char*>(&numbers), sizeof numbers};
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
  figure.append_attribute("data-what-if") = twin::dump_json(all).c_str();
  page.allow_kernel();
}

Result<void> show_what_if(IllustratedPage& page, const drive::Drive& drive, double speed_max_rad_s, Choice temperature,
                          Choice load, const friction::Uncertainty* uncertainty) {
  const Inputs in{temperature, load};
  if (kernel_files().empty() || (!in.warms() && !in.loads())) return {};
  page.add(page.body(), "h2", "What if");
  auto grid = page.add(page.body(), "div", {}, "figures");
  if (auto ok = page.show(
          grid, Curves(drive, speed_max_rad_s, in, uncertainty).figure(), "what_if",
          fmt::format("Law '{}' as 'tribotwin curve' evaluates it. On a screen with scripts, sliders move the whole "
                      "line{}; the dashed lines stay.",
                      drive.law.info->name, uncertainty ? " with its band, where the law is with 95 % confidence" : ""),
          Width::wide);
      !ok)
    return ok;
  const auto law = kernel::numbers_of(drive.law);
  std::vector numbers{bytes_of(law)};
  if (uncertainty) numbers.push_back(bytes_of(*uncertainty));
  const std::array sliders{Slider{"temperature", "°C", temperature.low, temperature.high, in.temperature_degC(), 1},
                           Slider{"load", "", load.low, load.high, in.load_norm(), 2}};
  add_sliders(page, grid, "law", sliders, numbers);
  return {};
}

}  // namespace tribotwin::render
