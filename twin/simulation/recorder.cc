#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/telemetry/run_folder.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/simulation/recorder.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// What follows once the folder is the run's own fails by the machine, not by the user.
Error as_work(const Error& error) { return {error.message, ErrorKind::work}; }
tl::unexpected<Error> not_recorded(const Error& error) { return tl::make_unexpected(as_work(error)); }

}  // namespace

struct Recorder::Impl {
  RunFolder folder;
  fs::path directory;
  std::unique_ptr<Telemetry> telemetry;
  std::int64_t every = 1;
  double timestep_s = 0;
  std::vector<double> row, cycle_row;
};

Recorder::Recorder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Recorder::~Recorder() = default;

Result<std::unique_ptr<Recorder>> Recorder::create(const fs::path& directory, const Scenario& scenario, bool cycles,
                                                   Existing existing) {
  auto impl = std::make_unique<Impl>();
  impl->timestep_s = scenario.model->get()->opt.timestep;
  impl->every = std::max<std::int64_t>(1, std::llround(1 / (scenario.telemetry_rate_hz * impl->timestep_s)));
  if (auto ok = impl->folder.open(directory, existing); !ok) return tl::unexpected(ok.error());
  impl->directory = directory;
  TelemetryOptions o{.attributes = {{"engine", "MuJoCo"},
                                    {"engine_version", mj_versionString()},
                                    {"scenario", scenario.name},
                                    {"seed", std::to_string(scenario.seed)},
                                    {"timestep_s", fmt::format("{}", impl->timestep_s)}},
                     .channels = channels(*scenario.model),
                     .cycle_channels = cycles ? cycle_channels() : std::vector<Channel>{}};
  for (const auto& drive : scenario.model->drives()) {
    o.joints.push_back(joint_name(scenario.model->get(), drive));
    o.joint_attributes.push_back(
        {{"gear_ratio", drive.drive.gear_ratio}, {"torque_max_nm", drive.drive.torque_max_nm}});
  }
  impl->row.resize(o.joints.size() * o.channels.size());
  auto telemetry = Telemetry::create(directory / "telemetry.h5", std::move(o));
  if (!telemetry) return not_recorded(telemetry.error());
  impl->telemetry = std::make_unique<Telemetry>(std::move(*telemetry));
  if (auto ok = write_file(directory / "scenario.yaml", scenario.resolved_yaml, Existing::refuse); !ok) {
    std::error_code ignored;
    fs::remove(directory / "telemetry.h5", ignored);  // nothing was recorded
    return not_recorded(ok.error());
  }
  impl->folder.keep_both();
  return std::unique_ptr<Recorder>(new Recorder(std::move(impl)));
}

Result<void> Recorder::sample(const Twin& twin, std::int64_t step) {
  if (step % impl_->every != 0) return {};
  read_channels(twin, impl_->row);
  return impl_->telemetry->append(static_cast<double>(step) * impl_->timestep_s, impl_->row).map_error(as_work);
}

Result<void> Recorder::append_cycle(double time_s, std::span<const CycleSample> drives) {
  impl_->cycle_row.clear();
  for (const CycleSample& drive : drives) add_channels(drive, impl_->cycle_row);
  return impl_->telemetry->append_cycle(time_s, impl_->cycle_row).map_error(as_work);
}

Result<void> Recorder::finish(const Summary& summary) {
  if (auto ok = impl_->telemetry->finish(!summary.interrupted); !ok) return not_recorded(ok.error());
  if (auto ok = write_file(impl_->directory / "summary.json", summary_json(summary), Existing::refuse); !ok)
    return not_recorded(ok.error());
  if (!summary.interrupted) impl_->folder.commit();
  return {};
}

const fs::path& Recorder::replaced() const { return impl_->folder.aside(); }

}  // namespace tribotwin::twin
