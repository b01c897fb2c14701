#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/diagnosis/fleet/database/database.hpp>
#include <tribotwin/twin/diagnosis/fleet/learning/learning.hpp>
#include <tribotwin/twin/diagnosis/fleet/survey.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

namespace tribotwin::twin::program {
namespace {

using namespace diagnosis::fleet;
using Json = nlohmann::ordered_json;

struct Arguments {
  std::vector<std::string> data;
  std::string store, date, columns;
  ImportOptions import;
  SurveyOptions survey;
  unsigned threads = 0;
  int retries = 1;
  bool json = false, quiet = false;
};

Json json_of(const Imported& i) {
  return {{"curves", i.curves},     {"added", i.added},       {"known", i.known},
          {"promoted", i.promoted}, {"replaced", i.replaced}, {"not_identifiable", i.weak}};
}

/// All of DATA; what it brought is said on stderr.
Imported imported(Store* store, const Arguments& a) {
  Imported sum;
  for (const auto& data : a.data) {
    const Imported one = import_curves(store, data, a.import);
    sum.curves += one.curves, sum.added += one.added, sum.known += one.known, sum.promoted += one.promoted;
    sum.replaced += one.replaced;
    if (sum.weak == 0) sum.first_weak = one.first_weak;
    sum.weak += one.weak;
    sum.failed.insert(sum.failed.end(), one.failed.begin(), one.failed.end());
  }
  if (a.quiet || a.data.empty()) return sum;
  note("{} curves: {} new, {} known already{}{}", sum.curves, sum.added, sum.known,
       sum.promoted ? fmt::format(", {} known, now learned from", sum.promoted) : "",
       sum.replaced ? fmt::format(", {} replaced", sum.replaced) : "");
  if (sum.weak)
    note("{} curves are left out, because features are not identifiable from their levels, the first: {}", sum.weak,
         sum.first_weak);
  return sum;
}

/// Work that failed: what it was, for people and for programs.
struct Failed {
  std::string name;
  Json json;
  TaskFailure failure;
};

Json with_failure(Json j, const std::string& input, const TaskFailure& f) {
  j["input"] = input, j["attempts"] = f.attempts, j["message"] = f.error.message;
  return j;
}

/// `work`: fit, judgement.
std::vector<Failed> failed_of(const char* work, const std::vector<FailedPart>& parts) {
  std::vector<Failed> all;
  for (const auto& [key, input, failure] : parts) {
    const Json j{{"work", work}, {"robot", key.robot}, {"joint", key.joint}, {"date", date_of(key.time_s)}};
    all.push_back({.name = fmt::format("{}: {}", work, diagnosis::fleet::name_of(key)),
                   .json = with_failure(j, input, failure),
                   .failure = failure});
  }
  return all;
}

std::vector<Failed> failed_of(const std::vector<FailedModel>& models) {
  std::vector<Failed> all;
  for (const auto& [type, joint, input, failure] : models)
    all.push_back({.name = fmt::format("model: {}", diagnosis::fleet::name_of(type, joint)),
                   .json = with_failure({{"work", "model"}, {"type", type}, {"joint", joint}}, input, failure),
                   .failure = failure});
  return all;
}

Json json_of(const std::vector<Failed>& failures) {
  Json all = Json::array();
  for (const auto& f : failures) all.push_back(f.json);
  return all;
}

std::string text_of(const std::vector<Failed>& failures) {
  std::vector<TaskFailure> all;
  for (const auto& f : failures) all.push_back({all.size(), f.failure.attempts, f.failure.error});
  return twin::text_of(all, [&](std::size_t i) { return failures[i].name; });
}

/// The end of a command whose results are delivered: exit code 1 names what failed.
Result<Exit> end(Exit code, const std::vector<Failed>& failures) {
  if (failures.empty()) return code;
  return report_error(failed, text_of(failures) + "; all else is done and kept, and the same command tries again");
}

std::vector<Failed> together(std::vector<Failed> one, std::vector<Failed> other) {
  std::ranges::move(other, std::back_inserter(one));
  return one;
}

/// On the first of several ranks; none on the others.
std::unique_ptr<Store> opened(const Arguments& a) {
  return ranks().root() ? std::make_unique<Store>(a.store) : nullptr;
}

Result<Exit> learn(const Arguments& a) {
  if (const auto ok = join_ranks(); !ok) return tl::unexpected(ok.error());
  const auto store = opened(a);
  const Imported data = imported(store.get(), a);
  const Learned learned = [&] {
    try {
      return learn_fleet(store.get(), {.threads = a.threads, .retries = a.retries});
    } catch (const InputError& lacking) {  // what it lacks may be what failed
      if (data.failed.empty()) throw;
      throw std::runtime_error(
          fmt::format("{}; without what failed: {}", text_of(failed_of("fit", data.failed)), lacking.what()));
    }
  }();
  if (!store) return done;
  if (interrupted()) return work_failed("interrupted; the store is as before");
  store->commit();
  const auto failures = together(failed_of("fit", data.failed), failed_of(learned.failed));
  Json j{{"files", Json::array({without_password(a.store)})},
         {"imported", json_of(data)},
         {"models", Json::array()},
         {"notes", learned.notes},
         {"failed", json_of(failures)}};
  TextTable table({TextTable::left("type"), TextTable::left("joint"), TextTable::right("robots"),
                   TextTable::right("curves"), TextTable::left("degC"), TextTable::right("between robots, Fc %"),
                   TextTable::right("day to day, Fc %"), TextTable::right("persistence per day")});
  for (const auto& m : learned.models) {
    const auto spread = spread_of(m);
    j["models"].push_back({{"type", m.type},
                           {"joint", m.joint},
                           {"robots", m.robots},
                           {"curves", m.observations},
                           {"temperature_degC", {m.temperature_low_degC, m.temperature_high_degC}},
                           {"knows_temperature", m.knows_temperature},
                           {"Fc_between_robots", spread.between},
                           {"Fc_day_to_day", spread.days},
                           {"Fc_measurement", spread.measurement},
                           {"persistence_per_day", m.region[0].persistence}});
    table.add({m.type.empty() ? "-" : m.type, m.joint, fmt::format("{}", m.robots), fmt::format("{}", m.observations),
               fmt::format("{:.0f} .. {:.0f}", m.temperature_low_degC, m.temperature_high_degC),
               m.robots < robots_minimum ? "-" : fmt::format("{:.1f}", 100 * spread.between),
               fmt::format("{:.2f}", 100 * spread.days), fmt::format("{:.2f}", m.region[0].persistence)});
    for (const auto& text : m.notes)
      if (!a.quiet) note("joint {}: {}", m.joint, text);
  }
  if (!a.quiet)
    for (const auto& text : learned.notes) note("{}", text);
  if (auto ok = deliver(a.json ? dump_json(j, 2) + "\n" : table.text()); !ok) return ok;
  return end(done, failures);
}

/// What is sure, of how many, at which rate.
std::string sentence_of(const Survey& s, const SurveyOptions& o, bool check) {
  const std::string what = check ? fmt::format("the {:g} days to {}", o.days, date_of(s.time_s))
                                 : fmt::format("all days to {}", date_of(s.time_s));
  std::string text =
      s.listed.empty()
          ? fmt::format("None of {} joints is listed over {}, at a false-discovery rate of {:g} %.", s.judged, what,
                        100 * o.rate)
          : fmt::format(
                "{} of {} joints are not as learned over {}, at a false-discovery rate of {:g} %: of such a "
                "list, {}.",
                s.listed.size(), s.judged, what, 100 * o.rate, healthy_among(s.listed.size(), o.rate));
  if (s.without_model)
    text += fmt::format(" {} joints have no verdict: no healthy curves of their type were learned.", s.without_model);
  if (s.without_temperature)
    text += fmt::format(" {} joints have no verdict: curves without temperature_degC.", s.without_temperature);
  if (!s.failed.empty())
    text += fmt::format(" {} more joints were not judged or, though listed, not explained: see what failed.",
                        s.failed.size());
  return text;
}

Json json_of(const Listed& l, std::size_t rank) {
  const auto& f = l.finding;
  Json j{{"rank", rank},
         {"robot", l.joint.robot},
         {"joint", l.joint.joint},
         {"type", l.joint.type},
         {"p", l.p},
         {"q", l.q},
         {"observations", l.observations},
         {"pattern", f.pattern},
         {"severity", f.severity},
         {"severity_unit", f.unit},
         {"confidence", f.confidence},
         {"friction_change", f.friction_change},
         {"equivalent_load", f.load.load_norm},
         {"equivalent_load_sigma", f.load.sigma},
         {"equivalent_load_threshold", f.load.threshold},
         {"margin", {{"value", f.margin}, {"low", f.margin_low}, {"high", f.margin_high}}},
         {"advice", f.advice}};
  if (l.since_s) j["cusum"] = l.cusum, j["since"] = date_of(*l.since_s);
  return j;
}

TextTable table_of(const Survey& s, bool check) {
  TextTable table({TextTable::right("#"), TextTable::left("robot"), TextTable::left("joint"),
                   TextTable::left("pattern"), TextTable::right("severity"), TextTable::left("unit"),
                   TextTable::right("confidence"), TextTable::right("Fc change %"),
                   TextTable::right("margin, load_norm"), TextTable::left("95 %"), TextTable::right("q"),
                   check ? TextTable::right("curves") : TextTable::left("since")});
  for (std::size_t i = 0; i < s.listed.size(); ++i) {
    const auto& l = s.listed[i];
    const auto& f = l.finding;
    table.add({fmt::format("{}", i + 1), l.joint.robot, l.joint.joint, std::string(f.pattern),
               f.pattern == "unknown" ? "-" : fmt::format("{:.3g}", f.severity),
               f.unit == "1" ? "relative" : std::string(f.unit), diagnosis::probability_text(f.confidence),
               fmt::format("{:+.1f}", 100 * f.friction_change), fmt::format("{:.3g}", f.margin),
               fmt::format("{:.3g} .. {:.3g}", f.margin_low, f.margin_high), fmt::format("{:.2g}", l.q),
               check       ? fmt::format("{}", l.observations)
               : l.since_s ? date_of(*l.since_s)
                           : "-"});
  }
  return table;
}

Result<Exit> survey(const Arguments& a, bool check) {
  if (const auto ok = join_ranks(); !ok) return tl::unexpected(ok.error());
  const auto store = opened(a);
  const Imported data = imported(store.get(), a);
  const Survey s = check ? check_fleet(store.get(), a.survey) : watch_fleet(store.get(), a.survey);
  if (!store) return done;
  if (interrupted()) return work_failed("interrupted; the store is as before");
  store->commit();
  const std::string sentence = sentence_of(s, a.survey, check);
  const auto failures = together(failed_of("fit", data.failed), failed_of("judgement", s.failed));
  Json j{{"sentence", sentence},
         {"date", date_of(s.time_s)},
         {"false_discovery_rate", a.survey.rate},
         {"judged", s.judged},
         {"listed", s.listed.size()},
         {"without_verdict", s.without_model + s.without_temperature + s.failed.size()},
         {"imported", json_of(data)},
         {"failed", json_of(failures)},
         {"joints", Json::array()}};
  for (std::size_t i = 0; i < s.listed.size(); ++i) j["joints"].push_back(json_of(s.listed[i], i + 1));
  const std::string text = s.listed.empty() ? sentence + "\n" : sentence + "\n\n" + table_of(s, check).text();
  if (auto ok = deliver(a.json ? dump_json(j, 2) + "\n" : text); !ok) return ok;
  return end(s.listed.empty() ? done : limit_exceeded, failures);
}

/// Before any work: what options say together.
void prepare(Arguments& a) {
  a.import.threads = a.survey.threads = a.threads;
  a.import.retries = a.survey.retries = a.retries;
  a.survey.load_sensitivity = a.import.load_sensitivity;
  a.import.read.columns = a.columns;
  catch_interrupts();  // the store goes back to what it was, and its journal goes with it
  for (const auto& data : a.data)
    if (is_same_file(data, a.store)) throw InputError(fmt::format("{}: is the store itself, not DATA", data));
  if (a.date.empty()) return;
  a.survey.time_s = to_time(a.date);
  if (!a.survey.time_s) throw InputError(fmt::format("--date {}: write 2026-11-23 or 2026-11-23T08:17", a.date));
  if (a.date.size() == 10) *a.survey.time_s += 86399;  // the whole day
}

void add_common(CLI::App& c, Arguments& a) {
  c.add_option("-o,--output", a.store,
               "The fleet's store, which is made or added to: a file (SQLite), or postgresql://USER@HOST:PORT/DATABASE "
               "with the password in PGPASSWORD or ~/.pgpass")
      ->required();
  c.add_flag("--replace", a.import.replace, "A curve that differs from the one in the store takes its place");
  c.add_option("--columns", a.columns,
               "YAML that maps foreign column names: robot: FOREIGN, speed_rad_s: {from: FOREIGN, unit: rpm}");
  c.add_option("--tau-max", a.import.read.torque_max_nm,
               "Largest manipulation torque [Nm], arm side, for curves in friction_norm alone")
      ->check(CLI::Range(1e-9, 1e9));
  c.add_option("--load-sensitivity", a.import.load_sensitivity,
               "Relative rise of Fc and Fs per load_norm; the same for all imports of a store")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  c.add_option("--threads", a.threads,
               "Curves, joints and types computed at once (default: one per core; under mpirun, per rank: 1)")
      ->check(CLI::Range(1u, 1024u));
  c.add_option("--retries", a.retries, "Further attempts of a curve, joint or type whose work failed (default: 1)")
      ->check(CLI::Range(0, 100));
  c.add_flag("--json", a.json, "Print JSON instead of the table");
  c.add_flag("--quiet", a.quiet, "No notes on stderr");
}

constexpr const char* data_help =
    "CSV or HDF5 with robot, joint, date and the columns of a friction curve, or a folder of "
    "ROBOT/JOINT/DATE.csv; may be repeated";

void add_learn(CLI::App& app, const std::shared_ptr<Arguments>& a, int& code) {
  auto* command = app.add_subcommand("learn", "Healthy curves into the store, and one model per type of joint");
  command->add_option("DATA", a->data, data_help)->required();
  add_common(*command, *a);
  command->footer("Example:\n  tribotwin fleet learn healthy.csv -o plant.db");
  command->callback([a, &code] {
    prepare(*a);
    a->import.learned = true;
    code = or_throw(learn(*a));
  });
}

void add_survey(CLI::App& app, const std::shared_ptr<Arguments>& a, int& code, bool check) {
  auto* command =
      check
          ? app.add_subcommand("check", "Which joints are not as learned over the last days; exit code 3 where any is")
          : app.add_subcommand("watch", "Small changes over many days (CUSUM); exit code 3 where any joint is listed");
  command->add_option("DATA", a->data, std::string(data_help) + "; without it the store is judged as it is");
  add_common(*command, *a);
  command
      ->add_option("--false-discovery-rate", a->survey.rate,
                   "Share of the listed joints that may be healthy, on average")
      ->check(CLI::Range(1e-6, 0.5))
      ->capture_default_str();
  if (check)
    command->add_option("--days", a->survey.days, "Length of the window that is judged [days]")
        ->check(CLI::Range(1e-3, 3650.0))
        ->capture_default_str();
  command->add_option("--date", a->date, "Last day that is judged (default: that of the newest curve)");
  command->footer(
      fmt::format("Example:\n  tribotwin fleet learn healthy.csv -o plant.db\n  tribotwin fleet {} "
                  "week.csv -o plant.db",
                  check ? "check" : "watch"));
  command->callback([a, &code, check] {
    prepare(*a);
    code = or_throw(survey(*a, check));
  });
}

}  // namespace

void add_fleet(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand("fleet", "Diagnose all joints of many robots, with few false alarms");
  c->require_subcommand(1);
  add_learn(*c, a, code);
  add_survey(*c, a, code, true);
  add_survey(*c, a, code, false);
}

}  // namespace tribotwin::twin::program
