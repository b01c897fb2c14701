#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/experiments/sweep/results.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/telemetry/columns.hpp>

namespace tribotwin::twin::sweep {
namespace {

using Json = nlohmann::ordered_json;

constexpr double missing = std::numeric_limits<double>::quiet_NaN();

Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

std::optional<std::vector<double>> numbers_of(const nlohmann::json& list) {
  if (!list.is_array()) return {};
  std::vector<double> all;
  for (const auto& x : list) {
    if (!x.is_number() && !x.is_null()) return {};
    all.push_back(x.is_null() ? missing : x.get<double>());
  }
  return all;
}

/// A cell of a CSV (RFC 4180); line breaks become blanks.
std::string cell(std::string text) {
  std::ranges::replace(text, '\n', ' ');
  if (text.find_first_of(",\"\r") == text.npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string cell(double x) { return std::isfinite(x) ? fmt::format("{}", x) : ""; }

double output_of(const RunResult& run, std::size_t output) { return run.failed() ? missing : run.outputs[output]; }

/// Values of a band at one time over the runs that count, ascending.
std::vector<double> at_time(const Plan& plan, const std::vector<RunResult>& runs, std::size_t band, std::size_t time) {
  std::vector<double> values;
  for (std::size_t r = 0; r < runs.size(); ++r)
    if (plan.independent(r) && !runs[r].failed() && std::isfinite(runs[r].bands[band][time]))
      values.push_back(runs[r].bands[band][time]);
  std::ranges::sort(values);
  return values;
}

std::string quantile_name(double p) { return fmt::format("q{}", p); }

Json json_of(const Estimated& e, bool intervals = true) {
  Json j{{"value", number(e.value)}};
  j["confidence_95"] =
      e.interval && intervals ? Json{number(e.interval->low), number(e.interval->high)} : Json(nullptr);
  return j;
}

Json json_of(const std::optional<SobolIndices>& indices) {
  if (!indices) return nullptr;
  return {{"first", json_of(indices->first)}, {"total", json_of(indices->total)}};
}

/// Shares of variance by Sobol' where the design gives them.
Json indices_json(const Plan& plan, const std::vector<RunResult>& runs, std::size_t output) {
  std::vector<double> values;
  for (const RunResult& run : runs) values.push_back(output_of(run, output));
  std::vector<std::optional<SobolIndices>> indices;
  if (plan.saltelli) {
    indices = saltelli_indices(values, plan.saltelli->groups(), plan.seed);
  } else {
    std::vector<std::size_t> levels;
    for (const Factor& f : plan.factors) levels.push_back(f.levels.size());
    if (values.size() < plan.runs) return Json::object();
    indices = grid_indices(values, levels);
  }
  Json all = Json::object();
  const auto groups = plan.groups();
  for (std::size_t g = 0; g < groups.size(); ++g) all[groups[g]] = json_of(indices[g]);
  return all;
}

/// Spearman's rank correlation with each key whose values are numbers.
Json correlations_json(const Plan& plan, const std::vector<RunResult>& runs, std::size_t output,
                       const std::vector<std::vector<double>>& inputs) {
  Json all = Json::object();
  const auto keys = plan.keys();
  for (std::size_t k = 0; k < keys.size(); ++k) {
    std::vector<double> x, y;
    for (std::size_t r = 0; r < runs.size(); ++r)
      if (const double value = output_of(runs[r], output);
          plan.independent(r) && std::isfinite(value) && std::isfinite(inputs[k][r]))
        x.push_back(inputs[k][r]), y.push_back(value);
    const auto r = rank_correlation(x, y);
    all[keys[k]] = r ? json_of(*r, plan.sampled()) : Json(nullptr);
  }
  return all;
}

/// Per key, the values of all runs; NaN where they are words.
std::vector<std::vector<double>> inputs_of(const Plan& plan, std::size_t runs) {
  std::vector<std::vector<double>> all(plan.keys().size(), std::vector<double>(runs, missing));
  for (std::size_t r = 0; r < runs; ++r) {
    const auto values = plan.values(r);
    for (std::size_t k = 0; k < values.size(); ++k)
      if (const auto x = to_number(values[k])) all[k][r] = *x;
  }
  return all;
}

Json output_json(const Plan& plan, const std::vector<RunResult>& runs, std::size_t output,
                 const std::vector<std::vector<double>>& inputs) {
  auto values = sample_of(plan, runs, output);
  Json j{{"count", values.size()}};
  if (values.empty()) return j;
  const Moments m = moments(values, plan.outputs[output].range);
  std::ranges::sort(values);
  j["mean"] = json_of(m.mean, plan.sampled());
  if (m.count > 1) j["deviation"] = json_of(m.deviation, plan.sampled());
  j["min"] = m.min, j["max"] = m.max;
  j["quantiles"] = Json::array();
  for (const double p : plan.quantiles) {
    Json q{{"probability", p}};
    q.update(json_of(quantile(values, p), plan.sampled()));
    j["quantiles"].push_back(std::move(q));
  }
  if (plan.saltelli || !plan.sampled()) j["sobol_indices"] = indices_json(plan, runs, output);
  j["rank_correlations"] = correlations_json(plan, runs, output, inputs);
  return j;
}

/// How many draws of each parameter were set to an end of its range.
void note_limits(const Plan& plan, const std::vector<std::vector<double>>& inputs, Json& notes) {
  std::size_t key = plan.factors.size();
  for (const auto& set : plan.parameters)
    for (std::size_t p = 0; p < set.size(); ++p, ++key) {
      const auto beyond = std::ranges::count_if(inputs[key], [&](double x) { return set.at_limit(p, x); });
      if (beyond > 0)
        notes.push_back(
            fmt::format("{}: {} of {} draws lay beyond the accepted range and have its end; the sigma is "
                        "large for the value",
                        set.keys[p], beyond, inputs[key].size()));
    }
}

/// Quantiles that lie beyond the sample.
void note_quantiles(const Plan& plan, const std::vector<RunResult>& runs, Json& notes) {
  std::size_t count = 0;
  for (std::size_t r = 0; r < runs.size(); ++r)
    count += plan.independent(r) && !runs[r].failed() && runs[r].status != "missing";
  const double rarest = std::min(plan.quantiles.front(), 1 - plan.quantiles.back());
  if (const double needed = std::ceil(1 / rarest - 1 - 1e-9); static_cast<double>(count) < needed)
    notes.push_back(
        fmt::format("{} runs are too few for the outer quantiles, which are the smallest and largest value "
                    "here; {:g} reach from {:g} to {:g}",
                    count, needed, plan.quantiles.front(), plan.quantiles.back()));
}

std::string interval_note(const Plan& plan) {
  if (!plan.sampled())
    return "a grid is no sample of a distribution: its figures are those of the combinations, without intervals";
  if (plan.type == DesignType::random) return "intervals are 95 %; quantiles are order statistics, of any distribution";
  return "intervals are 95 % as of independent draws; points of this design are more even, and the intervals "
         "usually too wide";
}

}  // namespace

std::string to_line(std::size_t run, const RunResult& result) {
  Json j{{"run", run}, {"status", result.status}, {"message", result.message}, {"outputs", Json::array()}};
  for (const double x : result.outputs) j["outputs"].push_back(number(x));
  j["bands"] = Json::array();
  for (const auto& band : result.bands) {
    Json values = Json::array();
    for (const double x : band) values.push_back(number(x));
    j["bands"].push_back(std::move(values));
  }
  return dump_json(j) + "\n";
}

std::optional<RunResult> from_line(std::size_t run, const std::string& line) {
  const auto j = parse_json(line);
  if (!j.is_object() || j.value("run", nlohmann::json()) != run) return {};
  for (const char* text : {"status", "message"})
    if (!j.contains(text) || !j[text].is_string()) return {};
  if (!j.contains("outputs") || !j.contains("bands") || !j["bands"].is_array()) return {};
  RunResult result{.status = j["status"], .message = j["message"], .outputs = {}, .bands = {}};
  auto outputs = numbers_of(j["outputs"]);
  if (!outputs) return {};
  result.outputs = std::move(*outputs);
  for (const auto& band : j["bands"]) {
    auto values = numbers_of(band);
    if (!values) return {};
    result.bands.push_back(std::move(*values));
  }
  return result;
}

Failures failures(const std::vector<RunResult>& runs) {
  Failures f;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    f.warned += runs[r].status == "warned";
    f.failed += runs[r].failed();
    if (runs[r].failed() && !f.first) f.first = r;
  }
  return f;
}

std::vector<double> sample_of(const Plan& plan, const std::vector<RunResult>& runs, std::size_t output) {
  std::vector<double> values;
  for (std::size_t r = 0; r < runs.size(); ++r)
    if (const double x = output_of(runs[r], output); plan.independent(r) && std::isfinite(x)) values.push_back(x);
  return values;
}

std::string results_csv(const Plan& plan, const std::vector<RunResult>& runs) {
  std::string text = "run";
  for (const auto& key : plan.keys()) text += "," + cell(key);
  for (const Output& output : plan.outputs) text += "," + cell(output.name);
  text += ",status,message\n";
  for (std::size_t r = 0; r < runs.size(); ++r) {
    text += fmt::format("{}", r);
    for (const auto& value : plan.values(r)) text += "," + cell(value);
    for (std::size_t o = 0; o < plan.outputs.size(); ++o) text += "," + cell(output_of(runs[r], o));
    text += "," + runs[r].status + "," + cell(runs[r].message) + "\n";
  }
  return text;
}

std::vector<Band> bands_of(const Plan& plan, const std::vector<RunResult>& runs) {
  std::vector<Band> all;
  for (std::size_t b = 0; b < plan.bands.size(); ++b) {
    Band band{.signal = plan.bands[b].name, .runs = {}, .quantiles = {}};
    band.quantiles.resize(plan.quantiles.size());
    for (std::size_t t = 0; t < plan.band_times_s.size(); ++t) {
      const auto values = at_time(plan, runs, b, t);
      band.runs.push_back(static_cast<double>(values.size()));
      for (std::size_t q = 0; q < plan.quantiles.size(); ++q)
        band.quantiles[q].push_back(values.empty() ? missing : quantile(values, plan.quantiles[q]).value);
    }
    all.push_back(std::move(band));
  }
  return all;
}

std::string bands_csv(const Plan& plan, const std::vector<Band>& bands) {
  if (bands.empty()) return {};
  std::string text = "time_s";
  for (const Band& band : bands) {
    text += "," + cell(band.signal + ".runs");
    for (const double p : plan.quantiles) text += "," + cell(band.signal + "." + quantile_name(p));
  }
  text += "\n";
  for (std::size_t t = 0; t < plan.band_times_s.size(); ++t) {
    text += fmt::format("{}", plan.band_times_s[t]);
    for (const Band& band : bands) {
      text += fmt::format(",{}", band.runs[t]);
      for (const auto& values : band.quantiles) text += "," + cell(values[t]);
    }
    text += "\n";
  }
  return text;
}

Result<std::string> results_hdf5(const Plan& plan, const std::vector<RunResult>& runs, const std::vector<Band>& bands) {
  std::vector<Column> columns;
  std::vector<double> index;
  std::vector<std::string> status, message;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    index.push_back(static_cast<double>(r));
    status.push_back(runs[r].status), message.push_back(runs[r].message);
  }
  columns.push_back({"run", "number of the run, from 0", index});
  const auto keys = plan.keys();
  const auto numeric = plan.numeric();
  const auto inputs = inputs_of(plan, runs.size());
  for (std::size_t k = 0; k < keys.size(); ++k) {
    Column column{"factors/" + column_name(keys[k]), "key of the scenario", inputs[k]};
    if (!numeric[k]) {
      std::vector<std::string> words;
      for (std::size_t r = 0; r < runs.size(); ++r) words.push_back(plan.values(r)[k]);
      column.values = std::move(words);
    }
    columns.push_back(std::move(column));
  }
  for (std::size_t o = 0; o < plan.outputs.size(); ++o) {
    std::vector<double> values;
    for (const RunResult& run : runs) values.push_back(output_of(run, o));
    columns.push_back({"outputs/" + column_name(plan.outputs[o].name), "output; NaN where the run failed", values});
  }
  columns.push_back({"status", "ok, warned by the health check, or failed", status});
  columns.push_back({"message", "checks that warn, or why the run failed", message});
  if (!bands.empty()) columns.push_back({"bands/time_s", "simulated time", plan.band_times_s});
  for (const Band& band : bands)
    for (std::size_t q = 0; q < plan.quantiles.size(); ++q)
      columns.push_back({"bands/" + column_name(band.signal) + "/" + quantile_name(plan.quantiles[q]),
                         "quantile over the runs", band.quantiles[q]});
  return columns_hdf5(columns, {{"plan", plan.file.filename().string()}});
}

std::string statistics_json(const Plan& plan, const std::vector<RunResult>& runs, const std::string& stopped) {
  const Failures failed = failures(runs);
  const auto inputs = inputs_of(plan, runs.size());
  Json notes = plan.notes;
  if (failed.failed)
    notes.push_back(
        fmt::format("{} runs failed and are left out; where failing depends on the factors, the statistics "
                    "are those of the runs that can be made",
                    failed.failed));
  if (failed.warned)
    notes.push_back(fmt::format("{} runs are not what the scenario asks for (status warned, see message); they count",
                                failed.warned));
  note_limits(plan, inputs, notes);
  if (plan.sampled()) note_quantiles(plan, runs, notes);
  notes.push_back(interval_note(plan));
  Json j{
      {"runs", {{"planned", plan.runs}, {"made", runs.size()}, {"failed", failed.failed}, {"warned", failed.warned}}},
      {"stopped", stopped},
      {"outputs", Json::object()},
      {"notes", notes}};
  for (std::size_t o = 0; o < plan.outputs.size(); ++o)
    j["outputs"][plan.outputs[o].name] = output_json(plan, runs, o, inputs);
  return dump_json(j, 2) + "\n";
}

}  // namespace tribotwin::twin::sweep
