#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>

/// Private to this folder: a table of any format, opened.
namespace tribotwin::twin::tables {

/// A column to be read: which one of the header, what its numbers become, and where they go.
struct Pick {
  std::size_t header, place;  ///< place: among the wanted columns
  double factor = 1, offset = 0;
  bool as_it_is = true;  ///< no conversion
  double rate_hz = 0;    ///< above 0: row / rate, no column of the file
  bool date = false;
  Quantity quantity;

  double value(double number) const { return as_it_is ? number : factor * number + offset; }
};

class Source {
 public:
  virtual ~Source() = default;
  /// The names in the file, not trusted to be printable.
  virtual const std::vector<std::string>& headers() const = 0;
  /// "line" or "row"
  virtual std::string_view row() const { return "row"; }
  /// Appends the rows of the picked columns to `numbers`, leaving out those with a number that is not finite.
  virtual Result<void> read(std::span<const Pick> picks, Numbers& numbers) = 0;
};
using Opened = Result<std::unique_ptr<Source>>;

/// A table whose columns are read one by one.
class ArraySource : public Source {
 public:
  Result<void> read(std::span<const Pick> picks, Numbers& numbers) override;

 protected:
  virtual Result<std::vector<double>> column(std::size_t header) = 0;
};

/// Rows and columns of an array: its sides without those of length 1, as far as more than two are left. More than two
/// are no matrix.
std::vector<std::size_t> matrix_sides(std::vector<std::size_t> sides);
/// What to say of an array with more than two.
std::string no_matrix(std::span<const std::size_t> sides);

/// One column of a matrix, as a stride through its elements.
struct Stripe {
  std::string name;
  std::size_t begin, step, count;
};
/// All columns of a matrix and, where it is at most 64 high, its rows: "q[:,0]", "q(:,1)" with counting from `first`;
/// of a vector, and of what is no matrix, one of its own name. `by_column`: elements of a column are neighbours.
std::vector<Stripe> stripes_of(const std::string& name, std::span<const std::size_t> sides, bool by_column, char open,
                               char close, std::size_t first);

Opened open_csv(const std::filesystem::path& file);
Opened open_record(const std::filesystem::path& file);
Opened open_numpy(const std::filesystem::path& file);
Opened open_matlab(const std::filesystem::path& file);
/// Why a file of version 4 or 5 (to 7) is not whole: libmatio ends its list of variables where the file is cut off, and
/// gives those before. Nothing for v7.3, whose length HDF5 checks, and for what is no MATLAB file.
/// Source: MathWorks, MAT-File Format, R2023b, chapters 1 and 2.
std::optional<std::string> cut_off(const std::filesystem::path& file);
/// `wanted`: as of read_numbers(); `topic`: empty where the file has one of joints only.
Opened open_mcap(const std::filesystem::path& file, const std::vector<std::string>& wanted, const std::string& topic);

}  // namespace tribotwin::twin::tables
