#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/twin/identification/calibration.hpp>
#include <tribotwin/twin/io/input.hpp>

/// FIT.yaml, the input of `tribotwin calibrate`. The readers throw InputError.
namespace tribotwin::twin::program {

/// A FIT.yaml, checked against models and recordings.
struct CalibrationCampaign {
  std::filesystem::path file;
  std::string resolved;  ///< everything that decides the result
  identification::Plan plan;
  std::size_t reference = 0;  ///< the variant that the others are compared with
};

/// `seed` replaces that of the file.
CalibrationCampaign read_calibration(const std::filesystem::path& file, std::optional<std::uint64_t> seed,
                                     const TableOptions& tables);

/// The section `recordings`: files and their settings. `law` may be any law, because the keys of a controller do not
/// depend on it.
std::vector<identification::Recording> read_recordings(Mapping in, const std::filesystem::path& folder,
                                                       const friction::LawInfo& law, const TableOptions& tables);

/// One entry of `hold_out`: folds of recordings.
identification::Split read_split(Mapping in, const std::vector<identification::Recording>& recordings);

}  // namespace tribotwin::twin::program
