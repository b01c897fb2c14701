#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/portable/drive_range.hpp>

namespace tribotwin::twin {

Result<double> fastest_rad_s(const drive::Drive& d, std::optional<double> given) {
  const double fastest = given.value_or(d.law.range.speed_max_rad_s / d.speed_scale());
  if (!std::isfinite(fastest))
    return tl::unexpected(Error("its law has no end of speed; give the fastest joint speed (--joint-speed)"));
  return fastest;
}

Result<void> require_identified_at(const drive::Drive& d, double temperature_degC) {
  const double low = d.law.range.temperature_min_degC, high = d.law.range.temperature_max_degC;
  if (!d.law.info->temperature_dependent || (temperature_degC >= low && temperature_degC <= high)) return {};
  return tl::unexpected(
      Error(fmt::format("the law is identified for {:g} .. {:g} degC, not for {:g} degC; choose a temperature within "
                        "(--temperature)",
                        low, high, temperature_degC)));
}

double largest_load_nm(const drive::Drive& d) {
  double most = d.law.info->load_dependent ? std::min(d.law.range.load_max, 1.0) : 0;
  for (const double load : d.load_table.loads) most = std::max(most, std::abs(load));
  return most * d.torque_max_nm;
}

}  // namespace tribotwin::twin
