#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>

namespace tribotwin::render {

/// An identified law, and the data that it was identified from or is compared with.
struct FitData {
  std::filesystem::path file;
  std::string text;  ///< of the file, as it is
  twin::identification::ParameterFile parameters;
  drive::Drive drive;                     ///< with this law, as of drawn_drive
  twin::identification::Samples samples;  ///< without rows when there are no data to show
  std::vector<double> residuals;          ///< measured - law [unit of the law], as the twin evaluates it
  double deviation = 0;                   ///< their standard deviation
  bool own_data = true;                   ///< the samples are those that the law was identified from
  std::vector<std::string> missing;       ///< what is not there, and why: sentences for the reader

  /// Whether the file says how well the law follows measured friction; after 'tribotwin calibrate' it does not.
  bool has_residual() const { return parameters.found.residual.std > 0 || parameters.found.condition_number > 0; }
};

/// As twin::identification::read_parameters, with every failure as a sentence that names the file. torque_max_nm and
/// gear_ratio are those of `given` where it has them.
Result<twin::identification::ParameterFile> read_parameter_file(const std::filesystem::path& file,
                                                                const twin::identification::ReadOptions& given);

/// A drive with the file's law, to draw it: torque_max_nm and gear_ratio are 1 where the file does not say them, which
/// leaves normalised torque and the law's own speed.
drive::Drive drawn_drive(const twin::identification::ParameterFile& file);

/// For bands around its curves. Nothing where no parameter has a sigma, or one that was looked for has none: then
/// nobody knows how sure the curve is.
std::optional<friction::Uncertainty> uncertainty_of(const twin::identification::ParameterFile& file);

/// Those rows of measured friction, for a drive with the law they were read for.
std::vector<FrictionPoint> friction_points(const drive::Drive& drive, const twin::identification::Samples& samples,
                                           std::span<const std::size_t> rows);

/// `data`: what the law is compared with; else what the parameter file names, relative to the working directory or to
/// its own folder. Where that is not there, or no measured friction, there are no samples and `missing` says so. Fails
/// on a parameter file that cannot be read, on data that were asked for and are not there, and on data that are no
/// measurement for this law.
Result<FitData> load_fit(const std::filesystem::path& parameters, std::vector<std::filesystem::path> data,
                         twin::identification::ReadOptions read);

}  // namespace tribotwin::render
