#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <new>
#include <system_error>

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/telemetry/hdf5.hpp>

namespace tribotwin::twin::hdf5 {

namespace {

std::recursive_mutex mutex;
bool alone = false;  // in the child of survives(): its parent held the lock for it

}  // namespace

std::string system_reason(int error) { return std::generic_category().message(error); }

namespace {

/// HDF5 prints what fails while it starts, and cannot be told before not to.
bool start_silently() {
  const int shown = ::fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0), nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
  H5dont_atexit();  // at exit HDF5 would close files again, and crash; refused where another library has started it
  const bool good = H5open() >= 0;
  if (shown >= 0) ::dup2(shown, STDERR_FILENO);
  for (const int descriptor : {shown, nowhere})
    if (descriptor >= 0) ::close(descriptor);
  return good;
}

}  // namespace

Hdf5::Hdf5() : lock_(alone ? std::unique_lock<std::recursive_mutex>() : std::unique_lock(mutex)) {
  static bool started = false;  // under the lock
  if (!started && !start_silently()) throw std::bad_alloc();
  started = true;
  H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

Hdf5::~Hdf5() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }

namespace {

/// In the child: signals end it, whoever catches them in the parent; what libraries say of a crash reaches nobody.
void be_silent() {
  for (const int signal : {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL}) std::signal(signal, SIG_DFL);
  const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
}

std::uintmax_t peak_bytes() {
  struct rusage usage {};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uintmax_t>(usage.ru_maxrss) * limits::KiB;
}

/// From now on, beyond what there is.
void limit_memory(std::uintmax_t most_bytes) {
  std::uintmax_t pages[6] = {};  // size, resident, shared, text, 0, data
  std::ifstream in("/proc/self/statm");
  for (auto& count : pages) in >> count;
  if (!in) return;
  const rlim_t bytes = pages[5] * static_cast<std::uintmax_t>(::sysconf(_SC_PAGESIZE)) + most_bytes;
  struct rlimit limit {};
  ::getrlimit(RLIMIT_DATA, &limit);
  limit.rlim_cur = std::min<rlim_t>(bytes, limit.rlim_max);
  ::setrlimit(RLIMIT_DATA, &limit);
}

/// Whether `work` did with that much memory. A library that was refused some goes on with an error of its own.
bool does_with(const std::function<void()>& work, std::uintmax_t most_bytes) {
  limit_memory(most_bytes);
  const std::uintmax_t before = peak_bytes();
  errno = 0;
  try {
    work();
  } catch (const std::bad_alloc&) {
    return false;
  } catch (...) {  // the caller meets the same failure
  }
  return errno != ENOMEM && peak_bytes() - before <= most_bytes;
}

enum class Ending : char { crash, no_memory, good };

/// A byte that a child writes and its parent reads: the state of waitpid is lost where SIGCHLD is ignored.
class SharedEnding {
 public:
  SharedEnding() : place_(::mmap(nullptr, 1, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0)) {
    if (place_ == MAP_FAILED) throw Failure(system_reason(errno));
  }
  SharedEnding(const SharedEnding&) = delete;
  ~SharedEnding() { ::munmap(place_, 1); }
  volatile Ending& operator*() const { return *static_cast<volatile Ending*>(place_); }

 private:
  void* place_;  // of zeros: crash
};

/// How a child ends that does `work`.
Ending ending_after(const std::function<void()>& work, std::uintmax_t most_bytes) {
  const SharedEnding ending;
  const pid_t child = ::fork();
  if (child < 0) throw Failure(system_reason(errno));
  if (child == 0) {
    alone = true;
    be_silent();
    *ending = does_with(work, most_bytes) ? Ending::good : Ending::no_memory;
    ::_exit(0);
  }
  while (::waitpid(child, nullptr, 0) < 0) {
    if (errno == ECHILD) break;
    if (errno != EINTR) throw Failure(system_reason(errno));
    if (!interrupted()) continue;
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    throw Failure("interrupted");
  }
  return *ending;
}

}  // namespace

std::uintmax_t memory_for(const fs::path& file) {
  std::error_code error;
  const auto size = fs::file_size(file, error);
  if (error) return limits::library_bytes;
  return limits::library_bytes + std::min(2 * limits::array_bytes, 2 * size * limits::best_compression);
}

bool survives(const std::function<void()>& work, std::uintmax_t most_bytes) {
  const std::lock_guard whole(mutex);  // so that no other thread is inside HDF5 when the child is made
  Ending ending = ending_after(work, most_bytes);
  // A file that wants memory without end wants it again; a machine that was short of it for a moment is not.
  if (ending == Ending::no_memory) ending = ending_after(work, most_bytes);
  return ending == Ending::good;
}

std::string hdf5_reason() {
  std::array<char, 1024> text{};
  H5Ewalk2(
      H5E_DEFAULT, H5E_WALK_UPWARD,
      [](unsigned n, const H5E_error2_t* error, void* out) -> herr_t {
        if (n == 0 && error->desc) std::snprintf(static_cast<char*>(out), 1024, "%s", error->desc);
        return 0;
      },
      text.data());
  std::string reason = text.data();
  if (const auto at = reason.find("error message = '"); at != std::string::npos) {
    reason.erase(0, at + 17);
    reason.erase(std::min(reason.find('\''), reason.size()));
  }
  return reason.empty() ? "HDF5 gave no reason" : reason;
}

void write_attribute(hid_t object, const std::string& name, hid_t type, const void* value) {
  const Id space(H5Screate(H5S_SCALAR), H5Sclose);
  const Id attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  check(H5Awrite(attribute, type, value));
}
void write_attribute(hid_t object, const std::string& name, const std::string& value) {
  // Of fixed length, so it lies under the checksum of its object: HDF5 1.10 crashes on damaged strings of variable
  // length.
  const Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  check(H5Tset_size(type, value.size() + 1));
  check(H5Tset_cset(type, H5T_CSET_UTF8));
  write_attribute(object, name, type, value.c_str());
}

namespace {

std::string read_text(hid_t attribute) {
  const Id type(H5Aget_type(attribute), H5Tclose);
  if (H5Tget_class(type) != H5T_STRING || check(H5Tis_variable_str(type))) return {};
  const std::size_t size = H5Tget_size(type);
  if (size > limits::hdf5_text_bytes)
    throw Failure(fmt::format("an attribute has {} bytes; at most {} are read", size, limits::hdf5_text_bytes));
  std::string value(size, '\0');
  check(H5Aread(attribute, type, value.data()));
  value.resize(std::min(value.find('\0'), value.size()));
  return value;
}
}  // namespace

std::string read_text(hid_t object, const char* name) {
  return check(H5Aexists(object, name)) ? read_text(Id(H5Aopen(object, name, H5P_DEFAULT), H5Aclose)) : "";
}

bool keeps_order(hid_t group, herr_t (*of)(hid_t, unsigned*)) {
  const Id opened(H5Gopen2(group, ".", H5P_DEFAULT), H5Gclose), properties(H5Gget_create_plist(opened), H5Pclose);
  unsigned order = 0;
  check(of(properties, &order));
  return (order & H5P_CRT_ORDER_TRACKED) != 0;
}

std::pair<std::vector<std::pair<std::string, std::string>>, NumericAttributes> read_attributes(hid_t group) {
  std::pair<std::vector<std::pair<std::string, std::string>>, NumericAttributes> all;
  H5O_info_t info;
  check(H5Oget_info2(group, &info, H5O_INFO_NUM_ATTRS));
  // Above eight attributes HDF5 loses the order unless it is tracked, which create_record requests.
  const auto order = [&](H5_index_t index, hsize_t n) {
    return H5Aopen_by_idx(group, ".", index, H5_ITER_INC, n, H5P_DEFAULT, H5P_DEFAULT);
  };
  const bool ordered = keeps_order(group, H5Pget_attr_creation_order);
  for (hsize_t n = 0; n < info.num_attrs; ++n) {
    hid_t id = order(H5_INDEX_CRT_ORDER, n);
    if (id < 0 && !ordered) id = order(H5_INDEX_NAME, n);
    const Id attribute(id, H5Aclose);
    std::string name(check(H5Aget_name(attribute, 0, nullptr)), '\0');
    check(H5Aget_name(attribute, name.size() + 1, name.data()));
    if (H5Tget_class(Id(H5Aget_type(attribute), H5Tclose)) == H5T_STRING) {
      all.first.emplace_back(name, read_text(attribute));
    } else if (double value = 0; H5Sget_simple_extent_npoints(Id(H5Aget_space(attribute), H5Sclose)) == 1) {
      check(H5Aread(attribute, H5T_NATIVE_DOUBLE, &value));
      all.second.emplace_back(name, value);
    }
  }
  return all;
}

void write_rows(hid_t dataset, hsize_t from, std::span<const double> values) {
  const hsize_t count = values.size(), size = from + count;
  if (count == 0) return;
  check(H5Dset_extent(dataset, &size));
  const Id in_file(H5Dget_space(dataset), H5Sclose), in_memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
  check(H5Sselect_hyperslab(in_file, H5S_SELECT_SET, &from, nullptr, &count, nullptr));
  check(H5Dwrite(dataset, H5T_NATIVE_DOUBLE, in_memory, in_file, H5P_DEFAULT, values.data()));
}

}  // namespace tribotwin::twin::hdf5
