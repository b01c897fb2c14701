#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/divided.hpp>
#include <tribotwin/twin/diagnosis/fleet/learning/learning.hpp>
#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr std::int64_t always = std::numeric_limits<std::int64_t>::max();

/// One joint of all robots of a type.
struct Group {
  std::string type, joint;
  std::vector<std::int64_t> ids;  ///< of the robots' joints
  std::size_t robots = 0, curves = 0;
};

std::vector<Group> groups_of(Store& store) {
  std::map<std::pair<std::string, std::string>, std::size_t> place;
  std::vector<Group> all;
  for (auto& j : store.joints()) {
    const auto [at, is_new] = place.emplace(std::pair(j.type, j.joint), all.size());
    if (is_new) all.push_back({.type = j.type, .joint = j.joint, .ids = {}});
    all[at->second].ids.push_back(j.id);
  }
  return all;
}

/// Healthy rows of the robots of a type as bytes, of every `step`th one so that they are at most curves_of_type.
class Sample {
 public:
  void add(const Rows& rows) {
    if (rows.empty() || robots_++ % step_ != 0) return;
    BytesOut out;
    put(out, rows);
    kept_.emplace_back(out.take(), rows.size());
    curves_ += rows.size();
    while (curves_ > curves_of_type && kept_.size() > 1) thin();
  }
  std::size_t step() const { return step_; }
  std::size_t robots() const { return kept_.size(); }
  std::size_t curves() const { return curves_; }
  std::string bytes() const {
    std::string all;
    for (const auto& [rows, count] : kept_) all += rows;
    return all;
  }

 private:
  void thin() {
    step_ *= 2, curves_ = 0;
    for (std::size_t i = 0; 2 * i < kept_.size(); ++i) {
      if (i > 0) kept_[i] = std::move(kept_[2 * i]);
      curves_ += kept_[i].second;
    }
    kept_.resize((kept_.size() + 1) / 2);
  }

  std::size_t step_ = 1, robots_ = 0, curves_ = 0;
  std::vector<std::pair<std::string, std::size_t>> kept_;  ///< rows of a robot, how many
};

/// The model of one group, or why there is none; on any rank.
void learn(BytesIn& in, BytesOut& out) {
  const std::string type = in.text(), joint = in.text();
  const auto step = in.get<std::uint64_t>();
  const std::string robots = in.text();
  auto model = learn_type([&](const std::function<void(const Rows&)>& visit) {
    for (BytesIn rows(robots); !rows.empty();) visit(get_rows(rows));
  });
  out.put(model.has_value());
  if (!model) {
    out.put(std::string_view(model.error().message));
    return;
  }
  model->type = type, model->joint = joint;
  if (step > 1)
    model->notes.push_back(fmt::format("learned from one of {} robots: {} curves are enough", step, curves_of_type));
  out.put(std::string_view(to_text(*model)));
}

/// The first rank: the groups one after the other, what is found in the order of the groups.
class Learning {
 public:
  explicit Learning(Store& store) : store_(store), groups_(groups_of(store)) {}

  /// All groups are one chunk.
  std::size_t next() {
    if (groups_.empty()) throw InputError("there are no curves to learn from");
    return std::exchange(begun_, true) ? 0 : groups_.size();
  }

  void input(std::size_t i, BytesOut& out) {
    Group& g = groups_[i];
    Sample sample;
    for (const auto id : g.ids) sample.add(store_.rows(id, true, -always, always));
    g.robots = sample.robots(), g.curves = sample.curves();
    out.put(std::string_view(g.type)).put(std::string_view(g.joint)).put<std::uint64_t>(sample.step());
    out.put(std::string_view(sample.bytes()));
  }

  void finish(const std::vector<std::string>& results, const std::vector<TaskFailure>& failures) {
    std::string problem;
    for (std::size_t i = 0; i < results.size(); ++i) {
      if (results[i].empty()) continue;
      BytesIn in(results[i]);
      const bool good = in.get<bool>();
      const std::string text = in.text();
      if (good) {
        store_.put_model(out_.models.emplace_back(from_text(text, store_.name())));
      } else {
        problem = fmt::format("{}: {}", name_of(groups_[i].type, groups_[i].joint), text);
        out_.notes.push_back("no model of " + problem);
      }
    }
    for (const auto& f : failures) {
      const Group& g = groups_[f.task];
      out_.failed.push_back({.type = g.type,
                             .joint = g.joint,
                             .input = fmt::format("{} curves of {} robots", g.curves, g.robots),
                             .failure = f});
      store_.put_failed_model(g.type, g.joint, failure_text(out_.failed.back().input, f));
    }
    if (out_.models.empty() && out_.failed.empty()) throw InputError(problem);
  }

  Learned take() { return std::move(out_); }

 private:
  Store& store_;
  std::vector<Group> groups_;
  bool begun_ = false;
  Learned out_;
};

}  // namespace

Learned learn_fleet(Store* store, const LearningOptions& options) {
  std::optional<Learning> learning;
  if (store) learning.emplace(*store);
  divide({.prepare = [&] { return learning->next(); },
          .input = [&](std::size_t i, BytesOut& out) { learning->input(i, out); },
          .work = learn,
          .finish = [&](const auto& results, const auto& failures) { learning->finish(results, failures); },
          .batch = 1},
         options.threads, options.retries);
  return learning ? learning->take() : Learned{};
}

}  // namespace tribotwin::twin::diagnosis::fleet
