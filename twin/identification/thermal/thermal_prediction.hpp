#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/identification/thermal/thermal_uncertainty.hpp>

/// What a file of `tribotwin thermal`, a chain's too, says of its parameters and predicts of recordings.
namespace tribotwin::twin::identification {

struct ThermalParameters {
  bool chain = false;             ///< joints that warm each other
  std::vector<std::string> data;  ///< the recordings they are from, as named then
  struct Row {
    std::string joint;         ///< "all": of a whole chain
    Estimate estimate;         ///< without its interval
    bool identifiable = true;  ///< else its value serves predictions within the recorded range, and is no result
  };
  std::vector<Row> rows;
  std::optional<Surroundings> surroundings;  ///< of the first joint that knows its uncertainty
};

/// Of a joint without its T_amb, which is that of its recordings. ErrorKind::input with file, key and what would be
/// right.
Result<ThermalParameters> read_thermal_parameters(const std::filesystem::path& file);

/// Which of these files the models of `parameters` are from, by whatever path. `data`: as that file names them.
std::vector<bool> of_the_fit(const std::vector<std::string>& files, const std::vector<std::string>& data,
                             const std::filesystem::path& parameters);

/// The temperatures of a session [degC], from its first one.
struct PredictedSession {
  std::vector<double> temperature_degC;
  std::vector<double> half_width_K;  ///< of the band of 95 % (thermal_band.hpp); empty where the file knows none
  double rms_K = 0, largest_K = 0;   ///< of predicted - recorded
  double inside = 0;                 ///< share of the recorded temperatures after the first within the band
};

/// Per joint of the recordings, per session. ErrorKind::input with the file, and the joint that either lacks.
Result<std::vector<std::vector<PredictedSession>>> predict_temperatures(const std::filesystem::path& parameters,
                                                                        const ThermalRecordings& recordings);

}  // namespace tribotwin::twin::identification
