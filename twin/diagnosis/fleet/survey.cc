#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/survey.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr std::size_t chunk = 4096;  ///< curves, or joints, in memory
constexpr std::int64_t always = std::numeric_limits<std::int64_t>::max();
constexpr double stop_learning = 1e-3;  ///< a chart that is as unlikely on a healthy joint no longer learns

/// Fits and keeps what is new in a chunk.
void keep(Store& store, std::vector<LevelCurve>& curves, const ImportOptions& o, Imported& out) {
  std::vector<Entry> entries;
  std::vector<std::size_t> to_fit;
  for (const auto& c : curves) {
    entries.push_back({.key = c.key, .file = c.file, .line = c.line, .checksum = c.checksum(), .observation = {}});
    const auto what = store.look(entries.back(), o.learned);
    if (what == Store::Put::added || (what == Store::Put::changed && o.replace)) to_fit.push_back(entries.size() - 1);
  }
  identification::in_parallel(to_fit.size(), o.threads, [&](std::size_t i) {
    entries[to_fit[i]].observation = observe_levels(curves[to_fit[i]], o.load_sensitivity);
  });
  for (const auto& e : entries) {
    switch (store.put(e, o.learned, o.replace)) {
      case Store::Put::added:
        ++out.added;
        break;
      case Store::Put::known:
        ++out.known;
        break;
      case Store::Put::promoted:
        ++out.promoted;
        break;
      case Store::Put::replaced:
        ++out.replaced;
        break;
      case Store::Put::changed:
        throw InputError(
            fmt::format("{}:{}: {}: differs from the curve of this robot, joint and date that {} brought; nothing was "
                        "imported. Give "
                        "it another date or number (column curve), or --replace to take its place",
                        e.file, e.line, name_of(e.key), store.origin(e.key)));
    }
    if (e.observation.weak.empty()) continue;
    if (out.weak++ == 0) out.first_weak = fmt::format("{}:{}: {}", e.file, e.line, joined(e.observation.weak));
  }
  out.curves += curves.size();
  curves.clear();
}

using ModelKey = std::pair<std::string, std::string>;

/// Calls work(i, healthy, recent, model) for every joint with observations in the time, in parallel, and counts the
/// rest.
class EachJoint {
 public:
  EachJoint(Store& store, std::int64_t from_s, std::int64_t to_s, unsigned threads)
      : store_(store), from_s_(from_s), to_s_(to_s), threads_(threads) {
    for (auto& m : store.models()) models_.emplace(ModelKey{m.type, m.joint}, std::move(m));
    if (models_.empty())
      throw InputError("the store holds no healthy state: begin with tribotwin fleet learn HEALTHY_DATA -o FLEET");
  }

  struct Task {
    const JointName* joint;
    const TypeModel* model;
    Rows healthy, recent;
  };
  Task task(const JointName& joint) const {
    const auto model = models_.find({joint.type, joint.joint});
    return {.joint = &joint,
            .model = model == models_.end() ? nullptr : &model->second,
            .healthy = store_.rows(joint.id, true, -always, always),
            .recent = store_.rows(joint.id, false, from_s_, to_s_)};
  }

  /// `done(task, result)` is called in the order of the joints.
  template <class Work, class Done>
  void run(const std::vector<JointName>& joints, Survey& survey, const Work& work, const Done& done) const {
    std::vector<Task> tasks;
    const auto finish = [&] {
      std::vector<decltype(work(tasks.front()))> results(tasks.size());
      identification::in_parallel(tasks.size(), threads_, [&](std::size_t i) { results[i] = work(tasks[i]); });
      for (std::size_t i = 0; i < tasks.size(); ++i) done(tasks[i], results[i]);
      tasks.clear();
    };
    for (const auto& joint : joints) {
      Task t = task(joint);
      if (t.recent.empty()) continue;
      if (!t.model) {
        ++survey.without_model;
        continue;
      }
      if (t.model->knows_temperature &&
          std::ranges::any_of(t.recent, [](const Row& r) { return !std::isfinite(r.temperature_degC); })) {
        ++survey.without_temperature;
        continue;
      }
      ++survey.judged;
      tasks.push_back(std::move(t));
      if (tasks.size() == chunk) finish();
    }
    if (!tasks.empty()) finish();
  }

 private:
  Store& store_;
  const std::int64_t from_s_, to_s_;
  const unsigned threads_;
  std::map<ModelKey, TypeModel> models_;
};

double rank_of(const Finding& f) {
  const double used = f.load.threshold > 0 ? f.load.load_norm / f.load.threshold : 0;
  return std::max(used, f.unit == "1" ? f.severity : 0);
}

std::int64_t end_of(Store& store, const SurveyOptions& o) {
  const auto newest = o.time_s ? o.time_s : store.newest();
  if (!newest) throw InputError("the store holds no observation to judge: all of them are healthy ones, learned from");
  return *newest;
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
}

/// What may be listed: p of at most the rate. The others only count.
struct Candidate {
  const JointName* joint;
  double p = 1, cusum = 0;
  std::size_t observations = 0;
};

/// Joints listed on each day, for `since`: p of at most the rate by day, and how many were judged on it.
class DailyLists {
 public:
  void add(const JointName* joint, const Chart& chart, double rate) {
    for (std::size_t i = 0; i < chart.steps.size(); ++i) {
      const auto day = static_cast<std::int64_t>(std::floor(chart.steps[i].day));
      if (i + 1 < chart.steps.size() && std::floor(chart.steps[i + 1].day) == static_cast<double>(day)) continue;
      auto& list = days_[day];
      ++list.judged;
      if (chart.steps[i].p <= rate) list.p.push_back(chart.steps[i].p), list.joints.push_back(joint);
    }
  }
  std::map<const JointName*, std::int64_t> first(double rate) const {
    std::map<const JointName*, std::int64_t> out;
    for (const auto& [day, list] : days_) {
      const auto q = adjusted(list.p, list.judged);
      for (std::size_t i = 0; i < q.size(); ++i)
        if (q[i] <= rate) out.emplace(list.joints[i], day * 86400);
    }
    return out;
  }

 private:
  struct Day {
    std::size_t judged = 0;
    std::vector<double> p;
    std::vector<const JointName*> joints;
  };
  std::map<std::int64_t, Day> days_;
};

std::int64_t seconds(double days) { return static_cast<std::int64_t>(std::llround(days * 86400)); }

/// The candidates whose adjusted p is at most the rate, explained by their last observations.
void list(const std::vector<Candidate>& candidates, const EachJoint& each, const SurveyOptions& o, Survey& survey) {
  std::vector<double> p;
  for (const auto& c : candidates) p.push_back(c.p);
  const auto q = adjusted(p, survey.judged);
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (!(q[i] <= o.rate)) continue;
    EachJoint::Task t = each.task(*candidates[i].joint);
    const double from = t.recent.back().day - o.days;
    std::erase_if(t.recent, [&](const Row& r) { return r.day <= from; });
    Listed l{.joint = *candidates[i].joint, .p = p[i], .q = q[i], .observations = candidates[i].observations};
    l.finding = explain(*t.model, t.healthy, judge_window(*t.model, t.healthy, t.recent), o.load_sensitivity);
    l.rank = rank_of(l.finding), l.cusum = candidates[i].cusum;
    survey.listed.push_back(std::move(l));
  }
}

}  // namespace

Imported import_curves(Store& store, const std::filesystem::path& data, const ImportOptions& options) {
  const auto reader = or_wrong_input(open_curves(data, options.read));
  Imported out;
  std::vector<LevelCurve> curves;
  for (LevelCurve curve; or_wrong_input(reader->next(curve)); curve = {}) {
    curves.push_back(std::move(curve));
    if (curves.size() == chunk) keep(store, curves, options, out);
  }
  keep(store, curves, options, out);
  return out;
}

std::vector<TypeModel> learn_fleet(Store& store, std::vector<std::string>& notes) {
  std::map<ModelKey, std::vector<std::int64_t>> groups;
  for (const auto& j : store.joints()) groups[{j.type, j.joint}].push_back(j.id);
  std::vector<TypeModel> all;
  std::string problem;
  for (const auto& group : groups) {
    const auto& key = group.first;
    const auto& ids = group.second;
    auto model = learn_type([&](const std::function<void(const Rows&)>& visit) {
      for (const auto id : ids) visit(store.rows(id, true, -always, always));
    });
    if (!model) {
      problem = fmt::format("joint {}{}: {}", key.second, key.first.empty() ? "" : " of type " + key.first,
                            model.error().message);
      notes.push_back("no model of " + problem);
      continue;
    }
    model->type = key.first, model->joint = key.second;
    store.put_model(*model);
    all.push_back(*std::move(model));
  }
  if (all.empty()) throw InputError(problem.empty() ? "there are no curves to learn from" : problem);
  return all;
}

Survey check_fleet(Store& store, const SurveyOptions& o) {
  Survey survey{.time_s = end_of(store, o)};
  const EachJoint each(store, survey.time_s - seconds(o.days) + 1, survey.time_s, o.threads);
  const auto joints = store.joints();
  std::vector<Candidate> candidates;
  each.run(
      joints, survey, [](const EachJoint::Task& t) { return judge_window(*t.model, t.healthy, t.recent).p; },
      [&](const EachJoint::Task& t, double p) {
        if (p <= o.rate) candidates.push_back({.joint = t.joint, .p = p, .observations = t.recent.size()});
      });
  list(candidates, each, o, survey);
  keep_verdicts(store, "check", o, survey);
  return survey;
}

Survey watch_fleet(Store& store, const SurveyOptions& o) {
  Survey survey{.time_s = end_of(store, o)};
  const EachJoint each(store, -always, survey.time_s, o.threads);
  const auto joints = store.joints();
  const CusumTail tail;
  std::vector<Candidate> candidates;
  DailyLists daily;
  each.run(
      joints, survey,
      [&](const EachJoint::Task& t) { return watch_joint(*t.model, t.healthy, t.recent, tail, stop_learning); },
      [&](const EachJoint::Task& t, const Chart& chart) {
        const auto& last = chart.steps.back();
        daily.add(t.joint, chart, o.rate);
        if (last.p <= o.rate)
          candidates.push_back({.joint = t.joint,
                                .p = last.p,
                                .cusum = std::max(last.sum[0], last.sum[1]),
                                .observations = chart.steps.size()});
      });
  list(candidates, each, o, survey);
  std::map<std::int64_t, std::int64_t> since;
  for (const auto& [joint, time_s] : daily.first(o.rate)) since.emplace(joint->id, time_s);
  for (auto& l : survey.listed)
    if (const auto at = since.find(l.joint.id); at != since.end()) l.since_s = at->second;
  keep_verdicts(store, "watch", o, survey);
  return survey;
}

}  // namespace tribotwin::twin::diagnosis::fleet
