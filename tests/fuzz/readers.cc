// Readers of scenarios, parameters, recordings and of the bus, for harness.cc.
#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>

#include <fmt/format.h>

#include <tribotwin/hil/can/socketcand_protocol.hpp>
#include <tribotwin/hil/can/words.hpp>
#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
#include <tribotwin/hil/canopen/setup/store_file.hpp>
#include <tribotwin/hil/faults/faults.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/hil/shadow/dbc_file.hpp>
#include <tribotwin/tests/fuzz/reader.hpp>
#include <tribotwin/twin/commands/calibrate/campaign.hpp>
#include <tribotwin/twin/commands/calibrate/results.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/diagnosis/fleet/reader.hpp>
#include <tribotwin/twin/diagnosis/fleet/store.hpp>
#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/diagnosis/observation.hpp>
#include <tribotwin/twin/experiments/fault_study/study.hpp>
#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/experiments/sweep/plan.hpp>
#include <tribotwin/twin/experiments/sweep/results.hpp>
#include <tribotwin/twin/experiments/working_days/campaign.hpp>
#include <tribotwin/twin/gears/foreign_model.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/robot/recording.hpp>
#include <tribotwin/twin/simulation/event.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::fuzz {
namespace {

using namespace tribotwin::twin;

const program::Robot& robot() {
  static const program::Robot once = program::load_robot("er3a_c60");
  return once;
}

std::string content(const Path& file) { return or_fail(read_bytes(file)); }

void read_session(const Path& file) {
  auto session = hil::SessionReader::open(file);
  if (!session) return end(session);
  hil::Turn turn;
  Result<bool> more = true;
  while (more && *more) more = session->next(turn);
  end(more);
}

/// An event of a session as a replay reads it.
void read_event_text(const Path& file) {
  const std::string text = content(file);
  const YAML::Node event = parse_yaml(text, "an event");
  const std::string type = Mapping("an event", "", event).text("type");
  (void)read_event(Mapping(type, "", event), *robot().model, 3600);
  ++read_whole;
}

void read_socketcand(const Path& file) {
  const std::string text = content(file);
  const auto parts = hil::words(text);
  const auto sent = hil::socketcand::parse_send(parts);
  const auto received = hil::socketcand::parse_frame(parts);
  if (sent) require(hil::socketcand::send_command(*sent).size() < 200, "a frame that is too long");
  ++(sent || received ? read_whole : refused);
}

/// With the checksum that it should have: random bytes have none.
void read_store(const Path& file) {
  const std::string text = content(file), body = text.substr(0, text.rfind("checksum = "));
  end(hil::StoreFile::parse(fmt::format("{}checksum = {:08X}\n", body, crc32(body)), file));
}

/// All that a fleet's commands read of its store.
void read_fleet_store(const Path& file) {
  constexpr std::int64_t ever = std::numeric_limits<std::int64_t>::max();
  (void)content(file);
  diagnosis::fleet::Store store(file.string());
  for (const auto& joint : store.joints())
    for (const bool learned : {false, true}) (void)store.rows(joint.id, learned, -ever, ever);
  for (const auto& model : store.model_texts()) (void)diagnosis::fleet::from_text(model, store.name());
  (void)store.newest(), (void)store.checks(), (void)store.files(-ever, ever), (void)store.notes(-ever, ever);
  ++read_whole;
}

void read_fleet_data(const Path& file) {
  const auto curves = diagnosis::fleet::open_curves(file, {});
  if (!curves) return end(curves);
  diagnosis::fleet::LevelCurve curve;
  Result<bool> more = true;
  while (more && *more) more = (*curves)->next(curve);
  end(more);
}

/// As if it were of this FIT: the part that says so is long, and differs from folder to folder.
void read_calibrated(const Path& file) {
  static const program::CalibrationCampaign campaign = [&] {
    const Path fit = file.parent_path() / "fit.yaml";
    std::filesystem::copy_file(Path(TRIBOTWIN_SOURCE_DIR) / "tests/fuzz/corpus/fit/xl330_fit.yaml", fit,
                               std::filesystem::copy_options::overwrite_existing);
    return program::read_calibration(fit, {}, {});
  }();
  nlohmann::json json = parse_json(content(file));
  if (json.is_object()) json.erase("crc32"), json["fit"] = campaign.resolved;
  or_fail(write_unforced(file, json.is_discarded() ? "" : dump_json(json)));
  (void)program::read_fits(campaign, file);
  ++read_whole;
}

void read_run_of_sweep(const Path& file) { ++(sweep::from_line(0, content(file)) ? read_whole : refused); }

const std::array all{
    Reader{"scenario", ".yaml", [](const Path& f) { end(load_scenario(f)); }},
    Reader{"plan", ".yaml", [](const Path& f) { end(sweep::load_plan(f)); }},
    Reader{"campaign", ".yaml", [](const Path& f) { end(load_campaign(f)); }},
    Reader{"days", ".yaml", [](const Path& f) { end(repeatability::load_campaign(f, load_yaml(f))); }},
    Reader{"study", ".yaml", [](const Path& f) { end(study::load_study(f, load_yaml(f))); }},
    Reader{"fit", ".yaml", [](const Path& f) { program::read_calibration(f, {}, {}), ++read_whole; }},
    Reader{"faults", ".yaml", [](const Path& f) { end(hil::load_faults(f, 1, 6)); }},
    Reader{"parameters", ".yaml", [](const Path& f) { end(identification::read_parameters(f)); }},
    Reader{"friction", ".yaml", [](const Path& f) { end(identification::read_friction(f)); }},
    Reader{"dynamics", ".yaml",
           [](const Path& f) { end(identification::read_dynamics(f, robot().regressor, robot().base)); }},
    Reader{"thermal", ".yaml", [](const Path& f) { end(identification::read_thermal(f)); }},
    Reader{"thermal_chain", ".yaml", [](const Path& f) { end(identification::read_thermal_chain(f)); }},
    Reader{"healthy", ".yaml", [](const Path& f) { end(diagnosis::read_healthy(f)); }},
    Reader{"curves", ".csv",
           [](const Path& f) { end(identification::read_samples(std::array{f}, *friction::find_law("load"), {})); }},
    Reader{"observations", ".csv", [](const Path& f) { end(diagnosis::read_observations(f, {})); }},
    Reader{"recording", ".csv", [](const Path& f) { end(identification::read_robot_recording(f, robot().regressor)); }},
    Reader{"set_points", ".csv", [](const Path& f) { end(read_set_points(f)); }},
    Reader{"bam", ".json", [](const Path& f) { end(read_set_points(f)); }},
    Reader{"urdf", ".urdf", [](const Path& f) { end(read_foreign_model(f)); }},
    Reader{"eds", ".eds", [](const Path& f) { end(hil::read_eds_file(f)); }},
    Reader{"dbc", ".dbc", [](const Path& f) { end(hil::read_dbc(f)); }},
    Reader{"session", ".session", read_session},
    Reader{"event", ".yaml", read_event_text},
    Reader{"model", ".json", [](const Path& f) { diagnosis::fleet::from_text(content(f), f.string()), ++read_whole; }},
    Reader{"store", ".store", read_store},
    Reader{"fleet_store", ".db", read_fleet_store},
    Reader{"fleet_data", ".csv", read_fleet_data},
    Reader{"calibration", ".json", read_calibrated},
    Reader{"sweep_run", ".json", read_run_of_sweep},
    Reader{"socketcand", ".txt", read_socketcand},
};

}  // namespace

std::span<const Reader> readers() { return all; }

}  // namespace tribotwin::fuzz
