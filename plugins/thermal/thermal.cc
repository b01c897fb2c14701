#include <cmath>

#include <tribotwin/plugins/thermal/thermal.hpp>

namespace tribotwin::thermal {
namespace {

constexpr Order all_orders[] = {Order::prescribed, Order::first, Order::second};

constexpr Parameter first_order[] = {
    {"R_th", "K/W", 1e-9, 1e9, "steady temperature rise per watt of friction heat", "choice per robot"},
    {"kappa", "s", 1e-3, 1e9, "thermal decay constant (P1: 3.04 h = 10944 s)", "P1 3.1.2"},
};
constexpr Parameter second_order[] = {
    {"c1", "K/J", 1e-15, 1e9, "heat gain of the first pole", "P5 (3)"},
    {"c2", "K/J", 1e-15, 1e9, "heat gain of the second pole", "P5 (3)"},
    {"t1", "s", 1e-3, 1e9, "time constant of the first pole", "P5 (3), P3 table"},
    {"t2", "s", 1e-3, 1e9, "time constant of the second pole", "P5 (3), P3 table"},
};

}  // namespace

std::string_view name(Order order) {
  switch (order) {
    case Order::prescribed:
      return "prescribed";
    case Order::first:
      return "first_order";
    case Order::second:
      return "second_order";
  }
  return {};
}

std::span<const Order> orders() { return all_orders; }

std::span<const Parameter> parameters(Order order) {
  switch (order) {
    case Order::prescribed:
      return {};
    case Order::first:
      return first_order;
    case Order::second:
      return second_order;
  }
  return {};
}

Model make_model(Order order, double T_amb_degC, std::span<const double> v) {
  Model model{.order = order, .T_amb_degC = T_amb_degC};
  if (order == Order::first) {
    model.t_s[0] = v[1];
    model.gain_K_J[0] = v[0] / v[1];
  } else if (order == Order::second) {
    for (int i = 0; i < 2; ++i) {
      model.gain_K_J[i] = v[i];
      model.t_s[i] = v[2 + i];
    }
  }
  return model;
}

std::vector<double> values(const Model& model) {
  if (model.order == Order::first) return {model.resistance_K_W(), model.t_s[0]};
  if (model.order == Order::second) return {model.gain_K_J[0], model.gain_K_J[1], model.t_s[0], model.t_s[1]};
  return {};
}

Decay decay(const Model& model, double dt_s) {
  return {dt_s, {-std::expm1(-dt_s / model.t_s[0]), -std::expm1(-dt_s / model.t_s[1])}};
}

Rise settled(const Model& model, double total_K) {
  if (model.order == Order::prescribed) return {{total_K, 0}};
  return {{total_K * model.share(0), total_K * model.share(1)}};
}

}  // namespace tribotwin::thermal
