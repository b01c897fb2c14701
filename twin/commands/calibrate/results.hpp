#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/twin/commands/calibrate/campaign.hpp>
#include <tribotwin/twin/io/file.hpp>

/// The results of `tribotwin calibrate`: in memory, as calibration.json, as a table, and as twins that run.
namespace tribotwin::twin::program {

/// The fits of a campaign by (variant, split, fold), and their errors.
struct CalibrationResults {
  const CalibrationCampaign& campaign;
  std::vector<identification::SimulationFit> fits;

  const identification::SimulationFit* find(std::size_t variant, std::size_t split, std::size_t fold) const {
    const auto found = std::ranges::find_if(fits, [&](const identification::SimulationFit& f) {
      return f.variant == variant && f.split == split && f.fold == fold;
    });
    return found == fits.end() ? nullptr : &*found;
  }
  std::size_t wanted() const {
    std::size_t each = 1;
    for (const auto& s : campaign.plan.splits) each += s.folds.size();
    return each * campaign.plan.variants.size();
  }
  bool complete() const { return fits.size() == wanted(); }

  const std::vector<std::size_t>& held_out(const identification::SimulationFit& f) const {
    static const std::vector<std::size_t> none;
    return f.split == identification::SimulationFit::all ? none : campaign.plan.splits[f.split].folds[f.fold].held_out;
  }
  /// Mean over the recordings that were held out (`unseen`) or learnt from [mrad].
  double mae(const identification::SimulationFit& f, bool unseen) const {
    const auto& out = held_out(f);
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < f.mae_mrad.size(); ++i)
      if ((std::ranges::find(out, i) != out.end()) == unseen) sum += f.mae_mrad[i], ++count;
    return sum / count;
  }
  /// Mean over all folds of a split; NaN before all folds are done.
  double mae(std::size_t variant, std::size_t split, bool unseen) const {
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < campaign.plan.splits[split].folds.size(); ++k) {
      const identification::SimulationFit* f = find(variant, split, k);
      if (!f) return std::nan("");
      const auto out = static_cast<double>(held_out(*f).size()),
                 recordings = unseen ? out : static_cast<double>(f->mae_mrad.size()) - out;
      sum += mae(*f, unseen) * recordings, count += recordings;
    }
    return sum / count;
  }
  /// Mean over all splits.
  double held_out_mae(std::size_t variant) const {
    double sum = 0;
    for (std::size_t s = 0; s < campaign.plan.splits.size(); ++s) sum += mae(variant, s, true);
    return sum / static_cast<double>(campaign.plan.splits.size());
  }
};

/// calibration.json with a checksum of everything else as its last key.
std::string calibration_file(const CalibrationResults& results);
/// The same without the checksum, as printed.
std::string json_text(const CalibrationResults& results);
std::string table_of(const CalibrationResults& results);

/// The fits that `file` already holds; none where it does not exist. Throws InputError where it is no calibration or
/// that of another campaign.
std::vector<identification::SimulationFit> read_fits(const CalibrationCampaign& campaign,
                                                     const std::filesystem::path& file);

/// Writes the twin of a fit on all recordings: VARIANT.params.yaml (the law), VARIANT.xml (the model) and VARIANT.yaml
/// (a scenario that runs them).
Result<void> write_twin(const CalibrationResults& results, const identification::SimulationFit& fit,
                        const std::filesystem::path& directory, Existing existing);

/// What the health check warns of where the twin of a fit on all recordings follows them, a sentence per check: with
/// the first recording, and in how many it is so.
Result<std::vector<std::string>> warnings_of(const CalibrationResults& results,
                                             const identification::SimulationFit& fit);

}  // namespace tribotwin::twin::program
