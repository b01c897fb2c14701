#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <fnmatch.h>
#include <glob.h>

#include <tribotwin/twin/commands/calibrate/campaign.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using namespace identification;

std::vector<fs::path> files_of_pattern(const std::string& pattern) {
  std::vector<fs::path> files;
  ::glob_t found{};
  if (::glob(pattern.c_str(), GLOB_ERR, nullptr, &found) == 0)
    files.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  ::globfree(&found);
  return files;
}

std::vector<fs::path> matching(Mapping& in, const std::string& key, const fs::path& folder) {
  const YAML::Node node = in.raw(key);
  if (!node) in.fail(key, "is missing: a file, a pattern such as runs/*.json, or a list of them");
  std::vector<std::string> patterns;
  if (node.IsScalar())
    patterns.push_back(in.text(key));
  else if (node.IsSequence())
    patterns = in.texts(key);
  std::vector<fs::path> files;
  for (const auto& pattern : patterns) {
    const std::string full = (folder / pattern).lexically_normal().string();
    const auto found = files_of_pattern(full);
    if (found.empty()) in.fail(key, fmt::format("'{}' matches no file", full));
    for (const auto& file : found)
      if (std::ranges::find(files, file) == files.end()) files.push_back(file);
  }
  if (files.empty()) in.fail(key, "names no file");
  return files;
}

bool matches(const std::string& pattern, const fs::path& file) {
  return ::fnmatch(pattern.c_str(), file.filename().c_str(), 0) == 0;
}

/// The texts and numbers at the top level of a recording in JSON; tables have none.
std::map<std::string, std::string> labels_of(const fs::path& file) {
  std::map<std::string, std::string> labels;
  if (file.extension() != ".json") return labels;
  const auto json = parse_json(or_throw(read_text(file, "a recording")));
  if (!json.is_object()) return labels;
  for (const auto& [key, value] : json.items()) {
    if (value.is_string()) labels[key] = value.get<std::string>();
    if (value.is_number()) labels[key] = fmt::format("{:g}", value.get<double>());
  }
  return labels;
}

/// What the head of a recording says about bench and controller is applied, or refused where nothing here has it.
/// Other numbers are labels.
void read_head(Recording& r, const Mapping& in) {
  for (const auto& number : r.points.numbers) {
    const std::string& key = number.first;
    const double value = number.second;
    const auto refuse = [&](const char* why) {
      in.fail("files", fmt::format("{}: {} is {:g}, but {}", r.file.string(), key, value, why));
    };
    const bool lever = key == "mass" || key == "length";
    if (lever && !(value > 0)) refuse("it must be above 0");
    if (lever) (key == "mass" ? r.bench.mass_kg : r.bench.length_m) = value;
    if ((key == "ki" || key == "kd") && value != 0) refuse("no controller here has such a gain; leave the file out");
    if (key == "offset" && value != 0) refuse("it is not applied; set it to 0 and give joint.ref");
  }
}

/// Of set points that are held, those that the run's recording or constant torques did not have.
void drop_what_was_not_commanded(const Scenario& scenario, SetPoints& p) {
  const bool torques = std::holds_alternative<std::vector<double>>(scenario.control);
  const auto& recorded = scenario.recording;
  if (torques || (recorded && recorded->position_rad.empty())) p.position_rad.clear();
  if (torques || (recorded && recorded->command_rad_s.empty())) p.command_rad_s.clear();
  if (!torques && recorded && recorded->command_nm.empty()) p.command_nm.clear();
}

/// The record of a run has positions, but no set points: those are in the scenario beside it.
void add_set_points_of_run(Recording& r, const Mapping& in) {
  const auto record = record_of(r.file);
  if (!record || !r.points.measured_rad.empty()) return;
  r.scenario = record->parent_path() / "scenario.yaml";
  const auto scenario = load_scenario(r.scenario);
  if (!scenario)
    in.fail("files", fmt::format("{} has no set points, and they are not known from the scenario of its "
                                 "run either: {}",
                                 record->string(), scenario.error().message));
  if (!scenario->motion || !scenario->events.empty())
    in.fail("files", fmt::format("{}: a run to calibrate on needs a motion and has no events", r.scenario.string()));
  SetPoints& p = r.points;
  p.measured_rad = std::move(p.position_rad);
  p.position_rad.assign(p.joints.size(), std::vector(p.time_s.size(), 0.0));
  p.velocity_rad_s = p.position_rad;
  p.torque_on.assign(p.time_s.size(), true);
  p.temperature_degC.clear();
  const auto* torques = std::get_if<std::vector<double>>(&scenario->control);
  const bool held = torques || (scenario->recording && scenario->recording->velocity_rad_s.empty());
  if (held) p.command_rad_s = p.command_nm = p.position_rad;
  std::vector<SetPoint> at(scenario->model->drives().size());
  bool moves = false;
  for (std::size_t k = 0; k < p.joints.size(); ++k) {
    const auto drive = find_drive(*scenario->model, p.joints[k]);
    if (!drive) in.fail("files", drive.error().message);
    p.temperature_degC.emplace_back(p.time_s.size(), scenario->temperature_degC[*drive]);
    for (std::size_t i = 0; i < p.time_s.size(); ++i) {
      scenario->motion->at(p.time_s[i], at);
      p.position_rad[k][i] = at[*drive].position_rad;
      moves |= (p.velocity_rad_s[k][i] = at[*drive].velocity_rad_s) != 0;
      if (!held) continue;
      p.command_rad_s[k][i] = at[*drive].velocity_rad_s;
      p.command_nm[k][i] = torques ? (*torques)[*drive] : at[*drive].torque_nm;
    }
  }
  if (!moves || held) p.velocity_rad_s.clear();  // set points that are held from row to row
  drop_what_was_not_commanded(*scenario, p);
}

Recording read_recording(const fs::path& file, const Mapping& in, const TableOptions& tables) {
  Recording r{.file = file, .points = or_wrong_input(read_set_points(file, tables)), .labels = labels_of(file)};
  add_set_points_of_run(r, in);
  const SetPoints& points = r.points;
  for (const auto& text : points.notes) note("{}", text);
  if (points.measured_rad.empty())
    in.fail("files", fmt::format("{} has no measured positions; needed is JSON with entries of timestamp, "
                                 "goal_position and position, or a table with time_s and, of each joint, "
                                 "set_point_JOINT_rad (_rad_s, _nm) and position_JOINT_rad",
                                 file.string()));
  for (const auto& measured_rad : points.measured_rad) {
    const auto measured = std::ranges::count_if(measured_rad, [](double q) { return std::isfinite(q); });
    if (measured < 10 || !std::isfinite(measured_rad[0]))
      in.fail("files", fmt::format("{} has {} measured positions; at least 10 are needed, among them that of the first "
                                   "entry",
                                   file.string(), measured));
  }
  read_head(r, in);
  return r;
}

/// The settings of the controller and of the bench for the recordings that are meant.
void read_numbers(Mapping& in, const std::vector<Recording*>& meant, const friction::LawInfo& law) {
  for (const auto key : keys_of(Place::control, law)) {
    const std::string text(key);
    if (!in.has(text)) continue;
    const auto [minimum, maximum] = accepted_range(Place::control, law, key);
    const double value = in.number(text, {minimum, maximum});
    for (Recording* r : meant) r->control.emplace_back(text, value);
  }
  if (in.has("temperature_degC"))
    for (Recording* r : meant) r->temperature_degC = in.number("temperature_degC", {-100, 300});
  if (in.has("mass"))
    for (Recording* r : meant) r->bench.mass_kg = in.number("mass", {1e-9, 1e9});
  if (in.has("length"))
    for (Recording* r : meant) r->bench.length_m = in.number("length", {1e-9, 1e4});
  auto payload = in.mapping("payload");
  if (!payload) return;
  payload->accept({"mass_kg", "com_m"});
  Payload carried{.mass_kg = payload->number("mass_kg", {0, 1e9})};
  if (payload->has("com_m")) {
    const auto com_m = payload->numbers("com_m", {-1e4, 1e4});
    if (com_m.size() != 3) payload->fail("com_m", "must be three numbers, from the flange");
    std::ranges::copy(com_m, carried.com_m.begin());
  }
  payload->done();
  for (Recording* r : meant) r->bench.payload = carried;
}

/// One entry of `settings`: what holds for the recordings that its pattern matches.
void read_settings(Mapping in, std::vector<Recording>& recordings, const friction::LawInfo& law) {
  auto accepted = keys_of(Place::control, law);
  for (const char* key : {"files", "temperature_degC", "mass", "length", "payload", "labels"})
    accepted.emplace_back(key);
  in.accept(accepted);
  const std::string pattern = in.text("files");
  std::vector<Recording*> meant;
  for (auto& r : recordings)
    if (matches(pattern, r.file)) meant.push_back(&r);
  if (meant.empty())
    in.fail("files", fmt::format("'{}' matches none of the recordings, of which the first is {}", pattern,
                                 recordings[0].file.filename().string()));
  read_numbers(in, meant, law);
  if (auto labels = in.mapping("labels"))
    for (const auto& label : labels->names())
      for (Recording* r : meant) r->labels[label] = labels->text(label);
  in.done();
}

/// `by LABEL`: one fold per value of the label, in the order of the recordings.
Split split_by_label(Mapping& in, const std::vector<Recording>& recordings) {
  const std::string text = in.text("folds"), prefix = "by ";
  if (!text.starts_with(prefix))
    in.fail("folds", fmt::format("is '{}' but must be 'by LABEL', such as by trajectory or by gain, or a list of lists "
                                 "of files",
                                 text));
  const std::string label = text.substr(prefix.size());
  Split split;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    const auto& labels = recordings[i].labels;
    const auto found = labels.find(label);
    if (found == labels.end()) {
      std::vector<std::string> known;
      for (const auto& [name, value] : labels) known.push_back(name);
      in.fail("folds",
              fmt::format("'{}': {} has no label '{}'; it has {}", text, recordings[i].file.filename().string(), label,
                          known.empty() ? "none" : joined(known)));
    }
    auto fold = std::ranges::find(split.folds, found->second, &Split::Fold::label);
    if (fold == split.folds.end()) fold = split.folds.insert(fold, {found->second, {}});
    fold->held_out.push_back(i);
  }
  if (split.folds.size() == 1 && recordings.size() > 1)
    in.fail("folds", fmt::format("'{}': every recording has {} {}, so that a fold would leave none to learn from; "
                                 "needed are at least two values",
                                 text, label, split.folds[0].label));
  split.name = in.text_or("name", label);
  return split;
}

void hold_out(Split::Fold& fold, const std::string& pattern, Mapping& in, const std::vector<Recording>& recordings) {
  bool any = false;
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    if (!matches(pattern, recordings[i].file)) continue;
    any = true;
    if (std::ranges::find(fold.held_out, i) == fold.held_out.end()) fold.held_out.push_back(i);
  }
  if (!any)
    in.fail("folds", fmt::format("'{}' matches none of the recordings, of which the first is {}", pattern,
                                 recordings[0].file.filename().string()));
}

/// A list of folds, each a pattern or a list of patterns.
Split split_by_files(Mapping& in, const YAML::Node& folds, const std::vector<Recording>& recordings) {
  Split split;
  for (const auto& fold : folds) {
    auto& made = split.folds.emplace_back();
    made.label = fmt::format("{}", split.folds.size());
    std::vector<std::string> patterns;
    if (fold.IsScalar()) patterns.push_back(fold.Scalar());
    for (const auto& item : fold) patterns.push_back(item.IsScalar() ? item.Scalar() : "");
    if (patterns.empty()) in.fail("folds", fmt::format("fold {} names no file", made.label));
    for (const auto& pattern : patterns) hold_out(made, pattern, in, recordings);
  }
  split.name = in.text_or("name", "files");
  return split;
}

}  // namespace

std::vector<Recording> read_recordings(Mapping in, const fs::path& folder, const friction::LawInfo& law,
                                       const TableOptions& tables) {
  in.accept({"files", "settings"});
  std::vector<Recording> recordings;
  const auto files = matching(in, "files", folder);
  if (const auto why = given_twice(files)) in.fail("files", *why);
  for (const auto& file : files) recordings.push_back(read_recording(file, in, tables));
  for (const Mapping& settings : in.mappings("settings")) read_settings(settings, recordings, law);
  for (auto& r : recordings) {
    for (const auto& [key, value] : r.control)
      if (key == "kp") r.labels["kp"] = fmt::format("{:g}", value);
    if (r.labels.contains("kp")) r.labels["gain"] = r.labels["kp"];
    if (r.bench.mass_kg) r.labels["mass"] = fmt::format("{:g}", *r.bench.mass_kg);
    if (r.bench.length_m) r.labels["length"] = fmt::format("{:g}", *r.bench.length_m);
  }
  in.done();
  return recordings;
}

Split read_split(Mapping in, const std::vector<Recording>& recordings) {
  in.accept({"name", "folds"});
  const YAML::Node folds = in.raw("folds");
  if (!folds || !(folds.IsScalar() || folds.IsSequence()))
    in.fail("folds", "must be 'by LABEL', such as by trajectory or by gain, or a list of lists of files");
  Split split = folds.IsScalar() ? split_by_label(in, recordings) : split_by_files(in, folds, recordings);
  for (const auto& fold : split.folds)
    if (fold.held_out.size() == recordings.size())
      in.fail("folds", fmt::format("fold '{}' holds out all {} recordings and leaves none to learn from", fold.label,
                                   recordings.size()));
  in.done();
  return split;
}

}  // namespace tribotwin::twin::program
