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

/// A large record that does not fit is refused before anything is written; a small one grows until the disk is full.
Result<void> check_space(const fs::path& directory, const Scenario& scenario) {
  constexpr double large_bytes = 100e6;
  const double bytes = predicted_bytes(scenario);
  if (bytes <= large_bytes) return {};
  fs::path there = fs::absolute(directory);
  std::error_code error;
  while (!fs::exists(there, error) && there != there.parent_path()) there = there.parent_path();
  const fs::space_info space = fs::space(there, error);
  if (error || static_cast<double>(space.available) >= bytes) return {};
  return work_failed(fmt::format(
      "{}: telemetry.h5 would take {:.3g} MB, but the disk has {:.3g} MB left (No space left on device); lower "
      "telemetry_rate_hz ({:g}) or duration_s, or use multirate where the motion repeats",
      directory.string(), bytes / 1e6, static_cast<double>(space.available) / 1e6, scenario.telemetry_rate_hz));
}

}  // namespace

std::int64_t steps_per_sample(const Scenario& scenario) {
  const double timestep_s = scenario.model->get()->opt.timestep;
  return std::max<std::int64_t>(1, std::llround(1 / (scenario.telemetry_rate_hz * timestep_s)));
}

double predicted_bytes(const Scenario& scenario) {
  constexpr double checked = 1.003;  // checksums and the index of the chunks
  const double step_s = scenario.model->get()->opt.timestep, drives = static_cast<double>(scenario.start_rad.size()),
               period_s = scenario.motion ? scenario.motion->period_s() : 0;
  double values = 0;
  if (period_s > 0)
    values += scenario.duration_s / period_s * (1 + drives * static_cast<double>(cycle_channels().size()));
  if (!scenario.multirate.enabled)
    values += scenario.duration_s / (static_cast<double>(steps_per_sample(scenario)) * step_s) *
              (1 + drives * static_cast<double>(channels(*scenario.model).size()));
  return checked * sizeof(double) * values;
}

TelemetryOptions telemetry_options(const Scenario& scenario) {
  const mujoco::Model& model = *scenario.model;
  TelemetryOptions o{.attributes = {{"engine", "MuJoCo"},
                                    {"engine_version", mj_versionString()},
                                    {"scenario", scenario.name},
                                    {"seed", std::to_string(scenario.seed)},
                                    {"timestep_s", fmt::format("{}", model.get()->opt.timestep)}},
                     .channels = channels(model)};
  for (const auto& drive : model.drives()) {
    o.joints.push_back(joint_name(model.get(), drive));
    o.units.push_back(units(model, drive));
    o.joint_attributes.push_back(
        {{"gear_ratio", drive.drive.gear_ratio}, {"torque_max_nm", drive.drive.torque_max_nm}});
  }
  return o;
}

struct Recorder::Impl {
  RunFolder folder;
  fs::path directory;
  std::unique_ptr<Telemetry> telemetry;
  std::int64_t every = 1;
  double timestep_s = 0;
  std::string scenario;  // the text of scenario.yaml
  std::vector<double> row, cycle_row;
};

Recorder::Recorder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Recorder::~Recorder() = default;

Result<std::unique_ptr<Recorder>> Recorder::create(const fs::path& directory, const Scenario& scenario, bool cycles,
                                                   Existing existing) {
  auto impl = std::make_unique<Impl>();
  impl->timestep_s = scenario.model->get()->opt.timestep;
  impl->every = steps_per_sample(scenario);
  if (auto ok = check_space(directory, scenario); !ok) return tl::unexpected(ok.error());
  if (auto ok = impl->folder.open(directory, existing); !ok) return tl::unexpected(ok.error());
  impl->directory = directory;
  impl->scenario = scenario.resolved_yaml;
  TelemetryOptions o = telemetry_options(scenario);
  if (cycles) o.cycle_channels = cycle_channels();
  impl->row.resize(o.joints.size() * o.channels.size());
  auto telemetry = Telemetry::create(directory / "telemetry.h5", std::move(o));
  if (!telemetry) return not_recorded(telemetry.error());
  impl->telemetry = std::make_unique<Telemetry>(std::move(*telemetry));
  if (auto ok = write_file(directory / "scenario.yaml", impl->scenario, Existing::refuse); !ok) {
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

Result<void> Recorder::add_event(const YAML::Node& event) {
  std::string scenario = with_event(impl_->scenario, event);
  if (auto ok = write_file(impl_->directory / "scenario.yaml", scenario, Existing::replace); !ok)
    return not_recorded(ok.error());
  impl_->scenario = std::move(scenario);
  return {};
}

Result<void> Recorder::finish(const Summary& summary) {
  if (auto ok = impl_->telemetry->finish(!summary.interrupted); !ok) return not_recorded(ok.error());
  if (auto ok = write_file(impl_->directory / "summary.json", summary_json(summary), Existing::refuse); !ok)
    return not_recorded(ok.error());
  if (!summary.interrupted) impl_->folder.commit();
  return {};
}

const fs::path& Recorder::replaced() const { return impl_->folder.aside(); }

void happen(Twin& twin, Recorder* recorder, YAML::Node node, double duration_s) {
  const std::string type = Mapping("an event", "", node).text("type");
  node["time_s"] = twin.time_s();
  Event event = read_event(Mapping(type, "", node), *twin.scenario().model, duration_s);
  if (recorder) or_throw(recorder->add_event(node));
  twin.happen(std::move(event));
}

}  // namespace tribotwin::twin
