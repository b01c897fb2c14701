#include <algorithm>
#include <cmath>

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

Decay decay(const Model& model, double dt_s) {
  return {dt_s, {-std::expm1(-dt_s / model.t_s[0]), -std::expm1(-dt_s / model.t_s[1])}};
}

Rise steady_rise(const Model& model, double total_K) {
  if (model.order == Order::prescribed) return {{total_K, 0}};
  return {{total_K * model.share(0), total_K * model.share(1)}};
}

}  // namespace tribotwin::thermal
