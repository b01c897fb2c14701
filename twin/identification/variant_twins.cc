#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <sstream>

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

std::string text_of(const pugi::xml_document& document) {
  std::ostringstream text;
  document.save(text, "  ");
  return text.str();
}

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
  return text_of(document);
}

/// Whether both models move exactly alike, without contacts, for a whole turn in each direction.
bool same_motion(const mujoco::Model& reference, const mujoco::Model& lean) {
  if (lean->nv != reference->nv || lean->nbody != reference->nbody) return false;
  const mujoco::DataPtr a = reference.make_data(), b = lean.make_data();
  const auto& drive = reference.drives()[0];
  for (int k = 0; k < 4000; ++k) {
    for (const auto& d : {a.get(), b.get()})
      d->ctrl[drive.control] = (k / 1000 % 2 ? -0.5 : 0.5) * drive.drive.torque_max_nm / drive.gear;
    reference.step(a.get());
    lean.step(b.get());
    if (!std::equal(a->qpos, a->qpos + lean->nq, b->qpos) || a->ncon != 0) return false;
  }
  return true;
}

/// The engine's XML compiler keeps process-wide state.
std::mutex compiler;

}  // namespace

double mean_error(Norm norm, const Recording& recording, std::span<const double> positions) {
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const double e = positions[i] - recording.points.measured_rad[i];
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

std::string VariantTwins::edited(const std::string& text, std::span<const double> values) const {
  pugi::xml_document document;
  document.load_string(text.c_str());
  const pugi::xml_node actuator = document.select_node("//actuator/plugin[@plugin='tribotwin.drive']").node();
  const auto named = [&](const char* path, const char* attribute) {
    for (const auto& match : document.select_nodes(path))
      if (std::string_view(match.node().attribute("name").value()) == actuator.attribute(attribute).value())
        return match.node();
    return pugi::xml_node();
  };
  const pugi::xml_node instance = named("//extension/plugin[@plugin='tribotwin.drive']/instance", "instance");
  pugi::xml_node joint = named("//worldbody//joint", "joint");
  set_law(instance, variant_->law->name);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Quantity& q = variant_->quantities[i];
    const std::string value = fmt::format("{}", values[i]);
    if (q.place == Place::drive) set_config(instance, q.key, value);
    if (q.place != Place::joint) continue;
    if (!joint.attribute(q.key.c_str())) joint.append_attribute(q.key.c_str());
    joint.attribute(q.key.c_str()) = value.c_str();
  }
  return text_of(document);
}

Result<std::shared_ptr<const mujoco::Model>> VariantTwins::load(const std::string& text,
                                                                std::span<const double> values) const {
  const std::string mjcf = edited(text, values);
  const std::lock_guard lock(compiler);
  return mujoco::load_string(mjcf, {.timestep_s = variant_->timestep_s});
}

Result<VariantTwins> VariantTwins::open(const Variant& variant) {
  VariantTwins twins;
  twins.variant_ = std::make_shared<const Variant>(variant);
  const auto given = mujoco::load_file(variant.model);
  if (!given) return tl::unexpected(Error("model: " + given.error().message));
  if ((*given)->drives().size() != 1)
    return tl::unexpected(fmt::format("model: {} has {} drives, but a recording of one joint needs exactly 1",
                                      variant.model.string(), (*given)->drives().size()));
  const auto document = mujoco::load_merged(variant.model);
  if (!document) return tl::unexpected(Error("model: " + document.error().message));
  const fs::path folder = variant.model.has_parent_path() ? variant.model.parent_path() : fs::path(".");
  absolute_folders((*document)->document_element(), folder);
  twins.text_ = text_of(**document);

  std::vector<double> values;
  for (const auto& q : variant.quantities) values.push_back(q.start);
  auto reference = twins.load(twins.text_, values);
  if (!reference) return tl::unexpected(Error("with the start values: " + reference.error().message));
  twins.reference_ = *reference;
  twins.try_without_scenery();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Quantity& q = variant.quantities[i];
    if (!q.free || (q.place != Place::drive && q.place != Place::joint)) continue;
    for (const double bound : {q.low, q.high}) {
      auto edge = values;
      edge[i] = bound;
      if (const auto model = twins.load(twins.lean_, edge); !model)
        return tl::unexpected(fmt::format("{}: its bound {:g} is refused: {}", q.path(), bound, model.error().message));
    }
  }
  return twins;
}

/// Visual geometry takes more than half of the step of a small model. It is removed where that changes no bit.
void VariantTwins::try_without_scenery() {
  lean_ = text_;
  const std::string stripped = without_scenery(text_, *reference_);
  if (stripped.empty()) return;
  std::vector<double> values;
  for (const auto& q : variant_->quantities) values.push_back(q.start);
  if (const auto lean = load(stripped, values); lean && same_motion(*reference_, **lean)) lean_ = stripped;
}

std::string VariantTwins::mjcf(std::span<const double> values) const {
  const bool identified =
      std::ranges::any_of(variant_->quantities, [](const Quantity& q) { return q.free && q.place == Place::drive; });
  pugi::xml_document document;
  document.load_string(edited(text_, values).c_str());
  if (!identified) return text_of(document);
  const std::string mark = starting_point_name(joint_name(reference_->get(), reference_->drives()[0]));
  for (const auto& match : document.select_nodes("/mujoco/custom/text"))
    if (mark == match.node().attribute("name").value()) match.node().parent().remove_child(match.node());
  return text_of(document);
}

Result<VariantTwins::Candidate> VariantTwins::candidate(std::vector<double> values) const {
  auto model = load(lean_, values);
  if (!model) return work_failed(model.error().message);
  return Candidate{std::move(*model), std::move(values)};
}

DcPositionOptions VariantTwins::control(std::span<const double> values, const Recording& recording) const {
  DcPositionOptions o;
  for (const auto& [key, value] : recording.points.numbers)
    if (key == "kp") o.kp = value;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (const Key* key = find_key(variant_->quantities[i].place, variant_->quantities[i].key); key && key->option)
      o.*key->option = values[i];
  for (const auto& [key, value] : recording.control) o.*find_key(Place::control, key)->option = value;
  return o;
}

double VariantTwins::delay_s(std::span<const double> values) const {
  for (std::size_t i = 0; i < values.size(); ++i)
    if (variant_->quantities[i].place == Place::motion) return values[i];
  return 0;
}

Scenario VariantTwins::scenario(const Candidate& candidate, const Recording& recording) const {
  const SetPoints& r = recording.points;
  Scenario scenario;
  scenario.model = candidate.model;
  scenario.duration_s = recording.duration_s();
  scenario.start_rad = {r.measured_rad[0]};
  const double recorded = r.temperature_degC[0];
  scenario.temperature_degC = {recording.temperature_degC.value_or(
      std::isfinite(recorded) ? recorded : candidate.model->drives()[0].drive.thermal.T_amb_degC)};
  scenario.control = control(candidate.values, recording);
  scenario.motion.emplace(scenario.start_rad);
  const double delay = delay_s(candidate.values);
  for (std::size_t i = 0; i < r.time_s.size(); ++i)
    scenario.motion->hold_at(r.time_s[i] - r.time_s[0] + delay, {r.position_rad[0][i]});
  scenario.recording = SetPoints{.time_s = r.time_s, .torque_on = r.torque_on};
  scenario.expects = {"tracking"};  // what counts is the recorded position, from which a small servo's goal is far
  return scenario;
}

Result<std::vector<double>> VariantTwins::positions(const Candidate& candidate, const Recording& recording) const {
  const SetPoints& r = recording.points;
  Twin twin(scenario(candidate, recording));
  const int address = position_address(twin.model().get(), twin.model().drives()[0]);
  std::vector<double> positions(r.time_s.size(), std::numeric_limits<double>::quiet_NaN());
  std::size_t next = 0;
  while (twin.steps() < twin.steps_total()) {
    for (; next < r.time_s.size() && r.time_s[next] - r.time_s[0] <= twin.time_s() + 1e-12; ++next)
      positions[next] = twin.data()->qpos[address];
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

double mae_mrad(const Recording& recording, std::span<const double> positions) {
  return 1e3 * mean_error(Norm::absolute, recording, positions);
}

}  // namespace tribotwin::twin::identification
