#include <algorithm>
#include <cmath>
#include <fstream>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/mcap/reader.hpp>
#include <tribotwin/twin/io/tables/layout.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/tables/source.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
constexpr double shortest_step_s = 1e-9;

/// The first bytes of a regular file: what is no regular file can be read once only, and is a CSV.
Result<std::string> first_bytes(const fs::path& file) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) return std::string();
  std::ifstream stream(file, std::ios::binary);
  std::string bytes(128, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (stream.bad()) return not_read(file.string());
  bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
  return bytes;
}

/// The recording in a bag, which is the folder that rosbag2 makes; of other files themselves.
Result<fs::path> out_of_bag(const fs::path& file) {
  std::error_code error;
  if (!fs::is_directory(file, error) || record_of(file)) return file;
  std::vector<std::string> recordings;
  const auto entries = entries_of(file);
  if (!entries) return tl::unexpected(entries.error());
  for (const fs::directory_entry& entry : *entries)
    if (entry.path().extension() == ".mcap") recordings.push_back(entry.path().string());
  if (recordings.empty()) return file;
  std::ranges::sort(recordings);
  if (recordings.size() > 1)
    return tl::unexpected(
        fmt::format("{}: is a folder of several recordings, {}; give one of them", file.string(), shown(recordings)));
  return recordings.front();
}

/// Formats are known by their first bytes, or by their name where the bytes say nothing.
tables::Opened open_table(const fs::path& given, const std::vector<std::string>& wanted, const TableOptions& options) {
  using namespace std::string_view_literals;
  const auto found = out_of_bag(given);
  if (!found) return tl::unexpected(found.error());
  const fs::path& file = *found;
  const auto bytes = first_bytes(file);
  if (!bytes) return tl::unexpected(bytes.error());
  const auto begins = [&](std::string_view magic) { return bytes->starts_with(magic); };
  if (mcap::begins_as_mcap(*bytes) || file.extension() == ".mcap")
    return tables::open_mcap(file, wanted, options.topic);
  if (!options.topic.empty())
    return tl::unexpected(fmt::format("{}: --topic is for MCAP files; this is none", file.string()));
  if (begins("\x28\xB5\x2F\xFD"sv))
    return tl::unexpected(
        fmt::format("{}: is compressed as a whole; unpack it first: zstd -d {}", file.string(), file.string()));
  if (begins("MATLAB "sv) || file.extension() == ".mat") return tables::open_matlab(file);
  if (begins("\x93NUMPY"sv) || begins("PK\x03\x04"sv) || file.extension() == ".npy" || file.extension() == ".npz")
    return tables::open_numpy(file);
  if (const auto record = record_of(file)) return tables::open_record(*record);
  return tables::open_csv(file);
}

/// What the table has, without numbers.
Numbers header_of(const tables::Layout& layout, const tables::Source& source) {
  Numbers numbers{.file = layout.file, .names = {}, .header = shown(layout.headers), .row = source.row()};
  for (const auto& column : layout.columns) numbers.names.push_back(column.name);
  return numbers;
}

}  // namespace

std::optional<fs::path> record_of(const fs::path& file) {
  std::error_code error;
  if (fs::is_directory(file, error) && fs::exists(file / "telemetry.h5", error)) return file / "telemetry.h5";
  if (file.extension() == ".h5" || file.extension() == ".hdf5" ||
      first_bytes(file).value_or("").starts_with("\x89HDF\r\n\x1a\n"))
    return file;
  return std::nullopt;
}

bool Numbers::has(std::string_view name) const { return std::ranges::find(names, name) != names.end(); }

std::string Numbers::hint(std::string_view name) const {
  const auto torque = parse_column(name);
  if (!torque || !*torque || (*torque)->quantity->name != "torque") return "";
  const std::string &joint = (*torque)->joint, current = fmt::format("current{}{}_a", joint.empty() ? "" : "_", joint);
  if (!has(current)) return "";
  return fmt::format("{} is there: --torque-constant {}KT makes the torque of it; ", current,
                     joint.empty() ? "" : joint + "=");
}

std::string Numbers::where(std::size_t index) const {
  return row == "line" ? fmt::format("{}:{}: ", file.string(), lines[index])
                       : fmt::format("{}: {} {}: ", file.string(), row, lines[index]);
}

OpenTable::OpenTable(fs::path file, TableOptions options, std::unique_ptr<tables::Source> source)
    : file_(std::move(file)), options_(std::move(options)), source_(std::move(source)) {}
OpenTable::OpenTable(OpenTable&&) noexcept = default;
OpenTable::~OpenTable() = default;

Result<OpenTable> OpenTable::open(const fs::path& file, const TableOptions& options,
                                  const std::vector<std::string>& wanted) {
  auto source = open_table(file, wanted, options);
  if (!source) return tl::unexpected(source.error());
  return OpenTable(file, options, std::move(*source));
}

Result<Numbers> OpenTable::header(const std::vector<std::string>& wanted) const {
  const auto layout = tables::lay_out(file_, source_->headers(), wanted, options_);
  if (!layout) return tl::unexpected(layout.error());
  if (const auto picks = layout->picks(wanted); !picks) return tl::unexpected(picks.error());
  return header_of(*layout, *source_);
}

Result<Numbers> OpenTable::read(const std::vector<std::string>& wanted) {
  const auto layout = tables::lay_out(file_, source_->headers(), wanted, options_);
  if (!layout) return tl::unexpected(layout.error());
  const auto picks = layout->picks(wanted);
  if (!picks) return tl::unexpected(picks.error());
  Numbers numbers = header_of(*layout, *source_);
  numbers.columns.resize(wanted.size());
  if (auto ok = source_->read(*picks, numbers); !ok) return tl::unexpected(ok.error());
  if (!picks->empty() && numbers.lines.empty() && numbers.left_out == 0)
    return tl::unexpected(fmt::format("{}: is empty: a header but no samples", file_.string()));
  return numbers;
}

Result<Numbers> read_numbers(const fs::path& file, const std::vector<std::string>& wanted,
                             const TableOptions& options) {
  auto table = OpenTable::open(file, options, wanted);
  if (!table) return tl::unexpected(table.error());
  return table->read(wanted);
}

namespace {

bool same_bytes(const fs::path& a, const fs::path& b) {
  std::ifstream one(a, std::ios::binary), other(b, std::ios::binary);
  std::vector<char> of_one(std::size_t{1} << 16), of_other(of_one.size());
  while (one && other) {
    one.read(of_one.data(), std::ssize(of_one)), other.read(of_other.data(), std::ssize(of_other));
    if (one.gcount() != other.gcount() || !std::equal(of_one.begin(), of_one.begin() + one.gcount(), of_other.begin()))
      return false;
  }
  return one.eof() && other.eof();
}

}  // namespace

std::optional<std::string> given_twice(const std::vector<fs::path>& files) {
  struct File {
    fs::path named, data;
    std::uintmax_t bytes;
  };
  std::vector<File> seen;
  for (const auto& named : files) {
    const fs::path data = record_of(named).value_or(named);
    std::error_code error;
    if (!fs::is_regular_file(data, error)) continue;
    const auto bytes = fs::file_size(data, error);
    for (const auto& other : seen)
      if (other.bytes == bytes && (fs::equivalent(other.data, data, error) || same_bytes(other.data, data)))
        return fmt::format(
            "{} and {} have the same content; a recording that counts twice makes sigmas too small: give it once",
            other.named.string(), named.string());
    seen.push_back({named, data, bytes});
  }
  return std::nullopt;
}

std::optional<std::string> not_increasing(const Numbers& numbers, const std::vector<double>& time_s) {
  for (std::size_t i = 1; i < time_s.size(); ++i)
    if (!(time_s[i] - time_s[i - 1] >= shortest_step_s))
      return fmt::format(
          "{}time_s {} does not come after {}; it must increase from row to row, recordings made one by one are files "
          "of their own",
          numbers.where(i), time_s[i], time_s[i - 1]);
  return std::nullopt;
}

}  // namespace tribotwin::twin
