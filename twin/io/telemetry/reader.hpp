#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/twin/io/telemetry/hdf5.hpp>

/// A record opened for reading, and what tables of HDF5 (column_reader.hpp) share with it.
namespace tribotwin::twin::hdf5 {

/// The columns of a file that share a time column: their common length and, joint by joint, their datasets.
struct Columns {
  Id time;
  std::vector<std::vector<Id>> joints;
  hsize_t rows = 0;
};

/// `head` is the record without the values.
struct Reader {
  fs::path path;
  Id file;
  bool plain = true;  ///< opens without SWMR, because its writer closed it
  Recording head;
  Columns samples, cycles;
};

/// Opens a file for reading; below 0 where HDF5 cannot. No filter of the file may load code.
hid_t open_plainly(const fs::path& path);

/// Names in a group, at most limits::hdf5_links. Throws Failure where one is a link to elsewhere.
std::vector<std::string> link_names(hid_t group);

enum class Texts { refuse, accept };

/// A dataset of one dimension and its length, which is checked against the file's size before memory of that size is
/// allocated. Throws Failure where it is stored in other files, or holds neither numbers nor, where these are accepted,
/// texts of at most limits::hdf5_text_bytes.
std::pair<Id, hsize_t> open_column(hid_t parent, const std::string& name, std::uintmax_t file_bytes, Texts texts);

/// Throws Failure where a part of these rows is missing from the file at `path`: HDF5 itself reads what lies beyond the
/// end of a file as zeros. `plain`: as of Reader. Damage within the rows is left to reading them.
void require_stored(const fs::path& path, bool plain, hid_t dataset, hsize_t from, hsize_t count);

/// Throws Failure. Does not follow links to other files, nor storage in other files.
Reader open_record(const fs::path& path);

/// Throws Failure where a part of these rows is missing from the file or has another checksum.
void read_rows(const Reader& reader, hid_t dataset, hsize_t from, std::span<double> values);

constexpr std::size_t rows_at_once = 4096;  ///< of an export: in memory

/// Rows of all columns of one table, column by column; time first.
class Rows {
 public:
  /// `at_once`: how many rows are in memory.
  Rows(const Reader& reader, const Columns& columns, std::size_t at_once);
  /// At most as many rows as are in memory. Throws Failure where a part of them is damaged.
  void read(hsize_t from, std::size_t count);
  double time_s(std::size_t row) const { return values_[row]; }
  /// The values of a row, joint by joint.
  void get(std::size_t row, std::vector<double>& values) const;

 private:
  const Reader& reader_;
  std::vector<hid_t> datasets_;
  std::vector<double> values_;
  std::size_t at_once_;
};

/// Reads all of a record once in a child process, because some damaged files crash HDF5 1.10. Fails where the child
/// crashes, where the file does not exist, and where the file cannot be read although nobody writes it.
Status probe(const fs::path& path);

/// The same of any file of HDF5: `read_everything` reads all of it. `kind` and `phrase` as of check_input_file and
/// guarded.
Status probe(const fs::path& path, std::string_view kind, std::string_view phrase,
             const std::function<void()>& read_everything);

}  // namespace tribotwin::twin::hdf5
