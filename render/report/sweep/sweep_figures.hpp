#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/report/sweep/quantity.hpp>
#include <tribotwin/twin/experiments/sweep/stored.hpp>

/// The figures of a sweep. Their captions say what was drawn.
namespace tribotwin::render {

/// What a factor does to an output, as in statistics.json.
struct Effect {
  std::string name;             ///< of the factor, or of the parameters of a joint
  nlohmann::json value, first;  ///< total and first Sobol' index; or the rank correlation, and null
  double size() const;          ///< magnitude
};

/// A sweep as columns, with names and units.
struct SweepView {
  explicit SweepView(const twin::sweep::StoredSweep& sweep);

  const twin::sweep::StoredSweep& sweep;
  std::vector<std::vector<double>> factors;  ///< per key and run; NaN where it is a word
  std::vector<std::vector<double>> outputs;  ///< per output and run, NaN where there is none
  std::vector<Quantity> quantities;          ///< of the outputs

  const nlohmann::json& statistics(std::size_t output) const;
  bool has_values(std::size_t output) const { return statistics(output).contains("mean"); }
  /// Whether effects() are Sobol' indices.
  bool has_indices(std::size_t output) const;
  /// Falling; those without a value are left out.
  std::vector<Effect> effects(std::size_t output) const;
  /// Keys by what they do to the output, falling; keys that do not vary are left out.
  std::vector<std::size_t> leading(std::size_t output) const;
  Axis axis_of_key(std::size_t key) const;
  /// Shown values of an output, of all runs.
  std::vector<double> shown(std::size_t output) const;
};

constexpr std::size_t ranked_effects = 12;

Drawing importance(const SweepView& view, std::size_t output);
Drawing distribution_of(const SweepView& view, std::size_t output);
/// Nothing where the factor's values are words.
std::optional<Drawing> over_factor(const SweepView& view, std::size_t output, std::size_t key);
/// Over two factors: of a grid a heat map, else the runs coloured by the output.
std::optional<Drawing> over_two(const SweepView& view, std::size_t output, std::size_t key, std::size_t other);
/// A quadratic in two factors, where it explains half of the variance.
std::optional<Drawing> surface_over(const SweepView& view, std::size_t output, std::size_t key, std::size_t other);
/// Nothing where no run has the signal.
std::optional<Drawing> band_over_time(const SweepView& view, std::size_t band);

}  // namespace tribotwin::render
