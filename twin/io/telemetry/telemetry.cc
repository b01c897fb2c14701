#include <cassert>
#include <chrono>

#include <tribotwin/twin/io/telemetry/record.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin {

using namespace hdf5;

namespace {

double steady_clock_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

struct Telemetry::Impl {
  fs::path path;
  TelemetryOptions options;
  Record record;
  std::string error;  // of the first failure, or of use after finish()
  double flushed_s = 0;

  Status write_out() {
    const auto ok = guarded(path, "recording stopped", [&] {
      {
        const Hdf5 hdf5;
        record.reserve(record.samples.growth(record.samples.pending()) + record.cycles.growth(record.cycles.pending()));
        record.samples.write();
        record.cycles.write();
      }
      flushed_s = options.wall_clock_s();
    });
    if (!ok) fail(ok.error().message);
    return ok;
  }
  void fail(const std::string& why) {
    error = why;
    record.abandon();
  }
  Status append(Table& table, double time_s, std::span<const double> values) {
    if (!error.empty()) return tl::unexpected(error);
    if (!table.time.dataset || values.size() != table.columns.size())
      return tl::unexpected(
          fmt::format("{}: {} values given where a row has {}", path.string(), values.size(), table.columns.size()));
    table.push(time_s, values);
    if (table.pending() == block || options.wall_clock_s() - flushed_s >= options.flush_interval_s) return write_out();
    return {};
  }
  ~Impl() {
    if (record.file && error.empty()) (void)write_out();
    if (record.file) (void)guarded(path, "", [&] { record.close(); });
  }
};

Telemetry::Telemetry(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Telemetry::Telemetry(Telemetry&&) noexcept = default;
Telemetry& Telemetry::operator=(Telemetry&&) noexcept = default;
Telemetry::~Telemetry() = default;

Result<Telemetry> Telemetry::create(const fs::path& path, TelemetryOptions options, Existing existing) {
  if (auto ok = guarded(path, not_written, [&] { refuse_if_in_use(path); }); !ok) return tl::unexpected(ok.error());
  auto fresh = NewFile::create(path, existing);
  if (!fresh) return tl::unexpected(fresh.error());
  auto telemetry = guarded(path, not_written, [&] {
    const Hdf5 hdf5;
    auto impl = std::make_unique<Impl>();
    impl->path = path;
    impl->record = create_record(fresh->partial(), options);
    check(H5Fstart_swmr_write(impl->record.file));
    impl->options = std::move(options);
    if (!impl->options.wall_clock_s) impl->options.wall_clock_s = steady_clock_s;
    for (Table* table : {&impl->record.samples, &impl->record.cycles}) {
      table->time.pending.reserve(block);
      for (auto& column : table->columns) column.pending.reserve(block);
    }
    impl->flushed_s = impl->options.wall_clock_s();
    return Telemetry(std::move(impl));
  });
  if (!telemetry) return telemetry;
  if (auto ok = fresh->publish_growing(); !ok) return tl::unexpected(ok.error());
  return telemetry;
}

Status Telemetry::append(double time_s, std::span<const double> values) {
  assert(impl_);
  return impl_->append(impl_->record.samples, time_s, values);
}
Status Telemetry::append_cycle(double time_s, std::span<const double> values) {
  assert(impl_);
  return impl_->append(impl_->record.cycles, time_s, values);
}

Status Telemetry::finish(bool complete) {
  assert(impl_);
  if (!impl_->error.empty()) return tl::unexpected(impl_->error);
  if (auto ok = impl_->write_out(); !ok) return ok;
  const auto ok = guarded(impl_->path, "recording stopped", [&] {
    const Hdf5 hdf5;
    impl_->record.mark_complete(complete);
    check(H5Fflush(impl_->record.file, H5F_SCOPE_GLOBAL));
    impl_->record.close_on_disk();
    impl_->record = {};
  });
  if (ok)
    impl_->error = fmt::format("{}: the recording is finished", impl_->path.string());
  else
    impl_->fail(ok.error().message);
  return ok;
}

}  // namespace tribotwin::twin
