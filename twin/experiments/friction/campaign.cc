#include <algorithm>
#include <set>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/friction/axis.hpp>
#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/experiments/friction/series.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/robot/drive_change.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
constexpr Bounds positions{-1e4, 1e4};  // of joints: rad, or m of a sliding one

std::vector<double> start_of(Mapping& in, const mujoco::Model& model) {
  std::vector<double> start(model.drives().size(), 0.0);
  const YAML::Node node = in.raw("start_rad");
  if (!node) return start;
  if (node.IsSequence()) {
    start = in.numbers("start_rad", positions);
    if (start.size() != model.drives().size())
      in.fail("start_rad",
              fmt::format("has {} numbers, but the model has {} drives", start.size(), model.drives().size()));
    return start;
  }
  auto by_name = in.mapping("start_rad");
  for (const auto& joint : by_name->names())
    start[drive_index(model, *by_name, joint, joint)] = by_name->number(joint, positions);
  return start;
}

/// The arm with the drive of the campaign; resolves the model's path in `root`.
void read_arm(Mapping& in, const fs::path& file, YAML::Node root, Campaign& c) {
  drive::Configuration keys;
  if (auto drive = in.mapping("drive"))
    for (const auto& key : drive->names()) keys.emplace_back(key, drive->text(key));
  const fs::path model = in.file("model", fs::absolute(file).parent_path());
  root["model"] = model.string();
  const std::string joint = in.text("joint");
  const auto plain = mujoco::load_file(model);
  if (!plain) throw InputError(plain.error().message);
  c.drive = drive_index(**plain, in, "joint", joint);
  auto loaded = load_with_drive(model, joint, keys);
  if (!loaded) in.fail("drive", loaded.error().message);
  c.model = *loaded;
}

Sensors read_sensors(Mapping& in, Sensors s) {
  auto sensors = in.mapping("sensors");
  if (!sensors) return s;
  sensors->accept({"encoder_increments_per_turn", "torque_noise_nm", "sampling_hz", "lag_s"});
  s.encoder_increments_per_turn = sensors->number_or("encoder_increments_per_turn", 0, {0, 1e12});
  s.torque_noise_nm = sensors->number_or("torque_noise_nm", 0, {0, 1e9});
  s.sampling_hz = sensors->number_or("sampling_hz", s.sampling_hz, {20, 10000});
  s.lag_s = sensors->number_or("lag_s", 0, {0, 0.1});
  sensors->done();
  return s;
}

CascadedOptions read_servo(Mapping& in, CascadedOptions s) {
  auto servo = in.mapping("servo");
  if (!servo) return s;
  servo->accept({"position_gain_1_s", "speed_bandwidth_rad_s", "integral_time_s"});
  s.position_gain_1_s = servo->number_or("position_gain_1_s", s.position_gain_1_s, {0, 200});
  s.speed_bandwidth_rad_s = servo->number_or("speed_bandwidth_rad_s", s.speed_bandwidth_rad_s, {1, 400});
  s.integral_time_s = servo->number_or("integral_time_s", s.integral_time_s, {0.005, 10});
  servo->done();
  return s;
}

/// Fails where the test cycle leaves the joint's range.
void require_room_for_cycle(const Mapping& in, const Campaign& c, const std::vector<double>& start_rad) {
  const auto& binding = c.model->drives()[c.drive];
  const auto [low, high] = test_cycle_of(*c.model, c.drive, start_rad).reach_rad(c.drive);
  const mjModel* m = c.model->get();
  const double from = m->jnt_range[2 * binding.joint], to = m->jnt_range[2 * binding.joint + 1];
  if (m->jnt_limited[binding.joint] && !(low >= from && high <= to))
    in.fail("joint", fmt::format("the test cycle takes it to {:.4g} .. {:.4g} rad, but its range is {:.4g} .. {:.4g} "
                                 "rad",
                                 low, high, from, to));
}

/// Of the levels, arm side.
std::vector<double> read_speeds(Mapping& in, const Campaign& c, const std::vector<double>& start_rad) {
  if (c.procedure == Procedure::test_cycle) {
    if (in.has("speeds_rad_s")) in.fail("speeds_rad_s", "is for plus_minus; the test cycle has Zhou 2024's 15 speeds");
    require_room_for_cycle(in, c, start_rad);
    return test_cycle_speeds_rad_s();
  }
  std::vector<double> speeds = read_axis(in, "speeds_rad_s", {1e-6, 1e6}, false).values;
  if (speeds.size() > 1000)
    in.fail("speeds_rad_s", fmt::format("has {} speeds, at most 1000 are possible", speeds.size()));
  std::vector<double> sorted = speeds;
  std::ranges::sort(sorted);
  for (std::size_t i = 1; i < sorted.size(); ++i)
    if (sorted[i] < 1.05 * sorted[i - 1])
      in.fail("speeds_rad_s", fmt::format("{} and {} are too close to be separated; they must differ by 5 % at least",
                                          sorted[i - 1], sorted[i]));
  for (double& v : speeds) v /= c.model->drives()[c.drive].drive.gear_ratio;
  return speeds;
}

}  // namespace

Result<YAML::Node> campaign_tree(const fs::path& file, const std::vector<std::string>& overrides) try {
  YAML::Node root = load_yaml(file);
  for (const auto& assignment : overrides)
    apply_setting(root, assignment, "--set seed=7 or --set series.0.load.norm=0.3");
  return root;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<Campaign> load_campaign(const fs::path& file, const std::vector<std::string>& overrides) {
  auto tree = campaign_tree(file, overrides);
  if (!tree) return tl::unexpected(tree.error());
  return campaign_of(file, *tree);
}

Result<Campaign> campaign_of(const fs::path& file, YAML::Node root) try {
  Campaign c;
  c.file = file;
  Mapping in(file.string(), "", root);
  in.accept({"name", "description", "model", "joint", "procedure", "speeds_rad_s", "seed", "start_rad", "sensors",
             "level_noise_nm", "servo", "drive", "series"});
  c.name = in.file_name_or("name", file.stem().string());
  root["name"] = c.name;
  c.description = in.text_or("description", "");
  c.seed = in.whole_or("seed", 1, {0, 9007199254740992.0});
  c.level_noise_nm = in.number_or("level_noise_nm", 0, {0, 1e9});
  c.procedure = in.choice("procedure", {"plus_minus", "test_cycle"}) == "plus_minus" ? Procedure::plus_minus
                                                                                     : Procedure::test_cycle;
  read_arm(in, file, root, c);
  Measurement basis;
  basis.start_rad = start_of(in, *c.model);
  basis.sensors = read_sensors(in, basis.sensors);
  basis.servo = read_servo(in, basis.servo);
  basis.speeds_rad_s = read_speeds(in, c, basis.start_rad);
  std::set<std::string> names;
  const auto series = in.mappings("series");
  if (series.empty()) in.fail("series", "is missing: a list of {name, load, temperature}");
  for (std::size_t i = 0; i < series.size(); ++i) add_series(c, basis, names, i, series[i]);
  in.done();
  c.resolved_yaml = resolved_yaml(*c.model, root);
  return c;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin
