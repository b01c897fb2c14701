#include <cmath>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/identification/curves/direction.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/verdict/report.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace identification;
using Json = nlohmann::ordered_json;

struct Arguments {
  std::vector<std::string> data, fix;
  std::string law = "extended", loss = "squares", shared, joint, evaluate, known_law;
  Destination output;
  TableArguments tables;
  double torque_max_nm = 0, gear_ratio = 0;
  unsigned folds = 0, threads = threads_of(0);
  bool json = false, staged = false, unweighted = false, each = false, quiet = false;
};

Result<Exit> identify_bouc_wen(const Arguments& a);
Result<Exit> identify_lugre(const Arguments& a);
/// Models with a state, which are identified from recordings sample by sample.
constexpr std::pair<std::string_view, Result<Exit> (*)(const Arguments&)> from_time_series[] = {
    {"bouc_wen", identify_bouc_wen}, {"lugre", identify_lugre}};

std::vector<const friction::LawInfo*> laws_of(const std::string& text) {
  std::vector<const friction::LawInfo*> laws;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t comma = std::min(text.find(',', at), text.size());
    const std::string name = text.substr(at, comma - at);
    const auto law = std::ranges::find(friction::laws(), name, &friction::LawInfo::name);
    if (law == friction::laws().end()) {
      std::vector<std::string_view> names;
      for (const auto& l : friction::laws()) names.push_back(l.name);
      for (const auto& [other, identify] : from_time_series) names.push_back(other);
      if (std::ranges::find(names, name) != names.end())
        throw InputError(fmt::format(
            "--law {}: '{}' is identified from other data than laws of friction curves, and by itself", text, name));
      throw InputError(fmt::format("--law {}: no law '{}' can be identified; did you mean '{}'? Those that can are {}",
                                   text, name, nearest(name, names), joined(names)));
    }
    laws.push_back(&*law);
    at = comma + 1;
  }
  return laws;
}

std::vector<std::pair<std::string, double>> fixed_of(const std::vector<std::string>& texts) {
  std::vector<std::pair<std::string, double>> fixed;
  for (const auto& text : texts) {
    const auto sign = text.find('=');
    if (sign == text.npos || sign == 0)
      throw InputError(fmt::format("--fix {}: must be NAME=VALUE, for example --fix alpha=1.36", text));
    const auto value = to_number(std::string_view(text).substr(sign + 1));
    if (!value || !std::isfinite(*value))
      throw InputError(fmt::format("--fix {}: '{}' is not a finite number", text, text.substr(sign + 1)));
    fixed.emplace_back(text.substr(0, sign), *value);
  }
  return fixed;
}

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

/// What does not exist is a dash: R^2 where friction never changes, AICc with too few samples.
std::string or_dash(double x, const std::string& spec) {
  return std::isfinite(x) ? fmt::format(fmt::runtime("{:" + spec + "}"), x) : "-";
}

Json json_of(const Estimates& fit, std::string_view law) {
  Json j;
  j["law"] = law;
  j["parameters"] = Json::object();
  static constexpr const char* status[] = {"estimated", "fixed", "held", "at_bound"};
  for (const auto& e : fit.parameters)
    j["parameters"][e.name] = {{"value", number(e.value)},
                               {"sigma", number(e.sigma)},
                               {"confidence_95", Json::array({number(e.low), number(e.high)})},
                               {"unit", e.unit},
                               {"status", status[static_cast<int>(e.status)]}};
  j["residual"] = {{"mean", number(fit.residual.mean)},
                   {"std", number(fit.residual.std)},
                   {"max_abs", number(fit.residual.max_abs)},
                   {"arcs", fit.residual.arcs}};
  j["samples"] = fit.samples;
  j["unidentifiable"] = fit.unidentifiable;
  j["lacking"] = json_of(fit.lacking);
  j["condition_number"] = number(fit.condition_number);
  j["r_squared"] = number(fit.r_squared);
  j["aicc"] = number(fit.aicc);
  j["cost"] = number(fit.cost);
  Json correlation = Json::object();
  for (std::size_t a = 0; a < fit.parameters.size(); ++a)
    for (std::size_t b = 0; b < fit.parameters.size(); ++b)
      if (fit.parameters[a].status == Status::estimated && fit.parameters[b].status == Status::estimated)
        correlation[fit.parameters[a].name][fit.parameters[b].name] = number(fit.correlation(a, b));
  j["correlation"] = std::move(correlation);
  j["notes"] = fit.notes;
  return j;
}

Json json_of(const Fit& fit, const Samples& samples, double held_out) {
  Json j = json_of(fit, fit.law.info->name);
  j["left_out"] = samples.left_out;
  j["curves"] = samples.curves();
  if (held_out >= 0) j["held_out_rms"] = number(held_out);
  return j;
}

/// What the rule of identifiability says of the parameters, and what to record next.
std::string judgement_of(const Estimates& fit) {
  std::string s;
  if (fit.residual.arcs > 0)
    s += fmt::format("{:.0f} % of the residuals' mean square are arcs, no noise; sigmas count them\n",
                     100 * fit.residual.arcs);
  if (fit.lacking.empty() && fit.residual.arcs == 0) s += "every parameter is identifiable from these data\n";
  if (fit.unidentifiable.empty() && !fit.lacking.empty()) s += "identifiable from these data, with doubts:\n";
  if (!fit.unidentifiable.empty())
    s += fmt::format("not identifiable from these data: {}\n", joined(fit.unidentifiable));
  for (const auto& line : lines_of(fit.lacking)) s += "  " + line + "\n";
  return s;
}

std::string table_of(const Estimates& fit, std::string_view law, std::string_view equation, std::string_view unit) {
  static constexpr const char* status[] = {"", "fixed", "held", "at its bound"};
  std::size_t width = 7;
  for (const auto& e : fit.parameters) width = std::max(width, e.name.size() + 1);
  std::string s = fmt::format("law {}: {}\n\n{:<{}} {:>13} {:>11}   {:<27} {:<15}\n", law, equation, "", width, "value",
                              "sigma", "95 % interval", "unit");
  for (const auto& e : fit.parameters) {
    s += fmt::format("{:<{}} {:>13.6g} ", e.name, width, e.value);
    s += std::isnan(e.sigma)
             ? fmt::format("{:>11}   {:<27} ", "-", status[static_cast<int>(e.status)])
             : fmt::format("{:>11.2g}   {:<27} ", e.sigma, fmt::format("{:.5g} .. {:.5g}", e.low, e.high));
    s += fmt::format("{}\n", e.unit);
  }
  std::vector<std::size_t> shown;
  for (std::size_t i = 0; i < fit.parameters.size(); ++i)
    if (fit.parameters[i].status == Status::estimated) shown.push_back(i);
  s += fmt::format("\ncorrelation\n{:{}}", "", width + 1);
  for (const std::size_t i : shown) s += fmt::format("{:>{}}", fit.parameters[i].name, width);
  for (const std::size_t i : shown) {
    s += fmt::format("\n{:<{}}", fit.parameters[i].name, width + 1);
    for (const std::size_t j : shown)
      if (j <= i)
        s += std::isfinite(fit.correlation(i, j)) ? fmt::format("{:>{}.2f}", fit.correlation(i, j), width)
                                                  : fmt::format("{:>{}}", "", width);
  }
  s += fmt::format(
      "\n\nresiduals: mean {:.3g}, std {:.4g}, largest {:.4g} {}; {} samples; R^2 {}; condition number {}; AICc {}\n",
      fit.residual.mean, fit.residual.std, fit.residual.max_abs, unit, fit.samples, or_dash(fit.r_squared, ".5f"),
      or_dash(fit.condition_number, ".3g"), or_dash(fit.aicc, ".1f"));
  return s + judgement_of(fit);
}

const char* unit_of_residuals(const friction::LawInfo& law) { return law.normalised ? "of torque_max" : "Nm"; }

std::string table_of(const Fit& fit, double held_out) {
  const char* unit = unit_of_residuals(*fit.law.info);
  std::string s = table_of(fit, fit.law.info->name, fit.law.info->equation, unit);
  if (held_out >= 0) s += fmt::format("held-out RMS error {:.4g} {}\n", held_out, unit);
  return s;
}

void print_notes(const Arguments& a, const std::vector<std::string>& notes) {
  if (!a.quiet)
    for (const auto& text : notes) note("{}", text);
}

/// PARAMS.yaml, and JSON or the table.
Result<Exit> deliver_dynamics(const Arguments& a, const Estimates& fit, double normalised_mse,
                              std::string_view equation, const std::string& yaml) {
  if (const auto ok = usable(fit); !ok) return work_failed(fmt::format("{}: {}", a.law, ok.error().message));
  print_notes(a, fit.notes);
  if (a.output.named())
    if (auto ok = deliver(yaml, a.output); !ok) return ok;
  if (!a.json)
    return deliver(table_of(fit, a.law, equation, "Nm") +
                   fmt::format("normalised MSE {}\n", or_dash(normalised_mse, ".3g")));
  Json j = json_of(fit, a.law);
  j["normalised_mse"] = number(normalised_mse);
  return deliver(dump_json(j, 2) + "\n");
}

TableOptions tables_of(const Arguments& a) {
  auto options = or_wrong_input(a.tables.options());
  options.joint = a.joint;
  return with_gear_ratio(std::move(options), a.gear_ratio);
}

Result<Exit> identify_bouc_wen(const Arguments& a) {
  const auto loops = read_loops(std::vector<std::filesystem::path>(a.data.begin(), a.data.end()), tables_of(a));
  if (!loops) throw InputError(loops.error().message);
  print_notes(a, loops->notes);
  const auto found = fit_hysteresis(loops->recordings, a.threads);
  if (!found) return work_failed(fmt::format("bouc_wen: {}", found.error().message));
  return deliver_dynamics(a, *found, found->normalised_mse, bouc_wen_equation, to_yaml(*found, a.data));
}

Result<Exit> identify_lugre(const Arguments& a) {
  if (a.known_law.empty())
    throw InputError("--law lugre: needs --static PARAMS.yaml, the static law of an earlier identification");
  auto known = or_wrong_input(read_parameters(a.known_law));
  if (a.torque_max_nm > 0) known.torque_max_nm = a.torque_max_nm;
  if (a.gear_ratio > 0) known.gear_ratio = a.gear_ratio;
  const auto drive = drive_of(known, "joint");
  if (!drive) throw InputError(fmt::format("{}: {}", a.known_law, drive.error().message));
  const auto sliding =
      read_sliding(std::vector<std::filesystem::path>(a.data.begin(), a.data.end()), *drive, tables_of(a));
  if (!sliding) throw InputError(sliding.error().message);
  print_notes(a, sliding->notes);
  const auto found = fit_bristles(*drive, sliding->recordings, a.threads);
  if (!found) return work_failed(fmt::format("lugre: {}", found.error().message));
  return deliver_dynamics(a, *found, found->normalised_mse, lugre_equation, to_yaml(known, *found, a.data));
}

Result<Exit> identify_shared(const Arguments& a, const friction::LawInfo& law, const Samples& samples,
                             const FitOptions& options) {
  const auto shared = fit_shared(law, samples, a.shared, options);
  if (!shared) return work_failed(shared.error().message);
  if (!std::isfinite(shared->value))
    return work_failed(fmt::format(
        "the fit gives no finite number for {}; check the data for values that no joint can have", a.shared));
  print_notes(a, shared->notes);
  Json j{{"law", law.name},
         {"shared", a.shared},
         {"value", number(shared->value)},
         {"sigma", number(shared->sigma)},
         {"curves", shared->curves},
         {"samples", shared->samples},
         {"profile", Json::array()},
         {"notes", shared->notes}};
  for (const auto& [value, cost] : shared->profile)
    j["profile"].push_back({{"value", value}, {"relative_cost_increase", cost}});
  if (a.output.named())
    if (auto ok = deliver(dump_json(j, 2) + "\n", a.output); !ok) return ok;
  if (a.json) return deliver(dump_json(j, 2) + "\n");
  std::string s = fmt::format(
      "{} common to {} curves ({} samples), all else of law {} free at each: {:.4f} +- {:.4f}\n\n{:>10} {:>18}\n",
      a.shared, shared->curves, shared->samples, law.name, shared->value, shared->sigma, a.shared, "relative cost");
  for (const auto& [value, cost] : shared->profile) s += fmt::format("{:>10.4f} {:>18.6f}\n", value, 1 + cost);
  return deliver(s);
}

/// One fit per curve: how the parameters move with what the curves were measured at.
Result<Exit> identify_each(const Arguments& a, const friction::LawInfo& law, const Samples& samples,
                           const FitOptions& options) {
  Json all = Json::array();
  std::string s = fmt::format("{:>6} {:>8} {:>8}", "curve", "load", "degC");
  for (const auto& p : law.parameters) s += fmt::format(" {:>11} {:>9}", p.name, "sigma");
  s += fmt::format("  residual std [{}]\n",
                   unit_of_residuals(law));  // behind it, of curves whose directions differ, asymmetry and offset
  std::size_t begin = 0;
  for (std::uint32_t curve = 0; curve < samples.curves(); ++curve) {
    std::vector<std::size_t> rows;
    for (; begin < samples.size() && samples.curve[begin] == curve; ++begin) rows.push_back(begin);
    const Samples one = samples.subset(rows);
    double load = 0, temperature = 0;
    for (std::size_t i = 0; i < one.size(); ++i)
      load += one.load[i] / static_cast<double>(one.size()),
          temperature += one.temperature_degC[i] / static_cast<double>(one.size());
    const auto found = fit(law, one, options);
    const auto ok = found ? usable(*found) : tl::unexpected(found.error());
    if (!ok)
      return work_failed(
          fmt::format("curve {} (load {:.3g}, {:.4g} degC): {}", curve + 1, load, temperature, ok.error().message));
    Json j = json_of(*found, one, -1);
    j["curve"] = curve + 1, j["load_norm"] = load, j["temperature_degC"] = temperature;
    all.push_back(std::move(j));
    s += fmt::format("{:>6} {:>8.4f} {:>8.2f}", curve + 1, load, temperature);
    const std::span parameters(found->parameters);
    for (const auto& e : parameters.first(law.parameters.size()))
      s += fmt::format(" {:>11.5g} {:>9}", e.value, std::isnan(e.sigma) ? "-" : fmt::format("{:.2g}", e.sigma));
    s += fmt::format("  {:.4g}", found->residual.std);
    for (const auto& e : parameters.subspan(law.parameters.size()))
      s += fmt::format("  {} {:.5g} +- {:.2g}", e.name, e.value, e.sigma);
    s += "\n";
  }
  return deliver(a.json ? dump_json(Json{{"law", law.name}, {"curves", std::move(all)}}, 2) + "\n" : s);
}

/// How well a law that was identified before predicts these data.
Result<Exit> evaluate(const Arguments& a) {
  const auto known = or_wrong_input(read_parameters(a.evaluate));
  const auto& law = *known.law.info;
  std::vector<std::filesystem::path> files(a.data.begin(), a.data.end());
  auto samples = read_samples(files, law,
                              {.torque_max_nm = a.torque_max_nm > 0 ? a.torque_max_nm : known.torque_max_nm,
                               .gear_ratio = a.gear_ratio > 0 ? a.gear_ratio : known.gear_ratio,
                               .table = tables_of(a)});
  if (!samples) throw InputError(samples.error().message);
  print_notes(a, samples->notes);
  const bool directed = known.asymmetry != 0 || known.offset != 0;
  if (directed) samples = by_direction(*samples);
  double mean = 0, squares = 0, max_error = 0;
  std::size_t outside = 0;
  const auto n = static_cast<double>(samples->size());
  std::vector<double> errors;
  for (std::size_t i = 0; i < samples->size(); ++i) {
    const auto level = friction::level(known.law, friction::at_temperature(known.law, samples->temperature_degC[i]),
                                       samples->speed[i], samples->load[i]);
    outside += level.outside;
    const double s = directed ? samples->direction[i] : 0;
    errors.push_back(samples->friction[i] - known.offset * s - level.total() * (1 + known.asymmetry * s));
    mean += errors.back() / n;
    max_error = std::max(max_error, std::abs(errors.back()));
  }
  for (const double e : errors) squares += (e - mean) * (e - mean) / n;
  if (a.json)
    return deliver(dump_json(Json{{"law", law.name},
                                  {"residual", {{"mean", mean}, {"std", std::sqrt(squares)}, {"max_abs", max_error}}},
                                  {"samples", samples->size()},
                                  {"outside_range", outside}},
                             2) +
                   "\n");
  return deliver(
      fmt::format("law {} of {}: measured - predicted: mean {:.4g}, std {:.4g}, largest {:.4g} {}; {} samples, {} of "
                  "them outside the range it was identified in\n",
                  law.name, a.evaluate, mean, std::sqrt(squares), max_error, law.normalised ? "of torque_max" : "Nm",
                  samples->size(), outside));
}

/// Options of friction curves have no meaning for laws that are identified sample by sample.
void refuse_options_of_curves(const Arguments& a) {
  for (const auto& [option, given] : {std::pair{"--fix", !a.fix.empty()},
                                      {"--staged", a.staged},
                                      {"--robust", a.loss != "squares"},
                                      {"--unweighted", a.unweighted},
                                      {"--cross-validate", a.folds > 1},
                                      {"--shared", !a.shared.empty()},
                                      {"--each", a.each}})
    if (given) throw InputError(fmt::format("{}: belongs to friction curves, not to --law {}", option, a.law));
}

void check_fixed(const friction::LawInfo& law, const FitOptions& options) {
  std::vector<std::string_view> names;
  for (const auto& p : law.parameters) names.push_back(p.name);
  names.insert(names.end(), {asymmetry_name, offset_name});
  for (const auto& [name, value] : options.fixed)
    if (std::ranges::find(names, name) == names.end())
      throw InputError(fmt::format("--fix {}={}: law '{}' has no such parameter; did you mean '{}'?", name, value,
                                   law.name, nearest(name, names)));
}

/// A fitted law and its errors on held-out curves, where there are any.
struct Candidate {
  Fit fit;
  std::optional<HeldOutErrors> errors;
  std::string remark = {};  ///< what is wrong with it beside the others

  double held_out() const { return errors ? errors->rms : -1; }
};

Result<Candidate> fit_law(const Arguments& a, const friction::LawInfo& law, const Samples& samples,
                          const FitOptions& options) {
  auto found = a.staged ? fit_staged(law, samples, options) : fit(law, samples, options);
  // The law's own conditions must hold for a law that is written and read again, not for one that is only compared.
  const auto ok = found ? usable(*found, !a.output.named() ? nullptr : &law) : tl::unexpected(found.error());
  // What fit() refuses are the data; a law that cannot be used is its work.
  if (!found) return tl::unexpected(Error(fmt::format("law '{}': {}", law.name, ok.error().message)));
  if (!ok) return work_failed(fmt::format("law '{}': {}", law.name, ok.error().message));
  if (a.folds <= 1) return Candidate{std::move(*found), {}};
  auto held_out = cross_validate(law, samples, options, a.folds);
  if (!held_out) return work_failed(held_out.error().message);
  return Candidate{std::move(*found), std::move(*held_out)};
}

/// A law that contains another can do no worse, unless it overfits or was not found.
void remark_failures(std::vector<Candidate>& all) {
  for (Candidate& wide : all)
    for (const Candidate& narrow : all) {
      const auto &a = *wide.fit.law.info, &b = *narrow.fit.law.info;
      if (!contains(a, b) || a.normalised != b.normalised || wide.fit.samples != narrow.fit.samples) continue;
      if (wide.errors && narrow.errors && worse(*wide.errors, *narrow.errors))
        wide.remark = fmt::format("contains {}, yet worse held out: overfits or did not converge", b.name);
      else if (wide.fit.cost > 1.001 * narrow.fit.cost)
        wide.remark = fmt::format("contains {}, yet fits worse: did not converge", b.name);
    }
}

std::string comparison_of(const std::vector<Candidate>& candidates, bool cross_validated) {
  constexpr auto right = TextTable::right;
  TextTable table{{TextTable::left("law"), right("p"), right("residual std"), right("largest"),
                   right(cross_validated ? "held-out RMS" : ""), TextTable::left("unit"), right("R^2"), right("AICc"),
                   TextTable::left()}};
  for (const Candidate& c : candidates)
    table.add({std::string(c.fit.law.info->name), fmt::format("{}", c.fit.estimated),
               fmt::format("{:.4g}", c.fit.residual.std), fmt::format("{:.4g}", c.fit.residual.max_abs),
               c.errors ? fmt::format("{:.4g}", c.errors->rms) : "", unit_of_residuals(*c.fit.law.info),
               or_dash(c.fit.r_squared, ".5f"), or_dash(c.fit.aicc, ".1f"), c.remark});
  return table.text();
}

Result<Samples> samples_for(const Arguments& a, const friction::LawInfo& law) {
  const std::vector<std::filesystem::path> files(a.data.begin(), a.data.end());
  return read_samples(files, law,
                      {.torque_max_nm = a.torque_max_nm, .gear_ratio = a.gear_ratio, .table = tables_of(a)});
}

Result<Exit> identify_curves(const Arguments& a) {
  const auto laws = laws_of(a.law);
  const FitOptions options{.fixed = fixed_of(a.fix),
                           .loss = a.loss == "huber"    ? Loss::huber
                                   : a.loss == "cauchy" ? Loss::cauchy
                                                        : Loss::squares,
                           .weigh = !a.unweighted,
                           .threads = a.threads};
  if (laws.size() > 1 && (a.output.named() || !a.shared.empty() || !a.fix.empty() || a.each))
    throw InputError("-o, --fix, --shared and --each need a single law");
  std::vector<Candidate> candidates;
  Json all = Json::array();
  std::string lacking;
  for (const auto* law : laws) {
    const auto samples = samples_for(a, *law);
    if (!samples) {
      lacking += (lacking.empty() ? "" : "; ") + samples.error().message;
      if (laws.size() > 1 && !a.quiet) note("{}; law '{}' is left out", samples.error().message, law->name);
      continue;
    }
    check_fixed(*law, options);
    if (candidates.empty()) print_notes(a, samples->notes);
    if (!a.shared.empty()) return identify_shared(a, *law, *samples, options);
    if (a.each) return identify_each(a, *law, *samples, options);
    auto candidate = fit_law(a, *law, *samples, options);
    if (!candidate) return tl::unexpected(candidate.error());
    if (!a.quiet)
      for (const auto& text : candidate->fit.notes)
        note("{}{}", laws.size() > 1 ? fmt::format("{}: ", law->name) : "", text);
    all.push_back(json_of(candidate->fit, *samples, candidate->held_out()));
    candidates.push_back(std::move(*candidate));
  }
  if (candidates.empty()) throw InputError(lacking);
  remark_failures(candidates);
  for (std::size_t k = 0; k < candidates.size(); ++k)
    if (!candidates[k].remark.empty()) all[k]["remark"] = candidates[k].remark;
  const Fit& fit = candidates.front().fit;
  if (a.output.named())
    if (auto ok = deliver(to_yaml(parameter_file(fit, a.data, a.torque_max_nm, a.gear_ratio)), a.output); !ok)
      return ok;
  if (a.json) return deliver(dump_json((laws.size() > 1 ? Json{{"laws", all}} : all.front()), 2) + "\n");
  return deliver(laws.size() > 1 ? comparison_of(candidates, a.folds > 1)
                                 : table_of(fit, candidates.front().held_out()));
}

Result<Exit> execute(const Arguments& a) {
  refuse_twice(a.data);
  if (!a.evaluate.empty()) return evaluate(a);
  if (const auto dynamic = std::ranges::find(from_time_series, a.law, [](const auto& entry) { return entry.first; });
      dynamic != std::end(from_time_series)) {
    refuse_options_of_curves(a);
    return dynamic->second(a);
  }
  if (!a.known_law.empty()) throw InputError("--static: belongs to --law lugre");
  return identify_curves(a);
}

}  // namespace

void add_identify(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand("identify",
                               "Identify a friction law's parameters, with uncertainties, from measured friction");
  c->add_option(
       "DATA", a->data,
       "Tables (CSV, folder of a run, telemetry.h5, .npz, .npy, .mat, .mcap) of friction curves or of recordings of a "
       "joint; for bouc_wen and lugre recordings sample by sample")
      ->required();
  c->add_option("--law", a->law,
                "Law, or several with commas between to compare them; bouc_wen: a gear's hysteretic spring; lugre: "
                "bristles over a law")
      ->capture_default_str();
  c->add_option("--fix", a->fix, "NAME=VALUE, a parameter that is known; asymmetry=0 and offset=0 leave those out")
      ->allow_extra_args(false);
  c->add_option("--tau-max", a->torque_max_nm,
                "Largest manipulation torque [Nm], arm side: turns Nm into normalised torque and back")
      ->check(CLI::Range(1e-9, 1e9));
  c->add_option("--gear-ratio", a->gear_ratio, "Motor turns per joint turn, for recordings and laws of the joint side")
      ->check(CLI::Range(1e-6, 1e6));
  c->add_option("--joint", a->joint, "Joint of a table of several, such as a telemetry.h5");
  a->tables.add_to(*c);
  c->add_flag("--staged", a->staged, "Load terms first, from one temperature, then the rest (Bittencourt 2012)");
  c->add_option("--robust", a->loss, "Loss for data with outliers")
      ->check(CLI::IsMember({"squares", "huber", "cauchy"}))
      ->capture_default_str();
  c->add_flag("--unweighted", a->unweighted, "Do not weigh by standard errors");
  c->add_option("--cross-validate", a->folds, "Also the error on held-out curves, in this many folds")
      ->check(CLI::Range(2, 100));
  c->add_option("--shared", a->shared,
                "A parameter common to all curves while the others are free at each (alpha* of Bittencourt 2012)");
  c->add_flag("--each", a->each, "One fit per curve");
  c->add_option("--static", a->known_law, "For --law lugre: PARAMS.yaml of the static law under the bristles");
  c->add_option("--evaluate", a->evaluate, "Identify nothing; evaluate how well this PARAMS.yaml predicts the data");
  a->output.add_to(*c, "PARAMS.yaml to write: read by curve, export --mjcf and tribotwin-report fit");
  c->add_option("--threads", a->threads, "Threads")->check(CLI::Range(1, 256));
  c->add_flag("--json", a->json, "Print JSON instead of the table");
  c->add_flag("--quiet", a->quiet, "No notes on stderr");
  c->footer(
      "Example:\n  tribotwin lab rh380n_friction -o lab/rh380n\n  tribotwin identify --law stribeck_T "
      "lab/rh380n/curves/00[89].csv lab/rh380n/curves/01?.csv -o params.yaml\n\nRecordings of your own, sample by "
      "sample: --law bouc_wen 20degC.csv 35degC.csv -o gear.yaml; --law lugre --static params.yaml reversals.csv -o "
      "lugre.yaml.");
  c->callback([a, &code] {
    auto inputs = paths(a->data);
    inputs.insert(inputs.end(), {a->known_law, a->evaluate});
    check(a->output, inputs);
    code = or_throw(execute(*a));
  });
}

}  // namespace tribotwin::twin::program
