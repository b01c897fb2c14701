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
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/recording.hpp>
#include <tribotwin/twin/simulation/health.hpp>

/// Twins with other values of their quantities, following recorded goal positions as in `tribotwin run`.
namespace tribotwin::twin::identification {

/// What was moved in a recording, where it differs from the model: the body of the model's only joint, or a payload.
struct Bench {
  std::optional<double> mass_kg;   ///< of that body; its inertia scales with it
  std::optional<double> length_m;  ///< of its centre of mass from the joint's axis
  std::optional<Payload> payload;  ///< at the flange
  bool operator==(const Bench& other) const;
};

struct Recording {
  std::filesystem::path file;
  SetPoints points;                  ///< measured_rad may hold NaN where nothing was measured
  std::filesystem::path scenario{};  ///< of the run whose record this is; else empty
  Bench bench{};
  std::vector<std::pair<std::string, double>> control;  ///< settings of this file; they override the variant
  std::optional<double> temperature_degC;               ///< default: the first of the file
  std::map<std::string, std::string> labels{};          ///< by which folds are defined

  double duration_s() const { return points.time_s.back() - points.time_s.front(); }
};

/// A model, the law of its drives, and its quantities.
struct Variant {
  std::string label;
  std::filesystem::path model;
  const friction::LawInfo* law = nullptr;  ///< replaces the model's law
  std::vector<Quantity> quantities;
  std::optional<double> timestep_s;
  Controller controller = Controller::dc_position;
  std::vector<Bench> benches{Bench{}};  ///< of all recordings
};

/// The drive of each recorded joint; fails where the model does not have it, or has drives that were not recorded.
Result<std::vector<std::size_t>> recorded_drives(const mujoco::Model& model, const Recording& recording);

/// Twins of one variant, for recordings with recorded_drives. Immutable; several threads may use it.
class VariantTwins {
 public:
  /// ErrorKind::input where the model cannot be read, has no drive, or is refused with the start values, with one
  /// quantity at one of its bounds, or with a bench: "KEY: why".
  static Result<VariantTwins> open(const Variant& variant);

  /// One value per quantity of the variant.
  struct Candidate {
    std::vector<std::shared_ptr<const mujoco::Model>> models;  ///< per bench of the variant
    std::vector<double> values;
  };
  /// ErrorKind::work where the model with these values is refused.
  Result<Candidate> candidate(std::vector<double> values) const;

  /// Position [rad] of each recorded joint at each recorded instant, NaN after the end of the simulation.
  /// ErrorKind::work when it diverges.
  using Positions = std::vector<std::vector<double>>;
  Result<Positions> positions(const Candidate& candidate, const Recording& recording) const;

  /// recorded_drives of the model.
  std::vector<std::size_t> drives_of(const Recording& recording) const { return *recorded_drives(*given_, recording); }

  /// The health check of such a simulation. Contacts are those of the candidate's model, which may have no geoms.
  Result<std::vector<Finding>> health(const Candidate& candidate, const Recording& recording) const;

  const Variant& variant() const { return *variant_; }
  std::vector<std::size_t> free_quantities() const;  ///< indices of quantities
  /// The controllers of a candidate for a recording, per drive.
  decltype(Scenario::control) control(std::span<const double> values, const Recording& recording) const;
  double delay_s(std::span<const double> values) const;
  /// What of a bench differs from the model, which is what is applied.
  Bench differing(Bench bench) const;
  std::vector<double> temperature_degC(const Recording& recording) const;  ///< at the start, per drive
  /// The whole model with these values on a bench, includes merged, asset folders absolute.
  std::string mjcf(std::span<const double> values, const Bench& bench) const;
  const mujoco::Model& reference() const { return *reference_; }  ///< with the start values

 private:
  Scenario scenario(const Candidate& candidate, const Recording& recording) const;
  std::string edited(const std::string& text, std::span<const double> values, const Bench& bench) const;
  Result<std::shared_ptr<const mujoco::Model>> load(const std::string& text, std::span<const double> values,
                                                    const Bench& bench) const;
  Result<void> check_edges() const;
  std::size_t drive_of(const Quantity& quantity) const;
  void try_without_scenery();

  std::shared_ptr<const Variant> variant_;
  std::string text_, lean_;                     ///< the model; without its visual elements
  std::shared_ptr<const mujoco::Model> given_;  ///< as the file has it
  std::shared_ptr<const mujoco::Model> reference_;
};

enum class Norm { squared, absolute };  ///< of the error of position

/// Mean squared [rad^2] or absolute [rad] error over the measured samples; NaN where there are none.
double mean_error(Norm norm, const Recording& recording, std::size_t joint, std::span<const double> positions_rad);

/// Mean absolute error [mrad; slides mm] as in `tribotwin run`, mean over the joints.
double mae_mrad(const Recording& recording, const VariantTwins::Positions& positions_rad);

}  // namespace tribotwin::twin::identification
