#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/quantity.hpp>
#include <tribotwin/twin/robot/recording.hpp>
#include <tribotwin/twin/simulation/health.hpp>

/// Twins with other values of their quantities, following recorded goal positions as in `tribotwin run`.
namespace tribotwin::twin::identification {

struct Recording {
  std::filesystem::path file;
  SetPoints points;                                     ///< measured_rad may hold NaN where nothing was measured
  std::vector<std::pair<std::string, double>> control;  ///< settings of this file; they override the variant
  std::optional<double> temperature_degC;               ///< default: the first of the file
  std::map<std::string, std::string> labels;            ///< by which folds are defined

  double duration_s() const { return points.time_s.back() - points.time_s.front(); }
};

/// A model with one drive, its law, and its quantities.
struct Variant {
  std::string label;
  std::filesystem::path model;
  const friction::LawInfo* law = nullptr;  ///< replaces the model's law
  std::vector<Quantity> quantities;
  std::optional<double> timestep_s;
};

/// Twins of one variant. Immutable; several threads may use it.
class VariantTwins {
 public:
  /// ErrorKind::input where the model cannot be read, does not have exactly one drive, or is refused with the start
  /// values or with one quantity at one of its bounds: "KEY: why".
  static Result<VariantTwins> open(const Variant& variant);

  /// One value per quantity of the variant.
  struct Candidate {
    std::shared_ptr<const mujoco::Model> model;
    std::vector<double> values;
  };
  /// ErrorKind::work where the model with these values is refused.
  Result<Candidate> candidate(std::vector<double> values) const;

  /// Position [rad] at each recorded instant, NaN after the end of the simulation. ErrorKind::work when it diverges.
  Result<std::vector<double>> positions(const Candidate& candidate, const Recording& recording) const;

  /// The health check of such a simulation. Contacts are those of the candidate's model, which may have no geoms.
  Result<std::vector<Finding>> health(const Candidate& candidate, const Recording& recording) const;

  const Variant& variant() const { return *variant_; }
  std::vector<std::size_t> free_quantities() const;  ///< indices of quantities
  /// The controller of a candidate for a recording.
  DcPositionOptions control(std::span<const double> values, const Recording& recording) const;
  double delay_s(std::span<const double> values) const;
  /// The whole model with these values, includes merged, asset folders absolute.
  std::string mjcf(std::span<const double> values) const;
  const mujoco::Model& reference() const { return *reference_; }  ///< with the start values

 private:
  Scenario scenario(const Candidate& candidate, const Recording& recording) const;
  std::string edited(const std::string& text, std::span<const double> values) const;
  Result<std::shared_ptr<const mujoco::Model>> load(const std::string& text, std::span<const double> values) const;
  void try_without_scenery();

  std::shared_ptr<const Variant> variant_;
  std::string text_, lean_;  ///< the model; without its visual elements
  std::shared_ptr<const mujoco::Model> reference_;
};

enum class Norm { squared, absolute };  ///< of the error of position

/// Mean squared [rad^2] or absolute [rad] error over the measured samples; NaN where there are none.
double mean_error(Norm norm, const Recording& recording, std::span<const double> positions_rad);

/// Mean absolute error [mrad] as in `tribotwin run`.
double mae_mrad(const Recording& recording, std::span<const double> positions_rad);

}  // namespace tribotwin::twin::identification
