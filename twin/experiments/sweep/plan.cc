#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <set>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/experiments/sweep/plan.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::sweep {
namespace {

namespace fs = std::filesystem;

constexpr double most_values = 2e8;  ///< numbers of a design: 1.6 GB
constexpr std::string_view keys_of_a_plan[] = {"scenario", "set",       "factors",    "parameters",
                                               "design",   "outputs",   "stop",       "quantiles",
                                               "bands",    "telemetry", "description"};
/// That a sweep adds to the plan in its campaign.yaml.
constexpr const char* keys_of_a_campaign[] = {"resolved_scenario", "parameters_crc32", "runs"};

/// As of --set.
std::string setting_of(const std::string& key, const std::string& value) { return fmt::format("{}={}", key, value); }

/// One section after the other, in the order in which they need each other. Everything throws InputError.
class Reader {
 public:
  explicit Reader(const fs::path& file) : root_(load_yaml(file)), in_(file.string(), "", root_) { plan_.file = file; }

  Plan read() {
    std::vector<std::string_view> accepted(std::begin(keys_of_a_plan), std::end(keys_of_a_plan));
    if (is_campaign())
      for (const auto* key : keys_of_a_campaign) accepted.push_back(key), (void)in_.raw(key);
    else
      plan_.name = plan_.file.stem().string();
    in_.accept(accepted);
    plan_.description = in_.text_or("description", "");
    plan_.telemetry = in_.flag_or("telemetry", false);
    read_scenario();
    read_set();
    read_factors();
    read_parameters();
    read_design();
    try_scenarios();
    read_outputs();
    read_quantiles();
    read_bands();
    read_stop();
    in_.done();
    resolve();
    if (is_campaign()) require_unchanged();
    return std::move(plan_);
  }

 private:
  void read_scenario() {
    const std::string given = in_.text("scenario");
    const fs::path here = (fs::absolute(plan_.file).parent_path() / given).lexically_normal();
    std::error_code error;
    try {
      plan_.scenario = fs::exists(here, error) ? here : given_or_shipped(given, ".yaml");
    } catch (const InputError& e) {
      in_.fail("scenario", e.what());  // with the place of the name
    }
    if (!fs::is_regular_file(plan_.scenario, error))
      in_.fail("scenario", fmt::format("'{}' does not exist; give a scenario file, relative to the plan, or one of "
                                       "'tribotwin list scenarios'",
                                       given));
    plan_.scenario = fs::absolute(plan_.scenario);
    if (load_yaml(plan_.scenario)["vary"])
      plan_.notes.push_back("the scenario's own 'vary' is left out: a sweep has factors instead");
  }

  /// A mapping or a dotted key down to its values.
  void add_settings(const std::string& prefix, const YAML::Node& node) {
    if (!node.IsMap()) {
      YAML::Emitter flow;
      flow << YAML::Flow << node;
      take_key(prefix, "set");
      plan_.common.push_back(setting_of(prefix, flow.c_str()));
      return;
    }
    for (const auto& entry : node)
      add_settings((prefix.empty() ? "" : prefix + ".") + entry.first.Scalar(), entry.second);
  }

  void read_set() {
    if (const auto set = in_.mapping("set")) add_settings("", root_["set"]);
  }

  /// Each key of the scenario is given once in a plan.
  void take_key(const std::string& key, const std::string& section) {
    if (key == "vary") in_.fail(section, "'vary' has no effect in a sweep; use factors");
    for (const auto& other : taken_)
      if (other == key || other.starts_with(key + ".") || key.starts_with(other + "."))
        in_.fail(section, fmt::format("'{}' collides with '{}', which the plan sets too; give each key of the scenario "
                                      "once",
                                      key, other));
    taken_.insert(key);
  }

  void read_factors() {
    auto factors = in_.mapping("factors");
    if (!factors) return;
    for (const auto& key : factors->names()) {
      take_key(key, "factors");
      plan_.factors.push_back(read_factor(*factors, key));
    }
  }

  void read_parameters() {
    const YAML::Node node = in_.raw("parameters");
    if (!node && plan_.factors.empty())
      in_.fail("factors", "is missing: give keys of the scenario to vary, or 'parameters' to draw");
    if (!node) return;
    // The model that the drawn parameters are for: the first of the plan.
    const Scenario first = or_wrong_input(load_scenario(plan_.scenario, settings_without_parameters()));
    plan_.model = first.model;
    if (node.IsMap())
      read_parameters_by_joint(*in_.mapping("parameters"));
    else
      read_parameter_file();
    for (const auto& set : plan_.parameters) {
      for (const auto& [key, value] : set.fixed) take_key(key, "parameters");
      for (const auto& key : set.keys) take_key(key, "parameters");
      plan_.notes.insert(plan_.notes.end(), set.notes.begin(), set.notes.end());
    }
  }

  void read_parameters_by_joint(Mapping joints) {
    if (joints.names().empty())
      in_.fail("parameters", "is empty; give a file, or one per joint: {JOINT: PARAMS.yaml}, or leave it out");
    for (const auto& joint : joints.names()) {
      const fs::path file = joints.file(joint, fs::absolute(plan_.file).parent_path());
      files_[joint] = fs::absolute(file).lexically_normal().string();
      auto set = law_parameters(file, *plan_.model, joint);
      if (!set) joints.fail(joint, set.error().message);
      plan_.parameters.push_back(std::move(*set));
      add_checksum(file);
    }
  }

  void read_parameter_file() {
    const fs::path file = in_.file("parameters", fs::absolute(plan_.file).parent_path());
    add_checksum(file);
    files_ = fs::absolute(file).lexically_normal().string();
    const auto fail = [&](const std::string& why) { in_.fail("parameters", why); };
    if (is_of_dynamics(file)) {
      auto sets = robot_parameters(file, *plan_.model);
      if (!sets) fail(sets.error().message);
      plan_.parameters = std::move(*sets);
      return;
    }
    const auto drives = plan_.model->drives();
    if (drives.size() != 1)
      fail(fmt::format("is a law of one joint, and the model has {}; name the joint: parameters: {{{}: {}}}",
                       drives.size(), joint_name(plan_.model->get(), drives[0]), root_["parameters"].Scalar()));
    auto set = law_parameters(file, *plan_.model, joint_name(plan_.model->get(), drives[0]));
    if (!set) fail(set.error().message);
    plan_.parameters.push_back(std::move(*set));
  }

  void add_checksum(const fs::path& file) {
    checksums_.push_back(fmt::format("{:08x}", crc32(or_throw(read_text(file, "a PARAMS.yaml")))));
  }

  std::vector<std::string> settings_without_parameters() const {
    std::vector<std::string> settings = plan_.common;
    for (const Factor& f : plan_.factors) settings.push_back(setting_of(f.key, f.trial_values().front()));
    return settings;
  }

  std::size_t dimensions() const {
    std::size_t all = plan_.factors.size();
    for (const auto& set : plan_.parameters) all += set.size();
    return all;
  }

  void read_design() {
    auto design = in_.mapping("design");
    if (!design) in_.fail("design", "is missing, for example design: {type: sobol, runs: 256, seed: 1}");
    design->accept({"type", "runs", "seed", "indices"});
    plan_.type = choice_of(*design, "type", design_types);
    plan_.seed = design->whole_or("seed", 1, {0, 9007199254740992.0});
    const bool indices = design->flag_or("indices", false);
    if (plan_.type == DesignType::grid)
      read_grid(*design, indices);
    else
      read_sample(*design, indices);
    design->done();
  }

  void read_grid(Mapping& design, bool indices) {
    if (indices) design.fail("indices", "is not needed: a full grid gives the indices by itself");
    if (!plan_.parameters.empty())
      design.fail("type", "is grid, but 'parameters' are drawn at random; use latin_hypercube, sobol or random");
    double runs = 1;
    for (const Factor& f : plan_.factors) {
      if (f.kind != Factor::Kind::levels)
        design.fail("type",
                    fmt::format("is grid, but '{}' is a distribution; give it a list or {{from, to, count}}, or "
                                "use another design",
                                f.key));
      runs *= static_cast<double>(f.levels.size());
    }
    if (runs > most_runs)
      design.fail("type", fmt::format("makes {:.3g} runs; at most {:g} are possible", runs, most_runs));
    plan_.runs = plan_.asked = static_cast<std::size_t>(runs);
    if (design.has("runs") && design.whole("runs", {1, most_runs}) != plan_.runs)
      design.fail("runs", fmt::format("is not what a grid of these factors has, {}; leave it out", plan_.runs));
    if (design.has("seed")) design.fail("seed", "has no effect on a grid; leave it out");
  }

  void read_sample(Mapping& design, bool indices) {
    plan_.asked = plan_.runs = design.whole("runs", {2, most_runs});
    std::size_t points = plan_.runs, width = dimensions();
    if (indices) {
      plan_.saltelli.emplace();
      for (std::size_t f = 0; f < plan_.factors.size(); ++f) plan_.saltelli->column_group.push_back(f);
      for (std::size_t s = 0; s < plan_.parameters.size(); ++s)
        plan_.saltelli->column_group.insert(plan_.saltelli->column_group.end(), plan_.parameters[s].size(),
                                            plan_.factors.size() + s);
      const std::size_t block = plan_.saltelli->block();
      points = plan_.runs / block, width *= 2;
      if (points < 8)
        design.fail("runs", fmt::format("is {}, but indices of {} factors need at least {} (8 base points x ({} + 2))",
                                        plan_.runs, block - 2, 8 * block, block - 2));
      plan_.saltelli->base_points = points;
      plan_.runs = points * block;
    }
    if (plan_.type == DesignType::sobol && width > sobol_dimensions())
      design.fail("type", fmt::format("is sobol, but {} dimensions are needed and {} are possible; use latin_hypercube",
                                      width, sobol_dimensions()));
    if (static_cast<double>(points) * static_cast<double>(width) > most_values)
      design.fail("runs",
                  fmt::format("times the number of dimensions, {}, must not be above {:g}", width, most_values));
    plan_.points = unit_points(plan_.type, points, width, plan_.seed);
  }

  /// The values that are tried first of all factors, and the estimates of all parameters.
  std::vector<std::string> typical_settings() const {
    std::vector<std::string> settings = settings_without_parameters();
    for (const auto& set : plan_.parameters) {
      for (const auto& [key, value] : set.fixed) settings.push_back(setting_of(key, value));
      for (std::size_t p = 0; p < set.size(); ++p)
        settings.push_back(fmt::format("{}={}", set.keys[p], set.mean(static_cast<Eigen::Index>(p))));
    }
    return settings;
  }

  /// A typical scenario, and those at the ends of each factor.
  void try_scenarios() {
    auto typical = load_scenario(plan_.scenario, typical_settings());
    if (!typical) in_.fail("scenario", typical.error().message);
    typical_ = std::move(*typical);
    plan_.model = typical_->model;
    for (const Factor& f : plan_.factors)
      for (const auto& value : f.trial_values()) {
        std::vector<std::string> settings = typical_settings();
        for (auto& setting : settings)
          if (setting.starts_with(f.key + "=")) setting = setting_of(f.key, value);
        if (const auto tried = load_scenario(plan_.scenario, settings); !tried)
          in_.mapping("factors")->fail(f.key, fmt::format("{}: {}", value, tried.error().message));
      }
    const std::atomic<bool> at_once = true;
    summary_ =
        or_wrong_input(run(*typical_, {.directory = {}, .stop = &at_once, .progress = {}, .sample = {}, .cycle = {}}));
  }

  void add_output(const std::string& name, const std::string& expression) {
    if (std::ranges::find(plan_.outputs, name, &Output::name) != plan_.outputs.end())
      in_.fail("outputs", fmt::format("'{}' is given twice", name));
    const auto keys = plan_.keys();
    if (name == "run" || name == "status" || name == "message" || std::ranges::find(keys, name) != keys.end())
      in_.fail("outputs", fmt::format("'{}' is the name of another column; give the output another name: {{NAME: {}}}",
                                      name, expression));
    auto output = parse_output(name, expression, *typical_, summary_);
    if (!output) in_.fail("outputs", fmt::format("'{}': {}", expression, output.error().message));
    if (std::ranges::find(keys, "duration_s") != keys.end())
      output->range.high = std::numeric_limits<double>::infinity();
    plan_.outputs.push_back(std::move(*output));
  }

  void read_outputs() {
    const YAML::Node node = in_.raw("outputs");
    if (!node || node.size() == 0)
      in_.fail("outputs", "is missing: give at least one, for example [heat_J, max(JOINT.temperature_degC)]");
    if (node.IsMap()) {
      auto named = in_.mapping("outputs");
      for (const auto& name : named->names()) add_output(name, named->text(name));
      return;
    }
    for (const auto& expression : in_.texts("outputs")) add_output(expression, expression);
  }

  void read_quantiles() {
    plan_.quantiles = {0.025, 0.25, 0.5, 0.75, 0.975};
    if (!in_.has("quantiles")) return;
    plan_.quantiles = in_.numbers("quantiles", {1e-6, 1 - 1e-6});
    if (plan_.quantiles.empty() || !std::ranges::is_sorted(plan_.quantiles, std::less_equal<>{}))
      in_.fail("quantiles", "must be ascending probabilities between 0 and 1, for example [0.025, 0.5, 0.975]");
  }

  void read_bands() {
    auto bands = in_.mapping("bands");
    if (!bands) return;
    bands->accept({"telemetry", "times", "times_s"});
    for (const auto& name : bands->texts("telemetry")) {
      auto signal = find_signal(name, *typical_);
      if (!signal) bands->fail("telemetry", signal.error().message);
      if (std::ranges::find(plan_.bands, name, &Signal::name) != plan_.bands.end())
        bands->fail("telemetry", fmt::format("'{}' is given twice", name));
      plan_.bands.push_back(std::move(*signal));
    }
    if (plan_.bands.empty()) bands->fail("telemetry", "is missing: a list of JOINT.CHANNEL");
    if (bands->has("times") && bands->has("times_s")) bands->fail("times", "is given beside times_s; give one of both");
    if (bands->has("times_s")) {
      plan_.band_times_s = bands->numbers("times_s", {0, 1e9});
      if (plan_.band_times_s.empty() || !std::ranges::is_sorted(plan_.band_times_s, std::less_equal<>{}))
        bands->fail("times_s", "must be ascending times [s]");
      if (plan_.band_times_s.back() > typical_->duration_s)
        bands->fail("times_s", fmt::format("goes to {:g} s, but the run lasts {:g} s", plan_.band_times_s.back(),
                                           typical_->duration_s));
    } else {
      set_band_times(bands->whole_or("times", 100, {2, 100000}));
    }
    bands->done();
  }

  /// `count` times of samples that all runs have, evenly from the first to the last.
  void set_band_times(std::size_t count) {
    const bool cycles = std::ranges::any_of(plan_.bands, &Signal::of_cycles);
    const double timestep_s = (*typical_->model)->opt.timestep;
    const double period_s =
        cycles ? static_cast<double>(std::llround(typical_->motion->period_s() / timestep_s)) * timestep_s
               : static_cast<double>(steps_per_sample(*typical_)) * timestep_s;
    const double samples = std::floor(typical_->duration_s / period_s * (1 + 1e-12) - (cycles ? 0 : 1e-6));
    for (std::size_t i = 0; i < count; ++i) {
      const double t = std::round(samples * static_cast<double>(i) / static_cast<double>(count - 1)) * period_s;
      if (plan_.band_times_s.empty() || t > plan_.band_times_s.back()) plan_.band_times_s.push_back(t);
    }
  }

  void read_stop() {
    auto stop = in_.mapping("stop");
    if (!stop) return;
    stop->accept({"narrower_than", "failures"});
    if (stop->has("failures")) plan_.failures = stop->whole("failures", {0, most_runs});
    if (auto widths = stop->mapping("narrower_than")) {
      if (!plan_.sampled() || plan_.type == DesignType::latin_hypercube)
        stop->fail("narrower_than", "needs a design whose beginning is a sample by itself: sobol or random");
      for (const auto& name : widths->names()) {
        const auto output = std::ranges::find(plan_.outputs, name, &Output::name);
        if (output == plan_.outputs.end()) {
          std::vector<std::string> names;
          for (const Output& o : plan_.outputs) names.push_back(o.name);
          widths->fail(
              name, fmt::format("is no output of the plan{}; there is {}", did_you_mean(name, names), joined(names)));
        }
        const double width = widths->number(name, {0, 1e300});
        if (!(width > 0)) widths->fail(name, "must be a width above 0, in the unit of the output");
        plan_.narrower_than.emplace_back(static_cast<std::size_t>(output - plan_.outputs.begin()), width);
      }
    }
    if (!plan_.failures && plan_.narrower_than.empty())
      in_.fail("stop", "is empty; give narrower_than: {OUTPUT: WIDTH}, or failures: N");
  }

  void resolve() {
    YAML::Node all = YAML::Clone(root_);
    all.remove("description");
    all["scenario"] = plan_.scenario.string();
    all["resolved_scenario"] = YAML::Load(typical_->resolved_yaml);
    if (!checksums_.empty()) all["parameters_crc32"] = checksums_, all["parameters"] = files_;
    all["runs"] = plan_.runs;
    plan_.resolved = all;
    if (plan_.asked != plan_.runs)
      plan_.notes.push_back(fmt::format("{} of {} runs: {} base points x ({} + 2)", plan_.runs, plan_.asked,
                                        plan_.saltelli->base_points, plan_.saltelli->groups()));
  }

  bool is_campaign() const { return static_cast<bool>(root_["resolved_scenario"]); }
  /// A campaign.yaml names files, whose content may be another one now.
  void require_unchanged() {
    const auto text = or_throw(read_text(plan_.file, "a YAML file"));
    const auto line = [](const std::string& t) { return t.substr(0, t.find('\n')); };
    const auto now = line(resolved_yaml(*plan_.model, plan_.resolved));
    if (line(text) != now)
      throw InputError(fmt::format("{}: was written with another engine or model ('{}', now '{}')", plan_.file.string(),
                                   line(text), now));
    for (const char* key : {"resolved_scenario", "parameters_crc32"})
      if (!same(root_[key], plan_.resolved[key]))
        in_.fail(key, fmt::format("is not what {} has now; the file has changed since the sweep was begun",
                                  *key == 'r' ? plan_.scenario.string() : "the file of parameters"));
  }
  static bool same(const YAML::Node& a, const YAML::Node& b) {
    if (a.Type() != b.Type() || a.size() != b.size()) return false;
    if (a.IsScalar()) return a.Scalar() == b.Scalar();
    if (a.IsMap())
      return std::all_of(a.begin(), a.end(), [&](const auto& x) {
        const YAML::Node other = b[x.first.Scalar()];
        return other && same(x.second, other);
      });
    for (std::size_t i = 0; i < a.size(); ++i)
      if (!same(a[i], b[i])) return false;
    return true;
  }

  YAML::Node root_;
  Mapping in_;
  Plan plan_;
  YAML::Node files_;  ///< as `parameters`, with whole paths
  std::set<std::string> taken_;
  std::vector<std::string> checksums_;
  std::optional<Scenario> typical_;
  Summary summary_{};
};

}  // namespace

std::vector<std::string> Plan::keys() const {
  std::vector<std::string> all;
  for (const Factor& f : factors) all.push_back(f.key);
  for (const auto& set : parameters) all.insert(all.end(), set.keys.begin(), set.keys.end());
  return all;
}

std::vector<std::string> Plan::values(std::size_t run) const {
  std::vector<std::string> all(factors.size());
  if (type == DesignType::grid) {
    for (std::size_t f = factors.size(); f-- > 0; run /= factors[f].levels.size())  // the last factor varies fastest
      all[f] = factors[f].levels[run % factors[f].levels.size()];
    return all;
  }
  std::vector<double> u;
  if (saltelli) {
    u = saltelli->point(points, run);
  } else {
    const auto width = static_cast<std::ptrdiff_t>(keys().size());
    const auto begin = points.begin() + static_cast<std::ptrdiff_t>(run) * width;
    u.assign(begin, begin + width);
  }
  for (std::size_t f = 0; f < factors.size(); ++f) all[f] = factors[f].value(u[f]);
  std::size_t at = factors.size();
  for (const auto& set : parameters) {
    const Eigen::VectorXd drawn = set.draw(std::span(u).subspan(at, set.size()));
    for (const double x : drawn) all.push_back(fmt::format("{}", x));
    at += set.size();
  }
  return all;
}

std::vector<std::string> Plan::settings(std::size_t run) const {
  std::vector<std::string> all = common;
  for (const auto& one : parameters)
    for (const auto& [key, value] : one.fixed) all.push_back(setting_of(key, value));
  const auto names = keys(), texts = values(run);
  for (std::size_t k = 0; k < names.size(); ++k) all.push_back(setting_of(names[k], texts[k]));
  return all;
}

std::vector<bool> Plan::numeric() const {
  std::vector<bool> all;
  for (const Factor& f : factors) all.push_back(f.numeric());
  all.resize(keys().size(), true);
  return all;
}

std::vector<std::string> Plan::groups() const {
  std::vector<std::string> all;
  for (const Factor& f : factors) all.push_back(f.key);
  for (const auto& set : parameters) all.push_back("parameters of " + set.joint);
  return all;
}

Result<Plan> load_plan(const fs::path& file) try { return Reader(file).read(); } catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::sweep
