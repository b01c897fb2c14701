#include <set>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <tribotwin/twin/io/telemetry/record.hpp>

namespace tribotwin::twin::hdf5 {

namespace {

Descriptor open_file(const fs::path& path, int flags) {
  Descriptor file(::open(path.c_str(), flags | O_CLOEXEC));
  if (file < 0) throw Failure(system_reason(errno));
  return file;
}

constexpr hsize_t index_bytes = 4096;  // of the file, for the index entry of a chunk, generously

// A writer holds a shared lock of its own: HDF5 gives up its lock when SWMR starts, and an exclusive one could shut out
// readers on file systems where both kinds of lock are one.
void mark_in_use(const Descriptor& file) {
  struct flock lock {
    .l_type = F_RDLCK, .l_whence = SEEK_SET
  };
  (void)::fcntl(file, F_OFD_SETLK, &lock);  // a file system without locks: no protection, but a record
}

std::string group_name(const std::string& joint) {
  static const std::set<std::string> taken{".", "time_s", "cycle_time_s", "complete"};
  if (joint.empty()) return "%";
  std::string name;
  for (const char c : joint) {
    if (c == '\0') throw Failure("the name of a joint has a NUL in it");
    if (c == '/' || c == '%' || (name.empty() && taken.contains(joint)))
      name += fmt::format("%{:02X}", c);
    else
      name += c;
  }
  return name;
}

Id create_column(hid_t parent, const Channel& channel, const char* time) {
  const hsize_t size = 0, max_size = H5S_UNLIMITED, chunk = chunk_rows;
  const Id space(H5Screate_simple(1, &size, &max_size), H5Sclose), properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  // Uncompressed: each flush of a part of a chunk would leave its previous, smaller copy behind as waste.
  check(H5Pset_chunk(properties, 1, &chunk));
  check(H5Pset_fletcher32(properties));
  Id dataset(H5Dcreate2(parent, channel.name.c_str(), H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, properties, H5P_DEFAULT),
             H5Dclose);
  write_attribute(dataset, "unit", channel.unit);
  write_attribute(dataset, "description", channel.description);
  if (time) write_attribute(dataset, "time", time);
  return dataset;
}

}  // namespace

void refuse_if_in_use(const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return;
  struct flock lock {
    .l_type = F_WRLCK, .l_whence = SEEK_SET
  };
  const Descriptor file = open_file(path, O_RDONLY);
  if (::fcntl(file, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK) throw Failure("a run is still writing it");
}

hsize_t Table::growth(hsize_t rows) const {
  const auto chunks = [](hsize_t n) { return (n + chunk_rows - 1) / chunk_rows; };
  return (chunks(written + rows) - chunks(written)) * (columns.size() + 1) *
         (chunk_rows * sizeof(double) + index_bytes);
}

void Table::write() {
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

void Record::reserve(hsize_t bytes) {
  hsize_t end = 0;
  check(H5Fget_filesize(file, &end));
  end += bytes;
  if (end <= reserved) return;
  rlimit limit{};
  if (::getrlimit(RLIMIT_FSIZE, &limit) == 0 && end > limit.rlim_cur) throw Failure(system_reason(EFBIG));
  int error = 0;
  do
    error = ::fallocate(descriptor, FALLOC_FL_KEEP_SIZE, static_cast<off_t>(reserved),
                        static_cast<off_t>(end - reserved)) == 0
                ? 0
                : errno;
  while (error == EINTR);
  if (error != 0 && error != EOPNOTSUPP && error != ENOSYS) throw Failure(system_reason(error));
  reserved = end;
}

void Record::close() {
  samples = {};
  cycles = {};
  (void)complete.close();  // its data went out with the last flush
  check(file.close());
  // To its own length: gives back what was claimed beyond.
  struct stat now {};
  if (::fstat(descriptor, &now) != 0 || ::ftruncate(descriptor, now.st_size) != 0) throw Failure(system_reason(errno));
  reserved = 0;
}

void Record::abandon() {
  for (Table* table : {&samples, &cycles}) {
    table->time.dataset.abandon();
    for (Table::Column& column : table->columns) column.dataset.abandon();
  }
  complete.abandon();
  file.abandon();
}

void Record::close_on_disk() {
  close();
  if (::fsync(descriptor) != 0) throw Failure(system_reason(errno));
}

Record create_record(const fs::path& path, const TelemetryOptions& o) {
  std::set<std::string> seen;
  for (const auto& joint : o.joints)
    if (!seen.insert(group_name(joint)).second) throw Failure(fmt::format("two joints are called '{}'", joint));
  if (!o.joint_attributes.empty() && o.joint_attributes.size() != o.joints.size())
    throw Failure(fmt::format("{} joints, but attributes of {}", o.joints.size(), o.joint_attributes.size()));
  if (!o.units.empty() && o.units.size() != o.joints.size())
    throw Failure(fmt::format("{} joints, but units of {}", o.joints.size(), o.units.size()));

  constexpr unsigned ordered = H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED;
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose), file_properties(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  check(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110));
  // By default HDF5 keeps 1 MiB of chunks of every column, of which a writer needs only the last one.
  check(H5Pset_cache(access, 0, 11, 4 * chunk_rows * sizeof(double), 1));
  check(H5Pset_link_creation_order(file_properties, ordered));
  check(H5Pset_attr_creation_order(file_properties, ordered));
  Record r;
  r.file = Id(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, file_properties, access), H5Fclose);
  r.descriptor = open_file(path, O_RDWR);
  mark_in_use(r.descriptor);
  r.reserve(65536 + 4096 * (1 + o.joints.size()) * (1 + o.channels.size() + o.cycle_channels.size()));
  for (const auto& [name, value] : o.attributes) write_attribute(r.file, name, value);
  const Id scalar(H5Screate(H5S_SCALAR), H5Sclose);
  r.complete =
      Id(H5Dcreate2(r.file, "complete", H5T_NATIVE_UINT8, scalar, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose);
  write_attribute(r.complete, "description", "1 when the run ended by itself, 0 while it runs and after a kill");
  r.mark_complete(0);

  r.samples.time.dataset = create_column(r.file, {"time_s", "s", "simulated time"}, nullptr);
  if (!o.cycle_channels.empty())
    r.cycles.time.dataset = create_column(
        r.file, {"cycle_time_s", "s", "simulated time at the end of each work cycle, skipped ones included"}, nullptr);
  const Id group_properties(H5Pcreate(H5P_GROUP_CREATE), H5Pclose), utf8(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  check(H5Pset_link_creation_order(group_properties, ordered));
  check(H5Pset_attr_creation_order(group_properties, ordered));
  check(H5Pset_char_encoding(utf8, H5T_CSET_UTF8));
  for (std::size_t j = 0; j < o.joints.size(); ++j) {
    const Id group(H5Gcreate2(r.file, group_name(o.joints[j]).c_str(), utf8, group_properties, H5P_DEFAULT), H5Gclose);
    write_attribute(group, "name", o.joints[j]);
    if (!o.joint_attributes.empty())
      for (const auto& [name, value] : o.joint_attributes[j]) write_attribute(group, name, H5T_NATIVE_DOUBLE, &value);
    for (std::size_t c = 0; c < o.channels.size(); ++c) {
      Channel channel = o.channels[c];
      if (!o.units.empty()) channel.unit = o.units[j][c];
      r.samples.columns.push_back({create_column(group, channel, "time_s"), {}});
    }
    for (const Channel& c : o.cycle_channels) r.cycles.columns.push_back({create_column(group, c, "cycle_time_s"), {}});
  }
  check(H5Fflush(r.file, H5F_SCOPE_GLOBAL));
  return r;
}

}  // namespace tribotwin::twin::hdf5
