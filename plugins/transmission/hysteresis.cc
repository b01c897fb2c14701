#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/key.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>

namespace tribotwin::transmission {
namespace {

constexpr double large = 1e15;
constexpr Key keys[] = {
    {"k00", "Nm/rad", "", -large, large, "stiffness k0 at 0 degC"},
    {"k01", "Nm/rad/K", "0", -large, large, "k0 per degC"},
    {"k02", "Nm/rad/K^2", "0", -large, large, "k0 per degC squared"},
    {"k10", "Nm/rad^2", "0", -large, large, "k1 at 0 degC: stiffness per |torsion|"},
    {"k11", "Nm/rad^2/K", "0", -large, large, "k1 per degC"},
    {"k12", "Nm/rad^2/K^2", "0", -large, large, "k1 per degC squared"},
    {"k20", "Nm/rad^4", "0", -1e30, 1e30, "k2 at 0 degC: stiffness per |torsion|^3"},
    {"k21", "Nm/rad^4/K", "0", -1e30, 1e30, "k2 per degC"},
    {"k22", "Nm/rad^4/K^2", "0", -1e30, 1e30, "k2 per degC squared"},
    {"w", "1", "", 0, 1, "elastic share of the torque"},
    {"beta", "rad^-n", "", 1e-12, 1e30, "shape: x' = phi' - beta |phi'| |x|^(n-1) x - gamma phi' |x|^n"},
    {"gamma", "rad^-n", "", -1e30, 1e30, "shape, |gamma| <= beta"},
    {"n", "1", "", 1, 10, "shape"},
    {"torsion_max_rad", "rad", "", 1e-9, 10, "end of the range of k; beyond it k is that of the end"},
    {"temperature_min_degC", "degC", "20", -273.15, 1000, "start of the range of k (RH380-N study: 20)"},
    {"temperature_max_degC", "degC", "50", -273.15, 1000, "end of the range of k (RH380-N study: 50)"},
};

std::vector<double*> places(Hysteresis& h) {
  std::vector<double*> all;
  for (auto& row : h.k)
    for (double& x : row) all.push_back(&x);
  for (double* x :
       {&h.w, &h.beta, &h.gamma, &h.n, &h.torsion_max_rad, &h.temperature_min_degC, &h.temperature_max_degC})
    all.push_back(x);
  return all;
}

/// y = x sgn phi': dy / d|phi|.
double slope(const Hysteresis& h, double y) {
  return 1 - std::pow(std::abs(y), h.n) * (h.gamma + std::copysign(h.beta, y));
}

constexpr int grid = 50;

}  // namespace

double Hysteresis::stiffness(double torsion, double T) const {
  const double p = std::min(std::abs(torsion), torsion_max_rad);
  T = std::clamp(T, temperature_min_degC, temperature_max_degC);
  const auto at = [&](int i) { return k[i][0] + (k[i][1] + k[i][2] * T) * T; };
  return at(0) + at(1) * p + at(2) * p * p * p;
}

double Hysteresis::limit_rad() const { return std::pow(beta + gamma, -1 / n); }

double Hysteresis::stiffest() const {
  double maximum = 0;
  for (int i = 0; i <= grid; ++i) {
    const double T = temperature_min_degC + (temperature_max_degC - temperature_min_degC) * i / grid;
    const auto at = [&](int c) { return k[c][0] + (k[c][1] + k[c][2] * T) * T; };
    for (int j = 0; j <= grid; ++j) {
      // x grows fastest against phi just after a reversal.
      const double p = torsion_max_rad * j / grid, growth = std::abs(at(1) + 3 * at(2) * p * p);
      const double fastest = 1 + std::max(0.0, (beta - gamma) / (beta + gamma));
      maximum = std::max(
          maximum, stiffness(p, T) * (w + (1 - w) * fastest) + growth * (w * p + (1 - w) * std::min(p, limit_rad())));
    }
  }
  return maximum;
}

double advance(const Hysteresis& h, double x0, double increment) {
  if (increment == 0) return x0;
  const double limit = h.limit_rad(), length = limit / h.n;  // distance on which x settles
  const double way = std::min(std::abs(increment), 60 * length);
  const double pieces = std::ceil(way / (0.05 * length)), step = way / pieces;
  double y = std::clamp(increment > 0 ? x0 : -x0, -limit, limit);
  for (int i = 0; i < static_cast<int>(pieces); ++i) {
    const double a = slope(h, y), b = slope(h, y + step / 2 * a), c = slope(h, y + step / 2 * b),
                 d = slope(h, y + step * c);
    y = std::clamp(y + step / 6 * (a + 2 * b + 2 * c + d), -limit, limit);
  }
  return increment > 0 ? y : -y;
}

double torque_nm(const Hysteresis& h, double torsion, double x, double T) {
  return h.stiffness(torsion, T) * (h.w * torsion + (1 - h.w) * x);
}

Advance advance(const Hysteresis& h, double x, double from, double to, double T) {
  const double middle = 0.5 * (from + to), x_middle = advance(h, x, middle - from),
               x_end = advance(h, x_middle, to - middle);
  const double k0 = h.stiffness(from, T), k1 = h.stiffness(middle, T), k2 = h.stiffness(to, T);
  const double work = (to - from) / 6 * (k0 * x + 4 * k1 * x_middle + k2 * x_end);
  const double stored = 0.5 * (k2 * x_end * x_end - k0 * x * x);
  return {x_end, (1 - h.w) * (work - stored)};
}

std::span<const char* const> all_keys() {
  static const std::vector<const char*> all = [] {
    std::vector<const char*> names{"drive"};
    for (const Key& key : keys) names.push_back(key.name);
    return names;
  }();
  return all;
}

Result<Hysteresis> make_hysteresis(std::string name, const Configuration& configuration) {
  std::map<std::string, std::string, std::less<>> left;
  for (const auto& [key, value] : configuration)
    if (!value.empty() && !left.emplace(key, value).second)
      return tl::unexpected(fmt::format("key '{}' is given twice", key));
  Hysteresis h{.name = std::move(name)};
  if (const auto drive = left.find("drive"); drive != left.end()) {
    h.drive = drive->second;
    left.erase(drive);
  }
  const auto values = places(h);
  for (std::size_t i = 0; i < std::size(keys); ++i) {
    const Key& key = keys[i];
    const auto found = left.find(key.name);
    if (found == left.end() && !key.fallback[0])
      return tl::unexpected(fmt::format("key '{}' is missing: {} [{}]", key.name, key.meaning, key.unit));
    const std::string text = found == left.end() ? key.fallback : found->second;
    if (found != left.end()) left.erase(found);
    const auto value = to_number(std::string_view(text).substr(text.starts_with('+') ? 1 : 0));
    if (!value || !std::isfinite(*value))
      return tl::unexpected(fmt::format("key '{}' is '{}' but must be a finite number [{}]", key.name, text, key.unit));
    if (*value < key.minimum || *value > key.maximum)
      return tl::unexpected(fmt::format("key '{}' is {} but must be within {} .. {} [{}]", key.name, *value,
                                        key.minimum, key.maximum, key.unit));
    *values[i] = *value;
  }
  if (!left.empty())
    return tl::unexpected(
        fmt::format("key '{}' is not known; the keys are {}", left.begin()->first, fmt::join(all_keys(), ", ")));
  if (!(h.gamma > -h.beta && h.gamma <= h.beta))
    return tl::unexpected(fmt::format(
        "gamma {} must be above -beta and at most beta = {}: beyond, loops would deliver energy or x have no limit",
        h.gamma, h.beta));
  if (h.temperature_min_degC > h.temperature_max_degC)
    return tl::unexpected(fmt::format("temperature_min_degC {} lies above temperature_max_degC {}",
                                      h.temperature_min_degC, h.temperature_max_degC));
  for (int i = 0; i <= grid; ++i)
    for (int j = 0; j <= grid; ++j) {
      const double T = h.temperature_min_degC + (h.temperature_max_degC - h.temperature_min_degC) * i / grid,
                   p = h.torsion_max_rad * j / grid;
      if (!(h.stiffness(p, T) > 0))
        return tl::unexpected(
            fmt::format("the stiffness is {:.4g} Nm/rad at a torsion of {:.3g} rad and {:.3g} degC; it must be above 0 "
                        "in the whole range",
                        h.stiffness(p, T), p, T));
    }
  return h;
}

Configuration configuration_of(const Hysteresis& hysteresis) {
  Hysteresis copy = hysteresis;
  const auto values = places(copy);
  Configuration c;
  if (!hysteresis.drive.empty()) c.emplace_back("drive", hysteresis.drive);
  for (std::size_t i = 0; i < std::size(keys); ++i) c.emplace_back(keys[i].name, fmt::format("{}", *values[i]));
  return c;
}

std::string reference_markdown() {
  std::string out =
      "\n### Elastic transmission: `tribotwin.hysteresis`\n\n"
      "`tau_g = w k phi + (1 - w) k x`, `x' = phi' - beta |phi'| |x|^(n-1) x - gamma phi' |x|^n`, "
      "`k = k0(T) + k1(T) |phi| + k2(T) |phi|^3`, `ki(T) = ki0 + ki1 T + ki2 T^2` (RH380-N study (2), (3)); torsion "
      "phi is the "
      "length of the tendon.\n\n"
      "| key | unit | default | range | meaning |\n|---|---|---|---|---|\n"
      "| `drive` | | the one on the tendon | | instance of the tribotwin.drive that supplies the temperature and "
      "receives the heat; needed where several act on joints of the tendon |\n";
  for (const Key& key : keys)
    out += fmt::format("| `{}` | {} | {} | {:g} .. {:g} | {} |\n", key.name, key.unit,
                       key.fallback[0] ? key.fallback : "required", key.minimum, key.maximum, key.meaning);
  return out;
}

}  // namespace tribotwin::transmission
