#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <set>
#include <string>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/divided.hpp>
#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/diagnosis/fleet/survey.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr std::size_t chunk = 4096;  ///< curves, or joints, in memory
constexpr std::int64_t always = std::numeric_limits<std::int64_t>::max();
/// False discoveries relative to the rate, the most that a kind of synthetic plants had at 5 %, 2 sigma above its mean
/// (README, measured).
constexpr double measured_excess = 2.3;

/// Curves that are read, fitted and kept, a chunk at a time.
class Import {
 public:
  Import(Store* store, const std::filesystem::path& data, const ImportOptions& o) : store_(store), options_(o) {
    if (store_) reader_ = or_wrong_input(open_curves(data, o.read));
  }

  Imported run() {
    divide({.prepare = [this] { return prepare(); },
            .input = [this](std::size_t i, BytesOut& out) { put(out, curves_[to_fit_[i]]); },
            .work = [this](BytesIn& in,
                           BytesOut& out) { put(out, observe_levels(get_curve(in), options_.load_sensitivity)); },
            .finish = [this](const auto& results, const auto& failures) { finish(results, failures); }},
           options_.threads, options_.retries);
    return out_;
  }

 private:
  /// Chunks until there is one with something new.
  std::size_t prepare() {
    do {
      curves_.clear(), entries_.clear(), to_fit_.clear();
      LevelCurve curve;
      for (; curves_.size() < chunk && or_wrong_input(reader_->next(curve)); curve = {})
        curves_.push_back(std::move(curve));
      if (curves_.empty()) return 0;
      std::set<std::string> seen;  // with --replace a later curve takes the place of one of this chunk
      for (const auto& c : curves_) {
        entries_.push_back({.key = c.key, .file = c.file, .line = c.line, .checksum = c.checksum(), .observation = {}});
        const auto what = store_->look(entries_.back(), options_.learned);
        const bool again = options_.replace && !seen.insert(name_of(c.key)).second;
        if (what == Store::Put::added || again || (what == Store::Put::changed && options_.replace))
          to_fit_.push_back(entries_.size() - 1);
      }
      if (to_fit_.empty()) keep();
    } while (to_fit_.empty());
    return to_fit_.size();
  }

  void finish(const std::vector<std::string>& results, const std::vector<TaskFailure>& failures) {
    for (std::size_t i = 0; i < results.size(); ++i) {
      if (results[i].empty()) continue;
      BytesIn in(results[i]);
      entries_[to_fit_[i]].observation = get_observation(in);
    }
    std::set<std::size_t> without;
    for (const auto& f : failures) {
      const Entry& e = entries_[to_fit_[f.task]];
      out_.failed.push_back({.key = e.key, .input = fmt::format("{}:{}", e.file, e.line), .failure = f});
      store_->put_failure("fit", e.key, failure_text(out_.failed.back().input, f));
      without.insert(to_fit_[f.task]);
    }
    keep(without);
  }

  /// `without`: entries whose fits failed. A later import tries them again.
  void keep(const std::set<std::size_t>& without = {}) {
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      if (without.contains(i)) continue;
      const Entry& e = entries_[i];
      const auto put = store_->put(e, options_.learned, options_.replace);
      if (put == Store::Put::changed)
        throw InputError(fmt::format(
            "{}:{}: {}: differs from the curve of this robot, joint and date that {} brought; nothing was imported. "
            "Give it another date or number (column curve), or --replace to take its place",
            e.file, e.line, name_of(e.key), store_->origin(e.key)));
      ++(put == Store::Put::added      ? out_.added
         : put == Store::Put::known    ? out_.known
         : put == Store::Put::promoted ? out_.promoted
                                       : out_.replaced);
      if (e.observation.weak.empty()) continue;
      if (out_.weak++ == 0) out_.first_weak = fmt::format("{}:{}: {}", e.file, e.line, joined(e.observation.weak));
    }
    out_.curves += curves_.size();
  }

  Store* const store_;
  const ImportOptions options_;
  std::unique_ptr<CurveReader> reader_;
  std::vector<LevelCurve> curves_;
  std::vector<Entry> entries_;
  std::vector<std::size_t> to_fit_;
  Imported out_;
};

using ModelKey = std::pair<std::string, std::string>;

double rank_of(const Finding& f) {
  const double used = f.load.threshold > 0 ? f.load.load_norm / f.load.threshold : 0;
  return std::max(used, f.unit == "1" ? f.severity : 0);
}

/// The joints with observations in the time, and the models by which they are judged. On all ranks.
class EachJoint {
 public:
  EachJoint(Store* store, std::int64_t from_s, std::int64_t to_s, const SurveyOptions& o, WeightsOf what)
      : store_(store), from_s_(from_s), to_s_(to_s), options_(o) {
    const std::string texts = or_throw(ranks().from_root([&]() -> Result<std::string> {
      BytesOut out;
      out.put(std::string_view(store_->name()));
      for (const auto& text : store_->model_texts()) out.put(std::string_view(text));
      return out.take();
    }));
    BytesIn in(texts);
    for (const std::string name = in.text(); !in.empty();) models_.push_back(from_text(in.text(), name));
    if (models_.empty())
      throw InputError("the store holds no healthy state: begin with tribotwin fleet learn HEALTHY_DATA -o FLEET");
    for (std::size_t i = 0; i < models_.size(); ++i) {
      judges_.emplace_back(models_[i]);
      weights_.emplace_back(models_[i], what);
      by_name_.emplace(ModelKey{models_[i].type, models_[i].joint}, i);
    }
    if (store_) joints_ = store_->joints();
  }

  struct Task {
    const JointName* joint = nullptr;
    std::size_t model = 0;
    Rows healthy, recent;
  };
  Task task(const JointName& joint) const {
    const auto model = by_name_.find({joint.type, joint.joint});
    Task t{.joint = &joint, .model = model == by_name_.end() ? none : model->second};
    t.recent = store_->rows(joint.id, false, from_s_, to_s_);
    if (!t.recent.empty() && t.model != none) t.healthy = store_->rows(joint.id, true, -always, always);
    return t;
  }

  const Judge& judge(std::size_t model) const { return judges_[model]; }

  /// What the last observations of each of these joints look like; on any rank. They become those of the survey, but
  /// for those that failed.
  void explain(std::vector<Listed> all, Survey& survey) const {
    std::size_t chunks = 0;
    divide({.prepare = [&] { return chunks++ == 0 ? all.size() : 0; },
            .input = [&](std::size_t i, BytesOut& out) { put(out, last_of(all[i].joint)); },
            .work =
                [&](BytesIn& in, BytesOut& out) {
                  const Task t = get_task(in);
                  const Judge& by = judge(t.model);
                  fleet::put(out, by.explain(t.healthy, by.shift(t.healthy, t.recent), options_.load_sensitivity));
                },
            .finish =
                [&](const std::vector<std::string>& results, const std::vector<TaskFailure>& failures) {
                  for (std::size_t i = 0; i < results.size(); ++i) {
                    if (results[i].empty()) continue;
                    BytesIn in(results[i]);
                    all[i].finding = get_finding(in);
                    all[i].rank = rank_of(all[i].finding);
                    survey.listed.push_back(std::move(all[i]));
                  }
                  for (const auto& f : failures) {
                    const Listed& l = all[f.task];
                    failed(last_of(l.joint), f, fmt::format(", to be explained; listed with q = {:.2g}", l.q), survey);
                  }
                }},
           options_.threads, options_.retries);
  }

  /// By model, from the evidence of all joints.
  std::vector<ByChoice> all_weights() const {
    std::vector<ByChoice> all;
    for (const auto& w : weights_) all.push_back(w.weights());
    return all;
  }

  /// Calls work(task, out) for every joint on any rank, and done(task, in) on the first in the order of the joints,
  /// with what work has put after the evidence.
  void run(Survey& survey, const std::function<Evidence(const Task&, BytesOut&)>& work,
           const std::function<void(const Task&, BytesIn&)>& done) {
    std::size_t next = 0;
    std::vector<Task> tasks;
    divide({.prepare =
                [&] {
                  tasks.clear();
                  while (tasks.size() < chunk && next < joints_.size()) add(joints_[next++], tasks, survey);
                  return tasks.size();
                },
            .input = [&](std::size_t i, BytesOut& out) { put(out, tasks[i]); },
            .work =
                [&](BytesIn& in, BytesOut& out) {
                  BytesOut rest;
                  fleet::put(out, work(get_task(in), rest));
                  out.put(std::string_view(rest.take()));
                },
            .finish =
                [&](const std::vector<std::string>& results, const std::vector<TaskFailure>& failures) {
                  for (std::size_t i = 0; i < results.size(); ++i) {
                    if (results[i].empty()) continue;
                    BytesIn in(results[i]);
                    weights_[tasks[i].model].add(get_evidence(in));
                    const std::string rest = in.text();
                    BytesIn of_work(rest);
                    done(tasks[i], of_work);
                  }
                  for (const auto& f : failures) failed(tasks[f.task], f, "", survey);
                }},
           options_.threads, options_.retries);
  }

 private:
  static constexpr std::size_t none = ~std::size_t{0};

  void add(const JointName& joint, std::vector<Task>& tasks, Survey& survey) const {
    Task t = task(joint);
    if (t.recent.empty()) return;
    if (t.model == none) {
      ++survey.without_model;
      return;
    }
    if (models_[t.model].knows_temperature &&
        std::ranges::any_of(t.recent, [](const Row& r) { return !std::isfinite(r.temperature_degC); })) {
      ++survey.without_temperature;
      return;
    }
    ++survey.judged;
    tasks.push_back(std::move(t));
  }

  /// The last observations of a listed joint.
  Task last_of(const JointName& joint) const {
    Task t = task(joint);
    const double from = t.recent.back().day - options_.days;
    std::erase_if(t.recent, [&](const Row& r) { return r.day <= from; });
    return t;
  }

  static void put(BytesOut& out, const Task& t) {
    out.put<std::uint64_t>(t.model);
    fleet::put(out, t.healthy), fleet::put(out, t.recent);
  }
  static Task get_task(BytesIn& in) {
    Task t{.model = in.get<std::uint64_t>()};
    t.healthy = get_rows(in), t.recent = get_rows(in);
    return t;
  }

  static void failed(const Task& t, const TaskFailure& failure, const std::string& more, Survey& survey) {
    const JointName& j = *t.joint;
    --survey.judged;
    survey.failed.push_back(
        {.key = {.type = j.type, .robot = j.robot, .joint = j.joint, .time_s = survey.time_s},
         .input = fmt::format("{} curves, {} healthy ones{}", t.recent.size(), t.healthy.size(), more),
         .failure = failure});
  }

  Store* const store_;
  const std::int64_t from_s_, to_s_;
  const SurveyOptions options_;
  std::deque<TypeModel> models_;
  std::deque<Judge> judges_;
  std::vector<PersistenceWeights> weights_;
  std::map<ModelKey, std::size_t> by_name_;
  std::vector<JointName> joints_;
};

/// Collective.
std::int64_t end_of(Store* store, const SurveyOptions& o) {
  return std::stoll(or_throw(ranks().from_root([&]() -> Result<std::string> {
    const auto newest = o.time_s ? o.time_s : store->newest();
    if (!newest)
      return tl::unexpected(
          Error("the store holds no observation to judge: all of them are healthy ones, learned from"));
    return std::to_string(*newest);
  })));
}

void keep_verdicts(Store& store, const char* kind, const SurveyOptions& o, Survey& survey) {
  std::ranges::stable_sort(survey.listed, std::greater{}, &Listed::rank);
  std::vector<StoredVerdict> kept;
  for (const auto& l : survey.listed)
    kept.push_back({.joint = l.joint.id,
                    .p = l.p,
                    .q = l.q,
                    .pattern = std::string(l.finding.pattern),
                    .unit = std::string(l.finding.unit),
                    .severity = l.finding.severity,
                    .confidence = l.finding.confidence,
                    .margin = l.finding.margin});
  store.put_verdicts(kind, survey.time_s, o.rate, survey.judged, kept);
  for (const auto& f : survey.failed) store.put_failure(kind, f.key, failure_text(f.input, f.failure));
}

/// What may be listed: p of at most the rate under some persistence. The others only count.
struct Candidate {
  const JointName* joint = nullptr;
  std::size_t model = 0;
  ByChoice by_persistence;
  double p = 1, cusum = 0;
  std::size_t observations = 0;
};

double smallest(const ByChoice& p) { return 2 * std::min(std::ranges::min(p[0]), std::ranges::min(p[1])); }

/// Joints listed on each day, for `since`: p of at most the rate by day, and how many were judged on it.
class DailyLists {
 public:
  void judged(double day) { ++days_[static_cast<std::int64_t>(day)].judged; }
  void add(double day, const JointName* joint, std::size_t model, ByChoice p) {
    days_[static_cast<std::int64_t>(day)].candidates.push_back(
        {.joint = joint, .model = model, .by_persistence = std::move(p)});
  }
  std::map<const JointName*, std::int64_t> first(double rate, const std::vector<ByChoice>& weights) const {
    std::map<const JointName*, std::int64_t> out;
    for (const auto& [day, list] : days_) {
      std::vector<double> p;
      for (const auto& c : list.candidates) p.push_back(by_chance(c.by_persistence, weights[c.model]));
      const auto q = adjusted(p, list.judged);
      for (std::size_t i = 0; i < q.size(); ++i)
        if (q[i] <= rate) out.emplace(list.candidates[i].joint, day * 86400);
    }
    return out;
  }

 private:
  struct Day {
    std::size_t judged = 0;
    std::vector<Candidate> candidates;
  };
  std::map<std::int64_t, Day> days_;
};

/// The last step of every day, with p where it may be listed.
void put_days(BytesOut& out, const Chart& chart, double rate) {
  const auto& all = chart.steps;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double day = std::floor(all[i].day);
    if (i + 1 < all.size() && std::floor(all[i + 1].day) == day) continue;
    const bool candidate = smallest(all[i].p) <= rate;
    out.put(day).put(all[i].sum).put(candidate);
    if (candidate) put(out, all[i].p);
  }
}
/// Calls each(day, p) for every day; returns the last one where it may be listed.
std::optional<Chart::Step> get_days(BytesIn& in, const std::function<void(double, std::optional<ByChoice>)>& each) {
  std::optional<Chart::Step> last;
  while (!in.empty()) {
    last = Chart::Step{.day = in.get<double>(), .p = {}};
    last->sum = in.get<double>();
    if (in.get<bool>()) {
      last->p = get_by_choice(in);
      each(last->day, last->p);
      continue;
    }
    each(last->day, std::nullopt);
    last.reset();
  }
  return last;
}

std::int64_t seconds(double days) { return static_cast<std::int64_t>(std::llround(days * 86400)); }

/// The candidates whose adjusted p is at most the rate.
std::vector<Listed> listed_of(std::vector<Candidate>& candidates, const std::vector<ByChoice>& weights, double rate,
                              std::size_t judged) {
  std::vector<double> p;
  for (auto& c : candidates) p.push_back(c.p = by_chance(c.by_persistence, weights[c.model]));
  const auto q = adjusted(p, judged);
  std::vector<Listed> all;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& c = candidates[i];
    if (q[i] <= rate)
      all.push_back({.joint = *c.joint,
                     .p = p[i],
                     .q = q[i],
                     .observations = c.observations,
                     .finding = {},
                     .cusum = c.cusum,
                     .since_s = {}});
  }
  return all;
}

}  // namespace

Imported import_curves(Store* store, const std::filesystem::path& data, const ImportOptions& options) {
  return Import(store, data, options).run();
}

Survey check_fleet(Store* store, const SurveyOptions& o) {
  Survey survey{.time_s = end_of(store, o)};
  EachJoint each(store, survey.time_s - seconds(o.days) + 1, survey.time_s, o, WeightsOf::shifts);
  std::vector<Candidate> candidates;
  each.run(
      survey,
      [&](const EachJoint::Task& t, BytesOut& out) {
        const Shift shift = each.judge(t.model).shift(t.healthy, t.recent);
        put(out, shift.by_chance);
        return shift.evidence;
      },
      [&](const EachJoint::Task& t, BytesIn& in) {
        ByChoice p = get_by_choice(in);
        if (smallest(p) <= o.rate)
          candidates.push_back(
              {.joint = t.joint, .model = t.model, .by_persistence = std::move(p), .observations = t.recent.size()});
      });
  each.explain(listed_of(candidates, each.all_weights(), o.rate, survey.judged), survey);
  if (store) keep_verdicts(*store, "check", o, survey);
  return survey;
}

std::string healthy_among(std::size_t listed, double rate) {
  const double all = static_cast<double>(listed), expected = rate * all;
  return fmt::format("{:.2g} joints or fewer are healthy on average as far as the model holds; up to {:.2g} in tests",
                     expected, std::min(all, measured_excess * expected));
}

Survey watch_fleet(Store* store, const SurveyOptions& o) {
  Survey survey{.time_s = end_of(store, o)};
  EachJoint each(store, -always, survey.time_s, o, WeightsOf::charts);
  const CusumTail tail;
  std::vector<Candidate> candidates;
  DailyLists daily;
  each.run(
      survey,
      [&](const EachJoint::Task& t, BytesOut& out) {
        const Chart chart = each.judge(t.model).watch(t.healthy, t.recent, tail);
        put_days(out, chart, o.rate);
        return chart.evidence;
      },
      [&](const EachJoint::Task& t, BytesIn& in) {
        const auto last = get_days(in, [&](double day, std::optional<ByChoice> p) {
          daily.judged(day);
          if (p) daily.add(day, t.joint, t.model, *std::move(p));
        });
        if (last)
          candidates.push_back({.joint = t.joint,
                                .model = t.model,
                                .by_persistence = last->p,
                                .cusum = last->sum,
                                .observations = t.recent.size()});
      });
  const auto weights = each.all_weights();
  each.explain(listed_of(candidates, weights, o.rate, survey.judged), survey);
  if (!store) return survey;
  std::map<std::int64_t, std::int64_t> since;
  for (const auto& [joint, time_s] : daily.first(o.rate, weights)) since.emplace(joint->id, time_s);
  for (auto& l : survey.listed)
    if (const auto at = since.find(l.joint.id); at != since.end()) l.since_s = at->second;
  keep_verdicts(*store, "watch", o, survey);
  return survey;
}

}  // namespace tribotwin::twin::diagnosis::fleet
