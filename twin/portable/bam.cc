#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <Eigen/Dense>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/portable/bam.hpp>
#include <tribotwin/twin/portable/drive_range.hpp>

namespace tribotwin::twin {
namespace {

constexpr int speed_count = 60, load_count = 6;
constexpr double alpha_min = 0.2, alpha_max = 5;

/// Whether the law is m4's own at every temperature.
bool is_m4(const friction::GeneralLaw& g) {
  for (const auto& term : friction::formula::terms) {
    const bool mine = term.heat == friction::formula::cold &&
                      (term.shape == friction::formula::constant || term.shape == friction::formula::stribeck ||
                       term.shape == friction::formula::linear);
    if (g.*term.number != 0 && !mine) return false;
  }
  return g.vs_T == 0 && g.vs_TT == 0 && g.s_T == 0;
}

BamFriction of_m4(const drive::Drive& d) {
  const friction::GeneralLaw& g = d.law.general_law;
  const double scale = d.torque_scale_nm(), u = d.speed_scale(), per_load = scale / d.torque_max_nm;
  return {.base_nm = scale * g.A,
          .stribeck_nm = scale * g.B,
          .load_base = per_load * g.A_l,
          .load_stribeck = per_load * g.B_l,
          .stribeck_rad_s = g.vs / u,
          .alpha = g.alpha,
          .viscous_nm_s_rad = scale * g.F1 * u,
          .exact = true};
}

/// Friction of the drive on a grid, a mean of its directions.
struct Samples {
  std::vector<double> speed, load;  ///< of each row
  Eigen::VectorXd friction;
};

/// Calls f(speed, load, friction) on a grid where the drive is compared, `friction` [Nm] being those of both directions
/// with both signs of the load, forward ones last.
template <class F>
void over_grid(const drive::Drive& d, const BamFriction& where, const F& f) {
  const auto at = friction::at_temperature(d.law, where.temperature_degC);
  const int loads = where.load_max_nm > 0 ? load_count : 1;
  for (int i = 1; i <= speed_count; ++i)
    for (int k = 0; k < loads; ++k) {
      const double share = static_cast<double>(i) / speed_count,
                   speed = where.speed_max_rad_s * share * share,  // denser where the Stribeck effect is
          load = where.load_max_nm * k / (load_count - 1), norm = load / d.torque_max_nm;
      f(speed, load,
        std::array{drive::friction_nm(d, at, -speed, -norm), drive::friction_nm(d, at, -speed, norm),
                   drive::friction_nm(d, at, speed, -norm), drive::friction_nm(d, at, speed, norm)});
    }
}

Samples sampled(const drive::Drive& d, const BamFriction& where) {
  Samples all;
  std::vector<double> values;
  over_grid(d, where, [&](double speed, double load, const std::array<double, 4>& friction) {
    all.speed.push_back(speed), all.load.push_back(load);
    values.push_back((friction[0] + friction[1] + friction[2] + friction[3]) / 4);
  });
  all.friction = Eigen::Map<Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  return all;
}

/// The numbers that enter linearly, by least squares; base and viscous friction below 0 are left out.
double fit_linear(const Samples& s, bool loaded, BamFriction& b) {
  const auto n = s.friction.size();
  bool with_base = true, with_viscous = true;
  for (;;) {
    std::vector<double*> numbers{&b.stribeck_nm};
    if (with_base) numbers.push_back(&b.base_nm);
    if (with_viscous) numbers.push_back(&b.viscous_nm_s_rad);
    if (loaded) numbers.insert(numbers.end(), {&b.load_base, &b.load_stribeck});
    for (double* all : {&b.base_nm, &b.stribeck_nm, &b.load_base, &b.load_stribeck, &b.viscous_nm_s_rad}) *all = 0;
    Eigen::MatrixXd basis(n, static_cast<Eigen::Index>(numbers.size()));
    for (std::size_t c = 0; c < numbers.size(); ++c) {
      *numbers[c] = 1;
      for (Eigen::Index r = 0; r < n; ++r)
        basis(r, static_cast<Eigen::Index>(c)) =
            b(s.speed[static_cast<std::size_t>(r)], s.load[static_cast<std::size_t>(r)]);
      *numbers[c] = 0;
    }
    const Eigen::VectorXd x = least_squares_solution(basis, s.friction);
    for (std::size_t c = 0; c < numbers.size(); ++c) *numbers[c] = x[static_cast<Eigen::Index>(c)];
    if (with_base && b.base_nm < 0)
      with_base = false;
    else if (with_viscous && b.viscous_nm_s_rad < 0)
      with_viscous = false;
    else
      return (basis * x - s.friction).squaredNorm();
  }
}

/// A grid over the Stribeck velocity (by its logarithm) and exponent, refined around its best point.
BamFriction fitted(const Samples& s, BamFriction where) {
  const bool loaded = where.load_max_nm > 0;
  double low = std::log(where.speed_max_rad_s * 1e-4), high = std::log(where.speed_max_rad_s * 2),
         alpha_low = alpha_min, alpha_high = alpha_max;
  BamFriction best = where;
  double least = HUGE_VAL;
  constexpr int points = 16;
  for (int round = 0; round < 6; ++round) {
    for (int i = 0; i <= points; ++i)
      for (int k = 0; k <= points; ++k) {
        BamFriction b = where;
        b.stribeck_rad_s = std::exp(low + (high - low) * i / points);
        b.alpha = alpha_low + (alpha_high - alpha_low) * k / points;
        if (const double sum = fit_linear(s, loaded, b); sum < least) least = sum, best = b;
      }
    const double width = 2 * (high - low) / points, alpha_width = 2 * (alpha_high - alpha_low) / points;
    low = std::log(best.stribeck_rad_s) - width, high = low + 2 * width;
    alpha_low = std::max(alpha_min, best.alpha - alpha_width),
    alpha_high = std::min(alpha_max, best.alpha + alpha_width);
  }
  return best;
}

/// Directions and the drive's offset are errors.
void compare(const drive::Drive& d, BamFriction& b) {
  double squares = 0;
  int count = 0;
  b.friction_min_nm = HUGE_VAL;
  over_grid(d, b, [&](double speed, double load, const std::array<double, 4>& friction) {
    for (std::size_t i = 0; i < friction.size(); ++i) {
      const double truth = friction[i] + (i < 2 ? -d.offset_nm : d.offset_nm), error = b(speed, load) - truth;
      squares += error * error, ++count;
      b.max_error_nm = std::max(b.max_error_nm, std::abs(error));
      b.friction_min_nm = std::min(b.friction_min_nm, truth), b.friction_max_nm = std::max(b.friction_max_nm, truth);
    }
  });
  b.rms_error_nm = std::sqrt(squares / count);
}

std::string lost_of(const drive::Drive& d) {
  std::string lost;
  const auto add = [&](bool is, const char* what) {
    if (is) lost += std::string(lost.empty() ? "" : ", ") + what;
  };
  add(d.law.info->temperature_dependent, "friction by temperature");
  add(d.thermal.order != thermal::Order::prescribed, "heat");
  add(d.winding.present(), "the winding");
  add(d.dynamics != drive::Dynamics::none, "bristles (presliding, hysteresis)");
  add(d.asymmetry != 0, "the difference of the directions");
  add(d.offset_nm != 0, "the offset");
  add(d.load_filter_s > 0, "the filter of the load");
  add(!d.load_table.loads.empty(), "the load table but for its mean");
  return lost + (lost.empty() ? "" : ", ") + "faults";
}

}  // namespace

double BamFriction::operator()(double speed_rad_s, double load_nm) const {
  const double s = std::exp(-std::pow(std::abs(speed_rad_s / stribeck_rad_s), alpha)), l = std::abs(load_nm);
  return base_nm + load_base * l + s * (stribeck_nm + load_stribeck * l) + viscous_nm_s_rad * std::abs(speed_rad_s);
}

Result<BamFriction> bam_friction(const drive::Drive& d, std::optional<double> temperature_degC,
                                 std::optional<double> speed_max_rad_s) {
  const friction::Range& range = d.law.range;
  BamFriction where{.temperature_degC = temperature_degC.value_or(d.thermal.T_amb_degC)};
  if (d.law.info->temperature_dependent && !temperature_degC)
    where.temperature_degC = std::clamp(where.temperature_degC, range.temperature_min_degC, range.temperature_max_degC);
  if (auto ok = require_identified_at(d, where.temperature_degC); !ok) return tl::unexpected(ok.error());
  const auto fastest = fastest_rad_s(d, speed_max_rad_s);
  if (!fastest) return tl::unexpected(fastest.error());
  where.speed_max_rad_s = *fastest;
  where.load_max_nm = largest_load_nm(d);
  const bool exact = is_m4(d.law.general_law) && d.load_table.loads.empty();
  BamFriction b = exact ? of_m4(d) : fitted(sampled(d, where), where);
  b.temperature_degC = where.temperature_degC, b.speed_max_rad_s = where.speed_max_rad_s;
  b.load_max_nm = where.load_max_nm;
  compare(d, b);
  b.lost = lost_of(d);
  return b;
}

std::string bam_json(const BamFriction& b, const std::string& actuator) {
  nlohmann::ordered_json all;
  all["model"] = "m4", all["actuator"] = actuator;
  all["friction_base"] = b.base_nm, all["friction_stribeck"] = b.stribeck_nm;
  all["load_friction_base"] = b.load_base, all["load_friction_stribeck"] = b.load_stribeck;
  all["dtheta_stribeck"] = b.stribeck_rad_s, all["alpha"] = b.alpha, all["friction_viscous"] = b.viscous_nm_s_rad;
  return dump_json(all, 2) + "\n";
}

}  // namespace tribotwin::twin
