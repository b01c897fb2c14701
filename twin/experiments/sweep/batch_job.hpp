#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>

/// How long a sweep takes, and the job of Slurm that makes it.
namespace tribotwin::twin::sweep {

/// Foretold from one run of `one_s` [s] for all ranks and their threads together: whole rounds of runs, but never less
/// than rank 0 takes to keep them, 0.25 ms each (tests/README.md, Ranks). Ranks that wait for the last runs are in it,
/// the start of the job and slower machines are not.
double predicted_s(std::size_t runs, double one_s, unsigned workers);

/// As many ranks as bring the sweep to about a quarter of an hour, but at least four runs for each, so that few wait
/// at the end.
unsigned suitable_ranks(std::size_t runs, double one_s, unsigned threads);

struct BatchJob {
  std::filesystem::path program, plan, directory;  ///< absolute
  std::size_t runs = 0;
  unsigned ranks = 1, threads = 1;  ///< threads: of each rank
  int retries = 1;                  ///< of a run that fails
  double one_s = 0;                 ///< of one run
  double memory_MB = 0;             ///< of a process that made one run
};

/// The file for `sbatch`: DIRECTORY.sbatch, beside the folder.
std::filesystem::path batch_file(const BatchJob& job);

/// Its text: one job of so many ranks that is queued again when something ends it before the sweep is complete.
/// ErrorKind::input where Slurm could not read a name.
Result<std::string> sbatch(const BatchJob& job);

}  // namespace tribotwin::twin::sweep
