#include <algorithm>
#include <cmath>
#include <cstdint>
#include <exception>
#include <tuple>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/telemetry/reader.hpp>

namespace tribotwin::twin {

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

std::string column_name(std::string_view channel, std::string_view unit) {
  static constexpr struct {
    std::string_view of_hinge, unit, of_slide;
  } endings[] = {{"_rad_s", "m/s", "_m_s"}, {"_rad", "m", "_m"}, {"_nm", "N", "_n"}};
  for (const auto& e : endings)
    if (channel.ends_with(e.of_hinge) && unit == e.unit)
      return std::string(channel.substr(0, channel.size() - e.of_hinge.size())).append(e.of_slide);
  return std::string(channel);
}

namespace hdf5 {

hid_t open_plainly(const fs::path& path) {
  check(H5PLset_loading_state(0));
  return H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
}

namespace {

/// What HDF5 shows of a group, link by link; the time of asking for each by its number grows with their square.
struct LinkNames {
  hsize_t most = 0;
  std::vector<std::string> names{};
  bool last_is_elsewhere = false;
  std::exception_ptr failure{};

  /// 1 ends the walk.
  static herr_t take(hid_t, const char* name, const H5L_info_t* link, void* made) noexcept {
    auto& own = *static_cast<LinkNames*>(made);
    if (own.names.size() == own.most) return 1;
    try {
      own.names.emplace_back(name);
    } catch (...) {
      own.failure = std::current_exception();
      return 1;
    }
    own.last_is_elsewhere = link->type != H5L_TYPE_HARD;
    return own.last_is_elsewhere ? 1 : 0;
  }
};

}  // namespace

std::vector<std::string> link_names(hid_t group) {
  H5G_info_t info;
  check(H5Gget_info(group, &info));
  if (info.nlinks > limits::hdf5_links)
    throw Failure(fmt::format("has {} entries in a group; at most {} are read", info.nlinks, limits::hdf5_links));
  LinkNames found{.most = info.nlinks};
  const bool ordered = keeps_order(group, H5Pget_link_creation_order);
  const herr_t walked =
      H5Literate(group, ordered ? H5_INDEX_CRT_ORDER : H5_INDEX_NAME, H5_ITER_INC, nullptr, &LinkNames::take, &found);
  if (found.failure) std::rethrow_exception(found.failure);
  check(walked);
  if (found.last_is_elsewhere) throw Failure(fmt::format("'{}' is a link to elsewhere", found.names.back()));
  return std::move(found.names);
}

namespace {

/// Throws Failure where HDF5 would take any memory for the values that the data set promises.
void check_storage(hid_t dataset, hid_t properties, std::size_t value_bytes, Texts texts) {
  const auto kind = H5Tget_class(Id(H5Dget_type(dataset), H5Tclose));
  const bool number = (kind == H5T_FLOAT || kind == H5T_INTEGER) && value_bytes <= sizeof(double);
  const bool text = texts == Texts::accept && kind == H5T_STRING && value_bytes <= limits::hdf5_text_bytes;
  if (value_bytes == 0 || (!number && !text))
    throw Failure(texts == Texts::refuse
                      ? "does not hold numbers"
                      : fmt::format("holds neither numbers of at most {} bytes nor texts of at most {}", sizeof(double),
                                    limits::hdf5_text_bytes));
  hsize_t rows = 0;
  if (H5Pget_layout(properties) == H5D_CHUNKED && H5Pget_chunk(properties, 1, &rows) == 1 &&
      rows > limits::hdf5_chunk_bytes / value_bytes)
    throw Failure(fmt::format("has chunks of {} rows; at most {} bytes are read", rows, limits::hdf5_chunk_bytes));
}

/// Whether the chunk that begins at row `row` lies within the file. HDF5 reads nothing behind the end of a file that it
/// opens plainly. Of one that is being written, or was when its writer was killed, it reads zeros there: a chunk under
/// a checksum with anything else in it lies within the file if it can be read. Only of the others the address is asked
/// for: HDF5 1.10 looks for it among all chunks.
bool chunk_is_there(const fs::path& path, bool plain, hid_t dataset, bool checksums, hsize_t row) {
  hsize_t bytes = 0;
  check(H5Dget_chunk_storage_size(dataset, &row, &bytes));
  if (bytes == 0 || plain) return bytes > 0;
  unsigned filters = 0;
  if (checksums && bytes <= limits::hdf5_chunk_bytes) {
    std::vector<char> raw(bytes);
    check(H5Dread_chunk(dataset, H5P_DEFAULT, &row, &filters, raw.data()));
    if (filters == 0 && std::ranges::any_of(raw, [](char c) { return c != 0; })) return true;
  }
  haddr_t address = HADDR_UNDEF;
  check(H5Dget_chunk_info_by_coord(dataset, &row, &filters, &address, &bytes));
  return address != HADDR_UNDEF && address + bytes <= fs::file_size(path);
}

bool has_checksums(hid_t properties) {
  for (int i = 0; i < H5Pget_nfilters(properties); ++i) {
    unsigned flags = 0;
    std::size_t values = 0;
    if (H5Pget_filter2(properties, static_cast<unsigned>(i), &flags, &values, nullptr, 0, nullptr, nullptr) ==
        H5Z_FILTER_FLETCHER32)
      return true;
  }
  return false;
}

}  // namespace

std::pair<Id, hsize_t> open_column(hid_t parent, const std::string& name, std::uintmax_t file_bytes, Texts texts) {
  try {
    Id dataset(H5Dopen2(parent, name.c_str(), H5P_DEFAULT), H5Dclose);
    const Id space(H5Dget_space(dataset), H5Sclose), properties(H5Dget_create_plist(dataset), H5Pclose);
    if (H5Pget_external_count(properties) != 0 || H5Pget_layout(properties) == H5D_VIRTUAL)
      throw Failure("is stored in other files");
    if (H5Sget_simple_extent_ndims(space) != 1) throw Failure("has not one dimension");
    const hssize_t rows = check(H5Sget_simple_extent_npoints(space));
    const std::size_t value_bytes = H5Tget_size(Id(H5Dget_type(dataset), H5Tclose));
    if (static_cast<std::uintmax_t>(rows) / limits::best_compression >
        file_bytes / std::max(value_bytes, sizeof(double)))
      throw Failure("is longer than the file");
    check_storage(dataset, properties, value_bytes, texts);
    return {std::move(dataset), rows};
  } catch (const Failure& e) {
    throw Failure(fmt::format("'{}': {}", name, e.what()));
  }
}

void require_stored(const fs::path& path, bool plain, hid_t dataset, hsize_t from, hsize_t count) {
  const Id properties(H5Dget_create_plist(dataset), H5Pclose);
  const auto cut = [&](hsize_t row) {
    return Failure(fmt::format("it is damaged: rows from {} on are not in the file", row));
  };
  switch (H5Pget_layout(properties)) {
    case H5D_CHUNKED: {
      hsize_t rows = 0;
      check(H5Pget_chunk(properties, 1, &rows));
      const bool checksums = has_checksums(properties);
      for (hsize_t row = from - from % rows; row < from + count; row += rows)
        if (!chunk_is_there(path, plain, dataset, checksums, row)) throw cut(row);
      break;
    }
    case H5D_CONTIGUOUS: {
      const haddr_t address = H5Dget_offset(dataset);
      if (address == HADDR_UNDEF || address + H5Dget_storage_size(dataset) > fs::file_size(path)) throw cut(0);
      break;
    }
    default:
      break;  // compact: in the object's header, under its checksum
  }
}

namespace {

void read_everything(const fs::path& path) {
  const Hdf5 hdf5;
  const Reader r = open_record(path);
  std::vector<double> values;
  for (const Columns* columns : {&r.samples, &r.cycles}) {
    const auto column = [&](const Id& dataset) {
      values.resize(65536);
      for (hsize_t at = 0; at < columns->rows; at += values.size()) try {
          read_rows(r, dataset, at, std::span(values).first(std::min<hsize_t>(values.size(), columns->rows - at)));
        } catch (const Failure&) {  // the next rows may crash all the same
        }
    };
    if (columns->time) column(columns->time);
    for (const auto& joint : columns->joints)
      for (const Id& dataset : joint) column(dataset);
  }
}

}  // namespace

Reader open_record(const fs::path& path) {
  Reader r;
  r.path = path;
  // A reader repeats what looks torn, waiting twice as long each time: HDF5's 100 attempts never end on a damaged file,
  // these do within 0.1 s.
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  check(H5Pset_metadata_read_attempts(access, 25));
  const hid_t plain = open_plainly(path);
  r.plain = plain >= 0;
  r.file = Id(r.plain ? plain : H5Fopen(path.c_str(), H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, access), H5Fclose);
  const std::uintmax_t bytes = fs::file_size(path);
  {
    const Id complete(H5Dopen2(r.file, "complete", H5P_DEFAULT), H5Dclose);
    unsigned char value = 0;
    if (H5Sget_simple_extent_npoints(Id(H5Dget_space(complete), H5Sclose)) != 1)
      throw Failure("'complete' is not one number");
    check(H5Dread(complete, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value));
    r.head.complete = value != 0;
  }
  r.head.attributes = read_attributes(r.file).first;
  const auto links = link_names(r.file);
  for (Columns* columns : {&r.samples, &r.cycles})
    if (const char* name = columns == &r.samples ? "time_s" : "cycle_time_s";
        columns == &r.samples || std::ranges::count(links, name) > 0)
      std::tie(columns->time, columns->rows) = open_column(r.file, name, bytes, Texts::refuse);
  for (const auto& link : links) {
    if (link == "complete" || link == "time_s" || link == "cycle_time_s") continue;
    const Id group(H5Gopen2(r.file, link.c_str(), H5P_DEFAULT), H5Gclose);
    r.samples.joints.emplace_back();
    r.cycles.joints.emplace_back();
    std::vector<Channel> channels, cycle_channels;
    for (const auto& name : link_names(group)) {
      auto [dataset, rows] = open_column(group, name, bytes, Texts::refuse);
      const std::string time = read_text(dataset, "time");
      const bool cycle = time.empty() ? name.starts_with("cycle_") : time == "cycle_time_s";  // not every record has it
      Columns& columns = cycle ? r.cycles : r.samples;
      columns.rows = std::min(columns.rows, rows);
      (cycle ? cycle_channels : channels)
          .push_back({name, read_text(dataset, "unit"), read_text(dataset, "description")});
      columns.joints.back().push_back(std::move(dataset));
    }
    if (r.head.joints.empty()) std::tie(r.head.channels, r.head.cycle_channels) = std::tie(channels, cycle_channels);
    const auto differ = [](const auto& a, const auto& b) {
      return !std::ranges::equal(a, b, {}, &Channel::name, &Channel::name);
    };
    if (differ(channels, r.head.channels) || differ(cycle_channels, r.head.cycle_channels))
      throw Failure(fmt::format("'{}' has other channels than the joints before it", link));
    auto& units = r.head.units.emplace_back();
    for (const Channel& channel : channels) units.push_back(channel.unit);
    r.head.joints.push_back(read_text(group, "name"));
    r.head.joint_attributes.push_back(read_attributes(group).second);
  }
  return r;
}

void read_rows(const Reader& reader, hid_t dataset, hsize_t from, std::span<double> values) {
  const hsize_t count = values.size();
  if (count == 0) return;
  require_stored(reader.path, reader.plain, dataset, from, count);
  const Id in_file(H5Dget_space(dataset), H5Sclose), in_memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
  check(H5Sselect_hyperslab(in_file, H5S_SELECT_SET, &from, nullptr, &count, nullptr));
  if (H5Dread(dataset, H5T_NATIVE_DOUBLE, in_memory, in_file, H5P_DEFAULT, values.data()) < 0)
    throw Failure("it is damaged: " + hdf5_reason());
}

Rows::Rows(const Reader& reader, const Columns& columns, std::size_t at_once) : reader_(reader), at_once_(at_once) {
  if (columns.time) datasets_.push_back(columns.time);
  for (const auto& joint : columns.joints)
    for (const Id& dataset : joint) datasets_.push_back(dataset);
  values_.resize(datasets_.size() * at_once);
}

void Rows::read(hsize_t from, std::size_t count) {
  for (std::size_t c = 0; c < datasets_.size(); ++c)
    read_rows(reader_, datasets_[c], from, std::span(values_).subspan(c * at_once_, count));
}

void Rows::get(std::size_t row, std::vector<double>& values) const {
  values.clear();
  for (std::size_t c = 1; c < datasets_.size(); ++c) values.push_back(values_[c * at_once_ + row]);
}

Status probe(const fs::path& path) {
  return probe(path, "an HDF5 record", no_record, [&] { read_everything(path); });
}

Status probe(const fs::path& path, std::string_view kind, std::string_view phrase,
             const std::function<void()>& read_everything) {
  std::error_code error;
  if (!fs::exists(path, error))
    return tl::unexpected(
        fmt::format("{}: {}", path.string(), error ? "cannot be read (" + error.message() + ")" : "does not exist"));
  if (auto ok = check_input_file(path, kind, limits::any_length, Pipes::refuse); !ok) return ok;
  return guarded(path, phrase, [&] {
    if (!survives(read_everything, memory_for(path)))
      throw Failure(
          "the file is damaged so that the HDF5 library crashes on it or wants memory without end, or this machine has "
          "too little");
  });
}

}  // namespace hdf5

namespace {

/// Checks that time increases, because readers of a record divide by its steps.
hdf5::Status increasing(const std::filesystem::path& path, const std::vector<double>& time_s, const char* name) {
  constexpr double shortest_step_s = 1e-9, largest_s = 1e10;
  for (std::size_t i = 0; i < time_s.size(); ++i)
    if (!(std::abs(time_s[i]) <= largest_s && (i == 0 || time_s[i] - time_s[i - 1] >= shortest_step_s)))
      return tl::unexpected(fmt::format(
          "{}: {} is {} at sample {}{}; it must increase from sample to sample, within {:g} .. {:g} s", path.string(),
          name, time_s[i], i, i ? fmt::format(", after {}", time_s[i - 1]) : "", -largest_s, largest_s));
  return {};
}

}  // namespace

Result<Recording> read_telemetry(const std::filesystem::path& path) {
  using namespace hdf5;
  if (auto ok = probe(path); !ok) return tl::unexpected(ok.error());
  auto recording = guarded(path, no_record, [&]() -> Recording {
    const Hdf5 hdf5;
    Reader r = open_record(path);
    const auto load = [&](const Columns& columns, std::vector<double>& time_s, auto& values) {
      const auto column = [&](const Id& dataset) {
        require_stored(r.path, r.plain, dataset, 0, columns.rows);  // before memory for them is taken
        std::vector<double> data(columns.rows);
        read_rows(r, dataset, 0, data);
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
  for (const auto& [name, time_s] :
       {std::pair{"time_s", &recording->time_s}, {"cycle_time_s", &recording->cycle_time_s}})
    if (auto ok = increasing(path, *time_s, name); !ok) return tl::unexpected(ok.error());
  return recording;
}

}  // namespace tribotwin::twin
