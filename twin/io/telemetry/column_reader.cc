#include <algorithm>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/telemetry/column_reader.hpp>
#include <tribotwin/twin/io/telemetry/reader.hpp>

namespace tribotwin::twin {

using namespace hdf5;

struct ColumnReader::Made {
  fs::path file;
  Id handle;
  std::vector<std::string> names;
  std::vector<Id> sets;
  std::size_t rows = 0;

  explicit Made(const fs::path& path);
  std::vector<double> numbers(std::size_t column, std::size_t from, std::size_t count) const;
  std::vector<std::string> texts(std::size_t column, std::size_t from, std::size_t count) const;
  Id type(std::size_t column) const { return Id(H5Dget_type(sets[column]), H5Tclose); }
  bool is_text(std::size_t column) const { return H5Tget_class(type(column)) == H5T_STRING; }

 private:
  /// The rows of a data set in memory and in the file.
  struct Part {
    Id memory, file;
  };
  Part part(std::size_t column, std::size_t from, std::size_t count) const;
  void add(const std::string& name, std::uintmax_t file_bytes);
  std::vector<std::string> variable_texts(std::size_t column, std::size_t from, std::size_t count) const;
  std::vector<std::string> fixed_texts(std::size_t column, std::size_t from, std::size_t count) const;
};

ColumnReader::Made::Made(const fs::path& path) : file(path), handle(open_plainly(path), H5Fclose) {
  const std::uintmax_t bytes = fs::file_size(path);
  for (const auto& name : link_names(handle)) add(name, bytes);
  if (sets.empty()) throw Failure("it has no column at its root");
}

/// Adds the data set of that name if it is a column.
void ColumnReader::Made::add(const std::string& name, std::uintmax_t file_bytes) {
  {
    const Id object(H5Oopen(handle, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (H5Iget_type(object) != H5I_DATASET) return;
    const auto kind = H5Tget_class(Id(H5Dget_type(object), H5Tclose));
    if (H5Sget_simple_extent_ndims(Id(H5Dget_space(object), H5Sclose)) != 1 ||
        (kind != H5T_INTEGER && kind != H5T_FLOAT && kind != H5T_STRING))
      return;
  }
  auto [set, size] = open_column(handle, name, file_bytes, Texts::accept);
  if (!sets.empty() && size != rows)
    throw Failure(fmt::format("{} has {} rows, but {} has {}", name, size, names.front(), rows));
  rows = size;
  names.push_back(name), sets.push_back(std::move(set));
}

ColumnReader::Made::Part ColumnReader::Made::part(std::size_t column, std::size_t from, std::size_t count) const {
  const hsize_t start = from, size = count;
  require_stored(file, true, sets[column], start, size);
  Part out{.memory = Id(H5Screate_simple(1, &size, nullptr), H5Sclose),
           .file = Id(H5Dget_space(sets[column]), H5Sclose)};
  check(H5Sselect_hyperslab(out.file, H5S_SELECT_SET, &start, nullptr, &size, nullptr));
  return out;
}

std::vector<double> ColumnReader::Made::numbers(std::size_t column, std::size_t from, std::size_t count) const {
  const auto part = this->part(column, from, count);
  std::vector<double> values(count);
  check(H5Dread(sets[column], H5T_NATIVE_DOUBLE, part.memory, part.file, H5P_DEFAULT, values.data()));
  return values;
}

std::vector<std::string> ColumnReader::Made::texts(std::size_t column, std::size_t from, std::size_t count) const {
  if (is_text(column))
    return check(H5Tis_variable_str(type(column))) > 0 ? variable_texts(column, from, count)
                                                       : fixed_texts(column, from, count);
  std::vector<std::string> values;  // a number of a robot or a curve
  for (const double x : numbers(column, from, count)) values.push_back(fmt::format("{:g}", x));
  return values;
}

std::vector<std::string> ColumnReader::Made::variable_texts(std::size_t column, std::size_t from,
                                                            std::size_t count) const {
  const auto part = this->part(column, from, count);
  const Id text = type(column);
  std::vector<char*> pointers(count, nullptr);
  check(H5Dread(sets[column], text, part.memory, part.file, H5P_DEFAULT, pointers.data()));
  std::vector<std::string> values;
  for (const char* p : pointers) values.emplace_back(p ? p : "");
  check(H5Dvlen_reclaim(text, part.memory, H5P_DEFAULT, pointers.data()));
  return values;
}

std::vector<std::string> ColumnReader::Made::fixed_texts(std::size_t column, std::size_t from,
                                                         std::size_t count) const {
  const Id text = type(column);
  const std::size_t size = H5Tget_size(text), at_once = std::max<std::size_t>(1, limits::hdf5_chunk_bytes / size);
  std::vector<std::string> values;
  for (std::size_t done = 0; done < count; done += at_once) {
    const std::size_t now = std::min(at_once, count - done);
    const auto part = this->part(column, from + done, now);
    std::string bytes(size * now, '\0');
    check(H5Dread(sets[column], text, part.memory, part.file, H5P_DEFAULT, bytes.data()));
    for (std::size_t i = 0; i < now; ++i) {
      const std::string one = bytes.substr(i * size, size);
      const auto end = one.find_last_not_of(std::string_view(" \0", 2));
      values.push_back(one.substr(0, one.find('\0')).substr(0, end == one.npos ? 0 : end + 1));
    }
  }
  return values;
}

ColumnReader::ColumnReader(std::unique_ptr<Made> made) : made_(std::move(made)) {}
ColumnReader::ColumnReader(ColumnReader&&) noexcept = default;
ColumnReader::~ColumnReader() = default;

Result<ColumnReader> ColumnReader::open(const fs::path& file) {
  const auto read_everything = [&] {
    const Hdf5 hdf5;
    const Made made(file);
    for (std::size_t column = 0; column < made.names.size(); ++column)
      for (std::size_t at = 0; at < made.rows; at += rows_at_once) try {
          const std::size_t count = std::min(rows_at_once, made.rows - at);
          made.is_text(column) ? void(made.texts(column, at, count)) : void(made.numbers(column, at, count));
        } catch (const Failure&) {  // the next rows may crash all the same
        }
  };
  if (auto ok = probe(file, "an HDF5 table", no_table, read_everything); !ok) return tl::unexpected(ok.error());
  return guarded(file, no_table, [&] {
    const Hdf5 hdf5;
    return ColumnReader(std::make_unique<Made>(file));
  });
}

const std::vector<std::string>& ColumnReader::names() const { return made_->names; }
std::size_t ColumnReader::rows() const { return made_->rows; }

Result<std::vector<double>> ColumnReader::numbers(std::size_t column, std::size_t from, std::size_t count) const {
  return guarded(made_->file, no_table, [&] {
    const Hdf5 hdf5;
    if (made_->is_text(column)) throw Failure(made_->names[column] + " is text; it must be numbers");
    return made_->numbers(column, from, count);
  });
}

Result<std::vector<std::string>> ColumnReader::texts(std::size_t column, std::size_t from, std::size_t count) const {
  return guarded(made_->file, no_table, [&] {
    const Hdf5 hdf5;
    return made_->texts(column, from, count);
  });
}

}  // namespace tribotwin::twin
