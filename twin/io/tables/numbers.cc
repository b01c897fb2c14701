#include <algorithm>
#include <cmath>
#include <fstream>

#include <fmt/format.h>

#include <tribotwin/twin/io/mcap/reader.hpp>
#include <tribotwin/twin/io/tables/layout.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/tables/source.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
constexpr double shortest_step_s = 1e-9;

/// The first bytes of a regular file: what is no regular file can be read once only, and is a CSV.
std::string first_bytes(const fs::path& file) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) return {};
  std::ifstream stream(file, std::ios::binary);
  std::string bytes(128, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
  return bytes;
}

/// The recording in a bag, which is the folder that rosbag2 makes; of other files themselves.
Result<fs::path> out_of_bag(const fs::path& file) {
  std::error_code error;
  if (!fs::is_directory(file, error) || record_of(file)) return file;
  std::vector<std::string> recordings;
  for (const auto& entry : fs::directory_iterator(file, error))
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
  const std::string bytes = first_bytes(file);
  const auto begins = [&](std::string_view magic) { return bytes.starts_with(magic); };
  if (mcap::begins_as_mcap(bytes) || file.extension() == ".mcap") return tables::open_mcap(file, wanted, options.topic);
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

}  // namespace

std::optional<fs::path> record_of(const fs::path& file) {
  std::error_code error;
  if (fs::is_directory(file, error) && fs::exists(file / "telemetry.h5", error)) return file / "telemetry.h5";
  if (file.extension() == ".h5" || file.extension() == ".hdf5" || first_bytes(file).starts_with("\x89HDF\r\n\x1a\n"))
    return file;
  return std::nullopt;
}

bool Numbers::has(std::string_view name) const { return std::ranges::find(names, name) != names.end(); }

std::string Numbers::where(std::size_t index) const {
  return row == "line" ? fmt::format("{}:{}: ", file.string(), lines[index])
                       : fmt::format("{}: {} {}: ", file.string(), row, lines[index]);
}

Result<Numbers> read_numbers(const fs::path& file, const std::vector<std::string>& wanted,
                             const TableOptions& options) {
  auto source = open_table(file, wanted, options);
  if (!source) return tl::unexpected(source.error());
  const auto layout = tables::lay_out(file, (*source)->headers(), wanted, options);
  if (!layout) return tl::unexpected(layout.error());
  const auto picks = layout->picks(wanted);
  if (!picks) return tl::unexpected(picks.error());
  Numbers numbers{.file = file, .names = {}, .header = shown(layout->headers), .row = (*source)->row()};
  numbers.columns.resize(wanted.size());
  for (const auto& column : layout->columns) numbers.names.push_back(column.name);
  if (auto ok = (*source)->read(*picks, numbers); !ok) return tl::unexpected(ok.error());
  if (!picks->empty() && numbers.lines.empty() && numbers.left_out == 0)
    return tl::unexpected(fmt::format("{}: is empty: a header but no samples", file.string()));
  return numbers;
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
