#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/experiments/sweep/factor.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin::sweep {
namespace {

constexpr char forms[] =
    "must be a list of values, {from: A, to: B, count: N}, {uniform: [A, B]} or {normal: [MEAN, STD]}";
constexpr std::size_t most_levels = 100000;

void read_list(const Mapping& factors, const YAML::Node& list, Factor& f) {
  if (list.size() == 0) factors.fail(f.key, "is an empty list; give at least one value");
  if (list.size() > most_levels) factors.fail(f.key, fmt::format("has more than {} values", most_levels));
  for (const auto& value : list) {
    if (!value.IsScalar() || value.Scalar().empty())
      factors.fail(f.key, "has an entry that is no number or word; a list holds plain values");
    if (std::ranges::find(f.levels, value.Scalar()) != f.levels.end())
      factors.fail(f.key, fmt::format("has {} twice; give each value once", value.Scalar()));
    f.levels.push_back(value.Scalar());
  }
}

void read_steps(Mapping& in, Factor& f) {
  in.accept({"from", "to", "count"});
  const double from = in.number("from"), to = in.number("to");
  const std::size_t count = in.whole("count", {2, static_cast<double>(most_levels)});
  if (from == to) in.fail("to", fmt::format("is {}, as 'from': the factor would not vary", to));
  const double last = static_cast<double>(count - 1);
  for (std::size_t i = 0; i < count; ++i)
    f.levels.push_back(
        fmt::format("{}", (from * (last - static_cast<double>(i)) + to * static_cast<double>(i)) / last));
}

void read_distribution(Mapping& in, Factor& f) {
  const bool uniform = in.has("uniform");
  const std::string name = uniform ? "uniform" : "normal";
  in.accept({name});
  const auto numbers = in.numbers(name);
  if (numbers.size() != 2) in.fail(name, uniform ? "must be [LOW, HIGH]" : "must be [MEAN, STD]");
  f.kind = uniform ? Factor::Kind::uniform : Factor::Kind::normal;
  f.a = numbers[0], f.b = numbers[1];
  if (uniform && !(f.a < f.b)) in.fail(name, fmt::format("is {} .. {}, but LOW must be below HIGH", f.a, f.b));
  if (!uniform && !(f.b > 0)) in.fail(name, fmt::format("has the standard deviation {}, which must be above 0", f.b));
}

}  // namespace

bool Factor::numeric() const {
  return std::ranges::all_of(levels, [](const std::string& level) {
    const auto number = to_number(level);
    return number && std::isfinite(*number);
  });
}

std::string Factor::value(double u) const {
  if (kind == Kind::levels)
    return levels[std::min(levels.size() - 1, static_cast<std::size_t>(u * static_cast<double>(levels.size())))];
  return fmt::format("{}", kind == Kind::uniform ? a + (b - a) * u : a + b * normal_quantile(u));
}

std::vector<std::string> Factor::trial_values() const {
  if (kind == Kind::uniform) return {fmt::format("{}", a), fmt::format("{}", b)};
  if (kind == Kind::normal) return {fmt::format("{}", a)};
  return levels.size() <= 100 ? levels : std::vector{levels.front(), levels.back()};
}

Factor read_factor(Mapping& factors, const std::string& key) {
  Factor f{.key = key, .levels = {}};
  const YAML::Node node = factors.raw(key);
  if (node.IsSequence()) {
    read_list(factors, node, f);
    return f;
  }
  if (!node.IsMap()) factors.fail(key, forms);
  auto in = *factors.mapping(key);
  if (in.has("from") || in.has("to") || in.has("count"))
    read_steps(in, f);
  else if (in.has("uniform") || in.has("normal"))
    read_distribution(in, f);
  else
    factors.fail(key, forms);
  return f;
}

}  // namespace tribotwin::twin::sweep
