#include <algorithm>
#include <chrono>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/diagnosis/learn.hpp>
#include <tribotwin/twin/experiments/fault_study/power.hpp>
#include <tribotwin/twin/experiments/fault_study/study.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

namespace tribotwin::twin::study {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using diagnosis::Observation, diagnosis::ObservationFile, diagnosis::HealthyState, diagnosis::Verdict;

/// The curves of a campaign as observations, one for one.
Result<ObservationFile> observed(const Joint& joint, const fs::path& directory) {
  auto file = diagnosis::read_observations(directory / "curves.csv", {});
  if (file && file->observations.size() != joint.campaign.curves.size())
    return tl::unexpected(fmt::format("{}: has {} curves where the campaign has {}",
                                      (directory / "curves.csv").string(), file->observations.size(),
                                      joint.campaign.curves.size()));
  return file;
}

/// Those of one series.
ObservationFile of_series(const ObservationFile& all, const Campaign& campaign, const std::string& series) {
  ObservationFile some = all;
  some.observations.clear();
  for (std::size_t i = 0; i < campaign.curves.size(); ++i)
    if (campaign.curves[i].series == series) some.observations.push_back(all.observations[i]);
  return some;
}

Json json_of(const Observation& o) {
  Json j{{"curve", o.curve}, {"temperature_degC", *o.temperature_degC}};
  for (Eigen::Index i = 0; i < diagnosis::feature_count; ++i)
    j["features"][diagnosis::feature_names[static_cast<std::size_t>(i)]] = o.features(i);
  for (std::size_t k = 0; k < diagnosis::indicator_count; ++k)
    j["indicators"][diagnosis::indicators[k].name] = *o.indicators[k];
  return j;
}

Json json_of(const Verdict& v) {
  Json j;
  for (std::size_t r = 0; r < diagnosis::regions.size(); ++r) {
    const auto& region = v.region[r];
    j[diagnosis::regions[r].name] = {{"distance", region.distance},
                                     {"anomalous", region.anomalous},
                                     {"statistic", region.statistic},
                                     {"limit", region.limit}};
  }
  j["anomalous"] = v.anomalous;
  j["equivalent_load"] = v.load.load_norm;
  j["equivalent_load_threshold"] = v.load.threshold;
  j["pattern"] = v.pattern;
  j["severity"] = v.severity;
  j["confidence"] = v.confidence;
  j["sentence"] = v.sentence;
  return j;
}

/// Of the learned curves, level by level.
LevelStatistics statistics_of(const Study& study, const Joint& joint, const fs::path& directory) {
  const auto table = read_numbers(directory / "curves.csv", {"curve", "speed_rad_s", "load_norm", "stderr_nm"});
  LevelStatistics mean;
  std::size_t curves = 0;
  for (std::size_t i = 0; table && i < table->columns[0].size();) {
    const Curve& curve = joint.campaign.curves[static_cast<std::size_t>(table->columns[0][i]) - 1];
    const std::size_t levels = curve.measurement.speeds_rad_s.size();
    if (std::ranges::count(study.learn, curve.series)) {
      for (auto* column : {&mean.speed_rad_s, &mean.load_norm, &mean.stderr_nm}) column->resize(levels);
      for (std::size_t k = 0; k < levels; ++k) {
        mean.speed_rad_s[k] += table->columns[1][i + k];
        mean.load_norm[k] += std::abs(table->columns[2][i + k]);
        mean.stderr_nm[k] += table->columns[3][i + k];
      }
      ++curves;
    }
    i += levels;
  }
  for (auto* column : {&mean.speed_rad_s, &mean.load_norm, &mean.stderr_nm})
    for (double& x : *column) x /= static_cast<double>(curves);
  return mean;
}

Json json_of(const Power& power) {
  Json j{{"fault", power.fault->name},
         {"unit", power.fault->unit},
         {"detection_limit", power.detection_limit},
         {"named_at_twice_the_limit", power.named},
         {"roc", Json::array()}};
  for (const auto& [severity, false_alarm, detected] : power.roc)
    j["roc"].push_back({{"severity", severity}, {"false_alarm", false_alarm}, {"detected", detected}});
  return j;
}

Result<Json> verdicts(const Study& study, const Joint& joint, const LabOptions& options) {
  const auto all = observed(joint, options.directory);
  if (!all) return work_failed(all.error().message);
  std::vector<ObservationFile> healthy;
  for (const auto& series : study.learn) healthy.push_back(of_series(*all, joint.campaign, series));
  const auto state = diagnosis::learn(healthy, {}, diagnosis::ObservationOptions{}.load_sensitivity);
  if (!state) return work_failed(fmt::format("{}: {}", joint.name, state.error().message));

  Json j{{"observations", Json::array()}, {"learned", Json::array()}};
  for (const auto& file : healthy)
    for (const auto& o : file.observations) j["learned"].push_back(json_of(o));
  for (const auto& [series, name] : study.check) {
    const ObservationFile some = of_series(*all, joint.campaign, series);
    const auto judged = diagnosis::check(*state, some, {.false_alarm = study.false_alarm});
    if (!judged) return work_failed(fmt::format("{}: {}", joint.name, judged.error().message));
    for (std::size_t i = 0; i < judged->size(); ++i) {
      const Observation& o = some.observations[i];
      const Curve& curve = joint.campaign.curves[o.curve - 1];
      Json row{{"load_kg", curve.payload_kg}, {"state", name}, {"series", series}, {"faults", curve.faults}};
      row.update(json_of((*judged)[i]));
      row.update(json_of(o));
      j["observations"].push_back(row);
    }
  }
  if (study.draws > 0) {
    const auto power = power_of(joint.campaign, statistics_of(study, joint, options.directory), *state, study.draws,
                                study.false_alarm, options);
    if (!power)
      return tl::unexpected(Error(fmt::format("{}: {}", joint.name, power.error().message), power.error().kind));
    for (const Power& one : *power) j["power"].push_back(json_of(one));
  }
  return j;
}

/// Checked before the measurements rather than by the verdicts.
Result<void> require_learnable(const Study& study, const Joint& joint) {
  const auto learned = static_cast<std::size_t>(std::ranges::count_if(
      joint.campaign.curves, [&](const Curve& c) { return std::ranges::count(study.learn, c.series) > 0; }));
  if (learned < diagnosis::observations_minimum)
    return tl::unexpected(
        Error(fmt::format("{}: diagnosis.learn: has {} curves of {}, but a healthy state needs {} or more",
                          joint.campaign.file.string(), learned, joint.name, diagnosis::observations_minimum)));
  return {};
}

/// Every joint's campaign: the common keys, then its own; a seed of its own.
void read_joints(Mapping& in, const fs::path& file, const YAML::Node& tree, Study& study) {
  auto joints = in.mapping("joints");
  const auto seed = in.whole_or("seed", 1, {0, 9007199254740992.0});
  for (const auto& name : joints->names()) {
    if (const auto why = unfit_file_name(name)) joints->fail(name, *why);  // its folder has this name
    YAML::Node root = YAML::Clone(tree);
    root.remove("joints");
    root.remove("diagnosis");
    root["joint"] = name;
    root["seed"] = seed + study.joints.size();  // each joint has errors of its own
    auto own = joints->mapping(name);
    for (const auto& key : own->names()) root[key] = YAML::Clone(own->raw(key));
    study.joints.push_back({name, or_wrong_input(campaign_of(file, root))});
  }
  if (study.joints.empty())
    in.fail("joints", "is empty: a mapping from joints to keys of the campaign that they have of their own");
}

void read_diagnosis(Mapping& in, Study& study) {
  const auto series_of = [&](const std::string& key, const std::string& series) {
    for (const Joint& joint : study.joints)
      if (std::ranges::none_of(joint.campaign.curves, [&](const Curve& c) { return c.series == series; }))
        in.fail(key, fmt::format("'{}' is no series of this campaign", series));
    return series;
  };
  if (const YAML::Node learn = in.raw("learn"); !learn || !learn.IsSequence())
    in.fail("learn", "must be a list of series");
  for (const auto& series : in.texts("learn")) study.learn.push_back(series_of("learn", series));
  if (study.learn.empty()) in.fail("learn", "must be a list of series");
  for (Mapping one : in.mappings("check")) {
    one.accept({"series", "state"});
    study.check.push_back({series_of("check", one.text("series")), one.text("state")});
    one.done();
  }
  study.false_alarm = in.number_or("false_alarm", study.false_alarm, {1e-9, 0.5});
  study.draws = in.whole_or("draws", 0, {0, 1e5});
  if (study.draws > 0 &&
      std::ranges::any_of(study.joints, [](const Joint& j) { return j.campaign.procedure != Procedure::test_cycle; }))
    in.fail("draws", "needs procedure: test_cycle, from whose travels the ripple of slow levels follows; leave it out");
  in.done();
}

}  // namespace

bool is_study(const YAML::Node& tree) { return static_cast<bool>(tree["joints"]); }

Result<Study> load_study(const fs::path& file, const YAML::Node& tree) try {
  Study study;
  Mapping in(file.string(), "", tree);
  auto diagnosis = in.mapping("diagnosis");
  if (!diagnosis) in.fail("diagnosis", "is missing: {learn: [SERIES, ...], check: [{series, state}, ...]}");
  read_joints(in, file, tree, study);
  read_diagnosis(*diagnosis, study);
  return study;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<LabSummary> run_study(const Study& study, const LabOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  for (const Joint& joint : study.joints)
    if (auto ok = require_learnable(study, joint); !ok) return tl::unexpected(ok.error());
  LabSummary sum;
  Json all;
  const double joints = static_cast<double>(study.joints.size());
  for (std::size_t i = 0; i < study.joints.size(); ++i) {
    const Joint& joint = study.joints[i];
    LabOptions own = options;
    own.directory = options.directory / joint.name;
    if (options.progress)
      own.progress = [&](double share, double left) {
        options.progress((static_cast<double>(i) + share) / joints,
                         share > 0 ? left * (joints - static_cast<double>(i)) : -1);
      };
    const auto summary = run_campaign(joint.campaign, own);
    if (!summary)
      return tl::unexpected(Error(fmt::format("{}: {}", joint.name, summary.error().message), summary.error().kind));
    sum.curves += summary->curves, sum.present += summary->present, sum.levels += summary->levels,
        sum.outside += summary->outside, sum.saturated += summary->saturated;
    if (summary->saturated > 0) sum.torque_limit_nm = summary->torque_limit_nm;
    auto judged = verdicts(study, joint, own);
    if (!judged) return tl::unexpected(judged.error());
    all[joint.name] = *std::move(judged);
  }
  const auto write = [&] {
    return write_derived(options.directory / "diagnosis.json", dump_json(all, 2) + "\n", options.existing);
  };
  if (auto ok = ranks().on_root(write); !ok) return work_failed(ok.error().message);
  sum.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return sum;
}

}  // namespace tribotwin::twin::study
