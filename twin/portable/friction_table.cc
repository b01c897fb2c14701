#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/portable/drive_range.hpp>
#include <tribotwin/twin/portable/friction_table.hpp>

namespace tribotwin::twin {
namespace {

using Axis = std::vector<double>;

constexpr int speeds_per_direction = 32, load_count = 11;
constexpr double decades = 4, between_temperatures_K = 5;

Axis even(double low, double high, int count) {
  Axis axis;
  for (int i = 0; i < count; ++i) axis.push_back(low + (high - low) * i / (count - 1));
  axis.back() = high;
  return axis;
}

/// With the sign of the speed, arm side [Nm].
double signed_nm(const drive::Drive& d, const friction::AtTemperature& at, double speed_rad_s, double load_nm) {
  return std::copysign(drive::friction_nm(d, at, speed_rad_s, load_nm / d.torque_max_nm), speed_rad_s);
}

Result<Axis> speeds(const drive::Drive& d, std::optional<double> speed_max_rad_s) {
  const auto fastest = fastest_rad_s(d, speed_max_rad_s);
  if (!fastest) return tl::unexpected(fastest.error());
  Axis axis;
  for (int i = 0; i < speeds_per_direction; ++i)
    axis.push_back(-*fastest * std::pow(10, -decades * i / (speeds_per_direction - 1)));
  for (int i = speeds_per_direction - 1; i >= 0; --i) axis.push_back(-axis[static_cast<std::size_t>(i)]);
  return axis;
}

Axis loads(const drive::Drive& d) {
  const double most_nm = largest_load_nm(d);
  return most_nm > 0 ? even(-most_nm, most_nm, load_count) : Axis{0};
}

Result<Axis> temperatures(const drive::Drive& d, std::optional<double> temperature_degC) {
  const double low = d.law.range.temperature_min_degC, high = d.law.range.temperature_max_degC;
  if (!d.law.info->temperature_dependent) return Axis{temperature_degC.value_or(d.thermal.T_amb_degC)};
  if (temperature_degC) {
    if (auto ok = require_identified_at(d, *temperature_degC); !ok) return tl::unexpected(ok.error());
    return Axis{*temperature_degC};
  }
  if (!std::isfinite(low) || !std::isfinite(high))
    return tl::unexpected(Error("its law has no range of temperature; give one temperature (--temperature)"));
  return high > low ? even(low, high, static_cast<int>(std::ceil((high - low) / between_temperatures_K)) + 1)
                    : Axis{low};
}

/// The values of a full grid.
struct Grid {
  Axis speed, load, temperature;
  std::vector<double> values;
  double at(std::size_t s, std::size_t l, std::size_t t) const {
    return values[(s * load.size() + l) * temperature.size() + t];
  }
};

double centre(const Axis& axis, std::size_t i) { return i + 1 < axis.size() ? (axis[i] + axis[i + 1]) / 2 : axis[i]; }
std::size_t cells(const Axis& axis) { return std::max<std::size_t>(axis.size() - 1, 1); }

double interpolation_error_nm(const drive::Drive& d, const Grid& g) {
  double most = 0;
  for (std::size_t t = 0; t < cells(g.temperature); ++t) {
    const auto at = friction::at_temperature(d.law, centre(g.temperature, t));
    for (std::size_t s = 0; s + 1 < g.speed.size(); ++s)
      for (std::size_t l = 0; l < cells(g.load); ++l) {
        if (g.speed[s] < 0 && g.speed[s + 1] > 0) continue;  // between the directions
        double sum = 0;
        for (int corner = 0; corner < 8; ++corner)
          sum += g.at(s + (corner & 1), std::min(l + (corner >> 1 & 1), g.load.size() - 1),
                      std::min(t + (corner >> 2), g.temperature.size() - 1));
        const double truth = signed_nm(d, at, centre(g.speed, s), centre(g.load, l));
        most = std::max(most, std::abs(sum / 8 - truth));
      }
  }
  return most;
}

std::string lost_of(const drive::Drive& d) {
  std::string lost = "sticking";
  if (d.dynamics != drive::Dynamics::none) lost += ", bristles (presliding, hysteresis)";
  if (d.thermal.order != thermal::Order::prescribed) lost += ", heat: temperature is an input";
  if (d.winding.present()) lost += ", the winding: its heat and the current limit";
  if (d.load_filter_s > 0) lost += ", the filter of the load";
  if (d.offset_nm != 0) lost += fmt::format(", the offset of {:g} Nm", d.offset_nm);
  return lost + ", faults";
}

}  // namespace

Result<FrictionTable> friction_table(const drive::Drive& d, std::optional<double> temperature_degC,
                                     std::optional<double> speed_max_rad_s) {
  const auto speed = speeds(d, speed_max_rad_s);
  if (!speed) return tl::unexpected(speed.error());
  const auto temperature = temperatures(d, temperature_degC);
  if (!temperature) return tl::unexpected(temperature.error());
  Grid g{*speed, loads(d), *temperature, {}};
  std::vector<friction::AtTemperature> at;
  for (const double T : g.temperature) at.push_back(friction::at_temperature(d.law, T));
  FrictionTable table{.csv = "speed_rad_s,load_nm,temperature_degC,friction_nm\n"};
  for (const double w : g.speed)
    for (const double load : g.load)
      for (std::size_t t = 0; t < at.size(); ++t) {
        g.values.push_back(signed_nm(d, at[t], w, load));
        table.csv += fmt::format("{},{},{},{}\n", w, load, g.temperature[t], g.values.back());
      }
  table.rows = g.values.size();
  table.slowest_rad_s = g.speed[g.speed.size() / 2];
  table.error_nm = interpolation_error_nm(d, g);
  table.lost = lost_of(d);
  return table;
}

}  // namespace tribotwin::twin
