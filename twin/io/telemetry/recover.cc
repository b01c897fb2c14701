#include <algorithm>
#include <cmath>
#include <limits>

#include <unistd.h>

#include <tribotwin/twin/io/telemetry/reader.hpp>
#include <tribotwin/twin/io/telemetry/record.hpp>

namespace tribotwin::twin {

using namespace hdf5;

namespace {

/// False where a part of the rows is damaged.
bool readable(Rows& rows, hsize_t from, std::size_t count) {
  try {
    rows.read(from, count);
    return true;
  } catch (const Failure&) {
    return false;
  }
}

struct Copied {
  std::size_t kept = 0, lost = 0;
  double last_time_s = -std::numeric_limits<double>::infinity();
};

/// Copies the rows that are proven.
Copied copy_rows(const Reader& reader, const Columns& from, Record& record, Table& to) {
  Copied result;
  Rows rows(reader, from, chunk_rows);
  std::vector<double> values;
  const auto infinite = [](double x) { return std::isinf(x); };
  for (hsize_t at = 0; at < from.rows; at += chunk_rows) {
    const std::size_t count = std::min<hsize_t>(chunk_rows, from.rows - at);
    const bool whole = readable(rows, at, count);
    for (std::size_t i = 0; whole && i < count; ++i) {
      rows.get(i, values);
      if (!std::isfinite(rows.time_s(i)) || !(rows.time_s(i) > result.last_time_s) ||
          std::ranges::any_of(values, infinite))
        continue;
      result.last_time_s = rows.time_s(i);
      ++result.kept;
      to.push(rows.time_s(i), values);
    }
    record.reserve(to.growth(to.pending()));
    to.write();
  }
  result.lost = from.rows - result.kept;
  return result;
}

Recovered copy_record(const Reader& reader, const fs::path& to) {
  const Recording& head = reader.head;
  Record record = create_record(to, {.attributes = head.attributes,
                                     .joints = head.joints,
                                     .joint_attributes = head.joint_attributes,
                                     .channels = head.channels,
                                     .units = head.units,
                                     .cycle_channels = head.cycle_channels});
  const int recovered = 1;
  write_attribute(record.file, "recovered", H5T_NATIVE_INT, &recovered);
  record.mark_complete(head.complete);
  const Copied samples = copy_rows(reader, reader.samples, record, record.samples);
  const Copied cycles = reader.cycles.time ? copy_rows(reader, reader.cycles, record, record.cycles) : Copied{};
  record.close_on_disk();
  return {.samples = samples.kept,
          .cycles = cycles.kept,
          .lost_samples = samples.lost,
          .lost_cycles = cycles.lost,
          .last_time_s = samples.last_time_s,
          .was_plain = false};
}

/// Whether every chunk can be read.
bool undamaged(const Reader& reader) {
  for (const Columns* columns : {&reader.samples, &reader.cycles}) {
    Rows rows(reader, *columns, chunk_rows);
    for (hsize_t at = 0; at < columns->rows; at += chunk_rows)
      if (!readable(rows, at, std::min<hsize_t>(chunk_rows, columns->rows - at))) return false;
  }
  return true;
}

Recovered as_it_is(const Reader& reader) {
  Recovered result{.samples = reader.samples.rows,
                   .cycles = reader.cycles.rows,
                   .lost_samples = 0,
                   .lost_cycles = 0,
                   .last_time_s = 0,
                   .was_plain = true};
  if (result.samples > 0) read_rows(reader, reader.samples.time, result.samples - 1, std::span(&result.last_time_s, 1));
  return result;
}

}  // namespace

Result<Recovered> recover(const fs::path& run_dir) {
  const fs::path path = run_dir / "telemetry.h5", original = run_dir / "telemetry.h5.original";
  if (auto ok = guarded(path, not_written, [&] { refuse_if_in_use(path); }); !ok) return tl::unexpected(ok.error());
  if (auto ok = probe(path); !ok) return tl::unexpected(ok.error());
  const Hdf5 hdf5;
  const auto reader = guarded(path, no_record, [&] { return open_record(path); });
  if (!reader) return tl::unexpected(reader.error());
  if (const auto good = guarded(path, no_record, [&] { return reader->plain && undamaged(*reader); }); !good)
    return tl::unexpected(good.error());
  else if (*good)
    return guarded(path, no_record, [&] { return as_it_is(*reader); });
  std::error_code error;
  const bool linked = fs::equivalent(path, original, error);  // by a recovery that was killed before its last step
  if (auto ok = check_output(original, Existing::refuse); !ok && !linked)
    return tl::unexpected(
        fmt::format("{}: is the original of an earlier recovery; move it away first", original.string()));
  auto fresh = NewFile::create(path, Existing::replace);
  if (!fresh) return tl::unexpected(fresh.error());
  const auto result = guarded(path, not_written, [&] { return copy_record(*reader, fresh->partial()); });
  if (!result) return result;
  if (result->samples == 0 && result->lost_samples > 0)
    return tl::unexpected(fmt::format("{}: of its {} samples none can be proven; nothing is changed", path.string(),
                                      reader->samples.rows));
  // The original gets its second name before it loses the first: there is no moment without it.
  if (!linked && ::link(path.c_str(), original.c_str()) != 0)
    return tl::unexpected(fmt::format("{}: {} ({})", original.string(), not_written, system_reason(errno)));
  if (auto ok = fresh->publish(); !ok) {
    // Where the rename was done and only its way to the disk failed, that name is the original's last one.
    if (fs::equivalent(path, original, error)) ::unlink(original.c_str());
    return tl::unexpected(ok.error());
  }
  return result;
}

}  // namespace tribotwin::twin
