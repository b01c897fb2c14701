#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <mutex>

#include <fmt/format.h>
#include <pugixml.hpp>

#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/identification/quantity_keys.hpp>
#include <tribotwin/twin/identification/variant_twins.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/starting_points.hpp>

namespace tribotwin::twin::identification {
namespace {

namespace fs = std::filesystem;

void absolute_folders(pugi::xml_node root, const fs::path& folder) {
  for (const char* attribute : {"meshdir", "texturedir"}) {
    std::string given;
    for (pugi::xml_node compiler : root.children("compiler")) {
      if (compiler.attribute(attribute)) given = compiler.attribute(attribute).value();
      compiler.remove_attribute(attribute);
    }
    if (!given.empty() || root.select_node("//asset//*[@file]"))
      root.append_child("compiler").append_attribute(attribute) =
          (fs::absolute(folder) / given).lexically_normal().c_str();
  }
}

pugi::xml_node config_of(const pugi::xml_node& instance, std::string_view key) {
  for (pugi::xml_node c : instance.children("config"))
    if (c.attribute("key").value() == key) return c;
  return {};
}

void set_config(pugi::xml_node instance, std::string_view key, const std::string& value) {
  pugi::xml_node c = config_of(instance, key);
  if (!c) {
    c = instance.append_child("config");
    c.append_attribute("key") = std::string(key).c_str();
    c.append_attribute("value");
  }
  c.attribute("value") = value.c_str();
}

/// Another law also removes the parameters of the old one.
void set_law(pugi::xml_node instance, std::string_view law) {
  if (config_of(instance, "law").attribute("value").value() == law) return;
  std::vector<pugi::xml_node> old;
  for (pugi::xml_node c : instance.children("config"))
    if (is_law_parameter(c.attribute("key").value())) old.push_back(c);
  for (const pugi::xml_node c : old) instance.remove_child(c);
  set_config(instance, "law", std::string(law));
}

/// The model without visual elements, every body with the inertia that it has in `m`; empty where bodies differ.
std::string without_scenery(const std::string& text, const mujoco::Model& m) {
  pugi::xml_document document;
  document.load_string(text.c_str());
  int id = 0;
  for (const auto& match : document.select_nodes("//worldbody//body")) {
    if (++id >= m->nbody) return {};
    pugi::xml_node body = match.node();
    if (body.child("inertial") || m->body_mass[id] == 0) continue;
    pugi::xml_node inertial = body.prepend_child("inertial");
    const auto give = [&](const char* attribute, const mjtNum* first, int count) {
      inertial.append_attribute(attribute) = joined({first, first + count}, " ").c_str();
    };
    give("mass", m->body_mass + id, 1);
    give("pos", m->body_ipos + 3 * id, 3);
    give("quat", m->body_iquat + 4 * id, 4);
    give("diaginertia", m->body_inertia + 3 * id, 3);
  }
  for (const char* path :
       {"//worldbody//geom", "//worldbody//site", "//worldbody//light", "//worldbody//camera", "//asset", "//visual"})
    for (const auto& match : document.select_nodes(path)) match.node().parent().remove_child(match.node());
  for (const auto& match : document.select_nodes("//@material")) match.parent().remove_attribute(match.attribute());
  return mujoco::text_of(document);
}

/// Whether both models move exactly alike, without contacts, for a whole turn in each direction.
bool same_motion(const mujoco::Model& reference, const mujoco::Model& lean) {
  if (lean->nv != reference->nv || lean->nbody != reference->nbody) return false;
  const mujoco::DataPtr a = reference.make_data(), b = lean.make_data();
  for (int k = 0; k < 4000; ++k) {
    for (const auto& d : {a.get(), b.get()})
      for (const auto& drive : reference.drives())
        d->ctrl[drive.control] = (k / 1000 % 2 ? -0.5 : 0.5) * drive.drive.torque_max_nm / drive.gear;
    reference.step(a.get());
    lean.step(b.get());
    if (!std::equal(a->qpos, a->qpos + lean->nq, b->qpos) || a->ncon != 0) return false;
  }
  return true;
}

/// Writes the inertia that a body has in `m` in place of what the text says, its mass and the place of its centre
/// changed; the rotational inertia scales with the mass.
void set_inertia(pugi::xml_node body, const mujoco::Model& m, int id, double mass_kg,
                 const std::array<double, 3>& centre) {
  while (pugi::xml_node old = body.child("inertial")) body.remove_child(old);
  pugi::xml_node inertial = body.prepend_child("inertial");
  const double share = mass_kg / m->body_mass[id];
  const mjtNum* I = m->body_inertia + 3 * id;
  const mjtNum* quat = m->body_iquat + 4 * id;
  inertial.append_attribute("mass") = fmt::format("{}", mass_kg).c_str();
  inertial.append_attribute("pos") = joined({centre.begin(), centre.end()}, " ").c_str();
  inertial.append_attribute("quat") = joined({quat, quat + 4}, " ").c_str();
  inertial.append_attribute("diaginertia") = joined(std::vector{share * I[0], share * I[1], share * I[2]}, " ").c_str();
}

/// The centre of mass of a joint's body in the body's frame [m], and the part of it across the joint's axis.
struct Lever {
  std::array<double, 3> centre, across;
  double length_m;
};
Lever lever_of(const mujoco::Model& m, int joint) {
  const int body = m->jnt_bodyid[joint];
  const mjtNum *axis = m->jnt_axis + 3 * joint, *anchor = m->jnt_pos + 3 * joint, *at = m->body_ipos + 3 * body;
  Lever lever{{at[0], at[1], at[2]}, {}, 0};
  double along = 0;
  for (std::size_t k = 0; k < 3; ++k) along += (at[k] - anchor[k]) * axis[k];
  for (std::size_t k = 0; k < 3; ++k) lever.across[k] = at[k] - anchor[k] - along * axis[k];
  lever.length_m = std::hypot(lever.across[0], lever.across[1], lever.across[2]);
  return lever;
}

/// The elements of a model's text that belong to its drives.
class ModelText {
 public:
  ModelText(const pugi::xml_document& document, const mujoco::Model& model) : document_(document), model_(model) {}
  pugi::xml_node named(const char* path, std::string_view name) const {
    for (const auto& match : document_.select_nodes(path))
      if (match.node().attribute("name").value() == name) return match.node();
    return {};
  }
  pugi::xml_node joint(std::size_t drive) const { return named("//worldbody//joint", joint_of(drive)); }
  pugi::xml_node instance(std::size_t drive) const {
    for (const auto& match : document_.select_nodes("//actuator/plugin[@plugin='tribotwin.drive']"))
      if (match.node().attribute("joint").value() == joint_of(drive))
        return named("//extension/plugin[@plugin='tribotwin.drive']/instance",
                     match.node().attribute("instance").value());
    return {};
  }

 private:
  std::string joint_of(std::size_t drive) const { return joint_name(model_.get(), model_.drives()[drive]); }

  const pugi::xml_document& document_;
  const mujoco::Model& model_;
};

/// The instance of two drives; empty where each has its own.
std::string shared_instance(const pugi::xml_document& document) {
  std::vector<std::string> seen;
  for (const auto& match : document.select_nodes("//actuator/plugin[@plugin='tribotwin.drive']/@instance")) {
    if (std::ranges::find(seen, match.attribute().value()) != seen.end()) return seen.back();
    seen.emplace_back(match.attribute().value());
  }
  return {};
}

/// The engine's XML compiler keeps process-wide state.
std::mutex compiler;

}  // namespace

Result<std::vector<std::size_t>> recorded_drives(const mujoco::Model& model, const Recording& recording) {
  const auto drives = model.drives();
  std::vector<std::size_t> found;
  for (const auto& joint : recording.points.joints) {
    const auto drive = find_drive(model, joint);
    if (!drive) return tl::unexpected(drive.error());
    found.push_back(*drive);
  }
  if (recording.points.joints.empty() && drives.size() == 1) found.push_back(0);
  if (found.size() == drives.size()) return found;
  std::size_t missing = 0;
  while (std::ranges::find(found, missing) != found.end()) ++missing;
  return tl::unexpected(
      fmt::format("there are no set points of its joint {}, but the model has {} drives, each of "
                  "which needs set_point_JOINT_rad and position_JOINT_rad",
                  joint_name(model.get(), drives[missing]), drives.size()));
}

bool Bench::operator==(const Bench& other) const {
  const auto same = [](const Payload& a, const Payload& b) { return a.mass_kg == b.mass_kg && a.com_m == b.com_m; };
  return mass_kg == other.mass_kg && length_m == other.length_m && payload.has_value() == other.payload.has_value() &&
         (!payload || same(*payload, *other.payload));
}

double mean_error(Norm norm, const Recording& recording, std::size_t joint, std::span<const double> positions) {
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const double e = positions[i] - recording.points.measured_rad[joint][i];
    if (!std::isfinite(e)) continue;
    sum += norm == Norm::squared ? e * e : std::abs(e);
    ++count;
  }
  return sum / static_cast<double>(count);
}

std::vector<std::size_t> VariantTwins::free_quantities() const {
  std::vector<std::size_t> all;
  for (std::size_t i = 0; i < variant_->quantities.size(); ++i)
    if (variant_->quantities[i].free) all.push_back(i);
  return all;
}

std::size_t VariantTwins::drive_of(const Quantity& q) const {
  return q.owner.empty() ? 0 : find_drive(*given_, q.owner).value_or(0);
}

Bench VariantTwins::differing(Bench bench) const {
  const int joint = given_->drives()[0].joint;
  const auto same = [](double a, double b) { return std::abs(a - b) <= 1e-6 * b; };
  if (bench.mass_kg && same(*bench.mass_kg, (*given_)->body_mass[(*given_)->jnt_bodyid[joint]])) bench.mass_kg.reset();
  if (bench.length_m && same(*bench.length_m, lever_of(*given_, joint).length_m)) bench.length_m.reset();
  return bench;
}

std::string VariantTwins::edited(const std::string& text, std::span<const double> values, const Bench& bench) const {
  pugi::xml_document document;
  document.load_string(text.c_str());
  const ModelText in(document, *given_);
  for (std::size_t i = 0; i < given_->drives().size(); ++i) set_law(in.instance(i), variant_->law->name);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Quantity& q = variant_->quantities[i];
    const std::string value = fmt::format("{}", values[i]);
    if (q.place == Place::drive) set_config(in.instance(drive_of(q)), q.key, value);
    if (q.place == Place::body) {
      const int id = mj_name2id(given_->get(), mjOBJ_BODY, q.owner.c_str());
      const mjtNum* at = (*given_)->body_ipos + 3 * id;
      set_inertia(in.named("//worldbody//body", q.owner), *given_, id, values[i], {at[0], at[1], at[2]});
    }
    if (q.place != Place::joint) continue;
    pugi::xml_node joint = in.joint(drive_of(q));
    if (!joint.attribute(q.key.c_str())) joint.append_attribute(q.key.c_str());
    joint.attribute(q.key.c_str()) = value.c_str();
  }
  if (const Bench other = differing(bench); other.mass_kg || other.length_m) {
    const int joint = given_->drives()[0].joint, body = (*given_)->jnt_bodyid[joint];
    Lever lever = lever_of(*given_, joint);
    const double longer = other.length_m ? *other.length_m / lever.length_m - 1 : 0;
    for (std::size_t k = 0; k < 3; ++k) lever.centre[k] += longer * lever.across[k];
    set_inertia(in.joint(0).parent(), *given_, body, other.mass_kg.value_or((*given_)->body_mass[body]), lever.centre);
  }
  return mujoco::text_of(document);
}

Result<std::shared_ptr<const mujoco::Model>> VariantTwins::load(const std::string& text, std::span<const double> values,
                                                                const Bench& bench) const {
  const std::string mjcf = edited(text, values, bench);
  const std::lock_guard lock(compiler);
  auto model = mujoco::load_string(mjcf, {.timestep_s = variant_->timestep_s});
  if (!model || !bench.payload) return model;
  return with_payload(**model, *bench.payload);
}

Result<VariantTwins> VariantTwins::open(const Variant& variant) {
  VariantTwins twins;
  twins.variant_ = std::make_shared<const Variant>(variant);
  const auto given = mujoco::load_file(variant.model);
  if (!given) return tl::unexpected(Error("model: " + given.error().message));
  if ((*given)->drives().empty())
    return tl::unexpected(
        fmt::format("model: {} has no tribotwin.drive; `tribotwin add-drives` gives it some", variant.model.string()));
  twins.given_ = *given;
  const auto document = mujoco::load_merged(variant.model);
  if (!document) return tl::unexpected(Error("model: " + document.error().message));
  const fs::path folder = variant.model.has_parent_path() ? variant.model.parent_path() : fs::path(".");
  absolute_folders((*document)->document_element(), folder);
  if (const auto shared = shared_instance(**document); !shared.empty())
    return tl::unexpected(fmt::format("model: two drives share the instance '{}'; give each its own", shared));
  twins.text_ = mujoco::text_of(**document);

  std::vector<double> values;
  for (const auto& q : variant.quantities) values.push_back(q.start);
  auto reference = twins.load(twins.text_, values, {});
  if (!reference) return tl::unexpected(Error("with the start values: " + reference.error().message));
  twins.reference_ = *reference;
  twins.try_without_scenery();
  if (const auto ok = twins.check_edges(); !ok) return tl::unexpected(ok.error());
  return twins;
}

/// Each bench with the start values, and each quantity at its bounds.
Result<void> VariantTwins::check_edges() const {
  std::vector<double> values;
  for (const auto& q : variant_->quantities) values.push_back(q.start);
  for (const Bench& bench : variant_->benches)
    if (const auto model = load(lean_, values, bench); !model)
      return tl::unexpected(fmt::format("with mass, length or payload of a recording: {}", model.error().message));
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Quantity& q = variant_->quantities[i];
    if (!q.free || q.place == Place::control || q.place == Place::motion) continue;
    for (const double bound : {q.low, q.high}) {
      auto edge = values;
      edge[i] = bound;
      if (const auto model = load(lean_, edge, {}); !model)
        return tl::unexpected(fmt::format("{}: its bound {:g} is refused: {}", q.path(), bound, model.error().message));
    }
  }
  return {};
}

/// Visual geometry takes more than half of the step of a small model. It is removed where that changes no bit.
void VariantTwins::try_without_scenery() {
  lean_ = text_;
  const std::string stripped = without_scenery(text_, *reference_);
  if (stripped.empty()) return;
  std::vector<double> values;
  for (const auto& q : variant_->quantities) values.push_back(q.start);
  if (const auto lean = load(stripped, values, {}); lean && same_motion(*reference_, **lean)) lean_ = stripped;
}

std::string VariantTwins::mjcf(std::span<const double> values, const Bench& bench) const {
  pugi::xml_document document;
  document.load_string(edited(text_, values, bench).c_str());
  for (const Quantity& q : variant_->quantities) {
    if (!q.free || q.place != Place::drive) continue;
    const std::string mark = starting_point_name(joint_name(given_->get(), given_->drives()[drive_of(q)]));
    for (const auto& match : document.select_nodes("/mujoco/custom/text"))
      if (mark == match.node().attribute("name").value()) match.node().parent().remove_child(match.node());
  }
  return mujoco::text_of(document);
}

Result<VariantTwins::Candidate> VariantTwins::candidate(std::vector<double> values) const {
  Candidate made;
  for (const Bench& bench : variant_->benches) {
    auto model = load(lean_, values, bench);
    if (!model) return work_failed(model.error().message);
    made.models.push_back(std::move(*model));
  }
  made.values = std::move(values);
  return made;
}

decltype(Scenario::control) VariantTwins::control(std::span<const double> values, const Recording& recording) const {
  const auto filled = [&](auto options, auto field) {
    const auto set = [&](std::string_view key, double value, std::size_t from, std::size_t to) {
      const Key* known = find_key(Place::control, key);
      if (!known || !has_key(variant_->controller, key)) return;
      for (std::size_t i = from; i < to; ++i) field(*known, options[i]) = value;
    };
    for (const auto& [key, value] : recording.points.numbers)
      if (key == "kp" || key == "vin") set(key == "vin" ? "supply_V" : key, value, 0, options.size());
    for (std::size_t i = 0; i < values.size(); ++i)
      if (const Quantity& q = variant_->quantities[i]; q.place == Place::control)
        set(q.key, values[i], drive_of(q), q.owner.empty() ? options.size() : drive_of(q) + 1);
    for (const auto& [key, value] : recording.control) set(key, value, 0, options.size());
    return options;
  };
  const std::size_t drives = given_->drives().size();
  if (variant_->controller == Controller::dc_position)
    return filled(std::vector<DcPositionOptions>(drives),
                  [](const Key& key, DcPositionOptions& o) -> double& { return key.dc->value(o); });
  using Mode = DriveCommand::Mode;
  CascadedOptions servo{.mode = variant_->controller == Controller::servo      ? Mode::position
                                : variant_->controller == Controller::velocity ? Mode::velocity
                                                                               : Mode::torque,
                        .gravity = false};
  servo.per_drive =
      filled(std::vector<LoopGains>(drives), [](const Key& key, LoopGains& o) -> double& { return o.*key.servo; });
  return servo;
}

double VariantTwins::delay_s(std::span<const double> values) const {
  for (std::size_t i = 0; i < values.size(); ++i)
    if (variant_->quantities[i].place == Place::motion) return values[i];
  return 0;
}

std::vector<double> VariantTwins::temperature_degC(const Recording& recording) const {
  const auto drives = given_->drives();
  const auto joints = drives_of(recording);
  std::vector<double> all(drives.size());
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const std::size_t i = joints[k];
    const double recorded = recording.points.temperature_degC[k][0];
    all[i] =
        recording.temperature_degC.value_or(std::isfinite(recorded) ? recorded : drives[i].drive.thermal.T_amb_degC);
  }
  return all;
}

Scenario VariantTwins::scenario(const Candidate& candidate, const Recording& recording) const {
  const SetPoints& r = recording.points;
  const auto bench = std::ranges::find(variant_->benches, recording.bench) - variant_->benches.begin();
  Scenario scenario;
  scenario.model = candidate.models[static_cast<std::size_t>(bench)];
  scenario.duration_s = recording.duration_s();
  const auto joints = drives_of(recording);
  scenario.start_rad.resize(scenario.model->drives().size());
  for (std::size_t k = 0; k < joints.size(); ++k) scenario.start_rad[joints[k]] = r.measured_rad[k][0];
  scenario.temperature_degC = temperature_degC(recording);
  scenario.control = control(candidate.values, recording);
  scenario.motion = motion_of(r, joints, scenario.start_rad, delay_s(candidate.values));
  scenario.recording = SetPoints{.time_s = r.time_s, .torque_on = r.torque_on};
  scenario.expects = {"tracking"};  // what counts is the recorded position, from which a small servo's goal is far
  return scenario;
}

Result<VariantTwins::Positions> VariantTwins::positions(const Candidate& candidate, const Recording& recording) const {
  const SetPoints& r = recording.points;
  Twin twin(scenario(candidate, recording));
  const auto joints = drives_of(recording);
  std::vector<int> address;
  for (const std::size_t i : joints) address.push_back(position_address(twin.model().get(), twin.model().drives()[i]));
  Positions positions(address.size(), std::vector(r.time_s.size(), std::numeric_limits<double>::quiet_NaN()));
  std::size_t next = 0;
  while (twin.steps() < twin.steps_total()) {
    for (; next < r.time_s.size() && r.time_s[next] - r.time_s[0] <= twin.time_s() + 1e-12; ++next)
      for (std::size_t k = 0; k < address.size(); ++k) positions[k][next] = twin.data()->qpos[address[k]];
    if (const auto ok = twin.step(); !ok) return work_failed(ok.error().message);
  }
  return positions;
}

Result<std::vector<Finding>> VariantTwins::health(const Candidate& candidate, const Recording& recording) const {
  Twin twin(scenario(candidate, recording));
  while (twin.steps() < twin.steps_total())
    if (const auto ok = twin.step(); !ok) return work_failed(ok.error().message);
  return examine({twin.scenario(), &twin});
}

double mae_mrad(const Recording& recording, const VariantTwins::Positions& positions) {
  double sum = 0;
  for (std::size_t k = 0; k < positions.size(); ++k) sum += mean_error(Norm::absolute, recording, k, positions[k]);
  return 1e3 * sum / static_cast<double>(positions.size());
}

}  // namespace tribotwin::twin::identification
