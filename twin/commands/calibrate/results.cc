#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/calibrate/results.hpp>
#include <tribotwin/twin/identification/verdict/report.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/json_input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/io/text_table.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using namespace identification;
using Json = nlohmann::ordered_json;
using Campaign = CalibrationCampaign;
using Results = CalibrationResults;

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

/// The rule of identifiability for the fit on all recordings.
std::vector<Lacking> lacking_of(const Variant& v, const SimulationFit& f) {
  constexpr double quantile = 1.959964;
  const auto n = static_cast<Eigen::Index>(v.quantities.size());
  std::vector<Estimate> all;
  Evidence evidence;
  Eigen::VectorXd sigma = Eigen::VectorXd::Constant(n, std::nan(""));
  for (std::size_t i = 0; i < v.quantities.size(); ++i) {
    const Quantity& q = v.quantities[i];
    const ParameterStatus s = f.status[i];
    const double half = quantile * f.sigma[i];
    sigma(static_cast<Eigen::Index>(i)) = f.sigma[i];
    all.push_back({.name = q.path(),
                   .unit = "",
                   .value = f.values[i],
                   .sigma = f.sigma[i],
                   .low = f.values[i] - half,
                   .high = f.values[i] + half,
                   .status = s == ParameterStatus::known      ? identification::Status::fixed
                             : s == ParameterStatus::at_bound ? identification::Status::at_bound
                                                              : identification::Status::estimated});
    const bool may_be_0 = q.low <= 0 && q.high >= 0;
    evidence.scale.push_back(std::max(std::abs(f.values[i]), may_be_0 ? 0.1 * (q.high - q.low) : 0));
    evidence.unseen.push_back(s == ParameterStatus::prior ? "the recordings add little to its prior" : "");
  }
  evidence.parameters = all;
  evidence.covariance = sigma.asDiagonal() * f.correlation * sigma.asDiagonal();
  return lacking(evidence, [](const Estimate&, Lack lack) -> std::string {
    return lack == Lack::at_bound ? "widen its range, or fix it" : "record motions and loads that it moves, or fix it";
  });
}

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
  j["evaluations"] = f->evaluations;
  j["minima"] = Json::array();
  for (const double m : f->minima) j["minima"].push_back(number(m));
  for (std::size_t i = 0; i < v.quantities.size(); ++i) {
    Json q{{"value", f->values[i]}};
    if (f->split == SimulationFit::all) {
      q["sigma"] = number(f->sigma[i]);
      q["status"] = name(f->status[i]);
    }
    j["parameters"][v.quantities[i].path()] = std::move(q);
  }
  if (f->split == SimulationFit::all) {
    j["lacking"] = json_of(lacking_of(v, *f));
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

Json json_of_split(const Results& r, std::size_t variant, std::size_t s) {
  const Split& split = r.campaign.plan.splits[s];
  Json j{{"name", split.name},
         {"learning_mae_mrad", number(r.mae(variant, s, false))},
         {"held_out_mae_mrad", number(r.mae(variant, s, true))},
         {"ratio", number(r.mae(variant, s, true) / r.mae(r.campaign.reference, s, true))},
         {"folds", Json::array()}};
  for (std::size_t k = 0; k < split.folds.size(); ++k) j["folds"].push_back(json_of(r, r.find(variant, s, k)));
  return j;
}

Json json_of_variant(const Results& r, std::size_t v) {
  const Variant& variant = r.campaign.plan.variants[v];
  Json j{{"label", variant.label},
         {"law", variant.law->name},
         {"sought", std::ranges::count_if(variant.quantities, &Quantity::free)},
         {"held_out_mae_mrad", number(r.held_out_mae(v))},
         {"ratio", number(r.held_out_mae(v) / r.held_out_mae(r.campaign.reference))},
         {"all", json_of(r, r.find(v, SimulationFit::all, 0))},
         {"splits", Json::array()}};
  for (std::size_t s = 0; s < r.campaign.plan.splits.size(); ++s) j["splits"].push_back(json_of_split(r, v, s));
  return j;
}

Json json_of(const Results& r) {
  const Plan& plan = r.campaign.plan;
  Json j{{"complete", r.complete()},
         {"error", plan.search.norm == Norm::squared ? "squared" : "absolute"},
         {"correlation_s", plan.search.correlation_s},
         {"search",
          {{"method", name(method_of(plan.search))},
           {"starts", plan.search.starts},
           {"evaluations", plan.search.evaluations},
           {"seed", plan.search.seed}}},
         {"reference", plan.variants[r.campaign.reference].label},
         {"variants", Json::array()}};
  for (const auto& recording : plan.recordings) {
    Json labels = Json::object();
    for (const auto& [key, value] : recording.labels) labels[key] = value;
    j["recordings"].push_back(
        {{"file", recording.file.string()}, {"duration_s", recording.duration_s()}, {"labels", labels}});
  }
  for (std::size_t v = 0; v < plan.variants.size(); ++v) j["variants"].push_back(json_of_variant(r, v));
  j["fit"] = r.campaign.resolved;
  return j;
}

/// With a checksum of everything else as its last key.
Json with_checksum(Json j) {
  j.erase("crc32");
  j["crc32"] = fmt::format("{:08x}", crc32(dump_json(j)));
  return j;
}

bool checksum_holds(const Json& j) { return with_checksum(j)["crc32"] == j.at("crc32"); }

/// A fit as json_of(Results, SimulationFit) wrote it.
SimulationFit fit_of(const Campaign& campaign, const JsonInput& in, SimulationFit f) {
  const auto& quantities = campaign.plan.variants[f.variant].quantities;
  f.objective = in["objective"].number({-1e300, 1e300});
  f.evaluations = static_cast<int>(in["evaluations"].number({0, 1e9}));
  for (const auto& m : in["minima"].list(0))
    f.minima.push_back(m.is_null() ? std::numeric_limits<double>::infinity() : m.number({-1e300, 1e300}));
  const JsonInput parameters = in["parameters"];
  for (const auto& q : quantities) {
    const JsonInput p = parameters[q.path()];
    f.values.push_back(p["value"].number({-1e300, 1e300}));
    f.sigma.push_back(p.has("sigma") ? p["sigma"].number_or_null({0, 1e300}) : std::nan(""));
    f.status.push_back(q.free ? ParameterStatus::estimated : ParameterStatus::known);
    const std::string status = p.has("status") ? p["status"].text() : "";
    for (const auto k : {ParameterStatus::prior, ParameterStatus::at_bound})
      if (status == name(k)) f.status.back() = k;
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

/// The list of fits in calibration.json.
std::vector<SimulationFit> fits_of(const Campaign& campaign, const nlohmann::json& j) {
  std::vector<SimulationFit> fits;
  const auto take = [&](const JsonInput& in, std::size_t variant, std::size_t split, std::size_t fold) {
    if (!in.is_null()) fits.push_back(fit_of(campaign, in, {.variant = variant, .split = split, .fold = fold}));
  };
  const auto& plan = campaign.plan;
  const auto variants = JsonInput(j, "")["variants"].list(plan.variants.size(), plan.variants.size());
  for (std::size_t v = 0; v < variants.size(); ++v) {
    take(variants[v]["all"], v, SimulationFit::all, 0);
    const auto splits = variants[v]["splits"].list(plan.splits.size(), plan.splits.size());
    for (std::size_t s = 0; s < splits.size(); ++s) {
      const auto folds = splits[s]["folds"].list(plan.splits[s].folds.size(), plan.splits[s].folds.size());
      for (std::size_t k = 0; k < folds.size(); ++k) take(folds[k], v, s, k);
    }
  }
  return fits;
}

std::string cell(double x) { return std::isfinite(x) ? fmt::format("{:.1f}", x) : "-"; }
std::string ratio(double a, double b) { return std::isfinite(a / b) ? fmt::format("{:.2f}", a / b) : "-"; }

/// One row per variant, one group of columns per split.
std::string table_of_variants(const Results& r) {
  const Plan& plan = r.campaign.plan;
  const std::size_t reference = r.campaign.reference;
  constexpr auto left = TextTable::left, right = TextTable::right;
  std::vector<TextTable::Column> columns{left("variant"), right("sought"), right("all: learnt")};
  for (const auto& split : plan.splits)
    for (const auto& column : {left("|"), right("by " + split.name + ": learnt"), right("held out"), right("ratio")})
      columns.push_back(column);
  if (plan.splits.size() > 1)
    for (const auto& column : {left("|"), right("all splits: held out"), right("ratio")}) columns.push_back(column);
  TextTable table(std::move(columns));
  for (std::size_t v = 0; v < plan.variants.size(); ++v) {
    const SimulationFit* all = r.find(v, SimulationFit::all, 0);
    std::vector<std::string> row{plan.variants[v].label,
                                 fmt::format("{}", std::ranges::count_if(plan.variants[v].quantities, &Quantity::free)),
                                 all ? cell(r.mae(*all, false)) : "-"};
    const auto group = [&row](std::initializer_list<std::string> cells) { row.insert(row.end(), cells); };
    for (std::size_t k = 0; k < plan.splits.size(); ++k)
      group({"|", cell(r.mae(v, k, false)), cell(r.mae(v, k, true)),
             ratio(r.mae(v, k, true), r.mae(reference, k, true))});
    if (plan.splits.size() > 1)
      group({"|", cell(r.held_out_mae(v)), ratio(r.held_out_mae(v), r.held_out_mae(reference))});
    table.add(std::move(row));
  }
  return fmt::format("mean absolute error of position [mrad], mean over recordings; ratio to {}\n\n",
                     plan.variants[reference].label) +
         table.text();
}

/// What keeps numbers of the fits on all recordings from being any.
std::string judgement_of(const Results& r) {
  std::string s;
  for (std::size_t v = 0; v < r.campaign.plan.variants.size(); ++v)
    if (const SimulationFit* all = r.find(v, SimulationFit::all, 0))
      for (const auto& line : lines_of(lacking_of(r.campaign.plan.variants[v], *all)))
        s += fmt::format("{}: {}\n", r.campaign.plan.variants[v].label, line);
  return s.empty() ? s : "\n" + s;
}

/// The folds of a split: one column per fold, one row per variant.
std::string table_of_folds(const Results& r, std::size_t k) {
  const Plan& plan = r.campaign.plan;
  std::vector<TextTable::Column> columns{TextTable::left(fmt::format("held out by {}", plan.splits[k].name))};
  for (const auto& fold : plan.splits[k].folds) columns.push_back(TextTable::right(fold.label));
  TextTable table(std::move(columns));
  for (std::size_t v = 0; v < plan.variants.size(); ++v) {
    std::vector<std::string> row{plan.variants[v].label};
    for (std::size_t f = 0; f < plan.splits[k].folds.size(); ++f) {
      const SimulationFit *one = r.find(v, k, f), *rival = r.find(r.campaign.reference, k, f);
      row.push_back(one && rival
                        ? fmt::format("{} ({})", cell(r.mae(*one, true)), ratio(r.mae(*one, true), r.mae(*rival, true)))
                        : "-");
    }
    table.add(std::move(row));
  }
  return "\n" + table.text();
}

}  // namespace

std::string json_text(const Results& results) { return dump_json(json_of(results), 1) + "\n"; }
std::string calibration_file(const Results& results) { return dump_json(with_checksum(json_of(results)), 1) + "\n"; }

std::string table_of(const Results& r) {
  std::string s = table_of_variants(r);
  for (std::size_t k = 0; k < r.campaign.plan.splits.size(); ++k) s += table_of_folds(r, k);
  return s + judgement_of(r);
}

std::vector<SimulationFit> read_fits(const Campaign& campaign, const fs::path& file) {
  std::error_code error;
  if (!fs::exists(file, error)) return {};
  const std::string text = or_throw(read_text(file, "a calibration"));
  const Json written = parse_ordered_json(text);  // in its own order, which the checksum is of
  const nlohmann::json j = written;
  const auto refuse = [&](const std::string& what) {
    throw InputError(fmt::format("{}: {}; choose another folder with -o, or remove this one", file.string(), what));
  };
  if (!j.is_object() || !j.contains("fit")) refuse("is no calibration");
  if (j.contains("crc32") && !checksum_holds(written)) refuse("was changed since it was made (checksum)");
  if (dump_json(j["fit"]) != dump_json(nlohmann::json(campaign.resolved)))
    refuse("holds another calibration (its FIT file, models, recordings, seed or versions differ)");
  try {
    return fits_of(campaign, j);
  } catch (const InputError& e) {
    refuse(e.what());
  }
  return {};
}

}  // namespace tribotwin::twin::program
