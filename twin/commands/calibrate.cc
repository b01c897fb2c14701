#include <chrono>
#include <cmath>
#include <fstream>
#include <memory>
#include <set>
#include <thread>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <fnmatch.h>
#include <glob.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/identification/calibration.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/json_input.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using namespace identification;
using Json = nlohmann::ordered_json;

constexpr Place places[] = {Place::drive, Place::joint, Place::control, Place::motion};

/// A FIT.yaml, read and checked against models and recordings.
struct Campaign {
  fs::path file;
  std::string resolved;  ///< what decides the outcome
  Plan plan;
  std::size_t reference = 0;  ///< the variant that the others are compared with
};

Quantity quantity_of(Mapping& in, Place place, const friction::LawInfo& law, const std::string& key) {
  Quantity q{.place = place, .key = key};
  const auto [minimum, maximum] = accepted_range(place, law, key);
  if (!in.raw(key).IsMap()) {
    q.start = in.number(key, {minimum, maximum});
    return q;
  }
  q.sought = true;
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

/// Adds or replaces what one section says.
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
    ::glob_t found{};
    if (::glob(full.c_str(), GLOB_ERR, nullptr, &found) == 0)
      for (std::size_t i = 0; i < found.gl_pathc; ++i)
        if (std::ranges::find(files, found.gl_pathv[i]) == files.end()) files.emplace_back(found.gl_pathv[i]);
    const bool nothing = found.gl_pathc == 0;
    ::globfree(&found);
    if (nothing) in.fail(key, fmt::format("'{}' matches no file", full));
  }
  if (files.empty()) in.fail(key, "names no file");
  return files;
}

bool matches(const std::string& pattern, const fs::path& file) {
  return ::fnmatch(pattern.c_str(), file.filename().c_str(), 0) == 0;
}

/// Texts and numbers beside the entries of a recording.
std::map<std::string, std::string> labels_of(const fs::path& file) {
  std::map<std::string, std::string> labels;
  std::ifstream stream(file);
  const auto json = nlohmann::json::parse(stream, nullptr, false);
  if (!json.is_object()) return labels;
  for (const auto& [key, value] : json.items()) {
    if (value.is_string()) labels[key] = value.get<std::string>();
    if (value.is_number()) labels[key] = fmt::format("{:g}", value.get<double>());
  }
  return labels;
}

std::vector<Recording> recordings_of(Mapping in, const fs::path& folder, const friction::LawInfo& any) {
  in.accept({"files", "settings"});
  std::vector<Recording> recordings;
  for (const auto& file : matching(in, "files", folder)) {
    auto points = read_set_points(file);
    if (!points) throw InputError(points.error().message);
    if (points->measured_rad.empty())
      in.fail("files", fmt::format("{} has no measured positions; what is needed is JSON with entries of timestamp, "
                                   "goal_position and position",
                                   file.string()));
    const auto measured = std::ranges::count_if(points->measured_rad, [](double q) { return std::isfinite(q); });
    if (measured < 10 || !std::isfinite(points->measured_rad[0]))
      in.fail("files",
              fmt::format("{} has {} measured positions; at least 10, that of the first entry among them, are needed",
                          file.string(), measured));
    recordings.push_back({.file = file, .points = std::move(*points), .labels = labels_of(file)});
  }
  for (Mapping settings : in.mappings("settings")) {
    auto accepted = keys_of(Place::control, any);
    for (const char* key : {"files", "temperature_degC", "labels"}) accepted.emplace_back(key);
    settings.accept(accepted);
    const std::string pattern = settings.text("files");
    std::vector<Recording*> meant;
    for (auto& r : recordings)
      if (matches(pattern, r.file)) meant.push_back(&r);
    if (meant.empty())
      settings.fail("files", fmt::format("'{}' matches none of the recordings, of which the first is {}", pattern,
                                         recordings[0].file.filename().string()));
    for (const auto key : keys_of(Place::control, any)) {
      const std::string text(key);
      if (!settings.has(text)) continue;
      const auto [minimum, maximum] = accepted_range(Place::control, any, key);
      const double value = settings.number(text, {minimum, maximum});
      for (Recording* r : meant) r->control.emplace_back(text, value);
    }
    if (settings.has("temperature_degC"))
      for (Recording* r : meant) r->temperature_degC = settings.number("temperature_degC", {-100, 300});
    if (auto labels = settings.mapping("labels"))
      for (const auto& label : labels->names())
        for (Recording* r : meant) r->labels[label] = labels->text(label);
    settings.done();
  }
  for (auto& r : recordings) {
    for (const auto& [key, value] : r.control)
      if (key == "kp") r.labels["kp"] = fmt::format("{:g}", value);
    if (r.labels.contains("kp")) r.labels["gain"] = r.labels["kp"];
  }
  in.done();
  return recordings;
}

Split split_of(Mapping in, const std::vector<Recording>& recordings) {
  in.accept({"name", "folds"});
  Split split;
  const YAML::Node folds = in.raw("folds");
  if (folds && folds.IsScalar()) {
    const std::string text = in.text("folds"), prefix = "by ";
    if (!text.starts_with(prefix))
      in.fail(
          "folds",
          fmt::format("is '{}' but must be 'by LABEL', such as by trajectory or by gain, or a list of lists of files",
                      text));
    const std::string label = text.substr(prefix.size());
    std::vector<std::string> order;
    std::map<std::string, std::vector<std::size_t>> groups;
    for (std::size_t i = 0; i < recordings.size(); ++i) {
      const auto found = recordings[i].labels.find(label);
      if (found == recordings[i].labels.end()) {
        std::vector<std::string> known;
        for (const auto& [name, value] : recordings[i].labels) known.push_back(name);
        in.fail("folds",
                fmt::format("'{}': {} has no label '{}'; it has {}", text, recordings[i].file.filename().string(),
                            label, known.empty() ? "none" : fmt::format("{}", fmt::join(known, ", "))));
      }
      auto& group = groups[found->second];
      if (group.empty()) order.push_back(found->second);
      group.push_back(i);
    }
    for (const auto& value : order) split.folds.push_back({value, groups[value]});
    split.name = in.text_or("name", label);
  } else if (folds && folds.IsSequence()) {
    for (const auto& fold : folds) {
      auto& made = split.folds.emplace_back();
      made.label = fmt::format("{}", split.folds.size());
      std::vector<std::string> patterns;
      if (fold.IsScalar()) patterns.push_back(fold.Scalar());
      for (const auto& item : fold) patterns.push_back(item.IsScalar() ? item.Scalar() : "");
      if (patterns.empty()) in.fail("folds", fmt::format("fold {} names no file", made.label));
      for (const auto& text : patterns) {
        bool any = false;
        for (std::size_t i = 0; i < recordings.size(); ++i)
          if (matches(text, recordings[i].file)) {
            any = true;
            if (std::ranges::find(made.held_out, i) == made.held_out.end()) made.held_out.push_back(i);
          }
        if (!any)
          in.fail("folds", fmt::format("'{}' matches none of the recordings, of which the first is {}", text,
                                       recordings[0].file.filename().string()));
      }
    }
    split.name = in.text_or("name", "files");
  } else {
    in.fail("folds", "must be 'by LABEL', such as by trajectory or by gain, or a list of lists of files");
  }
  for (const auto& fold : split.folds)
    if (fold.held_out.size() == recordings.size())
      in.fail("folds", fmt::format("fold '{}' holds out all {} recordings and leaves none to learn from", fold.label,
                                   recordings.size()));
  in.done();
  return split;
}

Campaign read_campaign(const fs::path& file, std::optional<std::uint64_t> seed) {
  Campaign c{.file = file};
  const YAML::Node root = load_yaml(file);
  Mapping in(file.string(), "", root);
  in.accept({"description", "recordings", "hold_out", "reference", "error", "correlation_s", "search", "timestep_s",
             "drive", "joint", "control", "motion", "variants"});
  const fs::path folder = fs::absolute(file).parent_path();
  in.text_or("description", "");
  const friction::LawInfo& any = friction::laws()[0];

  auto recordings = in.mapping("recordings");
  if (!recordings) in.fail("recordings", "is missing: {files: ...}");
  c.plan.recordings = recordings_of(*recordings, folder, any);

  const YAML::Node hold_out = in.raw("hold_out");
  if (hold_out && hold_out.IsMap())
    c.plan.splits.push_back(split_of(*in.mapping("hold_out"), c.plan.recordings));
  else
    for (Mapping split : in.mappings("hold_out")) c.plan.splits.push_back(split_of(split, c.plan.recordings));
  std::set<std::string> split_names;
  for (const auto& split : c.plan.splits)
    if (!split_names.insert(split.name).second)
      in.fail("hold_out", fmt::format("two splits are named '{}'; give one another name", split.name));

  SearchOptions& search = c.plan.search;
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
  std::optional<double> timestep;
  if (in.has("timestep_s"))
    timestep = in.number("timestep_s", {mujoco::shortest_timestep_s, mujoco::longest_timestep_s});

  std::string models;
  if (!in.has("variants")) in.fail("variants", "is missing: a list of {label, model, law, ...}");
  for (Mapping v : in.mappings("variants")) {
    v.accept({"label", "model", "law", "drive", "joint", "control", "motion"});
    Variant variant{.label = v.text("label"), .timestep_s = timestep};
    if (variant.label.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-") !=
        std::string::npos)
      v.fail("label", fmt::format("is '{}' but must consist of letters, digits, '_' and '-': files are named after it",
                                  variant.label));
    v.file_name_or("label", "");
    if (std::ranges::any_of(c.plan.variants, [&](const Variant& other) { return other.label == variant.label; }))
      v.fail("label", fmt::format("'{}' is the label of another variant", variant.label));
    variant.model = v.file("model", folder);
    std::vector<std::string_view> laws;
    for (const auto& law : friction::laws()) laws.push_back(law.name);
    variant.law = friction::find_law(v.choice("law", laws));
    // What all variants share comes first; their own word counts.
    for (const Place place : places) {
      read_section(in, place, *variant.law, variant.quantities);
      read_section(v, place, *variant.law, variant.quantities);
    }
    for (const auto& setting : c.plan.recordings)
      for (const auto& [key, value] : setting.control)
        for (const auto& q : variant.quantities)
          if (q.sought && q.path() == "control." + key)
            v.fail("label", fmt::format("control.{} is sought, but the settings of {} fix it", key,
                                        setting.file.filename().string()));
    const auto find = [&](const char* path) {
      return std::ranges::find_if(variant.quantities, [&](const Quantity& q) { return q.path() == path; });
    };
    for (const char* needed : {"control.error_gain", "control.supply_V", "control.resistance_ohm", "control.kt_nm_A"})
      if (find(needed) == variant.quantities.end())
        v.fail("label", fmt::format("the controller of '{}' is not complete: {} is missing, here or for all variants",
                                    variant.label, needed));
    for (const auto& r : c.plan.recordings) {
      const auto is_kp = [](const auto& number) { return number.first == "kp"; };
      if (find("control.kp") == variant.quantities.end() && std::ranges::none_of(r.points.numbers, is_kp) &&
          std::ranges::none_of(r.control, is_kp))
        v.fail("label", fmt::format("the gain of {} is not known: the file has no number 'kp', and neither "
                                    "recordings.settings nor control gives it",
                                    r.file.filename().string()));
    }
    if (const auto supply = find("control.supply_resistance_ohm"), winding = find("control.resistance_ohm");
        supply != variant.quantities.end() &&
        (supply->sought ? supply->high : supply->start) > (winding->sought ? winding->low : winding->start))
      v.fail("label",
             "control.supply_resistance_ohm may exceed control.resistance_ohm within these bounds; a supply loses less "
             "than the whole voltage");
    v.done();
    const auto opened = VariantTwins::open(variant);
    if (!opened) {
      const std::string& why = opened.error().message;
      throw InputError(why.starts_with("model: ")
                           ? fmt::format("{}: {}", file.string(), why)
                           : fmt::format("{}: variant '{}': {}", file.string(), variant.label, why));
    }
    models += fmt::format(" {:016x}", fingerprint(opened->reference()));
    c.plan.variants.push_back(std::move(variant));
  }
  if (c.plan.variants.empty()) in.fail("variants", "is empty");
  if (in.has("reference")) {
    std::vector<std::string_view> labels;
    for (const auto& v : c.plan.variants) labels.push_back(v.label);
    const std::string label = in.choice("reference", labels);
    c.reference = static_cast<std::size_t>(std::ranges::find(labels, label) - labels.begin());
  }
  in.done();
  Fingerprint recorded;
  for (const auto& r : c.plan.recordings) {
    recorded.add(r.file.string());
    for (const auto* column :
         {&r.points.time_s, &r.points.position_rad[0], &r.points.measured_rad, &r.points.temperature_degC})
      recorded.add(*column);
  }
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << root;
  c.resolved = fmt::format("{}\n# seed {}\n# models{}\n# recordings {:016x}\n# {}\n# MuJoCo {}\n", out.c_str(),
                           search.seed, models, recorded.value(), TRIBOTWIN_VERSION, mj_versionString());
  return c;
}

// Results: fits by (variant, split, fold), the same in memory, in calibration.json and on the way back from there.

struct Results {
  const Campaign& campaign;
  std::vector<SimulationFit> fits;

  const SimulationFit* find(std::size_t variant, std::size_t split, std::size_t fold) const {
    const auto found = std::ranges::find_if(
        fits, [&](const SimulationFit& f) { return f.variant == variant && f.split == split && f.fold == fold; });
    return found == fits.end() ? nullptr : &*found;
  }
  std::size_t wanted() const {
    std::size_t each = 1;
    for (const auto& s : campaign.plan.splits) each += s.folds.size();
    return each * campaign.plan.variants.size();
  }
  bool complete() const { return fits.size() == wanted(); }

  const std::vector<std::size_t>& held_out(const SimulationFit& f) const {
    static const std::vector<std::size_t> none;
    return f.split == SimulationFit::all ? none : campaign.plan.splits[f.split].folds[f.fold].held_out;
  }
  /// Mean over the recordings that were (not) held out [mrad].
  double mae(const SimulationFit& f, bool unseen) const {
    const auto& out = held_out(f);
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < f.mae_mrad.size(); ++i)
      if ((std::ranges::find(out, i) != out.end()) == unseen) sum += f.mae_mrad[i], ++count;
    return sum / count;
  }
  /// Over all held-out recordings of a split, each fold's its own fit; NaN before all folds are there.
  double mae(std::size_t variant, std::size_t split, bool unseen) const {
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < campaign.plan.splits[split].folds.size(); ++k) {
      const SimulationFit* f = find(variant, split, k);
      if (!f) return std::nan("");
      const auto out = static_cast<double>(held_out(*f).size()),
                 recordings = unseen ? out : static_cast<double>(f->mae_mrad.size()) - out;
      sum += mae(*f, unseen) * recordings, count += recordings;
    }
    return sum / count;
  }
  /// Over all splits.
  double held_out_mae(std::size_t variant) const {
    double sum = 0;
    for (std::size_t s = 0; s < campaign.plan.splits.size(); ++s) sum += mae(variant, s, true);
    return sum / static_cast<double>(campaign.plan.splits.size());
  }
};

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

Json json_of(const Results& r, const SimulationFit* f) {
  if (!f) return nullptr;
  const Plan& plan = r.campaign.plan;
  const Variant& v = plan.variants[f->variant];
  Json j;
  if (f->split != SimulationFit::all) {
    j["fold"] = plan.splits[f->split].folds[f->fold].label;
    j["held_out_mae_mrad"] = number(r.mae(*f, true));
  }
  j["learning_mae_mrad"] = number(r.mae(*f, false));
  j["objective"] = f->objective;
  j["minima"] = Json::array();
  for (const double m : f->minima) j["minima"].push_back(number(m));
  for (std::size_t i = 0; i < v.quantities.size(); ++i) {
    Json q{{"value", f->values[i]}};
    if (f->split == SimulationFit::all) {
      q["sigma"] = number(f->sigma[i]);
      q["status"] = name(f->knowledge[i]);
    }
    j["parameters"][v.quantities[i].path()] = std::move(q);
  }
  if (f->split == SimulationFit::all) {
    j["correlation"] = Json::object();
    for (std::size_t i = 0; i < v.quantities.size(); ++i)
      for (std::size_t k = 0; k < v.quantities.size(); ++k)
        if (const double x = f->correlation(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
            std::isfinite(x))
          j["correlation"][v.quantities[i].path()][v.quantities[k].path()] = x;
  }
  const auto& out = r.held_out(*f);
  for (std::size_t i = 0; i < f->mae_mrad.size(); ++i)
    j["recordings"].push_back({{"file", plan.recordings[i].file.filename().string()},
                               {"held_out", std::ranges::find(out, i) != out.end()},
                               {"mae_mrad", number(f->mae_mrad[i])}});
  return j;
}

Json json_of(const Results& r) {
  const Plan& plan = r.campaign.plan;
  Json j{{"complete", r.complete()},
         {"error", plan.search.norm == Norm::squared ? "squared" : "absolute"},
         {"correlation_s", plan.search.correlation_s},
         {"search",
          {{"starts", plan.search.starts}, {"evaluations", plan.search.evaluations}, {"seed", plan.search.seed}}},
         {"reference", plan.variants[r.campaign.reference].label},
         {"variants", Json::array()}};
  for (const auto& recording : plan.recordings) {
    Json labels = Json::object();
    for (const auto& [key, value] : recording.labels) labels[key] = value;
    j["recordings"].push_back(
        {{"file", recording.file.string()}, {"duration_s", recording.duration_s()}, {"labels", labels}});
  }
  for (std::size_t v = 0; v < plan.variants.size(); ++v) {
    const Variant& variant = plan.variants[v];
    Json one{{"label", variant.label},
             {"law", variant.law->name},
             {"sought", std::ranges::count_if(variant.quantities, &Quantity::sought)},
             {"held_out_mae_mrad", number(r.held_out_mae(v))},
             {"ratio", number(r.held_out_mae(v) / r.held_out_mae(r.campaign.reference))},
             {"all", json_of(r, r.find(v, SimulationFit::all, 0))},
             {"splits", Json::array()}};
    for (std::size_t s = 0; s < plan.splits.size(); ++s) {
      Json split{{"name", plan.splits[s].name},
                 {"learning_mae_mrad", number(r.mae(v, s, false))},
                 {"held_out_mae_mrad", number(r.mae(v, s, true))},
                 {"ratio", number(r.mae(v, s, true) / r.mae(r.campaign.reference, s, true))},
                 {"folds", Json::array()}};
      for (std::size_t k = 0; k < plan.splits[s].folds.size(); ++k)
        split["folds"].push_back(json_of(r, r.find(v, s, k)));
      one["splits"].push_back(std::move(split));
    }
    j["variants"].push_back(std::move(one));
  }
  j["fit"] = r.campaign.resolved;
  return j;
}

/// The same with a checksum of all else as its last key.
Json with_checksum(Json j) {
  j.erase("crc32");
  j["crc32"] = fmt::format("{:08x}", crc32(j.dump()));
  return j;
}

bool checksum_holds(const Json& j) { return with_checksum(j)["crc32"] == j.at("crc32"); }

/// A fit as json_of(Results, SimulationFit) wrote it.
SimulationFit fit_of(const Campaign& campaign, const JsonInput& in, SimulationFit f) {
  const auto& quantities = campaign.plan.variants[f.variant].quantities;
  f.objective = in["objective"].number({-1e300, 1e300});
  for (const auto& m : in["minima"].list(0))
    f.minima.push_back(m.is_null() ? std::numeric_limits<double>::infinity() : m.number({-1e300, 1e300}));
  const JsonInput parameters = in["parameters"];
  for (const auto& q : quantities) {
    const JsonInput p = parameters[q.path()];
    f.values.push_back(p["value"].number({-1e300, 1e300}));
    f.sigma.push_back(p.has("sigma") ? p["sigma"].number_or_null({0, 1e300}) : std::nan(""));
    f.knowledge.push_back(q.sought ? ParameterStatus::estimated : ParameterStatus::known);
    const std::string status = p.has("status") ? p["status"].text() : "";
    for (const auto k : {ParameterStatus::prior, ParameterStatus::at_bound})
      if (status == name(k)) f.knowledge.back() = k;
  }
  const auto n = std::ssize(quantities);
  f.correlation = Eigen::MatrixXd::Constant(n, n, std::nan(""));
  for (std::size_t a = 0; in.has("correlation") && a < quantities.size(); ++a)
    for (std::size_t b = 0; b < quantities.size(); ++b)
      if (const JsonInput all = in["correlation"];
          all.has(quantities[a].path()) && all[quantities[a].path()].has(quantities[b].path()))
        f.correlation(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) =
            all[quantities[a].path()][quantities[b].path()].number({-1.000001, 1.000001});
  const std::size_t recordings = campaign.plan.recordings.size();
  for (const auto& recording : in["recordings"].list(recordings, recordings))
    f.mae_mrad.push_back(recording["mae_mrad"].number_or_null({0, 1e300}));
  return f;
}

/// The fits that the folder already holds; none where it holds no calibration. Throws InputError where it holds
/// another.
std::vector<SimulationFit> fits_of(const Campaign& campaign, const fs::path& file) {
  std::vector<SimulationFit> fits;
  std::error_code error;
  if (!fs::exists(file, error)) return fits;
  std::ifstream stream(file);
  const Json written = Json::parse(stream, nullptr, false);  // in its own order, which the checksum is of
  const nlohmann::json j = written;
  const auto refuse = [&](const std::string& what) {
    throw InputError(fmt::format("{}: {}; choose another folder with -o, or remove this one", file.string(), what));
  };
  if (!j.is_object() || !j.contains("fit")) refuse("is no calibration");
  if (j.contains("crc32") && !checksum_holds(written)) refuse("was changed since it was made (checksum)");
  if (j["fit"] != campaign.resolved)
    refuse("holds another calibration (its FIT file, models, recordings, seed or versions differ)");
  const auto take = [&](const JsonInput& in, std::size_t variant, std::size_t split, std::size_t fold) {
    if (!in.is_null()) fits.push_back(fit_of(campaign, in, {.variant = variant, .split = split, .fold = fold}));
  };
  const auto& plan = campaign.plan;
  try {
    const auto variants = JsonInput(j, "")["variants"].list(plan.variants.size(), plan.variants.size());
    for (std::size_t v = 0; v < variants.size(); ++v) {
      take(variants[v]["all"], v, SimulationFit::all, 0);
      const auto splits = variants[v]["splits"].list(plan.splits.size(), plan.splits.size());
      for (std::size_t s = 0; s < splits.size(); ++s) {
        const auto folds = splits[s]["folds"].list(plan.splits[s].folds.size(), plan.splits[s].folds.size());
        for (std::size_t k = 0; k < folds.size(); ++k) take(folds[k], v, s, k);
      }
    }
  } catch (const InputError& e) {
    refuse(e.what());
  }
  return fits;
}

std::string table_of(const Results& r) {
  const Plan& plan = r.campaign.plan;
  const std::size_t reference = r.campaign.reference;
  const auto cell = [](double x) { return std::isfinite(x) ? fmt::format("{:.1f}", x) : std::string("-"); };
  const auto ratio = [](double a, double b) {
    return std::isfinite(a / b) ? fmt::format("{:.2f}", a / b) : std::string("-");
  };
  std::string s =
      fmt::format("mean absolute error of position [mrad], mean over recordings; ratio to {}\n\n{:<24}{:>9}",
                  plan.variants[reference].label, "", "all");
  for (const auto& split : plan.splits) s += fmt::format(" | {:^25}", ("by " + split.name).substr(0, 25));
  if (plan.splits.size() > 1) s += fmt::format(" | {:^16}", "all splits");
  s += fmt::format("\n{:<17}{:>7}{:>9}", "variant", "sought", "learnt");
  for (std::size_t k = 0; k < plan.splits.size(); ++k)
    s += fmt::format(" | {:>8} {:>9} {:>6}", "learnt", "held out", "ratio");
  if (plan.splits.size() > 1) s += fmt::format(" | {:>9} {:>6}", "held out", "ratio");
  s += '\n';
  for (std::size_t v = 0; v < plan.variants.size(); ++v) {
    const SimulationFit* all = r.find(v, SimulationFit::all, 0);
    s += fmt::format("{:<17}{:>7}{:>9}", plan.variants[v].label,
                     std::ranges::count_if(plan.variants[v].quantities, &Quantity::sought),
                     all ? cell(r.mae(*all, false)) : "-");
    for (std::size_t k = 0; k < plan.splits.size(); ++k)
      s += fmt::format(" | {:>8} {:>9} {:>6}", cell(r.mae(v, k, false)), cell(r.mae(v, k, true)),
                       ratio(r.mae(v, k, true), r.mae(reference, k, true)));
    if (plan.splits.size() > 1)
      s += fmt::format(" | {:>9} {:>6}", cell(r.held_out_mae(v)), ratio(r.held_out_mae(v), r.held_out_mae(reference)));
    s += '\n';
  }
  for (std::size_t k = 0; k < plan.splits.size(); ++k) {
    s += fmt::format("\n{:<24}", fmt::format("held out by {}", plan.splits[k].name).substr(0, 23));
    for (const auto& fold : plan.splits[k].folds) s += fmt::format("{:>17}", fold.label.substr(0, 16));
    for (std::size_t v = 0; v < plan.variants.size(); ++v) {
      s += fmt::format("\n{:<24}", plan.variants[v].label);
      for (std::size_t f = 0; f < plan.splits[k].folds.size(); ++f) {
        const SimulationFit *one = r.find(v, k, f), *rival = r.find(reference, k, f);
        s += fmt::format("{:>17}", one && rival ? fmt::format("{} ({})", cell(r.mae(*one, true)),
                                                              ratio(r.mae(*one, true), r.mae(*rival, true)))
                                                : "-");
      }
    }
    s += '\n';
  }
  return s;
}

/// VARIANT.params.yaml (the law), VARIANT.xml (the model) and VARIANT.yaml (a scenario that runs them).
Result<void> write_found(const Results& r, const SimulationFit& f, const fs::path& directory, Existing existing) {
  const Variant& variant = r.campaign.plan.variants[f.variant];
  const auto opened = VariantTwins::open(variant);
  if (!opened) return tl::unexpected(opened.error());
  const auto made = opened->candidate(f.values);
  if (!made) return tl::unexpected(made.error());
  const drive::Drive& drive = made->model->drives()[0].drive;
  ParameterFile file{.law = drive.law, .torque_max_nm = drive.torque_max_nm, .gear_ratio = drive.gear_ratio};
  const auto& parameters = drive.law.info->parameters;
  const auto quantity = [&](std::string_view name) {
    return std::ranges::find(variant.quantities, fmt::format("drive.{}", name), &Quantity::path) -
           variant.quantities.begin();
  };
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    const auto& p = parameters[i];
    Estimate e{.name = std::string(p.name),
               .unit = std::string(p.unit),
               .value = drive.law.parameters[i],
               .sigma = std::nan(""),
               .low = std::nan(""),
               .high = std::nan(""),
               .status = identification::Status::fixed};
    if (const auto at = static_cast<std::size_t>(quantity(p.name)); at < variant.quantities.size()) {
      using enum identification::Status;
      const ParameterStatus k = f.knowledge[at];
      e.status = k == ParameterStatus::estimated  ? estimated
                 : k == ParameterStatus::prior    ? held
                 : k == ParameterStatus::at_bound ? at_bound
                                                  : fixed;
      if (k == ParameterStatus::prior) file.found.unidentifiable.emplace_back(p.name);
      if (k == ParameterStatus::estimated)
        e.sigma = f.sigma[at], e.low = e.value - 1.96 * e.sigma, e.high = e.value + 1.96 * e.sigma;
    }
    file.found.parameters.push_back(std::move(e));
  }
  file.found.covariance = Eigen::MatrixXd::Constant(std::ssize(parameters), std::ssize(parameters), std::nan(""));
  for (std::size_t i = 0; i < parameters.size(); ++i)
    for (std::size_t k = 0; k < parameters.size(); ++k)
      if (const auto a = quantity(parameters[i].name), b = quantity(parameters[k].name);
          std::max(a, b) < std::ssize(variant.quantities))
        file.found.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) =
            f.correlation(a, b) * file.found.parameters[i].sigma * file.found.parameters[k].sigma;
  for (const auto& recording : r.campaign.plan.recordings) {
    file.data.push_back(recording.file.string());
    file.found.samples += recording.points.time_s.size();
  }
  file.found.notes.push_back(
      fmt::format("found by simulation (tribotwin calibrate {}): mean absolute error of position {:.1f} mrad; of "
                  "friction itself nothing was measured, so its residual is not known",
                  r.campaign.file.string(), r.mae(f, false)));
  const Recording& shown = r.campaign.plan.recordings[0];
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << YAML::BeginMap << YAML::Key << "description" << YAML::Value
      << fmt::format("{}: found by tribotwin calibrate {}", variant.label, r.campaign.file.filename().string());
  out << YAML::Key << "model" << YAML::Value << variant.label + ".xml" << YAML::Key << "motion" << YAML::Value
      << YAML::Flow << YAML::BeginMap;
  out << YAML::Key << "type" << YAML::Value << "recording" << YAML::Key << "file" << YAML::Value
      << fs::absolute(shown.file).string();
  out << YAML::Key << "delay_s" << YAML::Value << opened->delay_s(f.values) << YAML::EndMap << YAML::Key << "control"
      << YAML::Value << YAML::Flow << YAML::BeginMap;
  out << YAML::Key << "type" << YAML::Value << "dc_position";
  for (std::size_t q = 0; q < variant.quantities.size(); ++q)
    if (variant.quantities[q].place == Place::control &&
        std::ranges::find(shown.control, variant.quantities[q].key, [](const auto& c) { return c.first; }) ==
            shown.control.end())
      out << YAML::Key << variant.quantities[q].key << YAML::Value << f.values[q];
  for (const auto& [key, value] : shown.control) out << YAML::Key << key << YAML::Value << value;
  out << YAML::EndMap;
  if (shown.temperature_degC) out << YAML::Key << "temperature_degC" << YAML::Value << *shown.temperature_degC;
  if (variant.timestep_s) out << YAML::Key << "timestep_s" << YAML::Value << *variant.timestep_s;
  out << YAML::Key << "telemetry_rate_hz" << YAML::Value << 250 << YAML::EndMap;
  for (std::size_t q = 0; q < variant.quantities.size(); ++q)
    if (variant.quantities[q].place != Place::drive && variant.quantities[q].sought)
      file.found.notes.push_back(fmt::format("{} = {:.6g}{} ({})", variant.quantities[q].path(), f.values[q],
                                             std::isfinite(f.sigma[q]) ? fmt::format(" +- {:.2g}", f.sigma[q]) : "",
                                             name(f.knowledge[q])));
  for (const auto& [ending, text] : {std::pair<std::string, std::string>{".xml", opened->mjcf(f.values)},
                                     {".yaml", std::string(out.c_str()) + "\n"},
                                     {".params.yaml", to_yaml(file)}})
    if (const auto ok = write_derived(directory / (variant.label + ending), text, existing); !ok) return ok;
  return {};
}

struct Arguments {
  std::string fit, directory;
  std::optional<std::uint64_t> seed;
  unsigned threads = std::max(1u, std::thread::hardware_concurrency());
  bool json = false, quiet = false, force = false;
};

Result<Exit> execute(const Arguments& a) {
  const Campaign campaign = read_campaign(scenario_file(a.fit), a.seed);
  const fs::path directory = a.directory.empty() ? fs::path("runs") / campaign.file.stem() : fs::path(a.directory),
                 file = directory / "calibration.json";
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) return work_failed(fmt::format("{}: cannot be made ({})", directory.string(), error.message()));
  FolderLock lock;
  if (auto ok = lock.take(directory); !ok) return work_failed(ok.error().message);
  Results results{campaign, fits_of(campaign, file)};
  if (!results.fits.empty() && !a.quiet)
    note("goes on from {}, where {} of {} fits are done", file.string(), results.fits.size(), results.wanted());

  catch_interrupts();
  std::string write_error;
  const auto save = [&] {
    if (const auto ok = write_file(file, with_checksum(json_of(results)).dump(1) + "\n", Existing::replace);
        !ok && write_error.empty()) {
      write_error = ok.error().message;
      interrupted() = true;  // no use going on
    }
  };
  const auto outcome = [&] {
    Progress progress(a.quiet, "calibrating");
    const auto started = std::chrono::steady_clock::now();
    return calibrate(
        campaign.plan, results.fits,
        {.threads = a.threads,
         .stop = &interrupted(),
         .progress =
             [&](double share) {
               progress(share, share > 0.01
                                   ? std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count() *
                                         (1 / share - 1)
                                   : -1);
             },
         .done =
             [&](const SimulationFit& fit) {
               results.fits.push_back(fit);
               save();
             }});
  }();
  if (!write_error.empty()) return work_failed(write_error);
  if (!outcome) return work_failed(outcome.error().message);
  if (!results.complete())
    return work_failed(
        results.fits.empty()
            ? "interrupted before the first fit was done; nothing is written"
            : fmt::format("interrupted; {} of {} fits are kept in {}, the same command goes on from there",
                          results.fits.size(), results.wanted(), file.string()));
  for (std::size_t v = 0; v < campaign.plan.variants.size(); ++v)
    if (const auto ok = write_found(results, *results.find(v, SimulationFit::all, 0), directory, replace_if(a.force));
        !ok)
      return work_failed(ok.error().message);
  return deliver(a.json ? json_of(results).dump(1) + "\n" : table_of(results));
}

}  // namespace

void add_calibrate(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c =
      app.add_subcommand("calibrate", "Parameters of whole twins from recorded motions, tested on those held out");
  c->add_option("FIT", a->fit, "What is sought from which recordings (twin/README.md), or the name of a shipped one")
      ->required();
  c->add_option("-o,--output", a->directory, "Folder for calibration.json and the twins found (default: runs/NAME)");
  c->add_option("--seed", a->seed, "Seed of the search");
  c->add_option("--threads", a->threads, "Processors to use; they change nothing but the time")
      ->check(CLI::Range(1, 256));
  c->add_flag("--json", a->json, "Print calibration.json instead of the table");
  c->add_flag("--quiet", a->quiet, "No progress, no notes");
  c->add_flag("--force", a->force, "Replace twins that were changed since they were found");
  c->footer("Example:\n  tribotwin calibrate xl330_fit -o runs/xl330_fit");
  c->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
