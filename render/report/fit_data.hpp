#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include <tribotwin/twin/identification/parameters.hpp>
#include <tribotwin/twin/identification/samples.hpp>

namespace tribotwin::render {

struct FitOptions {
  std::vector<std::filesystem::path> data;   ///< else those that the parameter file names
  twin::identification::ReadOptions read;    ///< what is 0 or empty is taken from the parameter file
};

/// An identified law and what it was identified from, or is held against.
struct FitData {
  std::filesystem::path file;
  std::string text;                               ///< of the file, as it is
  twin::identification::ParameterFile parameters;
  drive::Drive drive;                             ///< with this law; torque_max_nm and gear_ratio are 1 where not known
  std::vector<std::filesystem::path> data;        ///< the files that were read
  twin::identification::Samples samples;          ///< without rows when the data are missing
  std::vector<double> residuals;                  ///< measured - law [unit of the law], as the twin evaluates it
  double mean = 0, deviation = 0, largest = 0;    ///< of the residuals: mean, standard deviation, magnitude
  std::size_t outside = 0;                        ///< samples outside the law's range, where it is held at its edge
  bool own_data = true;                           ///< the samples are those that the law was identified from
  std::vector<std::string> missing;               ///< what a reader must know is not there, and why: sentences
};

/// As twin::identification::read_parameters, with every failure as a sentence that names the file.
tl::expected<twin::identification::ParameterFile, std::string> read_parameter_file(const std::filesystem::path& file);

/// A drive with the file's law, to draw it: torque_max_nm and gear_ratio are 1 where the file does not say them, which
/// leaves normalised torque and the law's own speed.
drive::Drive drawn_drive(const twin::identification::ParameterFile& file);

/// Looks for data that only the parameter file names relative to the working directory, then to the parameter file's
/// folder; where a file is in neither, there are no samples and `missing` says so. Fails on a parameter file that cannot be
/// read, on data that were asked for and are not there, and on data that are no measurement for this law.
tl::expected<std::unique_ptr<FitData>, std::string> load_fit(const std::filesystem::path& parameters, const FitOptions& options = {});

}  // namespace tribotwin::render
