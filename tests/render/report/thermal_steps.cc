// Temperatures of a joint after each of COUNT steps of thermal::step at constant power, to compare with the kernel of
// pages. Arguments: first_order|second_order, T_amb [degC], ambient [degC], start [degC], power [W], dt [s], COUNT, and
// the model's parameters in their order.
#include <cstdlib>
#include <span>
#include <vector>

#include <fmt/core.h>

#include <tribotwin/plugins/thermal/thermal.hpp>

int main(int argc, char** argv) {
  namespace thermal = tribotwin::thermal;
  const auto* info = argc > 7 ? thermal::find_model(argv[1]) : nullptr;
  if (!info || argc != 8 + static_cast<int>(info->parameters.size())) return 2;
  std::vector<double> values;
  for (int i = 2; i < argc; ++i) values.push_back(std::strtod(argv[i], nullptr));
  const double T_amb_degC = values[0], ambient_degC = values[1], start_degC = values[2];
  const auto model = thermal::make_model(info->order, T_amb_degC, std::span(values).subspan(6));
  const auto decay = thermal::decay(model, values[4]);
  auto rise = thermal::steady_rise(model, start_degC - T_amb_degC);
  for (int i = 0; i < static_cast<int>(values[5]); ++i) {
    thermal::step(model, decay, values[3], ambient_degC - T_amb_degC, rise);
    fmt::print("{:.17g}\n", T_amb_degC + rise.total_K());
  }
}
