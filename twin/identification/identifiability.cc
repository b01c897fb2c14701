#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr double correlated_from = 0.99, loose = 0.1;
/// Residuals of which neighbours have most in common are arcs; a model that explains less than half has failed.
constexpr double arcs_from = 0.5, explained_least = 0.5;

/// A reason, and whether the number is withheld.
struct Reason {
  Lack lack;
  std::string text;
  bool withheld = true;
};
using Check = std::optional<Reason> (*)(const Evidence&, std::size_t);

double width(const Estimate& e) { return e.high - e.low; }

double scale_of(const Evidence& v, std::size_t i) {
  return i < v.scale.size() && v.scale[i] > 0 ? v.scale[i] : std::abs(v.parameters[i].value);
}

std::string duration(double s) {
  constexpr double longest_h = 1000;
  if (s < 600) return fmt::format("{:.3g} s", s);
  return s < 3600 * longest_h ? fmt::format("{:.2f} h", s / 3600) : fmt::format("over {:g} h", longest_h);
}

std::string interval(const Estimate& e) {
  return fmt::format("{:.3g} .. {:.3g}{}{}", e.low, e.high, e.unit.empty() ? "" : " ", e.unit);
}

std::optional<Reason> no_effect(const Evidence& v, std::size_t i) {
  if (!v.unseen.empty() && !v.unseen[i].empty()) return Reason{Lack::no_effect, v.unseen[i]};
  if (v.parameters[i].status != Status::held) return {};
  return Reason{Lack::no_effect, "these data show no effect of it"};
}

std::optional<Reason> at_bound(const Evidence& v, std::size_t i) {
  const Estimate& e = v.parameters[i];
  if (e.status != Status::at_bound) return {};
  return Reason{Lack::at_bound, fmt::format("{:.4g} {} is the end of its accepted range", e.value, e.unit)};
}

std::optional<Reason> few_cycles(const Evidence& v, std::size_t) {
  if (v.cycles >= v.cycles_needed) return {};
  return Reason{Lack::no_whole_cycle,
                fmt::format("{:.0f} whole work cycles, where {:.0f} are needed", v.cycles, v.cycles_needed)};
}

std::optional<Reason> short_record(const Evidence& v, std::size_t i) {
  if (v.recorded_s <= 0) return {};
  for (const auto& constant : v.time_constants) {
    const auto& own = v.parameters[i].name;
    if (own != constant.name && std::ranges::find(constant.with, own) == constant.with.end()) continue;
    const auto found = std::ranges::find(v.parameters, constant.name, &Estimate::name);
    if (found == v.parameters.end()) continue;
    const double longest_s = std::isnan(found->high) ? found->value : found->high;
    if (longest_s <= v.recorded_s) continue;
    return Reason{Lack::short_record, fmt::format("the record, {}, is too short for {} of up to {}",
                                                  duration(v.recorded_s), constant.name, duration(longest_s))};
  }
  return {};
}

std::optional<Reason> wide_interval(const Evidence& v, std::size_t i) {
  const Estimate& e = v.parameters[i];
  // A sigma of 0 beside residuals is a direction that the information lost in rounding.
  if (std::isnan(e.sigma) || (e.sigma == 0 && v.explained < 1))
    return Reason{Lack::wide_interval, "it has no finite interval"};
  if (width(e) <= scale_of(v, i)) return {};
  const bool own = i >= v.scale.size() || v.scale[i] <= 0;
  return Reason{Lack::wide_interval, fmt::format("its 95 % interval, {}, is wider than {}", interval(e),
                                                 own ? "its value" : fmt::format("{:.3g} {}", v.scale[i], e.unit))};
}

std::optional<Reason> correlated(const Evidence& v, std::size_t i) {
  if (v.covariance.size() == 0 || width(v.parameters[i]) <= loose * scale_of(v, i)) return {};
  const auto a = static_cast<Eigen::Index>(i);
  double largest = 0;
  Eigen::Index other = 0;
  for (Eigen::Index b = 0; b < v.covariance.cols(); ++b) {
    const double r = v.covariance(a, b) / std::sqrt(v.covariance(a, a) * v.covariance(b, b));
    if (b != a && std::abs(r) > std::abs(largest)) largest = r, other = b;
  }
  if (std::abs(largest) <= correlated_from) return {};
  const auto k = static_cast<std::size_t>(other);
  const bool own_polynomial = !v.polynomial.empty() && v.polynomial[i] >= 0 && v.polynomial[i] == v.polynomial[k];
  return Reason{Lack::correlated, fmt::format("its correlation with {} is {:.4f}", v.parameters[k].name, largest),
                !own_polynomial};
}

std::optional<Reason> structured(const Evidence& v, std::size_t) {
  if (v.common < arcs_from) return {};
  const bool failed = v.explained < explained_least;
  return Reason{Lack::structured,
                failed ? fmt::format("the model explains {:.0f} % of these data, and the rest is arcs along {}",
                                     100 * std::max(0.0, v.explained), v.along)
                       : fmt::format("the residuals are arcs along {}, no noise; its sigma counts them", v.along),
                failed};
}

/// The rule: the first check that finds something is the one reported.
constexpr Check rule[] = {no_effect, few_cycles, short_record, at_bound, wide_interval, correlated, structured};

std::string usual_advice(const Evidence& v, Lack lack) {
  switch (lack) {
    case Lack::no_effect:
      return "record data in which it has one, or fix it";
    case Lack::no_whole_cycle:
      return fmt::format("record {:.0f} or more", v.cycles_needed);
    case Lack::short_record:
      return "record twice its time constant or more, without a gap";
    case Lack::at_bound:
      return "check units and columns, or fix it";
    case Lack::wide_interval:
      return "record longer, or a wider range of what moves it";
    case Lack::correlated:
      return "record data in which the two act apart, or fix one of them";
    case Lack::structured:
      return "record what the model does not know, or choose another model";
  }
  return {};
}

}  // namespace

std::vector<Lacking> lacking(const Evidence& v, const Advice& advice) {
  std::vector<Lacking> out;
  for (std::size_t i = 0; i < v.parameters.size(); ++i) {
    const Estimate& e = v.parameters[i];
    if (e.status == Status::fixed) continue;
    for (const Check check : rule) {
      auto reason = check(v, i);
      if (!reason) continue;
      std::string next = advice ? advice(e, reason->lack) : std::string();
      out.push_back({e.name, reason->lack, std::move(reason->text),
                     next.empty() ? usual_advice(v, reason->lack) : std::move(next), reason->withheld});
      break;
    }
  }
  return out;
}

std::vector<std::string> withheld(std::span<const Lacking> all) {
  std::vector<std::string> names;
  for (const auto& one : all)
    if (one.withheld) names.push_back(one.parameter);
  return names;
}

std::string sentence(const Lacking& one) {
  return fmt::format("{} is {}: {}; {}", one.parameter, one.withheld ? "not identifiable" : "doubtful", one.reason,
                     one.next);
}

std::vector<std::string> lines_of(std::span<const Lacking> all) {
  std::vector<std::string> lines;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto same = [&](const Lacking& other) {
      return other.reason == all[i].reason && other.next == all[i].next && other.withheld == all[i].withheld;
    };
    if (std::ranges::any_of(all.first(i), same)) continue;
    std::vector<std::string> names;
    for (const auto& one : all.subspan(i))
      if (same(one)) names.push_back(one.parameter);
    lines.push_back(fmt::format("{} {}: {}; {}", joined(names), all[i].withheld ? "not identifiable" : "doubtful",
                                all[i].reason, all[i].next));
  }
  return lines;
}

}  // namespace tribotwin::twin::identification
