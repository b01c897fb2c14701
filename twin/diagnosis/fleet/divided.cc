#include <algorithm>
#include <array>
#include <exception>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/divided.hpp>
#include <tribotwin/twin/diagnosis/patterns.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Numbers = std::span<const double>;

/// The columns of a curve, in the order in which they travel.
template <class Curve>
auto columns_of(Curve& c) {
  return std::array{&c.speed_rad_s, &c.friction_nm, &c.load_norm,      &c.temperature_degC,
                    &c.stderr_nm,   &c.ripple_nm,   &c.lost_motion_rad};
}

/// The numbers of a finding, in the order in which they travel.
template <class F>
auto numbers_of(F& f) {
  return std::array{&f.severity,       &f.confidence, &f.friction_change, &f.load.load_norm, &f.load.sigma,
                    &f.load.threshold, &f.margin,     &f.margin_low,      &f.margin_high};
}

void put_optional(BytesOut& out, const std::optional<double>& x) { out.put(x.has_value()).put(x.value_or(0)); }
std::optional<double> get_optional(BytesIn& in) {
  const bool has = in.get<bool>();
  const double x = in.get<double>();
  return has ? std::optional(x) : std::nullopt;
}

/// Rank 0: the chunks one after the other, as a list of tasks that grows when a chunk is over.
class Chunks {
 public:
  explicit Chunks(const ChunkWork& work) : work_(work) { prepare(); }

  std::size_t tasks() const { return first_ + groups_.size(); }

  std::string input(std::size_t task) const {
    BytesOut out;
    for (const std::size_t item : groups_[task - first_]) work_.input(item, out);
    return out.take();
  }

  void keep(std::size_t task, const std::string& result) {
    BytesIn in(result);
    for (const std::size_t item : groups_[task - first_]) results_[item] = in.text();
    over();
  }

  void failed(const TaskFailure& failure) {
    const std::vector<std::size_t> items = groups_[failure.task - first_];
    if (items.size() > 1) {
      for (const std::size_t item : items) groups_.push_back({item});
    } else {
      failures_.push_back(failure);
      failures_.back().task = items.front();
    }
    over();
  }

  /// What has ended it before the last chunk.
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  void prepare() {
    first_ += groups_.size();
    groups_.clear(), failures_.clear(), over_ = 0;
    results_.assign(work_.prepare(), {});
    for (std::size_t item = 0; item < results_.size(); ++item) {
      if (item % work_.batch == 0) groups_.emplace_back();
      groups_.back().push_back(item);
    }
  }

  void over() {
    if (++over_ < groups_.size()) return;
    try {
      std::ranges::sort(failures_, {}, &TaskFailure::task);
      work_.finish(results_, failures_);
      prepare();
    } catch (...) {  // no further task, and all ranks hear of it
      error_ = std::current_exception();
    }
  }

  const ChunkWork& work_;
  std::size_t first_ = 0;                         ///< number of tasks of the chunks before
  std::vector<std::vector<std::size_t>> groups_;  ///< items by task of the chunk
  std::size_t over_ = 0;                          ///< of these tasks
  std::vector<std::string> results_;
  std::vector<TaskFailure> failures_;
  std::exception_ptr error_;
};

}  // namespace

void divide(const ChunkWork& w, unsigned threads, int retries) {
  std::optional<Chunks> chunks;
  or_throw(ranks().on_root([&]() -> Result<void> {
    chunks.emplace(w);
    return {};
  }));
  const auto work = [&](std::size_t, const std::string& input) -> Result<std::string> {
    BytesOut out;
    for (BytesIn in(input); !in.empty();) {
      BytesOut one;
      w.work(in, one);
      out.put(std::string_view(one.take()));
    }
    return out.take();
  };
  const Tasks list{.identity = "fleet",
                   .work = work,
                   .own_processes = true,
                   .keep = [&](std::size_t task, const std::string& result) -> Result<void> {
                     chunks->keep(task, result);
                     return {};
                   },
                   .failed = [&](const TaskFailure& failure) { chunks->failed(failure); },
                   .input = [&](std::size_t task) { return chunks->input(task); },
                   .grown = [&] { return chunks->tasks(); }};
  if (or_throw(carry_out(list, {.threads = threads, .retries = retries, .stop = &interrupted()})).stopped)
    throw std::runtime_error("interrupted; the store is as before");
  or_throw(ranks().on_root([&]() -> Result<void> {
    chunks->rethrow();
    return {};
  }));
}

std::string failure_text(const std::string& input, const TaskFailure& f) {
  return fmt::format("{}: {}{}", input, f.error.message,
                     f.attempts > 1 ? fmt::format(" ({} attempts)", f.attempts) : "");
}

void put(BytesOut& out, const LevelCurve& c) {
  out.put(std::string_view(c.file)).put<std::uint64_t>(c.line).put(c.key.curve);
  for (const auto* column : columns_of(c)) out.put(Numbers(*column));
}
LevelCurve get_curve(BytesIn& in) {
  LevelCurve c;
  c.file = in.text(), c.line = in.get<std::uint64_t>(), c.key.curve = in.get<std::uint32_t>();
  for (auto* column : columns_of(c)) *column = in.numbers<double>();
  return c;
}

void put(BytesOut& out, const Observation& o) {
  for (const double x : o.features.reshaped()) out.put(x);
  for (const double x : o.shape.reshaped()) out.put(x);
  put_optional(out, o.temperature_degC);
  for (const auto& x : o.indicators) put_optional(out, x);
  out.put(o.residual_nm).put<std::uint64_t>(o.weak.size());
  for (const auto& name : o.weak) out.put(std::string_view(name));
}
Observation get_observation(BytesIn& in) {
  Observation o;
  for (double& x : o.features.reshaped()) x = in.get<double>();
  for (double& x : o.shape.reshaped()) x = in.get<double>();
  o.temperature_degC = get_optional(in);
  for (auto& x : o.indicators) x = get_optional(in);
  o.residual_nm = in.get<double>();
  for (auto n = in.get<std::uint64_t>(); n > 0; --n) o.weak.push_back(in.text());
  return o;
}

void put(BytesOut& out, const Rows& rows) {
  out.put<std::uint64_t>(rows.size());
  for (const Row& r : rows) {
    out.put(r.day).put(r.temperature_degC).put(r.load_norm).put(r.scatter[0]).put(r.scatter[1]);
    for (const double x : r.logarithmic.reshaped()) out.put(x);
    for (const float x : r.claim) out.put(x);
  }
}
Rows get_rows(BytesIn& in) {
  Rows rows(in.get<std::uint64_t>());
  for (Row& r : rows) {
    for (double* x : {&r.day, &r.temperature_degC, &r.load_norm, &r.scatter[0], &r.scatter[1]}) *x = in.get<double>();
    for (double& x : r.logarithmic.reshaped()) x = in.get<double>();
    for (float& x : r.claim) x = in.get<float>();
  }
  return rows;
}

void put(BytesOut& out, const ByChoice& numbers) {
  for (const auto& region : numbers) out.put(Numbers(region));
}
ByChoice get_by_choice(BytesIn& in) {
  ByChoice numbers;
  for (auto& region : numbers) region = in.numbers<double>();
  return numbers;
}

void put(BytesOut& out, const Evidence& e) {
  put(out, e.healthy);
  for (const auto& region : e.other)
    for (const double x : region) out.put(x);
}
Evidence get_evidence(BytesIn& in) {
  Evidence e{.healthy = get_by_choice(in)};
  for (auto& region : e.other)
    for (double& x : region) x = in.get<double>();
  return e;
}

void put(BytesOut& out, const Finding& f) {
  out.put(f.pattern);
  for (const double* x : numbers_of(f)) out.put(*x);
  put_optional(out, f.load.nm), put_optional(out, f.load.kg);
}
Finding get_finding(BytesIn& in) {
  Finding f;
  const std::string name = in.text();
  for (const auto& p : patterns())
    if (p.name == name) f.pattern = p.name, f.unit = p.unit, f.advice = p.advice;
  for (double* x : numbers_of(f)) *x = in.get<double>();
  f.load.nm = get_optional(in), f.load.kg = get_optional(in);
  return f;
}

}  // namespace tribotwin::twin::diagnosis::fleet
