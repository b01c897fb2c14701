#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

/// Lubricant temperature of one joint from the heat its friction makes.
///
/// The state is the temperature rise over ambient, split over up to two relaxing nodes,
///
///   dx_i/dt = g_i P - x_i / t_i + w_i dT_amb / t_i,     T = T_amb + x_1 + x_2
///
/// first order (Bittencourt 2012): one node, t = kappa, g = R_th / kappa; second order (Pagani (3)): g_i = c_i, t_i;
/// prescribed: no node changes by itself, and T is set from outside. A later change dT_amb of the ambient temperature
/// enters through the nodes, each with its share w_i of the total gain, so the oil never jumps. Steps use the exact
/// zero-order-hold solution and are stable for any dt.
namespace tribotwin::thermal {

/// The models, by the row of `models()`.
enum class Order { prescribed, first, second };

inline constexpr int max_nodes = 2;

struct Parameter {
  std::string_view name, unit;
  double minimum, maximum;
  std::string_view meaning, source;
};

struct Model {
  Order order = Order::prescribed;
  double T_amb_degC = 25;
  /// Relaxation times [s] and heat gains [K/(W s)]; an unused node has gain 0.
  double t_s[max_nodes] = {1, 1};
  double gain_K_J[max_nodes] = {0, 0};

  /// Steady rise per power [K/W].
  double resistance_K_W() const { return gain_K_J[0] * t_s[0] + gain_K_J[1] * t_s[1]; }
  /// Shortest and longest relaxation time of the nodes in use [s].
  double fastest_s() const;
  double slowest_s() const;
  /// Share of the steady rise that node i carries.
  double share(int i) const { return order == Order::prescribed ? 0 : gain_K_J[i] * t_s[i] / resistance_K_W(); }
};

/// One row per thermal model; MJCF, YAML, messages and documentation follow from the table.
struct ModelInfo {
  Order order;
  std::string_view name;                  ///< as in MJCF and YAML
  std::string_view meaning;               ///< where there are no parameters to explain it
  int nodes;                              ///< that relax
  std::span<const Parameter> parameters;  ///< T_amb aside
  void (*place)(std::span<const double> parameters, Model& model);
  std::vector<double> (*values)(const Model& model);  ///< the inverse of `place`
};
/// All models, in the order of `Order` and of the documentation.
std::span<const ModelInfo> models();
const ModelInfo& info(Order order);
const ModelInfo* find_model(std::string_view name);
/// "prescribed, first_order or second_order", for messages and documentation.
std::string model_names();

std::string_view name(Order order);
/// The parameters a model takes, T_amb aside.
std::span<const Parameter> parameters(Order order);

/// A model from the values of `parameters(order)`, in that order.
Model make_model(Order order, double T_amb_degC, std::span<const double> values);

/// The values of `parameters(order)`, in that order: the inverse of make_model.
std::vector<double> values(const Model& model);

/// Temperature rise of the two nodes over T_amb [K].
struct Rise {
  double node_K[2] = {0, 0};
  double total_K() const { return node_K[0] + node_K[1]; }
};

/// What one step of length dt does to a node: x -> keep x + (1 - keep) target.
struct Decay {
  double dt_s = 0;
  double one_minus_keep[2] = {0, 0};
};
Decay decay(const Model& model, double dt_s);

/// Advances the rise over one step of constant power [W] with the ambient temperature `ambient_offset_K` above T_amb.
/// Leaves a prescribed temperature alone.
inline void step(const Model& model, const Decay& decay, double power_W, double ambient_offset_K, Rise& rise) {
  if (model.order == Order::prescribed) return;
  for (int i = 0; i < 2; ++i) {
    const double target = model.gain_K_J[i] * model.t_s[i] * power_W + model.share(i) * ambient_offset_K;
    rise.node_K[i] += (target - rise.node_K[i]) * decay.one_minus_keep[i];
  }
}

/// Time [s] after which the total rise reaches `total_K` at constant power [W], with the ambient temperature
/// `ambient_offset_K` above T_amb: 0 where it is reached, infinite where it never will be, or is prescribed.
double time_to_reach_s(const Model& model, const Rise& rise, double power_W, double ambient_offset_K, double total_K);

/// Distributes a total rise [K] over the nodes as in steady state.
Rise steady_rise(const Model& model, double total_K);

}  // namespace tribotwin::thermal
