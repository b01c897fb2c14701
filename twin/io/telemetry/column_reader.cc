#include <tribotwin/twin/io/telemetry/column_reader.hpp>
#include <tribotwin/twin/io/telemetry/hdf5.hpp>

namespace tribotwin::twin {

using namespace hdf5;

struct ColumnReader::Made {
  fs::path file;
  Id handle;
  std::vector<std::string> names;
  std::vector<Id> sets;
  std::size_t rows = 0;

  /// The rows of a data set in memory and in the file.
  struct Part {
    Id memory, file;
  };
  Part part(std::size_t column, std::size_t from, std::size_t count) const {
    const hsize_t start = from, size = count;
    Part out{.memory = Id(H5Screate_simple(1, &size, nullptr), H5Sclose),
             .file = Id(H5Dget_space(sets[column]), H5Sclose)};
    check(H5Sselect_hyperslab(out.file, H5S_SELECT_SET, &start, nullptr, &size, nullptr));
    return out;
  }
  /// Adds the data set of that name if it is a column.
  void add(const std::string& name) {
    Id object(H5Oopen(handle, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (H5Iget_type(object) != H5I_DATASET) return;
    const Id space(H5Dget_space(object), H5Sclose), type(H5Dget_type(object), H5Tclose);
    const auto kind = H5Tget_class(type);
    if (H5Sget_simple_extent_ndims(space) != 1 || (kind != H5T_INTEGER && kind != H5T_FLOAT && kind != H5T_STRING))
      return;
    const auto size = static_cast<std::size_t>(check(H5Sget_simple_extent_npoints(space)));
    if (!sets.empty() && size != rows)
      throw Failure(fmt::format("{} has {} rows, but {} has {}", name, size, names.front(), rows));
    rows = size;
    names.push_back(name), sets.push_back(std::move(object));
  }
};

ColumnReader::ColumnReader(std::unique_ptr<Made> made) : made_(std::move(made)) {}
ColumnReader::ColumnReader(ColumnReader&&) noexcept = default;
ColumnReader::~ColumnReader() = default;

Result<ColumnReader> ColumnReader::open(const fs::path& file) {
  return guarded(file, "is no readable HDF5 table", [&] {
    const Hdf5 hdf5;
    auto made = std::make_unique<Made>();
    made->file = file;
    made->handle = Id(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    std::vector<std::string> found;
    check(H5Literate(
        made->handle, H5_INDEX_NAME, H5_ITER_INC, nullptr,
        [](hid_t, const char* name, const H5L_info_t*, void* out) -> herr_t {
          static_cast<std::vector<std::string>*>(out)->emplace_back(name);
          return 0;
        },
        &found));
    for (const auto& name : found) made->add(name);
    if (made->sets.empty()) throw Failure("it has no column at its root");
    return ColumnReader(std::move(made));
  });
}

const std::vector<std::string>& ColumnReader::names() const { return made_->names; }
std::size_t ColumnReader::rows() const { return made_->rows; }

Result<std::vector<double>> ColumnReader::numbers(std::size_t column, std::size_t from, std::size_t count) const {
  return guarded(made_->file, no_record, [&] {
    const Hdf5 hdf5;
    const Id type(H5Dget_type(made_->sets[column]), H5Tclose);
    if (H5Tget_class(type) == H5T_STRING) throw Failure(made_->names[column] + " is text; it must be numbers");
    std::vector<double> values(count);
    const auto part = made_->part(column, from, count);
    check(H5Dread(made_->sets[column], H5T_NATIVE_DOUBLE, part.memory, part.file, H5P_DEFAULT, values.data()));
    return values;
  });
}

Result<std::vector<std::string>> ColumnReader::texts(std::size_t column, std::size_t from, std::size_t count) const {
  return guarded(made_->file, no_record, [&] {
    const Hdf5 hdf5;
    const Id& set = made_->sets[column];
    const Id type(H5Dget_type(set), H5Tclose);
    const auto part = made_->part(column, from, count);
    std::vector<std::string> values;
    if (H5Tget_class(type) != H5T_STRING) {
      // A number of a robot or a curve.
      std::vector<double> numbers(count);
      check(H5Dread(set, H5T_NATIVE_DOUBLE, part.memory, part.file, H5P_DEFAULT, numbers.data()));
      for (const double x : numbers) values.push_back(fmt::format("{:g}", x));
    } else if (check(H5Tis_variable_str(type)) > 0) {
      std::vector<char*> pointers(count, nullptr);
      const Id text(H5Tcopy(type), H5Tclose);
      check(H5Dread(set, text, part.memory, part.file, H5P_DEFAULT, pointers.data()));
      for (const char* p : pointers) values.emplace_back(p ? p : "");
      check(H5Dvlen_reclaim(text, part.memory, H5P_DEFAULT, pointers.data()));
    } else {
      const std::size_t size = H5Tget_size(type);
      std::string bytes(size * count, '\0');
      check(H5Dread(set, type, part.memory, part.file, H5P_DEFAULT, bytes.data()));
      for (std::size_t i = 0; i < count; ++i) {
        const std::string one = bytes.substr(i * size, size);
        const auto end = one.find_last_not_of(std::string_view(" \0", 2));
        values.push_back(one.substr(0, one.find('\0')).substr(0, end == one.npos ? 0 : end + 1));
      }
    }
    return values;
  });
}

}  // namespace tribotwin::twin
