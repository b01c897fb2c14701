#include <algorithm>
#include <set>
#include <tuple>

#include <fmt/format.h>

#include <tribotwin/twin/commands/calibrate/campaign.hpp>
#include <tribotwin/twin/control/dc_position_keys.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using namespace identification;
using Campaign = CalibrationCampaign;

constexpr Place places[] = {Place::drive, Place::joint, Place::body, Place::control, Place::motion};

/// Whose numbers a place has: the driven joints, the bodies, nobody's of a motion. The only joint has no name here.
std::vector<std::string> owners_of(Place place, const mujoco::Model& model) {
  if (place == Place::motion) return {""};
  if (place != Place::body) return joint_names(model);
  std::vector<std::string> bodies;
  for (int body = 1; body < model->nbody; ++body) bodies.emplace_back(mj_id2name(model.get(), mjOBJ_BODY, body));
  return bodies;
}

/// The number at `at`: a value or {start, low, high, sigma, scale}.
Quantity quantity_of(Mapping& in, const std::string& at, Place place, const friction::LawInfo& law,
                     const std::string& key) {
  Quantity q{.place = place, .key = key};
  const auto [minimum, maximum] = accepted_range(place, law, key);
  if (!in.raw(at).IsMap()) {
    q.start = in.number(at, {minimum, maximum});
    return q;
  }
  q.free = true;
  auto m = in.mapping(at);
  m->accept({"start", "low", "high", "sigma", "scale"});
  q.low = m->number("low", {minimum, maximum});
  q.high = m->number("high", {minimum, maximum});
  if (q.low >= q.high) m->fail("low", fmt::format("is {:g} but must be below high, {:g}", q.low, q.high));
  q.start = m->number("start", {q.low, q.high});
  q.logarithmic = m->has("scale") && m->choice("scale", {"linear", "logarithmic"}) == "logarithmic";
  if (q.logarithmic && !(q.low > 0))
    m->fail("low", fmt::format("is {:g} but must be above 0 on a logarithmic scale", q.low));
  q.sigma = m->number_or("sigma", 0, {1e-12, 1e12});
  m->done();
  return q;
}

/// The numbers of a key: one for every joint, or a mapping by joint (or body).
std::vector<Quantity> quantities_of(Mapping& in, Place place, const friction::LawInfo& law, const std::string& key,
                                    const std::vector<std::string>& owners) {
  const bool named = place == Place::body || (place != Place::motion && owners.size() > 1);
  const auto own = [&](Quantity q, const std::string& owner) {
    q.owner = named ? owner : "";
    return q;
  };
  std::vector<Quantity> all;
  const YAML::Node node = in.raw(key);
  const bool by_owner = node.IsMap() && place != Place::motion &&
                        std::ranges::any_of(owners, [&](const auto& owner) { return bool(node[owner]); });
  if (by_owner || (place == Place::body && node.IsMap())) {
    auto each = in.mapping(key);
    each->accept({owners.begin(), owners.end()});
    for (const auto& owner : each->names()) all.push_back(own(quantity_of(*each, owner, place, law, key), owner));
    each->done();
    return all;
  }
  if (place == Place::body) in.fail(key, fmt::format("must be a mapping by body: {}", joined(owners)));
  for (const auto& owner : owners) all.push_back(own(quantity_of(in, key, place, law, key), owner));
  return all;
}

/// Adds the quantities of one section, or replaces those of the same name.
void read_section(Mapping& parent, Place place, const friction::LawInfo& law, const mujoco::Model& model,
                  std::vector<Quantity>& quantities) {
  auto in = parent.mapping(std::string(name(place)));
  if (!in) return;
  auto accepted = keys_of(place, law);
  if (place == Place::control) accepted.push_back("type");
  in->accept(accepted);
  for (const auto& key : in->names()) {
    if (key == "type" && place == Place::control) continue;
    for (const Quantity& q : quantities_of(*in, place, law, key, owners_of(place, model))) {
      const auto known = std::ranges::find(quantities, q.path(), &Quantity::path);
      if (known == quantities.end())
        quantities.push_back(q);
      else
        *known = q;
    }
  }
}

void read_splits(Mapping& in, Plan& plan) {
  const YAML::Node hold_out = in.raw("hold_out");
  if (hold_out && hold_out.IsMap())
    plan.splits.push_back(read_split(*in.mapping("hold_out"), plan.recordings));
  else
    for (const Mapping& split : in.mappings("hold_out")) plan.splits.push_back(read_split(split, plan.recordings));
  std::set<std::string> names;
  for (const auto& split : plan.splits)
    if (!names.insert(split.name).second)
      in.fail("hold_out", fmt::format("two splits are named '{}'; give one another name", split.name));
}

SearchOptions read_search(Mapping& in, std::optional<std::uint64_t> seed) {
  SearchOptions search;
  if (in.has("error"))
    search.norm = in.choice("error", {"squared", "absolute"}) == "squared" ? Norm::squared : Norm::absolute;
  search.correlation_s = in.number_or("correlation_s", search.correlation_s, {1e-3, 1e6});
  if (auto s = in.mapping("search")) {
    s->accept({"method", "starts", "evaluations", "seed"});
    static constexpr std::pair<std::string_view, SearchMethod> methods[] = {
        {"auto", SearchMethod::automatic},
        {"gauss_newton", SearchMethod::gauss_newton},
        {"cma_es", SearchMethod::cma_es}};
    if (s->has("method")) search.method = choice_of(*s, "method", methods);
    if (search.method == SearchMethod::gauss_newton && search.norm != Norm::squared)
      s->fail("method", "is gauss_newton, which needs error: squared; cma_es takes either");
    search.starts = static_cast<int>(s->whole_or("starts", static_cast<std::size_t>(search.starts), {1, 1000}));
    search.evaluations =
        static_cast<int>(s->whole_or("evaluations", static_cast<std::size_t>(search.evaluations), {1, 1e7}));
    search.seed = s->whole_or("seed", search.seed, {0, 9007199254740992.0});
    s->done();
  }
  if (seed) search.seed = *seed;
  return search;
}

std::string read_label(Mapping& in, const std::vector<Variant>& others) {
  const std::string label = in.text("label");
  if (label.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-") != std::string::npos)
    in.fail("label",
            fmt::format("is '{}' but must consist of letters, digits, '_' and '-': files are named after it", label));
  in.file_name_or("label", "");
  if (std::ranges::find(others, label, &Variant::label) != others.end())
    in.fail("label", fmt::format("'{}' is the label of another variant", label));
  return label;
}

bool is(const Quantity& q, std::string_view path) { return path == fmt::format("{}.{}", name(q.place), q.key); }

const Quantity* find(const Variant& variant, std::string_view path) {
  const auto found = std::ranges::find_if(variant.quantities, [&](const Quantity& q) { return is(q, path); });
  return found == variant.quantities.end() ? nullptr : &*found;
}

/// Whether every drive has the number.
bool given(const Variant& variant, std::string_view path, std::size_t drives) {
  const auto count = std::ranges::count_if(variant.quantities, [&](const Quantity& q) { return is(q, path); });
  return count == static_cast<std::ptrdiff_t>(drives);
}

bool has_number(const Recording& r, std::string_view key) {
  return std::ranges::find(r.points.numbers, key, [](const auto& n) { return n.first; }) != r.points.numbers.end();
}

/// The numbers of the recordings and those of the variant do not contradict each other.
void check_settings(const Mapping& in, const Variant& variant, const std::vector<Recording>& recordings,
                    std::size_t drives) {
  for (const auto& r : recordings) {
    const std::string file = r.file.filename().string();
    for (const auto& [key, value] : r.control) {
      if (!has_key(variant.controller, key))
        in.fail("label", fmt::format("the settings of {} have {}, which a controller of type {} does not have", file,
                                     key, name(variant.controller)));
      if (const Quantity* q = find(variant, "control." + key); q && q->free)
        in.fail("label", fmt::format("control.{} is free, but the settings of {} fix it", key, file));
    }
    if (!r.scenario.empty() && find(variant, "motion.delay_s"))
      in.fail("label", fmt::format("motion.delay_s is given, but {} is the record of a run, whose set points have none",
                                   r.file.string()));
    if ((r.bench.mass_kg || r.bench.length_m) && drives > 1)
      in.fail("label", fmt::format("{} has mass or length, but of which body? The model has {} drives; give payload: "
                                   "{{mass_kg, com_m}} in recordings.settings, or body: {{mass_kg: ...}}",
                                   file, drives));
    if ((r.bench.mass_kg || r.bench.length_m) && find(variant, "body.mass_kg"))
      in.fail("label", fmt::format("body.mass_kg is given here, but {} has mass or length of its own", file));
  }
}

/// What the controller follows is in every recording. What it does not read is said.
void check_commands(const Mapping& in, const Variant& variant, const std::vector<Recording>& recordings) {
  using enum Controller;
  const Controller own = variant.controller == dc_position ? servo : variant.controller;
  std::string unread;
  for (const auto& r : recordings) {
    const SetPoints& p = r.points;
    const bool smooth = !p.velocity_rad_s.empty();
    struct Command {
      Controller follows;
      const char* column;
      bool there;
    };
    const Command commands[] = {{servo, "set_point_JOINT_rad", !p.position_rad.empty()},
                                {velocity, "set_point_JOINT_rad_s", !p.command_rad_s.empty() || smooth},
                                {torque, "set_point_JOINT_nm", !p.command_nm.empty()}};
    std::string types;
    for (const Command& c : commands)
      if (c.there) types += fmt::format("{}{}", types.empty() ? "" : " or ", name(c.follows));
    for (const Command& c : commands) {
      if (c.follows == own && !c.there)
        in.fail("label", fmt::format("{} has no {}, which a controller of type {} follows; its commands suit control: "
                                     "{{type: {}}}",
                                     r.file.filename().string(), c.column, name(variant.controller), types));
      const bool reads = variant.controller == dc_position ? c.follows == servo : c.follows >= own;
      if (c.there && !reads && !smooth && unread.empty())
        unread = fmt::format("{}: {} of {} counts nothing: a controller of type {} does not read it", variant.label,
                             c.column, r.file.filename().string(), name(variant.controller));
    }
  }
  if (!unread.empty()) note("{}", unread);
  const auto commands_torque = [](const Recording& r) { return !r.points.command_nm.empty(); };
  if (find(variant, "control.torque_gain") && std::ranges::none_of(recordings, commands_torque))
    in.fail("label", "control.torque_gain has no effect: no recording has set_point_JOINT_nm");
}

/// The controller of a variant is complete and does not contradict the settings of the recordings.
void check_control(const Mapping& in, const Variant& variant, const std::vector<Recording>& recordings,
                   std::size_t drives) {
  check_settings(in, variant, recordings, drives);
  for (const Quantity& q : variant.quantities)
    if (q.place == Place::control && !has_key(variant.controller, q.key))
      in.fail("label", fmt::format("control.{} belongs to another type of controller than {}; set control.type", q.key,
                                   name(variant.controller)));
  const auto need = [&](const std::string& key) {
    const auto in_settings = [&](const Recording& r) {
      return std::ranges::find(r.control, key, [](const auto& c) { return c.first; }) != r.control.end() ||
             (key == "supply_V" && has_number(r, "vin"));
    };
    if (!given(variant, "control." + key, drives) && !std::ranges::all_of(recordings, in_settings))
      in.fail("label", fmt::format("the controller of '{}' is not complete: control.{} is missing, here or for all "
                                   "variants",
                                   variant.label, key));
  };
  check_commands(in, variant, recordings);
  if (variant.controller != Controller::dc_position) {
    for (const char* key : {"position_gain_1_s", "speed_gain_nm_s_rad", "integral_time_s"})
      if (has_key(variant.controller, key)) need(key);
    return;
  }
  for (const auto& key : dc_position_keys())
    for (const Quantity& q : variant.quantities)
      if (key.knot && q.place == Place::control && q.key == key.name && q.free)
        in.fail("label", fmt::format("{} is free, but where a knot of a curve lies must be known; free are its factors",
                                     q.path()));
  for (const char* key : {"error_gain", "supply_V", "resistance_ohm", "kt_nm_A"}) need(key);
  for (const auto& r : recordings)
    if (!given(variant, "control.kp", drives) && !has_number(r, "kp") &&
        std::ranges::find(r.control, "kp", [](const auto& c) { return c.first; }) == r.control.end())
      in.fail("label", fmt::format("the gain of {} is not known: the file has no number 'kp', and neither "
                                   "recordings.settings nor control gives it",
                                   r.file.filename().string()));
  for (const Quantity& winding : variant.quantities)
    for (const Quantity& supply : variant.quantities)
      if (is(winding, "control.resistance_ohm") && is(supply, "control.supply_resistance_ohm") &&
          winding.owner == supply.owner &&
          (supply.free ? supply.high : supply.start) > (winding.free ? winding.low : winding.start))
        in.fail("label",
                "control.supply_resistance_ohm may exceed control.resistance_ohm within these bounds; a supply loses "
                "less than the whole voltage");
}

Controller controller_of(Mapping& in, Controller fallback) {
  using enum Controller;
  static const std::pair<std::string_view, Controller> types[] = {
      {name(dc_position), dc_position}, {name(servo), servo}, {name(velocity), velocity}, {name(torque), torque}};
  auto control = in.mapping("control");
  return control && control->has("type") ? choice_of(*control, "type", types) : fallback;
}

/// One entry of `variants`; the sections of `root` apply to all variants, and those of the variant override them.
Variant read_variant(Mapping in, Mapping& root, const fs::path& folder, const Plan& plan,
                     std::optional<double> timestep_s) {
  in.accept({"label", "model", "law", "drive", "joint", "body", "control", "motion"});
  Variant variant{.label = read_label(in, plan.variants), .timestep_s = timestep_s};
  variant.model = in.file("model", folder);
  std::vector<std::string_view> laws;
  for (const auto& law : friction::laws()) laws.push_back(law.name);
  variant.law = friction::find_law(in.choice("law", laws));
  const auto model = mujoco::load_file(variant.model);
  if (!model) in.fail("model", model.error().message);
  for (const auto& r : plan.recordings)
    if (const auto drives = recorded_drives(**model, r); !drives)
      in.fail("model", fmt::format("{} does not suit {}: {}", variant.model.string(), r.file.filename().string(),
                                   drives.error().message));
  variant.controller = controller_of(in, controller_of(root, Controller::dc_position));
  for (const Place place : places) {
    read_section(root, place, *variant.law, **model, variant.quantities);
    read_section(in, place, *variant.law, **model, variant.quantities);
  }
  for (const auto& r : plan.recordings)
    if (std::ranges::find(variant.benches, r.bench) == variant.benches.end()) variant.benches.push_back(r.bench);
  check_control(in, variant, plan.recordings, (*model)->drives().size());
  in.done();
  return variant;
}

/// Says which numbers of recordings replace those of the model, and which do not count.
void note_settings(const Variant& variant, const VariantTwins& twins, const std::vector<Recording>& recordings) {
  for (const Bench& bench : variant.benches) {
    const Bench other = twins.differing(bench);
    const auto count = std::ranges::count(recordings, bench, &Recording::bench);
    for (const auto& [number, what, unit] : {std::tuple{other.mass_kg, "mass", "kg"}, {other.length_m, "length", "m"}})
      if (number)
        note("{}: {} of {} recordings have {} {:g} {}, which replaces that of the model", variant.label, count,
             recordings.size(), what, *number, unit);
  }
  for (const auto& r : recordings)
    for (const auto& [key, value] : r.points.numbers)
      if (const Quantity* q = find(variant, "control.supply_V"); key == "vin" && q && !q->free && q->start != value)
        return note("{}: {} has vin {:g}, but control.supply_V is {:g}, which counts", variant.label,
                    r.file.filename().string(), value, q->start);
}

/// What is wrong with the firmware that follows some recording, at the start values.
std::string problem_of_control(const VariantTwins& twins, const std::vector<Recording>& recordings) {
  std::vector<double> start;
  for (const Quantity& q : twins.variant().quantities) start.push_back(q.start);
  for (const Recording& r : recordings) {
    const auto control = twins.control(start, r);
    if (const auto* drives = std::get_if<std::vector<DcPositionOptions>>(&control))
      for (const DcPositionOptions& o : *drives)
        if (auto why = problem_of(o); !why.empty()) return why;
  }
  return {};
}

/// Reads all variants; returns the fingerprints of their models.
std::string read_variants(Mapping& in, const fs::path& file, Plan& plan) {
  const fs::path folder = fs::absolute(file).parent_path();
  std::optional<double> timestep_s;
  if (in.has("timestep_s"))
    timestep_s = in.number("timestep_s", {mujoco::shortest_timestep_s, mujoco::longest_timestep_s});
  std::string models;
  if (!in.has("variants")) in.fail("variants", "is missing: a list of {label, model, law, ...}");
  for (const Mapping& one : in.mappings("variants")) {
    Variant variant = read_variant(one, in, folder, plan, timestep_s);
    const auto refuse = [&](const std::string& why) {
      throw InputError(fmt::format("{}: variant '{}': {}", file.string(), variant.label, why));
    };
    const auto opened = VariantTwins::open(variant);
    if (!opened) refuse(opened.error().message);
    if (const auto why = problem_of_control(*opened, plan.recordings); !why.empty()) refuse("control." + why);
    if (plan.variants.empty()) note_settings(variant, *opened, plan.recordings);
    models += fmt::format(" {:016x}", fingerprint(opened->reference()));
    plan.variants.push_back(std::move(variant));
  }
  if (plan.variants.empty()) in.fail("variants", "is empty");
  return models;
}

std::size_t read_reference(Mapping& in, const std::vector<Variant>& variants) {
  if (!in.has("reference")) return 0;
  std::vector<std::string_view> labels;
  for (const auto& v : variants) labels.push_back(v.label);
  const std::string label = in.choice("reference", labels);
  return static_cast<std::size_t>(std::ranges::find(labels, label) - labels.begin());
}

std::uint64_t fingerprint_of(const std::vector<Recording>& recordings) {
  Fingerprint recorded;
  for (const auto& r : recordings) {
    recorded.add(r.file.string());
    recorded.add(r.points.time_s);
    for (const auto* columns : {&r.points.position_rad, &r.points.command_rad_s, &r.points.command_nm,
                                &r.points.measured_rad, &r.points.temperature_degC})
      for (const auto& column : *columns) recorded.add(column);
  }
  return recorded.value();
}

}  // namespace

Campaign read_calibration(const fs::path& file, std::optional<std::uint64_t> seed, const TableOptions& tables) {
  Campaign c{.file = file};
  const YAML::Node root = load_yaml(file);
  Mapping in(file.string(), "", root);
  in.accept({"description", "recordings", "hold_out", "reference", "error", "correlation_s", "search", "timestep_s",
             "drive", "joint", "body", "control", "motion", "variants"});
  in.text_or("description", "");
  auto recordings = in.mapping("recordings");
  if (!recordings) in.fail("recordings", "is missing: {files: ...}");
  c.plan.recordings = read_recordings(*recordings, fs::absolute(file).parent_path(), friction::laws()[0], tables);
  read_splits(in, c.plan);
  c.plan.search = read_search(in, seed);
  const std::string models = read_variants(in, file, c.plan);
  c.reference = read_reference(in, c.plan.variants);
  in.done();
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << root;
  c.resolved =
      fmt::format("{}\n# seed {}\n# models{}\n# recordings {:016x}\n# {}\n# MuJoCo {}\n", out.c_str(),
                  c.plan.search.seed, models, fingerprint_of(c.plan.recordings), TRIBOTWIN_VERSION, mj_versionString());
  return c;
}

}  // namespace tribotwin::twin::program
