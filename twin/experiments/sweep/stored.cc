#include <algorithm>
#include <chrono>
#include <ctime>
#include <limits>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/experiments/sweep/stored.hpp>
#include <tribotwin/twin/experiments/sweep/sweep.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/json_input.hpp>
#include <tribotwin/twin/io/tables/csv.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::sweep {
namespace {

namespace fs = std::filesystem;

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr char changed[] = "the file was changed, and the sweep's command with --force writes it anew";

struct Table {
  std::vector<std::string> head;
  std::vector<std::vector<std::string>> rows;
};

Table read_table(const fs::path& file) {
  auto lines = or_wrong_input(tables::CsvLines::open(file));
  Table table{.head = or_wrong_input(lines.header()), .rows = {}};
  for (std::string_view line; or_wrong_input(lines.next(line));) {
    auto& row = table.rows.emplace_back();
    or_wrong_input(lines.cells(line, [&](std::size_t, std::string_view text) {
      row.emplace_back(text);
      return true;
    }));
    if (row.size() != table.head.size())
      throw InputError(fmt::format("{}:{}: has {} cells where the header has {}; {}", file.string(), lines.number(),
                                   row.size(), table.head.size(), changed));
  }
  return table;
}

double number_of(const std::string& cell) { return to_number(cell).value_or(none); }

void read_campaign(StoredSweep& s, Mapping campaign) {
  s.engine = engine_of(s.campaign);
  s.scenario = campaign.text("scenario");
  s.planned = campaign.whole("runs", {1, most_runs});
  auto design = campaign.mapping("design");
  if (!design) campaign.fail("design", "is missing");
  s.design = design->text("type");
  s.indices = design->flag_or("indices", false);
  if (s.design != design_types[0].first) s.seed = design->whole_or("seed", 1, {0, 9007199254740992.0});
  const YAML::Node outputs = campaign.raw("outputs");
  for (const auto& entry : outputs)
    if (outputs.IsMap())
      s.outputs.push_back({entry.first.Scalar(), entry.second.Scalar()});
    else
      s.outputs.push_back({entry.Scalar(), entry.Scalar()});
}

void read_origin(StoredSweep& s) {
  std::error_code error;
  const fs::path file = s.directory / "origin.yaml";
  if (!fs::is_regular_file(file, error)) return;  // of a sweep that an earlier version made
  const YAML::Node origin = load_yaml(file);
  s.plan = origin["plan"].as<std::string>("");
  s.description = origin["description"].as<std::string>("");
}

void read_results(StoredSweep& s, const fs::path& file) {
  const Table table = read_table(file);
  if (table.head.size() < s.outputs.size() + 4 || table.head.front() != "run" || table.head.back() != "message")
    throw InputError(
        fmt::format("{}:1: is no table of this sweep; its command with --force writes it anew", file.string()));
  const std::size_t keys = table.head.size() - s.outputs.size() - 3;
  s.keys.assign(table.head.begin() + 1, table.head.begin() + 1 + static_cast<std::ptrdiff_t>(keys));
  for (const auto& row : table.rows) {
    StoredRun run{.number = to_integer<std::size_t>(row[0]).value_or(0), .values = {}, .outputs = {}};
    for (std::size_t k = 0; k < keys; ++k) run.values.push_back(row[1 + k]);
    for (std::size_t o = 0; o < s.outputs.size(); ++o) run.outputs.push_back(number_of(row[1 + keys + o]));
    run.status = row[row.size() - 2], run.message = row.back();
    s.runs.push_back(std::move(run));
  }
}

void read_bands(StoredSweep& s, const fs::path& file) {
  const Table table = read_table(file);
  std::vector<std::vector<double>> probabilities;  // by signal
  for (std::size_t c = 1; c < table.head.size(); ++c) {
    const std::string& head = table.head[c];
    std::vector<double> values;
    for (const auto& row : table.rows) values.push_back(number_of(row[c]));
    if (head.ends_with(".runs")) {
      s.bands.push_back({.signal = head.substr(0, head.size() - 5), .runs = std::move(values), .quantiles = {}});
      probabilities.emplace_back();
    } else if (const auto q = head.rfind(".q"); q != head.npos && !s.bands.empty()) {
      probabilities.back().push_back(number_of(head.substr(q + 2)));
      s.bands.back().quantiles.push_back(std::move(values));
    }
  }
  for (std::size_t b = 0; b < s.bands.size(); ++b)  // also unlike themselves, where they are no numbers
    if (probabilities[b] != probabilities[0])
      throw InputError(fmt::format("{}:1: the quantiles of {} are not those of the first signal; {}", file.string(),
                                   s.bands[b].signal, changed));
  if (!s.bands.empty()) s.probabilities = probabilities[0];
  for (const auto& row : table.rows) s.times_s.push_back(number_of(row[0]));
}

/// Of runs that are there: the results that the sweep would write if these were all.
void make_results(StoredSweep& s) {
  const Plan plan = or_wrong_input(load_plan(s.directory / "campaign.yaml"));
  const auto there = or_wrong_input(read_runs(plan, s.directory));
  std::vector<RunResult> runs;
  s.keys = plan.keys();
  for (std::size_t r = 0; r < there.size(); ++r) {
    runs.push_back(there[r] ? *there[r]
                            : RunResult{.status = "missing",
                                        .message = {},
                                        .outputs = std::vector<double>(plan.outputs.size(), none),
                                        .bands = std::vector(plan.bands.size(),
                                                             std::vector<double>(plan.band_times_s.size(), none))});
    if (!there[r]) continue;
    s.runs.push_back({.number = r,
                      .values = plan.values(r),
                      .outputs = there[r]->outputs,
                      .status = there[r]->status,
                      .message = there[r]->message,
                      .counts = plan.independent(r)});
    s.runs.back().outputs.resize(plan.outputs.size(), none);
  }
  if (s.runs.empty())
    throw InputError(fmt::format("{}: has none of its {} runs yet; 'tribotwin sweep {} -o {}' makes them",
                                 s.directory.string(), s.planned, (s.directory / "campaign.yaml").string(),
                                 s.directory.string()));
  s.statistics = parse_json(statistics_json(plan, runs, ""));
  s.statistics["runs"]["made"] = s.runs.size();
  s.probabilities = plan.quantiles, s.times_s = plan.band_times_s;
  s.bands = bands_of(plan, runs);
}

constexpr Bounds any{-1e300, 1e300};

/// As results.cc writes them.
void check_estimate(const JsonInput& in) {
  in["value"].number_or_null(any);
  if (in.has("confidence_95") && !in["confidence_95"].is_null())
    for (const JsonInput& end : in["confidence_95"].list(2, 2)) end.number_or_null(any);
}

void check_effects(const nlohmann::json& output, const std::string& where) {
  const JsonInput in(output, where);
  for (const char* effects : {"sobol_indices", "rank_correlations"}) {
    if (!in.has(effects)) continue;
    if (!output[effects].is_object()) in[effects].fail("must be a mapping");
    for (const auto& [key, one] : output[effects].items()) {
      const JsonInput effect(one, fmt::format("{}: {}: {}", where, effects, key));
      if (effect.is_null()) continue;
      if (std::string_view(effects) == "rank_correlations")
        check_estimate(effect);
      else
        check_estimate(effect["first"]), check_estimate(effect["total"]);
    }
  }
}

/// Probabilities of its quantiles; none where no run has a value.
std::optional<std::vector<double>> check_output_statistics(const nlohmann::json& output, const std::string& where) {
  const JsonInput in(output, where);
  in["count"].number({0, most_runs});
  check_effects(output, where);
  if (!in.has("mean")) return std::nullopt;
  check_estimate(in["mean"]);
  if (in.has("deviation")) check_estimate(in["deviation"]);
  for (const char* end : {"min", "max"}) in[end].number_or_null(any);
  std::vector<double> probabilities;
  for (const JsonInput& quantile : in["quantiles"].list(0)) {
    probabilities.push_back(quantile["probability"].number({0, 1}));
    check_estimate(quantile);
  }
  return probabilities;
}

/// What readers of statistics.json rely on. Throws InputError.
void check_statistics(const nlohmann::json& statistics, const fs::path& file) {
  const JsonInput in(statistics, file.string());
  try {
    for (const char* part : {"outputs", "notes"}) (void)in[part];
    if (in.has("stopped")) (void)in["stopped"].text();
    for (const JsonInput& note : in["notes"].list(0)) (void)note.text();
    if (!statistics["outputs"].is_object()) in["outputs"].fail("must be a mapping");
    std::optional<std::vector<double>> first;
    for (const auto& [name, output] : statistics["outputs"].items()) {
      const std::string where = fmt::format("{}: outputs: {}", file.string(), name);
      const auto probabilities = check_output_statistics(output, where);
      if (!first) first = probabilities;
      if (probabilities && *probabilities != *first)
        JsonInput(output, where)["quantiles"].fail("must have the probabilities of the other outputs");
    }
  } catch (const InputError& e) {
    throw InputError(fmt::format("{}; {}", e.what(), changed));
  }
}

/// Of a finished sweep for indices: which runs are independent of each other.
void mark_independent(StoredSweep& s) {
  if (!s.indices) return;
  Saltelli design;
  for (const auto& output : s.statistics["outputs"])
    if (output.contains("sobol_indices") && design.column_group.empty())
      for (std::size_t g = 0; g < output["sobol_indices"].size(); ++g) design.column_group.push_back(g);
  for (StoredRun& run : s.runs) run.counts = design.independent(run.number);
}

/// The day of the newest file (UTC).
Result<std::string> date_of(const fs::path& directory) {
  fs::file_time_type newest = fs::file_time_type::min();
  std::error_code error;
  for (const fs::path& place : {directory, directory / "runs"}) {
    const auto entries = entries_of(place);
    if (!entries) return tl::unexpected(entries.error());
    for (const fs::directory_entry& entry : *entries)
      if (const auto ending = entry.path().extension(); ending == ".json" || ending == ".csv")
        newest = std::max(newest, entry.last_write_time(error));
  }
  if (newest == fs::file_time_type::min()) return std::string();  // no run yet
  const auto age = std::chrono::duration_cast<std::chrono::seconds>(fs::file_time_type::clock::now() - newest);
  const std::time_t at = std::time(nullptr) - age.count();
  std::tm day{};
  gmtime_r(&at, &day);
  return fmt::format("{:04}-{:02}-{:02}", 1900 + day.tm_year, 1 + day.tm_mon, day.tm_mday);
}

}  // namespace

Result<StoredSweep> read_sweep(const fs::path& directory) try {
  const auto status = read_status(directory);
  if (!status) return tl::unexpected(status.error());
  StoredSweep s{.directory = directory};
  const fs::path file = directory / "campaign.yaml";
  s.campaign = or_throw(read_text(file, "a YAML file"));
  read_campaign(s, Mapping(file.string(), "", load_yaml(file)));
  read_origin(s);
  s.finished = status->finished;
  auto date = date_of(directory);
  if (!date) return tl::unexpected(date.error());
  s.date = *std::move(date);
  if (!s.finished) {
    make_results(s);
    return s;
  }
  read_results(s, directory / "results.csv");
  std::error_code error;
  if (fs::exists(directory / "bands.csv", error)) read_bands(s, directory / "bands.csv");
  const fs::path statistics = directory / "statistics.json";
  s.statistics = parse_json(or_throw(read_text(statistics, "a JSON file")));
  check_statistics(s.statistics, statistics);
  mark_independent(s);
  return s;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::sweep
