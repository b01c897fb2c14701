#include <stdexcept>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/divided.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Numbers = std::span<const double>;

/// The columns of a curve, in the order in which they travel.
template <class Curve>
auto columns_of(Curve& c) {
  return std::array{&c.speed_rad_s, &c.friction_nm, &c.load_norm,      &c.temperature_degC,
                    &c.stderr_nm,   &c.ripple_nm,   &c.lost_motion_rad};
}

void put_optional(BytesOut& out, const std::optional<double>& x) { out.put(x.has_value()).put(x.value_or(0)); }
std::optional<double> get_optional(BytesIn& in) {
  const bool has = in.get<bool>();
  const double x = in.get<double>();
  return has ? std::optional(x) : std::nullopt;
}

}  // namespace

void divide(const ChunkWork& w, unsigned threads) {
  Ranks& all = ranks();
  for (;;) {
    const auto tasks = or_throw(all.from_root([&]() -> Result<std::string> { return std::to_string(w.prepare()); }));
    const std::size_t count = std::stoull(tasks);
    if (count == 0) return;
    Tasks list{.count = count, .identity = "fleet " + tasks, .work = w.work};
    if (all.several()) list.input = [&](std::size_t task) { return w.input(task); };
    const Outcome outcome = or_throw(carry_out(list, {.threads = threads}));
    if (!outcome.failures.empty())
      throw std::runtime_error(
          text_of(outcome.failures, [](std::size_t task) { return fmt::format("part {} of a chunk", task + 1); }));
    if (all.root()) w.finish(outcome.results);
  }
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
  }
}
Rows get_rows(BytesIn& in) {
  Rows rows(in.get<std::uint64_t>());
  for (Row& r : rows) {
    for (double* x : {&r.day, &r.temperature_degC, &r.load_norm, &r.scatter[0], &r.scatter[1]}) *x = in.get<double>();
    for (double& x : r.logarithmic.reshaped()) x = in.get<double>();
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
  out.put(e.other[0]).put(e.other[1]);
}
Evidence get_evidence(BytesIn& in) {
  Evidence e{.healthy = get_by_choice(in)};
  for (double& x : e.other) x = in.get<double>();
  return e;
}

}  // namespace tribotwin::twin::diagnosis::fleet
