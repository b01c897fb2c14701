#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/robot/recording.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

/// Identification by simulation, for recordings that are no friction curve: the whole twin (controller, motor, gear,
/// arm) follows recorded goal positions as in `tribotwin run`, and its error of position is what is made small.
///
/// Minimised is the negative logarithm of the posterior
///
///   n ln(error) + 1/2 sum z^2,   n = recorded time / correlation time,
///
/// error being the root mean square or the mean absolute error of position, every recording
/// weighing the same, and z the distance of each sought number from its start in units of what is known of it
/// beforehand. The scale of the error is unknown and its likelihood maximised over it, hence the logarithm. Samples are
/// milliseconds apart, errors last for a swing: a recording is worth as many measurements as it has correlation times.
///
/// The landscape has cliffs where the joint starts or stops sticking. A covariance matrix adaptation evolution strategy
/// (Hansen 2016, arXiv:1604.00772, without restarts of growing size) goes over them; at equal numbers of simulations on
/// the XL-330 recordings it ended lower than Ceres' trust region with numeric derivatives from the best of many starts.
namespace tribotwin::twin::identification {

/// Where a number of the twin is found: a drive's configuration, its MJCF joint, the controller, the recorded motion.
enum class Place { drive, joint, control, motion };
std::string_view name(Place place);
/// The accepted keys of a place; for the drive those of one law.
std::vector<std::string_view> keys_of(Place place, const friction::LawInfo& law);
/// The range a key accepts; of a drive's keys that are no law parameter, the engine's own check decides.
std::pair<double, double> accepted_range(Place place, const friction::LawInfo& law, std::string_view key);

/// A number of the twin, known or sought.
struct Quantity {
  Place place = Place::drive;
  std::string key;
  double start = 0;  ///< the value where it is known
  bool sought = false;
  double low = 0, high = 0;  ///< bounds, start within them
  double sigma = 0;  ///< what is known beforehand: one standard deviation, of ln(value) if logarithmic; 0: nothing
  bool logarithmic = false;  ///< needs low > 0

  std::string path() const;      ///< "drive.Fcl"
  double scale() const;          ///< of the coordinate z in which it is sought
  double value(double z) const;  ///< held within the bounds
  double coordinate(double value) const;
};

struct Recording {
  std::filesystem::path file;
  SetPoints points;                                     ///< measured_rad may hold NaN where nothing was measured
  std::vector<std::pair<std::string, double>> control;  ///< of this file alone, before what the variant says
  std::optional<double> temperature_degC;               ///< else the file's first
  std::map<std::string, std::string> labels;            ///< what folds are made by

  double duration_s() const { return points.time_s.back() - points.time_s.front(); }
};

/// A kind of twin: a model with one drive, its law, and which of its numbers are sought.
struct Variant {
  std::string label;
  std::filesystem::path model;
  const friction::LawInfo* law = nullptr;  ///< takes the place of the model's
  std::vector<Quantity> quantities;
  std::optional<double> timestep_s;
};

/// Twins of one variant. Immutable; several threads may use it.
class VariantTwins {
 public:
  /// Fails where the model cannot be read, has not exactly one drive, or is refused with the start values or with one
  /// quantity at one of its bounds: "KEY: why".
  static Result<VariantTwins> open(const Variant& variant);

  /// One value per quantity of the variant.
  struct Candidate {
    std::shared_ptr<const mujoco::Model> model;
    std::vector<double> values;
  };
  Result<Candidate> candidate(std::vector<double> values) const;

  /// Position [rad] at each recorded instant, NaN where the simulation ended before. Fails when it diverges.
  Result<std::vector<double>> positions(const Candidate& candidate, const Recording& recording) const;

  const Variant& variant() const { return *variant_; }
  std::vector<std::size_t> sought() const;
  /// The controller of a candidate for a recording.
  DcPositionOptions control(std::span<const double> values, const Recording& recording) const;
  double delay_s(std::span<const double> values) const;
  /// The whole model with these values, includes merged, asset folders absolute.
  std::string mjcf(std::span<const double> values) const;
  const mujoco::Model& reference() const { return *reference_; }  ///< with the start values

 private:
  std::string edited(const std::string& text, std::span<const double> values) const;
  Result<std::shared_ptr<const mujoco::Model>> load(const std::string& text, std::span<const double> values) const;
  void try_without_scenery();

  std::shared_ptr<const Variant> variant_;
  std::string text_, lean_;  ///< as written; without what is only seen
  std::shared_ptr<const mujoco::Model> reference_;
};

/// Mean absolute error [mrad] as `tribotwin run` reports it; NaN where nothing was measured.
double mae_mrad(const Recording& recording, std::span<const double> positions_rad);

enum class Norm { squared, absolute };  ///< of the error of position

struct SearchOptions {
  Norm norm = Norm::squared;
  double correlation_s = 3;  ///< errors of position this far apart count as independent
  int starts = 2;            ///< the first at the start values, the others drawn around them
  int evaluations = 400;     ///< of each start; an evaluation simulates every recording to learn from
  std::uint64_t seed = 1;
};

struct Split {
  struct Fold {
    std::string label;
    std::vector<std::size_t> held_out;
  };
  std::string name;
  std::vector<Fold> folds;
};

struct Plan {
  std::vector<Variant> variants;
  std::vector<Recording> recordings;
  std::vector<Split> splits;
  SearchOptions search;
};

/// What one sought number turned out to be worth.
enum class ParameterStatus {
  known,  ///< it was not sought
  estimated,
  prior,  ///< the recordings say little beyond what was known beforehand
  at_bound
};
std::string_view name(ParameterStatus knowledge);

/// One variant fitted on all recordings but those of a fold.
struct SimulationFit {
  static constexpr std::size_t all = static_cast<std::size_t>(-1);
  std::size_t variant = 0, split = all, fold = 0;
  std::vector<double> values;              ///< per quantity
  std::vector<double> sigma;               ///< per quantity, NaN unless estimated or prior; of fits on all recordings
  std::vector<ParameterStatus> knowledge;  ///< alike
  Eigen::MatrixXd correlation;             ///< alike, quantities by quantities
  std::vector<double> mae_mrad;            ///< per recording of the plan, learnt from or not
  double objective = 0;                    ///< the minimum found
  std::vector<double> minima;              ///< that each start found
};

struct Watch {
  unsigned threads = 1;
  const std::atomic<bool>* stop = nullptr;
  std::function<void(double share)> progress;      ///< one call at a time
  std::function<void(const SimulationFit&)> done;  ///< one call at a time, in any order
};

/// Fits every variant on all recordings and on those of every fold, fits in `have` excepted. Fits and starts are spread
/// over the threads; each is a chain of its own, so that their number changes nothing. Fails when a variant is refused
/// or a found twin diverges; a stop is no failure, the fits that were reached have been handed out.
Result<void> calibrate(const Plan& plan, const std::vector<SimulationFit>& have, const Watch& watch);

}  // namespace tribotwin::twin::identification
