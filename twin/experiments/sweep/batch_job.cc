#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/sweep/batch_job.hpp>

namespace tribotwin::twin::sweep {
namespace {

namespace fs = std::filesystem;

constexpr double keep_s = 0.25e-3;       // of a finished run on disk
constexpr double wished_s = 15 * 60;     // of a job whose size nobody asked for
constexpr double longest_s = 12 * 3600;  // that most partitions allow; a longer sweep is several stretches
constexpr double start_s = 600;          // for a slow disk, and the notice before the end

/// In single quotes, for bash.
std::string in_quotes(const fs::path& path) {
  std::string text = "'";
  for (const char c : path.string()) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

/// For a line of #SBATCH, where % begins what Slurm fills in.
std::string in_directive(const fs::path& path) {
  std::string text;
  for (const char c : path.string()) text += c == '%' ? std::string("%%") : std::string(1, c);
  return text;
}

/// Twice the time foretold, but never less than a few runs take: a stretch in which none ends would be the last.
long limit_min(const BatchJob& job) {
  const double all = 2 * predicted_s(job.runs, job.one_s, job.ranks * job.threads) + start_s;
  return static_cast<long>(std::ceil(std::max(std::min(all, longest_s), 4 * job.one_s + start_s) / 60));
}

constexpr char script[] = R"sh(
[ -n "${SLURM_JOB_ID:-}" ] || { echo "This is a job: start it with sbatch $0" >&2; exit 2; }

finished() { find "$folder/runs" -name '[0-9]*.json' 2> /dev/null | wc -l; }
say() { echo "$(date '+%F %T') job $SLURM_JOB_ID, start $((${SLURM_RESTART_COUNT:-0} + 1)): $*"; }

# Makes the sweep with this launcher, and sets code.
make() {
  say "$before runs are finished; ${SLURM_NTASKS:-1} ranks on ${SLURM_JOB_NODELIST:-this machine}: $*"
  "$@" "$program" sweep "$plan" -o "$folder" --threads "${SLURM_CPUS_PER_TASK:-1}" --retries "$retries" --quiet &
  ranks=$!
  wait "$ranks"
  code=$?
}
# Code 0 without results: a launcher that gave up says so at times. Code 1 with results of this start: some runs have
# failed.
results() { stat -c %Y "$folder/statistics.json" 2> /dev/null || echo 0; }
complete() { if [ "$code" -eq 0 ]; then [ "$(results)" -gt 0 ]; else [ "$(results)" -ge "$started" ]; fi; }
# Not one run more, and the input was not wrong: the ranks cannot be started or do not find each other.
idle() { ! complete && [ "$code" -ne 2 ] && [ "$(finished)" -le "$before" ]; }

# Only a job that still runs comes back, not one that was cancelled.
again() {
  [ "$(squeue -h -j "$SLURM_JOB_ID" -o %T)" = RUNNING ] || exit 1
  if [ "$(finished)" -le "$before" ]; then
    say "$1; no run was finished since the start, so it is not queued again"
    exit 1
  fi
  say "$1; $(finished) runs are finished, queued again for the others"
  scontrol requeue "$SLURM_JOB_ID" || exit 1
  sleep 300 &  # Slurm ends this script; bash answers signals while it waits
  wait $!
}

before=$(finished)
started=$(date +%s)
trap 'again "the time limit is near"' USR1
trap 'wait "$ranks"; say "ended by Slurm; $(finished) runs are finished"; exit 143' TERM
# srun where Slurm offers PMIx, which Open MPI knows; otherwise, or where that fails, mpirun of the MPI the program was
# built with. If the manual of your cluster names another launcher, write it in their place.
if [ "${SLURM_NTASKS:-1}" -eq 1 ]; then
  make env
else
  code=1
  if srun --mpi=list 2>&1 | grep -qw pmix; then
    make srun --mpi=pmix --kill-on-bad-exit=1 --cpus-per-task="${SLURM_CPUS_PER_TASK:-1}"
  fi
  if idle; then make mpirun --bind-to none; fi
fi
if complete; then
  # A rank that dies when the results are written changes nothing of them.
  if [ "$code" -gt 1 ]; then
    code=1
    if "$program" sweep -o "$folder" --status --json | grep -q '"failed": 0,'; then code=0; fi
  fi
  say "complete"
elif [ "$code" -ne 2 ]; then
  again "the ranks ended with code $code"
fi
exit "$code"
)sh";

}  // namespace

double predicted_s(std::size_t runs, double one_s, unsigned workers) {
  const double rounds = std::ceil(static_cast<double>(runs) / std::max(workers, 1U));
  return std::max(rounds * one_s, static_cast<double>(runs) * keep_s);
}

unsigned suitable_ranks(std::size_t runs, double one_s, unsigned threads) {
  const double workers = static_cast<double>(runs) * one_s / wished_s;
  const double most = std::max(1.0, std::floor(static_cast<double>(runs) / (4.0 * threads)));
  return static_cast<unsigned>(std::clamp(std::ceil(workers / threads), 1.0, most));
}

fs::path batch_file(const BatchJob& job) { return job.directory.string() + ".sbatch"; }

Result<std::string> sbatch(const BatchJob& job) {
  for (const fs::path& name : {job.program, job.plan, job.directory})
    if (name.string().find_first_of("\n\r\"\\") != std::string::npos)
      return tl::unexpected(Error(
          fmt::format("{}: has a quotation mark, a backslash or a line break, which a file for sbatch cannot hold",
                      name.string())));
  std::string text = "#!/bin/bash\n";
  text += fmt::format("# A sweep of {} runs on {} rank{} of {} thread{}. State of it: tribotwin sweep -o {} --status\n",
                      job.runs, job.ranks, job.ranks == 1 ? "" : "s", job.threads, job.threads == 1 ? "" : "s",
                      in_quotes(job.directory));
  text += fmt::format(
      "# One run took {:.3g} s where this was written; that makes {:.3g} min for all. --time is more, because other\n"
      "# machines and other runs differ.\n",
      job.one_s, predicted_s(job.runs, job.one_s, job.ranks * job.threads) / 60);
  text +=
      "# When a rank is killed, a node fails or the time is over, the job goes back into the queue by itself and then "
      "makes\n# the runs that are missing. scancel ends it; sbatch continues it. Another size: sbatch --ntasks=N.\n";
  text += "#SBATCH --job-name=tribotwin-sweep\n";
  text += fmt::format("#SBATCH --output=\"{}.slurm-%j.log\"\n", in_directive(job.directory));
  text += "#SBATCH --open-mode=append\n";
  text += fmt::format("#SBATCH --ntasks={}\n#SBATCH --cpus-per-task={}\n", job.ranks, job.threads);
  text += fmt::format("#SBATCH --time={}\n", limit_min(job));
  text += "#SBATCH --requeue\n#SBATCH --signal=B:USR1@120\n";
  text +=
      fmt::format("# If your cluster asks for them: --partition, --account, --mem-per-cpu (one run took {:.0f} MB).\n",
                  job.memory_MB);
  text += fmt::format("program={}\nplan={}\nfolder={}\nretries={}\n", in_quotes(job.program), in_quotes(job.plan),
                      in_quotes(job.directory), job.retries);
  return text + script;
}

}  // namespace tribotwin::twin::sweep
