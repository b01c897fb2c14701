#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/twin/identification/drive_gains/report.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/io/text_table.hpp>

namespace tribotwin::twin::identification {
namespace {

using Json = nlohmann::ordered_json;

/// The recorded torque of a joint is this times what was recorded.
double assumed_value(const AssumedGain& a) { return a.of_current ? a.nm_per_a.value_or(1) : 1; }

/// Whether there is something that a factor corrects.
bool is_relative(const AssumedGain& a) { return !a.of_current || a.nm_per_a; }

std::string with_sigma(double value, double sigma) { return fmt::format("{:.4g} +- {:.2g}", value, sigma); }

Json value_and_sigma(const Estimate& e) { return {{"value", e.value}, {"sigma", e.sigma}}; }

}  // namespace

std::vector<Estimate> drive_constants(const DriveGains& gains, std::span<const AssumedGain> assumed) {
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  std::vector<Estimate> out;
  for (std::size_t j = 0; j < gains.factors.size(); ++j) {
    Estimate e = gains.factors[j];
    const double by = assumed_value(assumed[j]);
    if (assumed[j].of_current) e.unit = assumed[j].slide ? "N/A" : "Nm/A";
    for (double* x : {&e.value, &e.sigma, &e.low, &e.high}) *x = gains.known(j) ? *x * by : unknown;
    out.push_back(std::move(e));
  }
  return out;
}

std::string table_of(const DriveGains& gains, std::span<const AssumedGain> assumed,
                     std::span<const KnownPayload> payloads) {
  constexpr auto right = TextTable::right;
  TextTable table{{TextTable::left("joint"), right("drive gain"), right("sigma"), TextTable::left("unit"),
                   right("95 % interval"), right("of that assumed")}};
  const auto constants = drive_constants(gains, assumed);
  for (std::size_t j = 0; j < constants.size(); ++j) {
    const Estimate& e = constants[j];
    if (!gains.known(j)) {
      table.add({e.name, "-", "-", e.unit, "not identifiable"});
      continue;
    }
    table.add({e.name, fmt::format("{:.5g}", e.value), fmt::format("{:.2g}", e.sigma), e.unit,
               fmt::format("{:.4g} .. {:.4g}", e.low, e.high),
               is_relative(assumed[j]) ? fmt::format("{:.1f} %", 100 * gains.factors[j].value) : "-"});
  }
  std::string s = table.text();
  for (const auto& line : lines_of(gains.lacking)) s += line + "\n";
  const bool counted = std::ranges::all_of(payloads, [](const KnownPayload& p) { return p.mass_sigma_kg > 0; });
  return s + (counted
                  ? "sigmas count what the payload's mass is known to; nothing recorded here tells that mass\n\n"
                  : "sigmas hold for the payload's mass as given: 1 % more makes every gain 1 % larger, and nothing "
                    "recorded here tells (MASS kg +- SIGMA counts that)\n\n");
}

Json json_of(const DriveGains& gains, std::span<const AssumedGain> assumed) {
  Json out = Json::object();
  const auto constants = drive_constants(gains, assumed);
  for (std::size_t j = 0; j < constants.size(); ++j) {
    const Estimate& e = constants[j];
    if (!gains.known(j)) {
      const auto why = std::ranges::find(gains.lacking, e.name, &Lacking::parameter);
      out[e.name] = {{"value", nullptr}, {"unit", e.unit}, {"reason", why->reason}, {"record_next", why->next}};
      continue;
    }
    out[e.name] = {{"value", e.value}, {"sigma", e.sigma}, {"low", e.low}, {"high", e.high}, {"unit", e.unit}};
    if (is_relative(assumed[j])) out[e.name]["of_assumed"] = gains.factors[j].value;
  }
  return out;
}

std::vector<std::string> doubtful_mass(const DriveGains& gains, std::span<const AssumedGain> assumed) {
  constexpr double much = 0.2, alike = 0.1;
  double low = std::numeric_limits<double>::infinity(), high = 0;
  int count = 0;
  for (std::size_t j = 0; j < gains.factors.size(); ++j) {
    if (!gains.known(j) || !is_relative(assumed[j])) continue;
    low = std::min(low, gains.factors[j].value), high = std::max(high, gains.factors[j].value);
    ++count;
  }
  if (count < 3 || high > low * (1 + alike)) return {};
  const double all = std::sqrt(low * high);
  if (std::abs(std::log(all)) < much) return {};
  return {fmt::format(
      "all gains are {:.3g} times those assumed, within {:.0f} %: a payload of {:.3g} times the mass of --payload says "
      "the same. Is that mass right?",
      all, 100 * (high / low - 1), 1 / all)};
}

std::string table_of(std::span<const Efficiency> efficiencies) {
  if (efficiencies.empty()) return {};
  constexpr auto right = TextTable::right;
  TextTable table{{TextTable::left("transmission"), right("loss per load"), right("efficiency driving"),
                   right("driven by the load")}};
  for (const Efficiency& e : efficiencies)
    table.add({e.joint, with_sigma(e.per_load.value, e.per_load.sigma), with_sigma(e.driving.value, e.driving.sigma),
               e.backdriven.value > 0 ? with_sigma(e.backdriven.value, e.backdriven.sigma) : "locks itself"});
  return "\n" + table.text();
}

Json json_of(std::span<const Efficiency> efficiencies) {
  Json out = Json::object();
  for (const Efficiency& e : efficiencies)
    out[e.joint] = {{"per_load", value_and_sigma(e.per_load)},
                    {"driving", value_and_sigma(e.driving)},
                    {"backdriven", value_and_sigma(e.backdriven)}};
  return out;
}

}  // namespace tribotwin::twin::identification
