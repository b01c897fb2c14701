#include <algorithm>
#include <iterator>

#include <tribotwin/twin/io/telemetry/reader.hpp>

namespace tribotwin::twin {

using namespace hdf5;

namespace {

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

Status write_csv(NewFile& out, const Reader& r, const Columns& columns, const std::vector<Channel>& channels,
                 const std::function<void(double)>& progress) {
  fmt::memory_buffer text;
  const auto add = std::back_inserter(text);
  const auto put = [&] {
    auto ok = out.write({text.data(), text.size()});
    text.clear();
    return ok;
  };
  fmt::format_to(add, "time_s");
  for (std::size_t j = 0; j < r.head.joints.size(); ++j)
    for (std::size_t c = 0; c < channels.size(); ++c)
      fmt::format_to(
          add, ",{}",
          quoted(r.head.joints[j] + "." +
                 (&columns == &r.samples ? column_name(channels[c].name, r.head.units[j][c]) : channels[c].name)));
  text.push_back('\n');
  const std::size_t width = 1 + r.head.joints.size() * channels.size();
  std::vector<double> values(width * rows_at_once);  // column by column
  for (hsize_t from = 0; from < columns.rows; from += rows_at_once) {
    const std::size_t rows = std::min<hsize_t>(rows_at_once, columns.rows - from);
    {
      const Hdf5 hdf5;
      read_rows(r, columns.time, from, std::span(values).first(rows));
      std::size_t at = 0;
      for (const auto& joint : columns.joints)
        for (const Id& dataset : joint)
          read_rows(r, dataset, from, std::span(values).subspan(rows_at_once * ++at, rows));
    }
    for (std::size_t i = 0; i < rows; ++i)
      for (std::size_t c = 0; c < width; ++c)
        fmt::format_to(add, "{}{}", values[rows_at_once * c + i], c + 1 < width ? ',' : '\n');
    if (auto ok = put(); !ok) return ok;
    if (progress) progress(static_cast<double>(from + rows) / static_cast<double>(columns.rows));
  }
  return put();
}

/// The whole CSV, not yet under its name.
Result<NewFile> make_csv(const fs::path& file, Existing existing, const Reader& r, const Columns& columns,
                         const std::vector<Channel>& channels, const std::function<void(double)>& progress) {
  if (auto ok = check_output(file, existing); !ok) return tl::unexpected(ok.error());
  auto out = NewFile::create(file, existing);
  if (!out) return out;
  const auto written = guarded(r.path, no_record, [&] { return write_csv(*out, r, columns, channels, progress); });
  if (!written) return tl::unexpected(written.error());
  if (!*written) return tl::unexpected(written->error());
  return out;
}

}  // namespace

std::array<fs::path, 2> csv_files(const fs::path& run_dir, const fs::path& file) {
  if (file.empty()) return {run_dir / "telemetry.csv", run_dir / "cycles.csv"};
  return {file, file.parent_path() / (file.stem().string() + "_cycles.csv")};
}

Result<std::vector<fs::path>> export_csv(const fs::path& run_dir, Existing existing,
                                         const std::function<void(double)>& progress, const fs::path& target) {
  const fs::path path = run_dir / "telemetry.h5";
  if (auto ok = probe(path); !ok) return tl::unexpected(ok.error());
  const auto r = guarded(path, no_record, [&] {
    const Hdf5 hdf5;
    return open_record(path);
  });
  if (!r) return tl::unexpected(r.error());
  const auto [samples, cycles] = csv_files(run_dir, target);
  std::vector<fs::path> files{samples};
  std::vector<NewFile> made;
  const auto make = [&](const Columns& columns, const std::vector<Channel>& channels, const auto& report) {
    auto file = make_csv(files.back(), existing, *r, columns, channels, report);
    if (!file) return Status(tl::unexpected(file.error()));
    made.push_back(std::move(*file));
    return Status{};
  };
  if (auto ok = make(r->samples, r->head.channels, progress); !ok) return tl::unexpected(ok.error());
  if (r->cycles.rows > 0) {
    files.push_back(cycles);
    if (auto ok = make(r->cycles, r->head.cycle_channels, std::function<void(double)>{}); !ok)
      return tl::unexpected(ok.error());
  }
  for (NewFile& file : made)
    if (auto ok = file.publish(); !ok) return tl::unexpected(ok.error());
  if (progress) progress(1);
  return files;
}

}  // namespace tribotwin::twin
