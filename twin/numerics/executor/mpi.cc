#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <dlfcn.h>
#include <fmt/format.h>
#include <unistd.h>

#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>
#include <tribotwin/twin/numerics/executor/mpi_functions.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// Messages over MPI, in frames of a size that it can count; the first byte of a frame says whether more follow.
class Mpi final : public Transport {
 public:
  Mpi(const tribotwin_mpi_functions& mpi, int rank, int size) : mpi_(mpi), rank_(rank), size_(size) {}
  int rank() const override { return rank_; }
  int size() const override { return size_; }
  void send(int to, const std::string& bytes) override {
    std::size_t at = 0;
    do {
      const std::size_t length = std::min(largest_frame, bytes.size() - at);
      std::string frame(1, at + length < bytes.size());
      frame.append(bytes, at, length);
      mpi_.send(to, frame.data(), frame.size());
      at += length;
    } while (at < bytes.size());
  }
  std::optional<Message> receive() override {
    int from = 0;
    std::size_t size = 0;
    while (mpi_.probe(&from, &size)) {
      std::string frame(size, '\0');
      mpi_.receive(frame.data(), size);
      std::string& whole = begun_[from];
      whole.append(frame, 1);
      if (frame[0] == 0) return Message{from, std::exchange(whole, {})};
    }
    return std::nullopt;
  }
  void close() override { mpi_.close(); }

 private:
  static constexpr std::size_t largest_frame = std::size_t{64} << 20;
  const tribotwin_mpi_functions& mpi_;
  const int rank_, size_;
  std::map<int, std::string> begun_;  ///< per sender
};

int number(const char* text) { return text ? std::atoi(text) : 0; }

/// Beside the program in the build tree, or where it is installed.
std::vector<fs::path> places() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  return {folder / "libtribotwin_mpi.so", folder.parent_path() / TRIBOTWIN_LIBRARIES / "libtribotwin_mpi.so"};
}

Result<const tribotwin_mpi_functions*> load() {
  std::string why = "libtribotwin_mpi.so is not there: this program was built where CMake found no MPI";
  for (const fs::path& file : places()) {
    std::error_code error;
    if (!fs::exists(file, error)) continue;
    // Open MPI's own plugins look its symbols up in the whole program.
    void* library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_GLOBAL);
    if (void* symbol = library ? ::dlsym(library, TRIBOTWIN_MPI_SYMBOL) : nullptr)
      return static_cast<const tribotwin_mpi_functions*>(symbol);
    why = ::dlerror();
  }
  return work_failed(why);
}

/// The arguments of this process without the number of threads, which machines of one job may have different.
std::string arguments() {
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  std::string all, word;
  for (bool skip = false; std::getline(file, word, '\0'); skip = word == "--threads")
    if (!skip && !word.starts_with("--threads")) all += word + '\0';
  return all;
}

std::string host() {
  char name[256] = {};
  return ::gethostname(name, sizeof name - 1) == 0 ? name : "?";
}

tl::unexpected<Error> not_joined(const Launch& launch, const std::string& why) {
  return work_failed(fmt::format(
      "{} has started {} ranks, but they cannot work together ({}); {}TRIBOTWIN_RANKS=alone makes each a "
      "program of its own",
      launch.launcher, launch.ranks, why, launch.reachable ? "" : "start them with srun --mpi=pmix, or with mpirun; "));
}

}  // namespace

std::optional<Launch> launch(const std::function<const char*(const char*)>& environment) {
  const auto has = [&](const char* name) { return environment(name) != nullptr; };
  if (const char* wish = environment("TRIBOTWIN_RANKS"); wish && std::string_view(wish) == "alone") return {};
  if (has("OMPI_COMM_WORLD_SIZE")) return Launch{"mpirun", number(environment("OMPI_COMM_WORLD_SIZE"))};
  // A batch script has SLURM_NTASKS as well, but only the tasks of a step have the size of the step.
  if (has("SLURM_PROCID") && has("SLURM_STEP_NUM_TASKS"))
    return Launch{"srun", number(environment("SLURM_STEP_NUM_TASKS")), has("PMIX_RANK") || has("PMI_RANK")};
  if (has("PMI_SIZE")) return Launch{"mpiexec", number(environment("PMI_SIZE"))};
  return {};
}

Result<void> join_ranks() {
  const auto started = launch([](const char* name) { return std::getenv(name); });
  if (!started || started->ranks <= 1 || ranks().several()) return {};
  if (!started->reachable) return not_joined(*started, "it offers no PMI");
  const auto mpi = load();
  if (!mpi) return not_joined(*started, mpi.error().message);
  int rank = 0, size = 0;
  if (const int error = (*mpi)->open(&rank, &size))
    return not_joined(*started, fmt::format("MPI_Init gives error {}", error));
  if (size != started->ranks)
    return not_joined(*started, fmt::format("{} sees {}", (*mpi)->version(), size == 1 ? "one" : std::to_string(size)));
  ranks() = Ranks(std::make_unique<Mpi>(**mpi, rank, size));
  if (!ranks().join(arguments(), host())) {
    if (rank == 0) note("the {} ranks have different arguments: each is a program of its own", size);
    return {};
  }
  if (!ranks().root()) hold_output_back();
  return {};
}

int leave_ranks(int code) {
  if (!ranks().several()) return code;
  const bool root = ranks().root();
  ranks().leave(code, held_error());
  return root ? code : done;
}

}  // namespace tribotwin::twin
