#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/report/dynamics/dynamics_data.hpp>
#include <tribotwin/render/report/fit_data.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/json_input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/tables/rows.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {
namespace {

namespace fs = std::filesystem;
using twin::JsonInput;

std::vector<std::string> texts(const JsonInput& list) {
  std::vector<std::string> out;
  for (const auto& one : list.list(0)) out.push_back(one.text());
  return out;
}

twin::identification::Dependence dependence_of(const std::string& on, const JsonInput& in) {
  twin::identification::Dependence d{.on = on,
                                     .share = in["share"].number(),
                                     .chance = in["chance"].number(),
                                     .growth = in["growth"].number_or_null()};
  for (const auto& bin : in["bins"].list(0))
    d.bins.push_back({bin["from"].number(), bin["to"].number(), bin["mean"].number(), bin["sigma"].number_or_null()});
  return d;
}

/// The quantity of which most samples lie outside of the training.
void read_training(const JsonInput& in, JointPrediction& joint) {
  if (in.is_null()) {
    joint.outside = std::nan("");
    return;
  }
  for (const auto& [quantity, range] : in.entries())
    if (const double share = range["share_outside"].number({0, 1}); share > joint.outside)
      joint.outside = share, joint.outside_of = quantity;
}

void read_band(const JsonInput& in, JointPrediction& joint) {
  if (!in.has("band") || in["band"].is_null()) return;
  joint.half_width = in["band"]["half_width"].number({0, 1e300});
  joint.beside_band = 1 - in["band"]["share_inside"].number_or_null();
  joint.band_fails = in["band"]["fails"].truth();
}

JointPrediction joint_of(const std::string& name, const JsonInput& in) {
  JointPrediction joint{.name = name, .unit = in["unit"].text()};
  if (in.has("lacking")) {
    joint.lacking = in["lacking"].text();
    joint.rms = joint.of_range = joint.range = joint.largest = joint.of_variation = std::nan("");
    return joint;
  }
  joint.rms = in["rms"].number_or_null(), joint.of_range = in["relative_to_range"].number_or_null();
  joint.range = in["range"].number_or_null(), joint.largest = in["largest"].number_or_null();
  const JsonInput verdict = in["verdict"];
  joint.badly_explained = verdict["badly_explained"].truth();
  joint.of_variation = verdict["of_variation"].number_or_null();
  if (verdict.has("dependence") && !std::isnan(joint.of_variation))
    for (const auto& [on, one] : verdict["dependence"].entries()) joint.dependence.push_back(dependence_of(on, one));
  read_training(in["training"], joint);
  read_band(in, joint);
  return joint;
}

std::string nowhere(const std::string& what, const std::string& name, const fs::path& by) {
  return fmt::format("{}: {} is neither in the working directory nor beside {}.", what, name, by.filename().string());
}

/// Columns of a joint in the table that tribotwin predict wrote beside its JSON.
enum Column : std::size_t { recorded, predicted, moving, band, columns };

std::array<std::string, columns> columns_of(const JointPrediction& joint) {
  const char* unit = joint.unit == "N" ? "n" : "nm";
  return {fmt::format("torque_{}_{}", joint.name, unit), fmt::format("predicted_{}_{}", joint.name, unit),
          "moving_" + joint.name, fmt::format("band_{}_{}", joint.name, unit)};
}

bool has_band(const JointPrediction& joint) { return !std::isnan(joint.half_width); }

/// Appends what a row says of a joint, whose columns begin at `first`.
void take_row(const twin::TableRows& row, std::size_t first, JointPrediction& joint) {
  const double time_s = row.number(0), torque = row.number(first + recorded), expected = row.number(first + predicted),
               moves = row.number(first + moving);
  if (!std::isfinite(time_s + torque + expected + moves)) return;
  joint.time_s.push_back(time_s);
  joint.recorded.push_back(torque);
  joint.predicted.push_back(moves == 0 ? std::nan("") : expected);
  if (has_band(joint)) joint.band.push_back(row.number(first + band));
}

/// Torques of each joint, in one pass.
Result<void> read_torques(const fs::path& table, std::vector<JointPrediction>& joints) {
  std::vector<JointPrediction*> drawn;
  std::vector<std::string> wanted{"time_s"};
  for (auto& joint : joints) {
    if (!joint.lacking.empty()) continue;
    drawn.push_back(&joint);
    std::ranges::copy(columns_of(joint), std::back_inserter(wanted));
  }
  const auto rows = twin::TableRows::open(table, {.texts = {}, .numbers = wanted}, {});
  if (!rows) return tl::unexpected(rows.error());
  for (std::size_t k = 0; k < wanted.size(); ++k)
    if (!(*rows)->has_number(k) && (k == 0 || (k - 1) % columns != band || has_band(*drawn[(k - 1) / columns])))
      return tl::unexpected(
          Error(fmt::format("{}: has no {}; give the table of the same tribotwin predict", table.string(), wanted[k])));
  for (auto more = (*rows)->next();; more = (*rows)->next()) {
    if (!more) return tl::unexpected(more.error());
    if (!*more) return {};
    for (std::size_t j = 0; j < drawn.size(); ++j) take_row(**rows, 1 + columns * j, *drawn[j]);
  }
}

/// Units of a law's parameters, which a parameter file leaves out.
void name_units(twin::identification::FrictionEstimates& friction, const std::vector<JointPrediction>& joints) {
  const auto joint = std::ranges::find(joints, friction.joint, &JointPrediction::name);
  const bool slide = joint != joints.end() && joint->unit == "N";
  const auto law = twin::identification::dynamics_law(friction.law, "friction");
  for (auto& e : friction.estimates) {
    e.unit = e.name == "offset" ? twin::unit_of("Nm", slide) : "";
    if (!law) continue;
    const auto p = std::ranges::find((*law)->parameters, e.name, &friction::Parameter::name);
    if (p != (*law)->parameters.end()) e.unit = twin::unit_of(p->unit, slide);
  }
}

void name_missing_bands(const JsonInput& in, DynamicsData& out) {
  if (!in.has("bands_lacking"))
    out.missing.push_back("No 95 % bands are known: the predictions are of an earlier version of tribotwin predict.");
  else if (const auto why = in["bands_lacking"].text(); !why.empty())
    out.missing.push_back(why + ".");
}

void take_table(const JsonInput& name, DynamicsData& out) {
  const fs::path& by = out.files.front();
  if (name.is_null()) {
    out.missing.push_back("No torques are drawn: tribotwin predict wrote no table; -o predicted.csv does.");
  } else if (const auto table = twin::named_file(name.text(), by)) {
    twin::or_wrong_input(read_torques(*table, out.joints));
    out.files.push_back(*table);
  } else {
    out.missing.push_back(nowhere("No torques are drawn", name.text(), by));
  }
}

DynamicsData read_result(const fs::path& file) {
  const auto value = twin::parse_json(twin::or_wrong_input(twin::read_text(file, "JSON of tribotwin predict")));
  const JsonInput in(value, file.string());
  if (value.is_discarded() || !in.has("of") || !in.has("joints"))
    in.fail(
        "is no JSON of tribotwin predict: tribotwin predict MODEL PARAMS DATA -o predicted.csv --json > "
        "predicted.json");
  DynamicsData out{.files = {file}};
  out.model = in["of"]["model"].text(), out.parameters = in["of"]["parameters"].text();
  out.recordings = texts(in["of"]["data"]);
  for (const auto& [name, joint] : in["joints"].entries()) out.joints.push_back(joint_of(name, joint));
  out.warnings = texts(in["warnings"]), out.badly_explained = texts(in["badly_explained"]);
  name_missing_bands(in, out);
  take_table(in["of"]["table"], out);
  return out;
}

}  // namespace

Result<DynamicsData> load_dynamics(const fs::path& file) try {
  DynamicsData out = read_result(file);
  const auto parameters = twin::named_file(out.parameters, file);
  if (!parameters) {
    out.missing.push_back(nowhere("No parameters are shown", out.parameters, file));
    return out;
  }
  auto friction = twin::identification::read_friction(*parameters);
  if (!friction) return tl::unexpected(friction.error());
  out.files.push_back(*parameters);
  out.friction = std::move(*friction);
  // In the order of the robot, which the parameters have and JSON has not; joints without friction are last.
  std::ranges::stable_sort(out.joints, {}, [&](const JointPrediction& joint) {
    return std::ranges::find(out.friction, joint.name, &twin::identification::FrictionEstimates::joint) -
           out.friction.begin();
  });
  for (auto& joint : out.friction) name_units(joint, out.joints);
  return out;
} catch (const twin::InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::render
