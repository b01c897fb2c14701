#include <fmt/format.h>

#include <tribotwin/twin/io/tables/source.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin::tables {
namespace {

/// The samples of a run: time_s and JOINT.CHANNEL, as in telemetry.csv.
class RecordSource final : public ArraySource {
 public:
  explicit RecordSource(Recording recording) : recording_(std::move(recording)) {
    headers_.emplace_back("time_s");
    for (const auto& joint : recording_.joints)
      for (const auto& channel : recording_.channels) headers_.push_back(fmt::format("{}.{}", joint, channel.name));
  }
  const std::vector<std::string>& headers() const override { return headers_; }

 private:
  Result<std::vector<double>> column(std::size_t header) override {
    if (header == 0) return recording_.time_s;
    const std::size_t channels = recording_.channels.size();
    return recording_.values[(header - 1) / channels][(header - 1) % channels];
  }

  Recording recording_;
  std::vector<std::string> headers_;
};

}  // namespace

Opened open_record(const std::filesystem::path& file) {
  auto recording = read_telemetry(file);
  if (!recording) return tl::unexpected(recording.error());
  return std::make_unique<RecordSource>(std::move(*recording));
}

}  // namespace tribotwin::twin::tables
