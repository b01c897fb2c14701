#include <set>

#include <tribotwin/twin/io/telemetry/columns.hpp>
#include <tribotwin/twin/io/telemetry/hdf5.hpp>

namespace tribotwin::twin {

using namespace hdf5;

namespace {

/// Without the times of creation, which would make each file another one.
Id timeless(hid_t kind) {
  Id properties(H5Pcreate(kind), H5Pclose);
  check(H5Pset_obj_track_times(properties, false));
  return properties;
}

void write_numbers(const Id& dataset, const std::vector<double>& values) {
  check(H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()));
}

/// UTF-8 of variable length.
Id text_type() {
  Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  check(H5Tset_size(type, H5T_VARIABLE));
  check(H5Tset_cset(type, H5T_CSET_UTF8));
  return type;
}

void write(hid_t file, const Column& column) {
  const auto* numbers = std::get_if<std::vector<double>>(&column.values);
  const auto* texts = std::get_if<std::vector<std::string>>(&column.values);
  const hsize_t size = numbers ? numbers->size() : texts->size();
  const Id space(H5Screate_simple(1, &size, nullptr), H5Sclose),
      type = text_type(), properties = timeless(H5P_DATASET_CREATE), links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  check(H5Pset_char_encoding(links, H5T_CSET_UTF8));
  const Id dataset(H5Dcreate2(file, column.path.c_str(), numbers ? H5T_NATIVE_DOUBLE : hid_t{type}, space, links,
                              properties, H5P_DEFAULT),
                   H5Dclose);
  write_attribute(dataset, "description", column.description);
  if (size == 0) return;
  if (numbers) return write_numbers(dataset, *numbers);
  std::vector<const char*> pointers;
  for (const auto& text : *texts) pointers.push_back(text.c_str());
  check(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, pointers.data()));
}

void create_groups(hid_t file, const std::vector<Column>& columns) {
  const Id properties = timeless(H5P_GROUP_CREATE), links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  check(H5Pset_char_encoding(links, H5T_CSET_UTF8));
  std::set<std::string> groups;
  for (const Column& column : columns)
    for (auto slash = column.path.find('/'); slash != std::string::npos; slash = column.path.find('/', slash + 1))
      if (const auto group = column.path.substr(0, slash); groups.insert(group).second)
        Id(H5Gcreate2(file, group.c_str(), links, properties, H5P_DEFAULT), H5Gclose);
}

std::string image_of(hid_t file) {
  check(H5Fflush(file, H5F_SCOPE_GLOBAL));
  const ssize_t size = check(H5Fget_file_image(file, nullptr, 0));
  std::string bytes(static_cast<std::size_t>(size), '\0');
  check(H5Fget_file_image(file, bytes.data(), bytes.size()));
  return bytes;
}

}  // namespace

std::string column_name(const std::string& name) {
  std::string out;
  for (const char c : name) out += c == '/' ? "%2F" : c == '%' ? "%25" : std::string(1, c);
  return name == "." ? "%2E" : out;
}

Result<std::string> columns_hdf5(const std::vector<Column>& columns,
                                 const std::vector<std::pair<std::string, std::string>>& attributes) {
  return guarded("an HDF5 table", not_written, [&] {
    const Hdf5 hdf5;
    const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    check(H5Pset_fapl_core(access, std::size_t{1} << 20, false));  // in memory alone
    const Id creation = timeless(H5P_FILE_CREATE),
             file(H5Fcreate("table.h5", H5F_ACC_TRUNC, creation, access), H5Fclose);
    for (const auto& [name, value] : attributes) write_attribute(file, name, value);
    create_groups(file, columns);
    for (const Column& column : columns) write(file, column);
    return image_of(file);
  });
}

}  // namespace tribotwin::twin
