#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string_view>

#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin {

/// Rows as an MCAP file while they come: what export_mcap makes of a telemetry.h5 with these options, of a run that has
/// not ended. One thread at a time.
class McapRows {
 public:
  /// `sink` takes the bytes of the file in their order.
  McapRows(std::function<Result<void>(std::string_view)> sink, const TelemetryOptions& options, McapMessages messages);
  McapRows(McapRows&&) noexcept;
  ~McapRows();

  /// One sample: joints x channels values, joint by joint. Fails where the sink does, and where no stamp can hold the
  /// time.
  Result<void> write(double time_s, std::span<const double> row);
  /// The rest of the file; nothing may follow.
  Result<void> finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tribotwin::twin
