#include <algorithm>
#include <set>

#include <fmt/format.h>

#include <tribotwin/twin/commands/calibrate_campaign.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using namespace identification;
using Campaign = CalibrationCampaign;

constexpr Place places[] = {Place::drive, Place::joint, Place::control, Place::motion};

Quantity quantity_of(Mapping& in, Place place, const friction::LawInfo& law, const std::string& key) {
  Quantity q{.place = place, .key = key};
  const auto [minimum, maximum] = accepted_range(place, law, key);
  if (!in.raw(key).IsMap()) {
    q.start = in.number(key, {minimum, maximum});
    return q;
  }
  q.free = true;
  auto m = in.mapping(key);
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

/// Adds the quantities of one section, or replaces those of the same name.
void read_section(Mapping& parent, Place place, const friction::LawInfo& law, std::vector<Quantity>& quantities) {
  auto in = parent.mapping(std::string(name(place)));
  if (!in) return;
  in->accept(keys_of(place, law));
  for (const auto& key : in->names()) {
    const Quantity q = quantity_of(*in, place, law, key);
    const auto known =
        std::ranges::find_if(quantities, [&](const Quantity& other) { return other.path() == q.path(); });
    if (known == quantities.end())
      quantities.push_back(q);
    else
      *known = q;
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
    s->accept({"starts", "evaluations", "seed"});
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

const Quantity* find(const Variant& variant, std::string_view path) {
  const auto found = std::ranges::find_if(variant.quantities, [&](const Quantity& q) { return q.path() == path; });
  return found == variant.quantities.end() ? nullptr : &*found;
}

/// The controller of a variant is complete and does not contradict the settings of the recordings.
void check_control(const Mapping& in, const Variant& variant, const std::vector<Recording>& recordings) {
  for (const auto& r : recordings)
    for (const auto& [key, value] : r.control)
      if (const Quantity* q = find(variant, "control." + key); q && q->free)
        in.fail("label",
                fmt::format("control.{} is free, but the settings of {} fix it", key, r.file.filename().string()));
  for (const char* needed : {"control.error_gain", "control.supply_V", "control.resistance_ohm", "control.kt_nm_A"})
    if (!find(variant, needed))
      in.fail("label", fmt::format("the controller of '{}' is not complete: {} is missing, here or for all variants",
                                   variant.label, needed));
  for (const auto& r : recordings) {
    const auto is_kp = [](const auto& number) { return number.first == "kp"; };
    if (!find(variant, "control.kp") && std::ranges::none_of(r.points.numbers, is_kp) &&
        std::ranges::none_of(r.control, is_kp))
      in.fail("label", fmt::format("the gain of {} is not known: the file has no number 'kp', and neither "
                                   "recordings.settings nor control gives it",
                                   r.file.filename().string()));
  }
  const Quantity *supply = find(variant, "control.supply_resistance_ohm"),
                 *winding = find(variant, "control.resistance_ohm");
  if (supply && (supply->free ? supply->high : supply->start) > (winding->free ? winding->low : winding->start))
    in.fail("label",
            "control.supply_resistance_ohm may exceed control.resistance_ohm within these bounds; a supply loses less "
            "than the whole voltage");
}

/// One entry of `variants`; the sections of `root` apply to all variants, and those of the variant override them.
Variant read_variant(Mapping in, Mapping& root, const fs::path& folder, const Plan& plan,
                     std::optional<double> timestep_s) {
  in.accept({"label", "model", "law", "drive", "joint", "control", "motion"});
  Variant variant{.label = read_label(in, plan.variants), .timestep_s = timestep_s};
  variant.model = in.file("model", folder);
  std::vector<std::string_view> laws;
  for (const auto& law : friction::laws()) laws.push_back(law.name);
  variant.law = friction::find_law(in.choice("law", laws));
  for (const Place place : places) {
    read_section(root, place, *variant.law, variant.quantities);
    read_section(in, place, *variant.law, variant.quantities);
  }
  check_control(in, variant, plan.recordings);
  in.done();
  return variant;
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
    const auto opened = VariantTwins::open(variant);
    if (!opened)
      throw InputError(fmt::format("{}: variant '{}': {}", file.string(), variant.label, opened.error().message));
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
    for (const auto* column :
         {&r.points.time_s, &r.points.position_rad[0], &r.points.measured_rad, &r.points.temperature_degC})
      recorded.add(*column);
  }
  return recorded.value();
}

}  // namespace

Campaign read_calibration(const fs::path& file, std::optional<std::uint64_t> seed, const TableOptions& tables) {
  Campaign c{.file = file};
  const YAML::Node root = load_yaml(file);
  Mapping in(file.string(), "", root);
  in.accept({"description", "recordings", "hold_out", "reference", "error", "correlation_s", "search", "timestep_s",
             "drive", "joint", "control", "motion", "variants"});
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
