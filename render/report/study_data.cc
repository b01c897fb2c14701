#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/report/study_data.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/json_input.hpp>
#include <tribotwin/twin/io/tables/table.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using twin::InputError, twin::JsonInput, twin::or_wrong_input;
using namespace twin::diagnosis;

constexpr double most_curves = 1e9;

void read(StudyObservation& o, const JsonInput& in, const StudyJoint& joint) {
  const double curve = in["curve"].number();
  const bool counts = curve >= 1 && curve <= most_curves && curve == std::floor(curve);
  const auto found = counts ? joint.curves.find(static_cast<std::size_t>(curve)) : joint.curves.end();
  if (found == joint.curves.end()) in["curve"].fail(fmt::format("{}/curves.csv has no curve {}", joint.name, curve));
  o.curve = found->first;
  o.temperature_degC = in["temperature_degC"].number();
  for (std::size_t i = 0; i < feature_names.size(); ++i)
    o.features(static_cast<Eigen::Index>(i)) = in["features"][feature_names[i]].number();
}

StudyVerdict verdict_of(const JsonInput& in, const StudyJoint& joint) {
  StudyVerdict v;
  read(v, in, joint);
  v.load_kg = in["load_kg"].number();
  v.state = in["state"].text();
  v.pattern = in["pattern"].text();
  if (in.has("faults"))
    for (const JsonInput& fault : in["faults"].list(0)) v.faults.push_back(fault.text());
  else if (drive::find_fault(v.state))  // of an older version
    v.faults = {v.state};
  v.anomalous = in["anomalous"].truth();
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const JsonInput region = in[regions[r].name];
    v.region[r] = {.distance = region["distance"].number(),
                   .statistic = region["statistic"].number(),
                   .limit = region["limit"].number(),
                   .anomalous = region["anomalous"].truth()};
  }
  return v;
}

twin::study::Power power_of(const JsonInput& in) {
  twin::study::Power power{.fault = drive::find_fault(in["fault"].text()),
                           .detection_limit = in["detection_limit"].number(),
                           .named = {},
                           .roc = {}};
  if (!power.fault) in["fault"].fail("is no fault of the twin");
  for (const auto& [name, share] : in["named_at_twice_the_limit"].entries())
    power.named[name] = std::min(1.0, share.number());
  for (const JsonInput& point : in["roc"].list(1))
    power.roc.push_back(
        {point["severity"].number(), point["false_alarm"].number({0, 1}), point["detected"].number({0, 1})});
  return power;
}

std::map<std::size_t, StudyCurve> curves_of(const fs::path& file) {
  const twin::Table table = or_wrong_input(twin::read_table(file));
  const auto series = std::ranges::find(table.names, "series") - table.names.begin();
  const auto numbers = or_wrong_input(table.numbers("curve")), speed = or_wrong_input(table.numbers("speed_rad_s")),
             friction = or_wrong_input(table.numbers("friction_nm"));
  if (!table.has("series")) throw InputError(fmt::format("{}: has no column 'series'", file.string()));
  std::map<std::size_t, StudyCurve> curves;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    if (!(numbers[i] >= 1 && numbers[i] <= most_curves))
      throw InputError(fmt::format("{}curve: is {} but curves are counted from 1", table.where(i), numbers[i]));
    StudyCurve& curve = curves[static_cast<std::size_t>(numbers[i])];
    curve.series = table.rows[i][static_cast<std::size_t>(series)];
    curve.speed_rad_s.push_back(speed[i]);
    curve.friction_nm.push_back(friction[i]);
  }
  return curves;
}

}  // namespace

bool StudyVerdict::is_named() const { return std::ranges::count(faults, pattern) > 0; }

std::string StudyVerdict::name() const { return fmt::format("{:g} kg, {}", load_kg, state); }

Result<std::vector<StudyJoint>> load_study_folder(const fs::path& directory) try {
  const fs::path file = directory / "diagnosis.json";
  const auto text = twin::read_text(file, "a file");
  if (!text)
    return tl::unexpected(fmt::format(
        "{}: cannot be read; 'tribotwin lab' writes it at the end of a study, such as br609_diagnosis", file.string()));
  const json root = twin::parse_json(*text);
  if (root.is_discarded())
    return tl::unexpected(fmt::format("{}: is no JSON; 'tribotwin lab' writes it again", file.string()));
  std::vector<StudyJoint> joints;
  for (const auto& [name, in] : JsonInput(root, file.string()).entries()) {
    if (const auto why = twin::unfit_file_name(name)) in.fail(*why);  // the folder of its curves
    StudyJoint joint{
        .name = name, .curves = curves_of(directory / name / "curves.csv"), .learned = {}, .checked = {}, .power = {}};
    for (const JsonInput& one : in["learned"].list(observations_minimum))
      read(joint.learned.emplace_back(), one, joint);
    for (const JsonInput& one : in["observations"].list(1)) joint.checked.push_back(verdict_of(one, joint));
    if (in.has("power"))
      for (const JsonInput& one : in["power"].list(1)) joint.power.push_back(power_of(one));
    joints.push_back(std::move(joint));
  }
  return joints;
} catch (const InputError& e) {
  return tl::unexpected(e.what());
}

}  // namespace tribotwin::render
