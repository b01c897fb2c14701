#include <tribotwin/twin/telemetry/telemetry.hpp>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <mutex>
#include <optional>
#include <set>

#include <fmt/format.h>
#include <hdf5.h>
#include <unistd.h>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = tl::expected<void, std::string>;

// The serial HDF5 library is not thread-safe: one lock for all records of the process, held per block, not per sample.
std::mutex hdf5;

constexpr std::size_t block = 2048;   // samples per chunk and per write
constexpr char slash_in_group[] = "\u2215";

/// Closes an HDF5 id.
class Id {
 public:
  Id() = default;
  Id(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Id(Id&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Id& operator=(Id&& other) noexcept {
    reset();
    id_ = std::exchange(other.id_, -1);
    close_ = other.close_;
    return *this;
  }
  ~Id() { reset(); }
  void reset() {
    if (id_ >= 0) close_(id_);
    id_ = -1;
  }
  operator hid_t() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }

 private:
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

/// HDF5's innermost reason for the last failure.
std::string reason() {
  std::string text;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD,
           [](unsigned n, const H5E_error2_t* error, void* out) -> herr_t {
             if (n == 0 && error->desc) *static_cast<std::string*>(out) = error->desc;
             return 0;
           },
           &text);
  if (const auto at = text.find("error message = '"); at != std::string::npos) {
    text.erase(0, at + 17);
    text.erase(text.find('\''));
  }
  return text.empty() ? "HDF5 gave no reason" : text;
}

std::string group_name(std::string_view joint) {
  std::string name;
  for (const char c : joint) c == '/' ? name += slash_in_group : name += c;
  return name.empty() || name == "." ? "_" + name : name;
}

void write_attribute(hid_t object, const std::string& name, const std::string& value) {
  const Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type, std::max<std::size_t>(1, value.size()));
  H5Tset_cset(type, H5T_CSET_UTF8);
  const Id space(H5Screate(H5S_SCALAR), H5Sclose);
  const Id attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  H5Awrite(attribute, type, value.empty() ? "" : value.data());
}

std::string read_attribute(hid_t object, const char* name) {
  if (H5Aexists(object, name) <= 0) return {};
  const Id attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  const Id type(H5Aget_type(attribute), H5Tclose);
  if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type)) return {};
  std::string value(H5Tget_size(type), '\0');
  H5Aread(attribute, type, value.data());
  while (!value.empty() && value.back() == '\0') value.pop_back();
  return value;
}

/// A growing column of doubles and its unwritten rest.
struct Column {
  Id dataset;
  std::vector<double> pending;
};

Id create_column(hid_t parent, const std::string& name, const std::string& unit, const std::string& description) {
  const hsize_t size = 0, most = H5S_UNLIMITED, chunk = block;
  const Id space(H5Screate_simple(1, &size, &most), H5Sclose);
  const Id properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_chunk(properties, 1, &chunk);
  Id dataset(H5Dcreate2(parent, name.c_str(), H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, properties, H5P_DEFAULT), H5Dclose);
  if (dataset) {
    write_attribute(dataset, "unit", unit);
    write_attribute(dataset, "description", description);
  }
  return dataset;
}

/// A time column and the columns that share its length.
struct Table {
  Column time;
  std::vector<Column> columns;
  hsize_t written = 0;
  std::string error;

  bool empty() const { return time.pending.empty(); }
  void push(double t, std::span<const double> values) {
    time.pending.push_back(t);
    for (std::size_t i = 0; i < columns.size(); ++i) columns[i].pending.push_back(values[i]);
  }
  bool write(Column& column) {
    const hsize_t count = column.pending.size(), size = written + count;
    const auto failed = [this] {
      error = reason();   // now: closing the ids below clears HDF5's memory of it
      return false;
    };
    if (H5Dset_extent(column.dataset, &size) < 0) return failed();
    const Id file_space(H5Dget_space(column.dataset), H5Sclose);
    H5Sselect_hyperslab(file_space, H5S_SELECT_SET, &written, nullptr, &count, nullptr);
    const Id memory_space(H5Screate_simple(1, &count, nullptr), H5Sclose);
    if (H5Dwrite(column.dataset, H5T_NATIVE_DOUBLE, memory_space, file_space, H5P_DEFAULT, column.pending.data()) < 0) return failed();
    return H5Dflush(column.dataset) >= 0 || failed();
  }
  /// Time goes last: a reader never sees an instant whose values are missing.
  bool write() {
    if (empty()) return true;
    for (Column& column : columns)
      if (!write(column)) return false;
    if (!write(time)) return false;
    written += time.pending.size();
    for (Column& column : columns) column.pending.clear();
    time.pending.clear();
    return true;
  }
};

struct File {
  Id id, complete;
  Table samples, cycles;
};

tl::expected<File, std::string> create_file(const fs::path& path, const TelemetryOptions& o, bool swmr) {
  std::set<std::string> groups;
  for (const auto& joint : o.joints)
    if (!groups.insert(group_name(joint)).second)
      return tl::unexpected(fmt::format("{}: two joints are called '{}'", path.string(), joint));

  const std::lock_guard lock(hdf5);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  const auto fail = [&] { return tl::unexpected(fmt::format("{}: cannot be written ({})", path.string(), reason())); };
  File file;
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110);
  file.id = Id(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), H5Fclose);
  if (!file.id) return fail();
  for (const auto& [name, value] : o.attributes) write_attribute(file.id, name, value);
  {
    const Id scalar(H5Screate(H5S_SCALAR), H5Sclose);
    file.complete = Id(H5Dcreate2(file.id, "complete", H5T_NATIVE_UINT8, scalar, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose);
    if (!file.complete) return fail();
    write_attribute(file.complete, "description", "1 when the run ended by itself, 0 while it runs and after a kill");
    const unsigned char no = 0;
    H5Dwrite(file.complete, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, &no);
  }
  file.samples.time.dataset = create_column(file.id, "time_s", "s", "simulated time");
  if (!o.cycle_channels.empty())
    file.cycles.time.dataset = create_column(file.id, "cycle_time_s", "s", "simulated time at the end of each work cycle, skipped ones included");
  for (const auto& joint : o.joints) {
    const Id group(H5Gcreate2(file.id, group_name(joint).c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
    if (!group) return fail();
    write_attribute(group, "name", joint);
    for (const Channel& c : o.channels) file.samples.columns.push_back({create_column(group, c.name, c.unit, c.description), {}});
    for (const Channel& c : o.cycle_channels) file.cycles.columns.push_back({create_column(group, c.name, c.unit, c.description), {}});
  }
  for (Table* table : {&file.samples, &file.cycles}) {
    table->time.pending.reserve(block);
    for (Column& column : table->columns) {
      if (!column.dataset) return fail();
      column.pending.reserve(block);
    }
  }
  if (H5Fflush(file.id, H5F_SCOPE_GLOBAL) < 0 || (swmr && H5Fstart_swmr_write(file.id) < 0)) return fail();
  return file;
}

double steady_clock_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

struct Telemetry::Impl {
  fs::path path;
  TelemetryOptions options;
  File file;
  std::string error;
  double flushed_s = 0;

  Status write_out() {
    const std::lock_guard lock(hdf5);
    if (!file.samples.write() || !file.cycles.write())
      error = fmt::format("{}: recording stopped ({})", path.string(), file.samples.error.empty() ? file.cycles.error : file.samples.error);
    flushed_s = options.wall_clock_s();
    return error.empty() ? Status{} : Status(tl::unexpected(error));
  }
  Status append(Table& table, double time_s, std::span<const double> values) {
    if (!error.empty()) return tl::unexpected(error);
    table.push(time_s, values);
    if (table.time.pending.size() == block) return write_out();
    if (options.wall_clock_s() - flushed_s >= options.flush_interval_s) return write_out();
    return {};
  }
  ~Impl() {
    if (file.id && error.empty()) (void)write_out();
    const std::lock_guard lock(hdf5);
    file = {};
  }
};

Telemetry::Telemetry(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Telemetry::Telemetry(Telemetry&&) noexcept = default;
Telemetry& Telemetry::operator=(Telemetry&&) noexcept = default;
Telemetry::~Telemetry() = default;

tl::expected<Telemetry, std::string> Telemetry::create(const fs::path& path, TelemetryOptions options) {
  auto file = create_file(path, options, true);
  if (!file) return tl::unexpected(file.error());
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->options = std::move(options);
  if (!impl->options.wall_clock_s) impl->options.wall_clock_s = steady_clock_s;
  impl->file = std::move(*file);
  impl->flushed_s = impl->options.wall_clock_s();
  return Telemetry(std::move(impl));
}

Status Telemetry::append(double time_s, std::span<const double> values) {
  return impl_->append(impl_->file.samples, time_s, values);
}
Status Telemetry::append_cycle(double time_s, std::span<const double> values) {
  return impl_->append(impl_->file.cycles, time_s, values);
}

Status Telemetry::finish() {
  if (!impl_->error.empty()) return tl::unexpected(impl_->error);
  if (auto ok = impl_->write_out(); !ok) return ok;
  const std::lock_guard lock(hdf5);
  const unsigned char yes = 1;
  const bool marked = H5Dwrite(impl_->file.complete, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, &yes) >= 0 &&
                      H5Fflush(impl_->file.id, H5F_SCOPE_GLOBAL) >= 0;
  if (!marked) impl_->error = fmt::format("{}: recording stopped ({})", impl_->path.string(), reason());
  impl_->file = {};
  return marked ? Status{} : Status(tl::unexpected(impl_->error));
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

std::optional<std::vector<double>> read_column(hid_t parent, const char* name) {
  const Id dataset(H5Dopen2(parent, name, H5P_DEFAULT), H5Dclose);
  if (!dataset) return std::nullopt;
  const Id space(H5Dget_space(dataset), H5Sclose);
  std::vector<double> values(static_cast<std::size_t>(std::max<hssize_t>(0, H5Sget_simple_extent_npoints(space))));
  if (!values.empty() && H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) return std::nullopt;
  return values;
}

std::vector<std::string> link_names(hid_t group) {
  std::vector<std::string> names;
  // Creation order is not tracked; names keep joints in their alphabetical order.
  H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, nullptr,
             [](hid_t, const char* name, const H5L_info_t*, void* out) -> herr_t {
               static_cast<std::vector<std::string>*>(out)->emplace_back(name);
               return 0;
             },
             &names);
  return names;
}

}  // namespace

tl::expected<Recording, std::string> read_telemetry(const fs::path& path) {
  std::error_code exists;
  if (!fs::exists(path, exists)) return tl::unexpected(fmt::format("{}: does not exist", path.string()));
  const std::lock_guard lock(hdf5);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  Id file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!file) file = Id(H5Fopen(path.c_str(), H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, H5P_DEFAULT), H5Fclose);
  if (!file) return tl::unexpected(fmt::format("{}: is no readable HDF5 file ({})", path.string(), reason()));
  Recording r;
  const auto damaged = [&](const std::string& what) {
    return tl::unexpected(fmt::format("{}: {} is missing or damaged ({})", path.string(), what, reason()));
  };
  {
    const Id complete(H5Dopen2(file, "complete", H5P_DEFAULT), H5Dclose);
    unsigned char value = 0;
    if (!complete || H5Dread(complete, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value) < 0) return damaged("'complete'");
    r.complete = value != 0;
  }
  std::vector<std::string> attributes;
  H5Aiterate2(file, H5_INDEX_NAME, H5_ITER_INC, nullptr,
              [](hid_t, const char* name, const H5A_info_t*, void* out) -> herr_t {
                static_cast<std::vector<std::string>*>(out)->emplace_back(name);
                return 0;
              },
              &attributes);
  for (const auto& name : attributes) r.attributes.emplace_back(name, read_attribute(file, name.c_str()));
  auto time = read_column(file, "time_s");
  if (!time) return damaged("'time_s'");
  r.time_s = std::move(*time);
  if (H5Lexists(file, "cycle_time_s", H5P_DEFAULT) > 0)
    if (auto cycle = read_column(file, "cycle_time_s")) r.cycle_time_s = std::move(*cycle);
  for (const auto& link : link_names(file)) {
    const Id group(H5Gopen2(file, link.c_str(), H5P_DEFAULT), H5Gclose);
    if (!group) continue;
    const bool first = r.joints.empty();
    r.joints.push_back(read_attribute(group, "name"));
    r.values.emplace_back();
    r.cycle_values.emplace_back();
    for (const auto& name : link_names(group)) {
      auto values = read_column(group, name.c_str());
      if (!values) return damaged(fmt::format("'{}/{}'", link, name));
      const bool cycle = name.starts_with("cycle_");
      if (first) {
        const Id dataset(H5Dopen2(group, name.c_str(), H5P_DEFAULT), H5Dclose);
        (cycle ? r.cycle_channels : r.channels).push_back({name, read_attribute(dataset, "unit"), read_attribute(dataset, "description")});
      }
      (cycle ? r.cycle_values : r.values).back().push_back(std::move(*values));
    }
  }
  const auto cut = [](std::vector<double>& time_s, auto& all) {
    std::size_t length = time_s.size();
    for (const auto& joint : all)
      for (const auto& column : joint) length = std::min(length, column.size());
    time_s.resize(length);
    for (auto& joint : all)
      for (auto& column : joint) column.resize(length);
  };
  cut(r.time_s, r.values);
  cut(r.cycle_time_s, r.cycle_values);
  return r;
}

tl::expected<Recovered, std::string> recover(const fs::path& run_dir) {
  const fs::path path = run_dir / "telemetry.h5", fresh = run_dir / "telemetry.h5.recovering";
  auto r = read_telemetry(path);
  if (!r) return tl::unexpected(r.error());
  const Recovered result{r->time_s.size(), r->time_s.empty() ? 0 : r->time_s.back(), r->complete};
  if (r->complete) return result;
  TelemetryOptions options{.attributes = r->attributes, .joints = r->joints, .channels = r->channels, .cycle_channels = r->cycle_channels};
  options.attributes.emplace_back("recovered", "1");
  {
    auto file = create_file(fresh, options, false);
    if (!file) {
      std::error_code ignored;
      fs::remove(fresh, ignored);
      return tl::unexpected(file.error());
    }
    const std::lock_guard lock(hdf5);
    const auto fill = [](Table& table, std::vector<double>& time, auto& values) {
      table.time.pending = std::move(time);
      std::size_t column = 0;
      for (auto& joint : values)
        for (auto& data : joint) table.columns[column++].pending = std::move(data);
      return table.write();
    };
    const bool written = fill(file->samples, r->time_s, r->values) && (options.cycle_channels.empty() || fill(file->cycles, r->cycle_time_s, r->cycle_values)) &&
                         H5Fflush(file->id, H5F_SCOPE_GLOBAL) >= 0;
    const std::string why = !file->samples.error.empty() ? file->samples.error : !file->cycles.error.empty() ? file->cycles.error : written ? "" : reason();
    *file = {};
    if (!written) {
      std::error_code ignored;
      fs::remove(fresh, ignored);
      return tl::unexpected(fmt::format("{}: cannot be written ({})", fresh.string(), why));
    }
  }
  std::error_code error;
  fs::rename(fresh, path, error);
  if (error) return tl::unexpected(fmt::format("{}: cannot be replaced ({})", path.string(), error.message()));
  return result;
}

tl::expected<std::vector<fs::path>, std::string> export_csv(const fs::path& run_dir, const std::function<void(double)>& progress) {
  const auto r = read_telemetry(run_dir / "telemetry.h5");
  if (!r) return tl::unexpected(r.error());
  std::vector<fs::path> files;
  const auto quoted = [](const std::string& text) {
    if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
  };
  const auto write = [&](const fs::path& file, const std::string& time_name, const std::vector<double>& time,
                         const std::vector<Channel>& channels, const auto& values) -> Status {
    const fs::path partial = file.string() + ".partial";
    const auto fail = [&] {
      const std::string why = std::strerror(errno);
      std::error_code ignored;
      fs::remove(partial, ignored);
      return tl::unexpected(fmt::format("{}: cannot be written ({})", file.string(), why));
    };
    std::FILE* out = std::fopen(partial.c_str(), "wb");
    if (!out) return fail();
    fmt::memory_buffer line;
    fmt::format_to(std::back_inserter(line), "{}", time_name);
    for (const auto& joint : r->joints)
      for (const Channel& channel : channels) fmt::format_to(std::back_inserter(line), ",{}", quoted(joint + "." + channel.name));
    bool good = true;
    for (std::size_t i = 0; good && i <= time.size(); ++i) {
      line.push_back('\n');
      good = std::fwrite(line.data(), 1, line.size(), out) == line.size();
      line.clear();
      if (i == time.size()) break;
      fmt::format_to(std::back_inserter(line), "{}", time[i]);
      for (const auto& joint : values)
        for (const auto& column : joint) fmt::format_to(std::back_inserter(line), ",{}", column[i]);
      if (progress && i % 4096 == 0) progress(static_cast<double>(i) / static_cast<double>(time.size()));
    }
    good = std::fclose(out) == 0 && good;
    if (!good || std::rename(partial.c_str(), file.c_str()) != 0) return fail();
    files.push_back(file);
    return {};
  };
  if (auto ok = write(run_dir / "telemetry.csv", "time_s", r->time_s, r->channels, r->values); !ok) return tl::unexpected(ok.error());
  if (!r->cycle_time_s.empty())
    if (auto ok = write(run_dir / "cycles.csv", "cycle_time_s", r->cycle_time_s, r->cycle_channels, r->cycle_values); !ok)
      return tl::unexpected(ok.error());
  if (progress) progress(1);
  return files;
}

}  // namespace tribotwin::twin
