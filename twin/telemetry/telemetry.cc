#include <tribotwin/twin/telemetry/telemetry.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <cmath>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <mutex>
#include <set>
#include <stdexcept>
#include <system_error>
#include <tuple>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <hdf5.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = tl::expected<void, std::string>;

constexpr std::size_t block = 4096;   // samples per chunk and per write
constexpr char no_record[] = "is no readable HDF5 record";
constexpr char not_written[] = "cannot be written";

// Thrown inside this file only: the reason why something failed.
struct Failure : std::runtime_error {
  using std::runtime_error::runtime_error;
};

std::string system_reason(int error) { return std::generic_category().message(error); }

/// Result of `work`, or the message "FILE: PHRASE (reason)" for whatever it throws.
template <class Work>
auto guarded(const fs::path& path, std::string_view phrase, Work&& work) -> tl::expected<decltype(work()), std::string> {
  try {
    if constexpr (std::is_void_v<decltype(work())>) {
      work();
      return {};
    } else {
      return work();
    }
  } catch (const std::exception& e) {
    return tl::unexpected(fmt::format("{}: {} ({})", path.string(), phrase, e.what()));
  } catch (...) {
    return tl::unexpected(fmt::format("{}: {} (unknown reason)", path.string(), phrase));
  }
}

/// One thread in HDF5 at a time, held per block and not per sample; HDF5 prints no errors meanwhile.
class Hdf5 {
 public:
  Hdf5() : lock_(mutex()) {
    H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~Hdf5() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }
  Hdf5(const Hdf5&) = delete;

 private:
  static std::recursive_mutex& mutex() {
    static std::recursive_mutex m;
    return m;
  }
  std::lock_guard<std::recursive_mutex> lock_;
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

/// HDF5's innermost reason for the last failure. The next HDF5 call, closing an id included, forgets it.
std::string hdf5_reason() {
  std::array<char, 1024> text{};
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD,
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

template <class Result>
Result check(Result result) {
  if (result < 0) throw Failure(hdf5_reason());
  return result;
}

/// Owns an HDF5 id.
class Id {
 public:
  Id() = default;
  Id(hid_t id, herr_t (*closer)(hid_t)) : id_(check(id)), close_(closer) {}
  Id(Id&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Id& operator=(Id&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Id() { (void)close(); }
  herr_t close() {
    if (id_ < 0) return 0;
    const Hdf5 hdf5;
    return close_(std::exchange(id_, -1));
  }
  operator hid_t() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }

 private:
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

class Descriptor {
 public:
  Descriptor() = default;
  Descriptor(const fs::path& path, int flags) : fd_(::open(path.c_str(), flags | O_CLOEXEC)) {
    if (fd_ < 0) throw Failure(system_reason(errno));
  }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  operator int() const { return fd_; }

 private:
  int fd_ = -1;
};

// A writer holds a shared lock of its own: HDF5 gives up its lock when SWMR starts, and an exclusive one could shut out
// readers on file systems where both kinds of lock are one.
void mark_in_use(const Descriptor& file) {
  struct flock lock{.l_type = F_RDLCK, .l_whence = SEEK_SET};
  (void)::fcntl(file, F_OFD_SETLK, &lock);   // a file system without locks: no protection, but a record
}

void refuse_if_in_use(const fs::path& path) {
  struct flock lock{.l_type = F_WRLCK, .l_whence = SEEK_SET};
  const Descriptor file(path, O_RDONLY);
  if (::fcntl(file, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK) throw Failure("a run is still writing it");
}

std::string group_name(const std::string& joint) {
  static const std::set<std::string> taken{".", "time_s", "cycle_time_s", "complete"};
  if (joint.empty()) return "%";
  std::string name;
  for (const char c : joint) {
    if (c == '\0') throw Failure("the name of a joint has a NUL in it");
    if (c == '/' || c == '%' || (name.empty() && taken.contains(joint))) name += fmt::format("%{:02X}", c);
    else name += c;
  }
  return name;
}

void write_attribute(hid_t object, const std::string& name, hid_t type, const void* value) {
  const Id space(H5Screate(H5S_SCALAR), H5Sclose);
  const Id attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  check(H5Awrite(attribute, type, value));
}
void write_attribute(hid_t object, const std::string& name, const std::string& value) {
  // Of fixed length, so it lies under the checksum of its object: HDF5 1.10 crashes on damaged strings of variable length.
  const Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  check(H5Tset_size(type, value.size() + 1));
  check(H5Tset_cset(type, H5T_CSET_UTF8));
  write_attribute(object, name, type, value.c_str());
}

std::string read_text(hid_t attribute) {
  const Id type(H5Aget_type(attribute), H5Tclose);
  if (H5Tget_class(type) != H5T_STRING || check(H5Tis_variable_str(type))) return {};
  std::string value(H5Tget_size(type), '\0');
  check(H5Aread(attribute, type, value.data()));
  value.resize(std::min(value.find('\0'), value.size()));
  return value;
}
std::string read_text(hid_t object, const char* name) {
  return check(H5Aexists(object, name)) ? read_text(Id(H5Aopen(object, name, H5P_DEFAULT), H5Aclose)) : "";
}

/// The string and the numeric attributes of an object.
auto read_attributes(hid_t object) {
  std::pair<std::vector<std::pair<std::string, std::string>>, NumericAttributes> all;
  H5O_info_t info;
  check(H5Oget_info2(object, &info, H5O_INFO_NUM_ATTRS));
  // Above eight attributes HDF5 forgets the order unless it is tracked, which create_record asks for.
  const auto order = [&](H5_index_t index, hsize_t n) { return H5Aopen_by_idx(object, ".", index, H5_ITER_INC, n, H5P_DEFAULT, H5P_DEFAULT); };
  for (hsize_t n = 0; n < info.num_attrs; ++n) {
    hid_t id = order(H5_INDEX_CRT_ORDER, n);
    if (id < 0) id = order(H5_INDEX_NAME, n);
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

void read_rows(hid_t dataset, hsize_t from, std::span<double> values) {
  const hsize_t count = values.size();
  if (count == 0) return;
  const Id in_file(H5Dget_space(dataset), H5Sclose), in_memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
  check(H5Sselect_hyperslab(in_file, H5S_SELECT_SET, &from, nullptr, &count, nullptr));
  if (H5Dread(dataset, H5T_NATIVE_DOUBLE, in_memory, in_file, H5P_DEFAULT, values.data()) < 0)
    throw Failure("the record is damaged: " + hdf5_reason());
}

/// A time column and the columns that share its length, with their rows not yet written.
struct Table {
  struct Column {
    Id dataset;
    std::vector<double> pending;
  };
  Column time;
  std::vector<Column> columns;
  hsize_t written = 0;

  std::size_t pending() const { return time.pending.size(); }
  void push(double time_s, std::span<const double> values) {
    time.pending.push_back(time_s);
    for (std::size_t i = 0; i < columns.size(); ++i) columns[i].pending.push_back(values[i]);
  }
  /// Bytes that the file may grow by when `rows` more are written: whole chunks and their index.
  hsize_t growth(hsize_t rows) const {
    const auto chunks = [](hsize_t n) { return (n + block - 1) / block; };
    return (chunks(written + rows) - chunks(written)) * (columns.size() + 1) * (block * sizeof(double) + 16384);
  }
  /// Time goes last: a reader never sees an instant whose values are missing.
  void write() {
    if (pending() == 0) return;
    const auto flush = [&](Column& column) {
      write_rows(column.dataset, written, column.pending);
      check(H5Dflush(column.dataset));
    };
    for (Column& column : columns) flush(column);
    flush(time);
    written += pending();
    for (Column& column : columns) column.pending.clear();
    time.pending.clear();
  }
};

/// A record being written.
struct Record {
  Descriptor descriptor;
  Id file, complete;
  Table samples, cycles;
  hsize_t reserved = 0;

  /// Claims the disk space of what comes next: a write that fails half way leaves HDF5 with a file nobody can open.
  void reserve(hsize_t bytes) {
    hsize_t end = 0;
    check(H5Fget_filesize(file, &end));
    end += bytes;
    if (end <= reserved) return;
    rlimit limit{};
    if (::getrlimit(RLIMIT_FSIZE, &limit) == 0 && end > limit.rlim_cur) throw Failure(system_reason(EFBIG));
    int error = 0;
    do error = ::fallocate(descriptor, FALLOC_FL_KEEP_SIZE, static_cast<off_t>(reserved), static_cast<off_t>(end - reserved)) == 0 ? 0 : errno;
    while (error == EINTR);
    if (error != 0 && error != EOPNOTSUPP && error != ENOSYS) throw Failure(system_reason(error));
    reserved = end;
  }
  void mark_complete(unsigned char value) { check(H5Dwrite(complete, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value)); }
  void close() {
    samples = {};
    cycles = {};
    (void)complete.close();   // its data went out with the last flush
    check(file.close());
    // To its own length: gives back what was claimed beyond.
    struct stat now{};
    if (::fstat(descriptor, &now) == 0 && ::ftruncate(descriptor, now.st_size) == 0) reserved = 0;
  }
};

Id create_column(hid_t parent, const Channel& channel, const char* time) {
  const hsize_t size = 0, most = H5S_UNLIMITED, chunk = block;
  const Id space(H5Screate_simple(1, &size, &most), H5Sclose), properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  // Uncompressed: each flush of a part of a chunk would leave its previous, smaller copy behind as waste.
  check(H5Pset_chunk(properties, 1, &chunk));
  Id dataset(H5Dcreate2(parent, channel.name.c_str(), H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, properties, H5P_DEFAULT), H5Dclose);
  write_attribute(dataset, "unit", channel.unit);
  write_attribute(dataset, "description", channel.description);
  if (time) write_attribute(dataset, "time", time);
  return dataset;
}

Record create_record(const fs::path& path, const TelemetryOptions& o) {
  std::set<std::string> seen;
  for (const auto& joint : o.joints)
    if (!seen.insert(group_name(joint)).second) throw Failure(fmt::format("two joints are called '{}'", joint));
  if (!o.joint_attributes.empty() && o.joint_attributes.size() != o.joints.size())
    throw Failure(fmt::format("{} joints, but attributes of {}", o.joints.size(), o.joint_attributes.size()));
  if (fs::exists(path)) refuse_if_in_use(path);

  constexpr unsigned ordered = H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED;
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose), file_properties(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  check(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110));
  check(H5Pset_link_creation_order(file_properties, ordered));
  check(H5Pset_attr_creation_order(file_properties, ordered));
  Record r;
  r.file = Id(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, file_properties, access), H5Fclose);
  r.descriptor = Descriptor(path, O_RDWR);
  mark_in_use(r.descriptor);
  r.reserve(65536 + 4096 * (1 + o.joints.size()) * (1 + o.channels.size() + o.cycle_channels.size()));
  for (const auto& [name, value] : o.attributes) write_attribute(r.file, name, value);
  const Id scalar(H5Screate(H5S_SCALAR), H5Sclose);
  r.complete = Id(H5Dcreate2(r.file, "complete", H5T_NATIVE_UINT8, scalar, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose);
  write_attribute(r.complete, "description", "1 when the run ended by itself, 0 while it runs and after a kill");
  r.mark_complete(0);

  r.samples.time.dataset = create_column(r.file, {"time_s", "s", "simulated time"}, nullptr);
  if (!o.cycle_channels.empty())
    r.cycles.time.dataset = create_column(r.file, {"cycle_time_s", "s", "simulated time at the end of each work cycle, skipped ones included"}, nullptr);
  const Id group_properties(H5Pcreate(H5P_GROUP_CREATE), H5Pclose), utf8(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  check(H5Pset_link_creation_order(group_properties, ordered));
  check(H5Pset_attr_creation_order(group_properties, ordered));
  check(H5Pset_char_encoding(utf8, H5T_CSET_UTF8));
  for (std::size_t j = 0; j < o.joints.size(); ++j) {
    const Id group(H5Gcreate2(r.file, group_name(o.joints[j]).c_str(), utf8, group_properties, H5P_DEFAULT), H5Gclose);
    write_attribute(group, "name", o.joints[j]);
    if (!o.joint_attributes.empty())
      for (const auto& [name, value] : o.joint_attributes[j]) write_attribute(group, name, H5T_NATIVE_DOUBLE, &value);
    for (const Channel& c : o.channels) r.samples.columns.push_back({create_column(group, c, "time_s"), {}});
    for (const Channel& c : o.cycle_channels) r.cycles.columns.push_back({create_column(group, c, "cycle_time_s"), {}});
  }
  check(H5Fflush(r.file, H5F_SCOPE_GLOBAL));
  return r;
}

double steady_clock_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

struct Telemetry::Impl {
  fs::path path;
  TelemetryOptions options;
  Record record;
  std::string error;   // of the first failure, or of use after finish()
  double flushed_s = 0;

  Status write_out() {
    const auto ok = guarded(path, "recording stopped", [&] {
      {
        const Hdf5 hdf5;
        record.reserve(record.samples.growth(record.samples.pending()) + record.cycles.growth(record.cycles.pending()));
        record.samples.write();
        record.cycles.write();
      }
      flushed_s = options.wall_clock_s();
    });
    if (!ok) error = ok.error();
    return ok;
  }
  Status append(Table& table, double time_s, std::span<const double> values) {
    if (!error.empty()) return tl::unexpected(error);
    if (!table.time.dataset || values.size() != table.columns.size())
      return tl::unexpected(fmt::format("{}: {} values given where a row has {}", path.string(), values.size(), table.columns.size()));
    table.push(time_s, values);
    if (table.pending() == block || options.wall_clock_s() - flushed_s >= options.flush_interval_s) return write_out();
    return {};
  }
  ~Impl() {
    if (record.file && error.empty()) (void)write_out();
    (void)guarded(path, "", [&] { record.close(); });
  }
};

Telemetry::Telemetry(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Telemetry::Telemetry(Telemetry&&) noexcept = default;
Telemetry& Telemetry::operator=(Telemetry&&) noexcept = default;
Telemetry::~Telemetry() = default;

tl::expected<Telemetry, std::string> Telemetry::create(const fs::path& path, TelemetryOptions options) {
  return guarded(path, not_written, [&] {
    const Hdf5 hdf5;
    auto impl = std::make_unique<Impl>();
    impl->path = path;
    impl->record = create_record(path, options);
    check(H5Fstart_swmr_write(impl->record.file));
    impl->options = std::move(options);
    if (!impl->options.wall_clock_s) impl->options.wall_clock_s = steady_clock_s;
    for (Table* table : {&impl->record.samples, &impl->record.cycles}) {
      table->time.pending.reserve(block);
      for (auto& column : table->columns) column.pending.reserve(block);
    }
    impl->flushed_s = impl->options.wall_clock_s();
    return Telemetry(std::move(impl));
  });
}

Status Telemetry::append(double time_s, std::span<const double> values) {
  assert(impl_);
  return impl_->append(impl_->record.samples, time_s, values);
}
Status Telemetry::append_cycle(double time_s, std::span<const double> values) {
  assert(impl_);
  return impl_->append(impl_->record.cycles, time_s, values);
}

Status Telemetry::finish() {
  assert(impl_);
  if (!impl_->error.empty()) return tl::unexpected(impl_->error);
  if (auto ok = impl_->write_out(); !ok) return ok;
  const auto ok = guarded(impl_->path, "recording stopped", [&] {
    const Hdf5 hdf5;
    impl_->record.mark_complete(1);
    check(H5Fflush(impl_->record.file, H5F_SCOPE_GLOBAL));
    impl_->record.close();
    impl_->record = {};
  });
  impl_->error = ok ? fmt::format("{}: the recording is finished", impl_->path.string()) : ok.error();
  return ok;
}

std::span<const double> Recording::channel(std::string_view joint, std::string_view name) const {
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (joints[j] != joint) continue;
    for (std::size_t c = 0; c < channels.size(); ++c)
      if (channels[c].name == name) return values[j][c];
    for (std::size_t c = 0; c < cycle_channels.size(); ++c)
      if (cycle_channels[c].name == name) return cycle_values[j][c];
  }
  return {};
}

namespace {

/// The columns of a file that share a time column: their common length and, joint by joint, their datasets.
struct Columns {
  Id time;
  std::vector<std::vector<Id>> joints;
  hsize_t rows = 0;
};

/// A record opened for reading; `head` is it without the values.
struct Reader {
  Id file;
  bool plain = true;   // opens without SWMR
  Recording head;
  Columns samples, cycles;
};

std::vector<std::string> link_names(hid_t group) {
  H5G_info_t info;
  check(H5Gget_info(group, &info));
  std::vector<std::string> names;
  const auto get = [&](hsize_t n, char* text, std::size_t size) {
    const ssize_t length = H5Lget_name_by_idx(group, ".", H5_INDEX_CRT_ORDER, H5_ITER_INC, n, text, size, H5P_DEFAULT);
    return check(length >= 0 ? length : H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, n, text, size, H5P_DEFAULT));
  };
  for (hsize_t n = 0; n < info.nlinks; ++n) {
    names.emplace_back(get(n, nullptr, 0), '\0');
    get(n, names.back().data(), names.back().size() + 1);
  }
  return names;
}

/// A dataset and its length, which is checked against the file's size before anybody allocates that much.
std::pair<Id, hsize_t> open_column(hid_t parent, const std::string& name, std::uintmax_t file_bytes) {
  constexpr std::uintmax_t best_compression = 1100;   // of deflate, should somebody have repacked the file
  try {
    Id dataset(H5Dopen2(parent, name.c_str(), H5P_DEFAULT), H5Dclose);
    const Id space(H5Dget_space(dataset), H5Sclose);
    if (H5Sget_simple_extent_ndims(space) != 1) throw Failure("has not one dimension");
    const hssize_t rows = check(H5Sget_simple_extent_npoints(space));
    if (static_cast<std::uintmax_t>(rows) / best_compression > file_bytes / sizeof(double)) throw Failure("is longer than the file");
    return {std::move(dataset), rows};
  } catch (const Failure& e) {
    throw Failure(fmt::format("'{}': {}", name, e.what()));
  }
}

Reader open_record(const fs::path& path) {
  Reader r;
  // A reader repeats what looks torn, waiting twice as long each time: HDF5's 100 attempts never end on a damaged file,
  // these do within 0.1 s.
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  check(H5Pset_metadata_read_attempts(access, 25));
  const hid_t plain = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  r.plain = plain >= 0;
  r.file = Id(r.plain ? plain : H5Fopen(path.c_str(), H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, access), H5Fclose);
  const std::uintmax_t bytes = fs::file_size(path);
  {
    const Id complete(H5Dopen2(r.file, "complete", H5P_DEFAULT), H5Dclose);
    unsigned char value = 0;
    if (H5Sget_simple_extent_npoints(Id(H5Dget_space(complete), H5Sclose)) != 1) throw Failure("'complete' is not one number");
    check(H5Dread(complete, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value));
    r.head.complete = value != 0;
  }
  r.head.attributes = read_attributes(r.file).first;
  const auto links = link_names(r.file);
  for (Columns* columns : {&r.samples, &r.cycles})
    if (const char* name = columns == &r.samples ? "time_s" : "cycle_time_s"; columns == &r.samples || std::ranges::count(links, name) > 0)
      std::tie(columns->time, columns->rows) = open_column(r.file, name, bytes);
  for (const auto& link : links) {
    if (link == "complete" || link == "time_s" || link == "cycle_time_s") continue;
    const Id group(H5Gopen2(r.file, link.c_str(), H5P_DEFAULT), H5Gclose);
    r.samples.joints.emplace_back();
    r.cycles.joints.emplace_back();
    std::vector<Channel> channels, cycle_channels;
    for (const auto& name : link_names(group)) {
      auto [dataset, rows] = open_column(group, name, bytes);
      const std::string time = read_text(dataset, "time");
      const bool cycle = time.empty() ? name.starts_with("cycle_") : time == "cycle_time_s";   // not every record has it
      Columns& columns = cycle ? r.cycles : r.samples;
      columns.rows = std::min(columns.rows, rows);
      (cycle ? cycle_channels : channels).push_back({name, read_text(dataset, "unit"), read_text(dataset, "description")});
      columns.joints.back().push_back(std::move(dataset));
    }
    if (r.head.joints.empty()) std::tie(r.head.channels, r.head.cycle_channels) = std::tie(channels, cycle_channels);
    const auto differ = [](const auto& a, const auto& b) { return !std::ranges::equal(a, b, {}, &Channel::name, &Channel::name); };
    if (differ(channels, r.head.channels) || differ(cycle_channels, r.head.cycle_channels))
      throw Failure(fmt::format("'{}' has other channels than the joints before it", link));
    r.head.joints.push_back(read_text(group, "name"));
    r.head.joint_attributes.push_back(read_attributes(group).second);
  }
  return r;
}

Status present(const fs::path& path) {
  std::error_code error;
  if (fs::exists(path, error)) return {};
  return tl::unexpected(fmt::format("{}: {}", path.string(), error ? "cannot be read (" + error.message() + ")" : "does not exist"));
}

struct File {
  std::FILE* stream;
  explicit File(const fs::path& path) : stream(std::fopen(path.c_str(), "wb")) {
    if (!stream) throw Failure(system_reason(errno));
  }
  File(const File&) = delete;
  ~File() {
    if (stream) std::fclose(stream);
  }
  void write(const fmt::memory_buffer& text) {
    if (std::fwrite(text.data(), 1, text.size(), stream) != text.size()) throw Failure(system_reason(errno));
  }
  void close() {
    if (std::fclose(std::exchange(stream, nullptr)) != 0) throw Failure(system_reason(errno));
  }
};

/// Lets `write` produce `partial` and makes it `path`; a failure leaves no partial file behind.
template <class Write>
Status replace(const fs::path& path, const fs::path& partial, Write&& write) {
  const auto ok = guarded(path, not_written, [&] {
    write();
    std::error_code error;
    fs::rename(partial, path, error);
    if (error) throw Failure(error.message());
  });
  std::error_code ignored;
  if (!ok) fs::remove(partial, ignored);
  return ok;
}

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

void write_csv(const fs::path& path, const Reader& r, const Columns& columns, const std::vector<Channel>& channels,
               const std::function<void(double)>& progress) {
  File out(path);
  fmt::memory_buffer text;
  const auto add = std::back_inserter(text);
  fmt::format_to(add, "time_s");
  for (const auto& joint : r.head.joints)
    for (const Channel& channel : channels) fmt::format_to(add, ",{}", quoted(joint + "." + channel.name));
  text.push_back('\n');
  const std::size_t width = 1 + r.head.joints.size() * channels.size();
  std::vector<double> values(width * block);   // column by column
  for (hsize_t from = 0; from < columns.rows; from += block) {
    const std::size_t rows = std::min<hsize_t>(block, columns.rows - from);
    {
      const Hdf5 hdf5;
      read_rows(columns.time, from, std::span(values).first(rows));
      std::size_t at = 0;
      for (const auto& joint : columns.joints)
        for (const Id& dataset : joint) read_rows(dataset, from, std::span(values).subspan(block * ++at, rows));
    }
    for (std::size_t i = 0; i < rows; ++i)
      for (std::size_t c = 0; c < width; ++c) fmt::format_to(add, "{}{}", values[block * c + i], c + 1 < width ? ',' : '\n');
    out.write(text);
    text.clear();
    if (progress) progress(static_cast<double>(from + rows) / static_cast<double>(columns.rows));
  }
  out.write(text);
  out.close();
}

/// All who read a record divide by its steps.
Status increasing(const fs::path& path, const std::vector<double>& time_s, const char* name) {
  constexpr double shortest_step_s = 1e-9, largest_s = 1e10;
  for (std::size_t i = 0; i < time_s.size(); ++i)
    if (!(std::abs(time_s[i]) <= largest_s && (i == 0 || time_s[i] - time_s[i - 1] >= shortest_step_s)))
      return tl::unexpected(fmt::format("{}: {} is {} at sample {}{}; it must increase from sample to sample, within {:g} .. {:g} s", path.string(), name, time_s[i], i, i ? fmt::format(", after {}", time_s[i - 1]) : "", -largest_s, largest_s));
  return {};
}

}  // namespace

tl::expected<Recording, std::string> read_telemetry(const fs::path& path) {
  if (auto ok = present(path); !ok) return tl::unexpected(ok.error());
  auto recording = guarded(path, no_record, [&]() -> Recording {
    const Hdf5 hdf5;
    Reader r = open_record(path);
    const auto load = [](const Columns& columns, std::vector<double>& time_s, auto& values) {
      const auto column = [&](const Id& dataset) {
        std::vector<double> data(columns.rows);
        read_rows(dataset, 0, data);
        return data;
      };
      if (columns.time) time_s = column(columns.time);
      for (const auto& joint : columns.joints) {
        auto& all = values.emplace_back();
        for (const Id& dataset : joint) all.push_back(column(dataset));
      }
    };
    load(r.samples, r.head.time_s, r.head.values);
    load(r.cycles, r.head.cycle_time_s, r.head.cycle_values);
    return std::move(r.head);
  });
  if (!recording) return recording;
  for (const auto& [name, time_s] : {std::pair{"time_s", &recording->time_s}, {"cycle_time_s", &recording->cycle_time_s}})
    if (auto ok = increasing(path, *time_s, name); !ok) return tl::unexpected(ok.error());
  return recording;
}

tl::expected<Recovered, std::string> recover(const fs::path& run_dir) {
  const fs::path path = run_dir / "telemetry.h5", fresh = run_dir / "telemetry.h5.recovering";
  if (auto ok = present(path); !ok) return tl::unexpected(ok.error());
  const Hdf5 hdf5;
  Recovered result{};
  auto reader = guarded(path, no_record, [&] {
    Reader r = open_record(path);
    result = {r.samples.rows, 0, r.head.complete && r.plain};
    if (r.samples.rows > 0) read_rows(r.samples.time, r.samples.rows - 1, std::span(&result.last_time_s, 1));
    return r;
  });
  if (!reader) return tl::unexpected(reader.error());
  if (result.was_complete) return result;
  const auto ok = replace(path, fresh, [&] {
    refuse_if_in_use(path);
    const Recording& head = reader->head;
    Record record = create_record(fresh, {.attributes = head.attributes, .joints = head.joints, .joint_attributes = head.joint_attributes,
                                          .channels = head.channels, .cycle_channels = head.cycle_channels});
    const int recovered = 1;
    if (!H5Aexists(record.file, "recovered")) write_attribute(record.file, "recovered", H5T_NATIVE_INT, &recovered);
    record.mark_complete(head.complete);
    record.reserve(record.samples.growth(reader->samples.rows) + record.cycles.growth(reader->cycles.rows));
    std::vector<double> piece(64 * block);
    const auto copy = [&](const Columns& from, Table& to) {
      const auto column = [&](const Id& source, const Id& target) {
        for (hsize_t at = 0; at < from.rows; at += piece.size()) {
          const auto rows = std::span(piece).first(std::min<hsize_t>(piece.size(), from.rows - at));
          read_rows(source, at, rows);
          write_rows(target, at, rows);
        }
      };
      std::size_t next = 0;
      for (const auto& joint : from.joints)
        for (const Id& dataset : joint) column(dataset, to.columns[next++].dataset);
      if (from.time && to.time.dataset) column(from.time, to.time.dataset);
    };
    copy(reader->samples, record.samples);
    copy(reader->cycles, record.cycles);
    record.close();
    if (::fsync(record.descriptor) != 0) throw Failure(system_reason(errno));
  });
  if (!ok) return tl::unexpected(ok.error());
  return result;
}

tl::expected<std::vector<fs::path>, std::string> export_csv(const fs::path& run_dir, const std::function<void(double)>& progress) {
  const fs::path path = run_dir / "telemetry.h5";
  if (auto ok = present(path); !ok) return tl::unexpected(ok.error());
  const auto r = guarded(path, no_record, [&] {
    const Hdf5 hdf5;
    return open_record(path);
  });
  if (!r) return tl::unexpected(r.error());
  std::vector<fs::path> files;
  const auto write = [&](const char* name, const Columns& columns, const std::vector<Channel>& channels, const auto& report) {
    files.push_back(run_dir / name);
    const fs::path partial = files.back().string() + ".partial";
    return replace(files.back(), partial, [&] { write_csv(partial, *r, columns, channels, report); });
  };
  if (auto ok = write("telemetry.csv", r->samples, r->head.channels, progress); !ok) return tl::unexpected(ok.error());
  if (r->cycles.rows > 0)
    if (auto ok = write("cycles.csv", r->cycles, r->head.cycle_channels, nullptr); !ok) return tl::unexpected(ok.error());
  if (progress) progress(1);
  return files;
}

}  // namespace tribotwin::twin
