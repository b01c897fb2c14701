/// What a step of the rise needs. Without text and tables, so that pages have it compiled for browsers too.
#include <cmath>

#include <tribotwin/plugins/thermal/thermal.hpp>

namespace tribotwin::thermal {

Decay decay(const Model& model, double dt_s) {
  return {dt_s, {-std::expm1(-dt_s / model.t_s[0]), -std::expm1(-dt_s / model.t_s[1])}};
}

Rise steady_rise(const Model& model, double total_K) {
  if (model.order == Order::prescribed) return {{total_K, 0}};
  return {{total_K * model.share(0), total_K * model.share(1)}};
}

}  // namespace tribotwin::thermal
