#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/identification/matrix_input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using identification::read_matrix, identification::yaml_of;

std::string list(const VectorXd& v) {
  return fmt::format("[{}]", joined(std::span(v.data(), static_cast<std::size_t>(v.size()))));
}

std::string baseline(const Baseline& b) {
  return fmt::format("{{coefficients: {}, covariance: {}, inverse_gram: {}, freedom: {}}}", yaml_of(b.coefficients),
                     yaml_of(b.covariance), yaml_of(b.inverse_gram), b.freedom);
}

VectorXd numbers(Mapping& m, const std::string& key, Index count) {
  const auto values = m.numbers(key);
  if (static_cast<Index>(values.size()) != count) m.fail(key, fmt::format("must hold {} numbers", count));
  return Eigen::Map<const VectorXd>(values.data(), count);
}

/// Symmetric and positive definite.
MatrixXd covariance(Mapping& m, const std::string& key, Index size) {
  const MatrixXd c = read_matrix(m, key, size, size);
  if (!c.isApprox(c.transpose(), 1e-9) || !cholesky_factor(c))
    m.fail(key, "is no covariance: it must be symmetric and positive definite");
  return c;
}

Mapping required(Mapping& m, const std::string& key) {
  auto inner = m.mapping(key);
  if (!inner) m.fail(key, "is missing");
  return *inner;
}

Baseline read_baseline(Mapping m, Index regressors, Index size) {
  Baseline b{.coefficients = read_matrix(m, "coefficients", regressors, size),
             .covariance = covariance(m, "covariance", size),
             .inverse_gram = covariance(m, "inverse_gram", regressors),
             .freedom = m.number("freedom", {static_cast<double>(size), 1e9})};
  m.done();
  return b;
}

}  // namespace

std::string to_yaml(const HealthyState& h) {
  std::string s =
      fmt::format("# Healthy state of a joint, of tribotwin diagnose learn: friction law {} with alpha {}, Zhou 2024\n",
                  law_name, alpha);
  if (!h.joint.empty()) s += fmt::format("joint: {}\n", quoted(h.joint));
  if (h.torque_max_nm > 0) s += fmt::format("torque_max_nm: {}\n", h.torque_max_nm);
  s += fmt::format("law: {}\nalpha: {}\nobservations: {}\nleft_out: {}\n", law_name, alpha, h.observations, h.left_out);
  s += fmt::format("temperature: {{low_degC: {}, high_degC: {}, known: {}}}\n", h.temperature_low_degC,
                   h.temperature_high_degC, h.knows_temperature);
  s += fmt::format("features: [{}]\nunits: ['{}']\n", joined(feature_names), joined(feature_units, "', '"));
  s += fmt::format("mean: {}\ncovariance: {}\n", list(h.mean), yaml_of(h.covariance));
  s += fmt::format("thresholds:   # squared distances, N^2 of Zhou 2024 (2 and 6 sigma)\n  anomalous: {}\n  wear: {}\n",
                   h.anomalous_distance, h.wear_distance);
  s += "radii:   # N sqrt(lambda) for N = 1, Zhou 2024 (14)\n";
  for (std::size_t r = 0; r < regions.size(); ++r) s += fmt::format("  {}: {}\n", regions[r].name, list(h.radii(r)));
  s +=
      "# Baseline by which anomalies are judged: ln Fc, ln Fs, ln Vs, ln Fv, beta on 1 and, where known, temperature - "
      "middle\nbaseline:\n";
  for (std::size_t r = 0; r < regions.size(); ++r)
    s += fmt::format("  {}: {}\n", regions[r].name, baseline(h.region[r]));
  s += fmt::format("  together: {}\n  scatter: [{}]\n  shrinkage: {}\n", yaml_of(h.together), joined(h.scatter),
                   h.shrinkage);
  if (std::ranges::any_of(h.indicators, [](const auto& i) { return i.has_value(); })) s += "indicators:\n";
  for (std::size_t k = 0; k < indicator_count; ++k)
    if (h.indicators[k])
      s += fmt::format("  {}: {{mean: {}, sd: {}}}   # {}\n", indicators[k].name, h.indicators[k]->mean,
                       h.indicators[k]->deviation, indicators[k].meaning);
  s += fmt::format(
      "load:\n  sensitivity: {}   # relative rise of Fc and Fs per load_norm, assumed\n  effect: {}   # on ln Fc, ln "
      "Fs, ln Vs, ln Fv, beta per ln(1 + k load) / k, k the sensitivity at the healthy load\n  measured: {}\n",
      h.load_sensitivity, list(h.load_effect), h.load_measured);
  if (h.lever_m > 0) s += fmt::format("  lever_m: {}\n", h.lever_m);
  std::vector<std::string> data;
  for (const auto& file : h.data) data.push_back(quoted(file));
  return s + fmt::format("data: [{}]\n", joined(data));
}

Result<HealthyState> read_healthy(const std::filesystem::path& file) try {
  Mapping m(file.string(), "", load_yaml(file));
  m.accept({"joint", "torque_max_nm", "law", "alpha", "observations", "left_out", "temperature", "features", "units",
            "mean", "covariance", "thresholds", "radii", "baseline", "indicators", "load", "data"});
  HealthyState h{.joint = m.text_or("joint", ""), .torque_max_nm = m.number_or("torque_max_nm", 0, {1e-9, 1e9})};
  m.choice("law", {law_name});
  m.number("alpha", {alpha, alpha});
  h.observations = m.whole("observations", {static_cast<double>(observations_minimum), 1e6});
  h.left_out = m.whole("left_out", {0, 1e6});
  auto temperature = required(m, "temperature");
  h.temperature_low_degC = temperature.number("low_degC", {-273.15, 1000});
  h.temperature_high_degC = temperature.number("high_degC", {h.temperature_low_degC, 1000});
  h.knows_temperature = temperature.flag_or("known", false);
  temperature.done();
  for (const auto& [key, names] : {std::pair{"features", &feature_names}, {"units", &feature_units}})
    if (const auto given = m.texts(key); !std::ranges::equal(given, *names))
      m.fail(key, fmt::format("are [{}] but must be [{}]", joined(given), joined(*names)));
  h.mean = numbers(m, "mean", feature_count);
  if (!(h.mean.minCoeff() > 0)) m.fail("mean", "must hold numbers above 0");
  h.covariance = covariance(m, "covariance", feature_count);
  auto thresholds = required(m, "thresholds");
  h.anomalous_distance = thresholds.number("anomalous", {0, 1e9});
  h.wear_distance = thresholds.number("wear", {h.anomalous_distance, 1e9});
  thresholds.done();
  auto radii = required(m, "radii");  // follow from the covariance
  for (const auto& r : regions) numbers(radii, std::string(r.name), r.count);
  radii.done();
  auto base = required(m, "baseline");
  const Index q = h.knows_temperature ? 2 : 1;
  for (std::size_t r = 0; r < regions.size(); ++r)
    h.region[r] = read_baseline(required(base, std::string(regions[r].name)), q, regions[r].count);
  h.together = covariance(base, "together", feature_count);
  const VectorXd scatter = numbers(base, "scatter", 2);
  h.scatter = {scatter(0), scatter(1)};
  h.shrinkage = base.number("shrinkage", {0, 1});
  base.done();
  if (auto known = m.mapping("indicators")) {
    std::vector<std::string_view> names;
    for (const auto& i : indicators) names.push_back(i.name);
    known->accept(names);
    for (std::size_t k = 0; k < indicator_count; ++k)
      if (auto one = known->mapping(std::string(names[k]))) {
        h.indicators[k] = HealthyState::IndicatorState{.mean = one->number("mean", {-1e9, 1e9}),
                                                       .deviation = one->number("sd", {1e-12, 1e9})};
        one->done();
      }
  }
  auto loads = required(m, "load");
  h.load_sensitivity = loads.number("sensitivity", {0, 100});
  h.load_effect = numbers(loads, "effect", feature_count);
  h.load_measured = loads.flag_or("measured", false);
  h.lever_m = loads.number_or("lever_m", 0, {1e-6, 1e3});
  loads.done();
  h.data = m.texts("data");
  m.done();
  return h;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::diagnosis
