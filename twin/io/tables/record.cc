#include <fmt/format.h>

#include <tribotwin/twin/io/tables/source.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin::tables {
namespace {

/// The samples of a run: time_s and JOINT.COLUMN, as in telemetry.csv.
class RecordSource final : public ArraySource {
 public:
  explicit RecordSource(Recording recording) : recording_(std::move(recording)) {
    headers_.emplace_back("time_s");
    for (std::size_t j = 0; j < recording_.joints.size(); ++j)
      for (std::size_t c = 0; c < recording_.channels.size(); ++c)
        headers_.push_back(fmt::format("{}.{}", recording_.joints[j],
                                       column_name(recording_.channels[c].name, recording_.units[j][c])));
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
