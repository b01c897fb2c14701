#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Eigen::Index;
using Parameters = Eigen::Matrix<double, 5, 1>;  // Fc, Fs - Fc, ln Vs, ln Fv, beta
using Information = Eigen::Matrix<double, 5, 5>;

constexpr std::array stribeck_places{0.2, 0.3, 0.4, 0.5, 0.6};  ///< of ln Vs between slowest and fastest level
constexpr std::array exponents{0.3, 0.6, 0.9, 1.3};
constexpr double converged = 1e-9, beta_minimum = 0.02, beta_maximum = 4.9;
constexpr double sigma_maximum = 0.5;  ///< share of the value from which on observe() decides
constexpr int steps = 40;

double mean_of(const std::vector<double>& x) {
  return std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
}

/// Weighted least squares of law `steady_state` with alpha fixed.
class LevelFit {
 public:
  explicit LevelFit(const LevelCurve& c) : speed_(c.speed_rad_s), friction_(c.friction_nm), weight_(c.stderr_nm) {
    double sum = 0;
    for (auto& w : weight_) sum += w = 1 / (w * w);
    for (auto& w : weight_) w *= static_cast<double>(weight_.size()) / sum;
    if (weight_.empty()) weight_.assign(speed_.size(), 1.0);
    for (const double v : speed_) log_speed_.push_back(std::log(v));
  }

  std::vector<double>& friction() { return friction_; }
  const Parameters& parameters() const { return at_; }
  double boundary(std::size_t i) const { return at_(0) + at_(1) * stribeck(i, at_(2)); }
  double cost() const { return cost_; }
  const Information& information() const { return information_; }

  /// Best of a grid, the linear parameters solved at each point.
  bool start() {
    bool found = false;
    const auto [low, high] = std::ranges::minmax(log_speed_);
    for (const double place : stribeck_places)
      for (const double beta : exponents) {
        Eigen::Matrix3d gram = Eigen::Matrix3d::Zero();
        Eigen::Vector3d moment = Eigen::Vector3d::Zero();
        const double ln_Vs = low + place * (high - low);
        for (std::size_t i = 0; i < speed_.size(); ++i) {
          const Eigen::Vector3d g(1, stribeck(i, ln_Vs), std::exp(beta * log_speed_[i]));
          gram.noalias() += weight_[i] * g * g.transpose();
          moment += weight_[i] * friction_[i] * g;
        }
        const Eigen::Vector3d x = gram.llt().solve(moment);
        if (!(x.minCoeff() > 0)) continue;
        const Parameters p = (Parameters() << x(0), x(1), ln_Vs, std::log(x(2)), beta).finished();
        if (const double cost = cost_of(p); !found || cost < cost_) at_ = p, cost_ = cost, found = true;
      }
    return found;
  }

  /// From where it is; false where it does not come to rest inside of the bounds.
  bool improve() {
    double damping = 1e-3;
    cost_ = cost_of(at_);
    for (int step = 0; step < steps; ++step) {
      const Parameters slope = linearise();
      Information damped = information_;
      damped.diagonal() *= 1 + damping;
      const Parameters change = damped.llt().solve(slope), next = at_ + change;
      if (!change.allFinite()) return false;
      const double cost = cost_of(next);
      const bool small = change.dot(slope) < converged * converged * cost_ * 1e4 || change.norm() < converged;
      if (cost <= cost_) {
        at_ = next, cost_ = cost, damping = std::max(damping / 10, 1e-9);
      } else if (!small) {
        damping *= 10;
        if (damping > 1e6) return false;
        continue;
      }
      if (small) return linearise(), inside();
    }
    return false;
  }

 private:
  double stribeck(std::size_t i, double ln_Vs) const { return std::exp(-std::exp(alpha * (log_speed_[i] - ln_Vs))); }
  bool inside() const {
    return at_(0) > 0 && at_(1) > 0 && at_(4) > beta_minimum && at_(4) < beta_maximum && at_.allFinite();
  }
  double cost_of(const Parameters& p) const {
    double sum = 0;
    for (std::size_t i = 0; i < speed_.size(); ++i) {
      const double e = friction_[i] - p(0) - p(1) * stribeck(i, p(2)) - std::exp(p(3) + p(4) * log_speed_[i]);
      sum += weight_[i] * e * e;
    }
    return sum;
  }
  /// Sets J'WJ, returns J'We.
  Parameters linearise() {
    information_.setZero();
    Parameters slope = Parameters::Zero();
    for (std::size_t i = 0; i < speed_.size(); ++i) {
      const double u = std::exp(alpha * (log_speed_[i] - at_(2))), E = std::exp(-u);
      const double viscous = std::exp(at_(3) + at_(4) * log_speed_[i]);
      const Parameters g = (Parameters() << 1, E, at_(1) * E * u * alpha, viscous, viscous * log_speed_[i]).finished();
      information_.noalias() += weight_[i] * g * g.transpose();
      slope += weight_[i] * (friction_[i] - at_(0) - at_(1) * E - viscous) * g;
    }
    return slope;
  }

  std::vector<double> speed_, friction_, weight_, log_speed_;
  Parameters at_ = Parameters::Zero();
  Information information_ = Information::Zero();
  double cost_ = 0;
};

/// As observe(): two rounds with the levels brought to the mean load of the curve.
bool fit_at_mean_load(const LevelCurve& c, double k, LevelFit& fit) {
  if (!fit.start() || !fit.improve()) return false;
  if (c.load_norm.empty() || k == 0) return true;
  const double mean = mean_of(c.load_norm);
  if (std::ranges::all_of(c.load_norm, [&](double l) { return std::abs(l - mean) < 1e-6; })) return true;
  for (int round = 0; round < 2; ++round) {
    for (std::size_t i = 0; i < c.friction_nm.size(); ++i)
      fit.friction()[i] = c.friction_nm[i] - fit.boundary(i) * k * (c.load_norm[i] - mean) / (1 + k * mean);
    if (!fit.improve()) return false;
  }
  return true;
}

/// The fit as an observation; none where it is in doubt.
std::optional<Observation> confident(const LevelCurve& c, const LevelFit& fit) {
  const Parameters& p = fit.parameters();
  const auto n = static_cast<double>(c.speed_rad_s.size());
  const Eigen::LLT<Information> factor(fit.information());
  if (factor.info() != Eigen::Success) return std::nullopt;
  const Information covariance = factor.solve(Information::Identity());
  const double variance = fit.cost() / std::max(1.0, n - 5), Fs = p(0) + p(1), Vs = std::exp(p(2));
  Information slope = Information::Zero();  // of ln Fc, ln Fs, ln Vs, ln Fv, beta
  slope(0, 0) = 1 / p(0), slope(1, 0) = slope(1, 1) = 1 / Fs;
  slope(2, 2) = slope(3, 3) = slope(4, 4) = 1;
  Observation o{.residual_nm = std::sqrt(fit.cost() / n)};
  o.features << p(0), Fs, Vs, std::exp(p(3)), p(4);
  o.shape = slope * covariance * slope.transpose();
  for (Index i = 0; i < feature_count; ++i)
    if (!(std::sqrt(variance * o.shape(i, i)) < sigma_maximum * (i < 4 ? 1 : p(4)))) return std::nullopt;
  const auto [slowest, fastest] = std::ranges::minmax(c.speed_rad_s);
  if (slowest > Vs || fastest < 5 * Vs || !(variance > 0)) return std::nullopt;
  return o;
}

Observation observed(const LevelCurve& c, double load_sensitivity) {
  if (c.speed_rad_s.size() > 5) {
    LevelFit fit(c);
    if (fit_at_mean_load(c, load_sensitivity, fit))
      if (auto o = confident(c, fit)) return *std::move(o);
  }
  const std::size_t n = c.speed_rad_s.size();
  identification::Samples samples{
      .speed = c.speed_rad_s,
      .load = c.load_norm.empty() ? std::vector(n, 0.0) : c.load_norm,
      .temperature_degC = c.temperature_degC.empty() ? std::vector(n, 0.0) : c.temperature_degC,
      .friction = c.friction_nm,
      .standard_error = c.stderr_nm,
      .curve = std::vector<std::uint32_t>(n, 0)};
  auto o = observe(samples, load_sensitivity);
  if (o) return *std::move(o);
  Observation none;
  for (const auto& name : feature_names) none.weak.emplace_back(name);
  return none;
}

}  // namespace

std::string name_of(const Key& k) {
  return fmt::format("robot {}, joint {}, {}{}", k.robot, k.joint, date_of(k.time_s),
                     k.curve > 1 ? fmt::format(", curve {}", k.curve) : "");
}

std::string name_of(const std::string& type, const std::string& joint) {
  return fmt::format("joint {}{}", joint, type.empty() ? "" : " of type " + type);
}

std::string LevelCurve::where() const { return fmt::format("{}:{}", file, line); }

std::uint32_t LevelCurve::checksum() const {
  std::uint32_t sum = 0;
  for (const auto* column :
       {&speed_rad_s, &friction_nm, &load_norm, &temperature_degC, &stderr_nm, &ripple_nm, &lost_motion_rad}) {
    const auto size = static_cast<std::uint32_t>(column->size());
    sum = crc32({reinterpret_cast<const char*>(&size), sizeof size}, sum);
    sum = crc32({reinterpret_cast<const char*>(column->data()), size * sizeof(double)}, sum);
  }
  return sum;
}

Observation observe_levels(const LevelCurve& c, double load_sensitivity) {
  Observation o = observed(c, load_sensitivity);
  o.file = c.where();
  o.curve = c.key.curve;
  if (!c.temperature_degC.empty()) o.temperature_degC = mean_of(c.temperature_degC);
  if (!c.load_norm.empty()) o.indicators[load] = mean_of(c.load_norm);
  if (!c.ripple_nm.empty()) o.indicators[ripple] = std::ranges::max(c.ripple_nm);
  if (!c.lost_motion_rad.empty()) {
    auto levels = c.lost_motion_rad;
    std::erase(levels, 0.0);
    o.indicators[lost_motion] = levels.empty() ? 0 : identification::median_of(std::move(levels));
  }
  return o;
}

}  // namespace tribotwin::twin::diagnosis::fleet
