#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <tribotwin/plugins/thermal/thermal.hpp>

namespace tribotwin::thermal {
namespace {

constexpr Parameter first_order[] = {
    {"R_th", "K/W", 1e-9, 1e9, "steady temperature rise per watt of friction heat", "choice per robot"},
    {"kappa", "s", 1e-3, 1e9, "thermal decay constant (Bittencourt 2012: 3.04 h = 10944 s)", "Bittencourt 2012 3.1.2"},
};
constexpr Parameter second_order[] = {
    {"c1", "K/J", 1e-15, 1e9, "heat gain of the first pole", "Pagani (3)"},
    {"c2", "K/J", 1e-15, 1e9, "heat gain of the second pole", "Pagani (3)"},
    {"t1", "s", 1e-3, 1e9, "time constant of the first pole", "Pagani (3), Hao 2021 table"},
    {"t2", "s", 1e-3, 1e9, "time constant of the second pole", "Pagani (3), Hao 2021 table"},
};

constexpr ModelInfo table[] = {
    {.order = Order::prescribed,
     .name = "prescribed",
     .meaning = "the temperature is set from outside, T_amb until then",
     .nodes = 0,
     .parameters = {},
     .place = [](std::span<const double>, Model&) {},
     .values = [](const Model&) { return std::vector<double>{}; }},
    {.order = Order::first,
     .name = "first_order",
     .meaning = "",
     .nodes = 1,
     .parameters = first_order,
     .place = [](std::span<const double> v, Model& m) { m.t_s[0] = v[1], m.gain_K_J[0] = v[0] / v[1]; },
     .values =
         [](const Model& m) {
           return std::vector{m.resistance_K_W(), m.t_s[0]};
         }},
    {.order = Order::second,
     .name = "second_order",
     .meaning = "",
     .nodes = 2,
     .parameters = second_order,
     .place =
         [](std::span<const double> v, Model& m) {
           for (int i = 0; i < 2; ++i) m.gain_K_J[i] = v[i], m.t_s[i] = v[2 + i];
         },
     .values =
         [](const Model& m) {
           return std::vector{m.gain_K_J[0], m.gain_K_J[1], m.t_s[0], m.t_s[1]};
         }},
};
static_assert(std::ranges::all_of(table, [](const ModelInfo& row) { return &row - table == int(row.order); }));

/// When the total rise at constant power stops rising or falling; infinite where it does not.
double turning_time_s(const Model& model, const Rise& rise, double power_W, double ambient_offset_K) {
  constexpr double never = std::numeric_limits<double>::infinity();
  double slope[2];  // of each node now [K/s]
  for (int i : {0, 1})
    slope[i] = model.gain_K_J[i] * power_W + (model.share(i) * ambient_offset_K - rise.node_K[i]) / model.t_s[i];
  const double rate_1_s = 1 / model.t_s[0] - 1 / model.t_s[1];
  if (slope[0] * slope[1] >= 0 || rate_1_s == 0) return never;
  const double turn_s = std::log(-slope[0] / slope[1]) / rate_1_s;
  return turn_s > 0 ? turn_s : never;
}

}  // namespace

std::span<const ModelInfo> models() { return table; }

const ModelInfo& info(Order order) { return table[static_cast<std::size_t>(order)]; }

const ModelInfo* find_model(std::string_view name) {
  const auto found = std::ranges::find(table, name, &ModelInfo::name);
  return found == std::end(table) ? nullptr : found;
}

std::string model_names() {
  std::string names;
  for (const ModelInfo& row : table) {
    if (&row != table) names += &row == std::end(table) - 1 ? " or " : ", ";
    names += row.name;
  }
  return names;
}

std::string_view name(Order order) { return info(order).name; }
std::span<const Parameter> parameters(Order order) { return info(order).parameters; }

double Model::fastest_s() const { return info(order).nodes < 2 ? t_s[0] : std::min(t_s[0], t_s[1]); }
double Model::slowest_s() const { return info(order).nodes < 2 ? t_s[0] : std::max(t_s[0], t_s[1]); }

Model make_model(Order order, double T_amb_degC, std::span<const double> values) {
  Model model{.order = order, .T_amb_degC = T_amb_degC};
  info(order).place(values, model);
  return model;
}

std::vector<double> values(const Model& model) { return info(model.order).values(model); }

double time_to_reach_s(const Model& model, const Rise& rise, double power_W, double ambient_offset_K, double total_K) {
  constexpr double never = std::numeric_limits<double>::infinity();
  if (rise.total_K() >= total_K) return 0;
  if (model.order == Order::prescribed) return never;
  const auto at = [&](double time_s) {
    Rise then = rise;
    step(model, decay(model, time_s), power_W, ambient_offset_K, then);
    return then.total_K();
  };
  // A sum of two exponentials turns once at most.
  const double end_s = 50 * model.slowest_s(), turn_s = turning_time_s(model, rise, power_W, ambient_offset_K);
  for (auto [from_s, to_s] : {std::pair(0.0, std::min(turn_s, end_s)), std::pair(std::min(turn_s, end_s), end_s)}) {
    if (at(to_s) < total_K) continue;
    for (int i = 0; i < 100; ++i) {
      const double middle_s = (from_s + to_s) / 2;
      (at(middle_s) < total_K ? from_s : to_s) = middle_s;
    }
    return to_s;
  }
  return never;
}

}  // namespace tribotwin::thermal
