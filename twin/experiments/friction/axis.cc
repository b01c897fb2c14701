#include <algorithm>
#include <cmath>

#include <tribotwin/twin/experiments/friction/axis.hpp>

namespace tribotwin::twin {

double Axis::draw(std::mt19937_64& random) const {
  const double share = static_cast<double>(random() >> 11) * 0x1p-53;  // equal on every standard library
  if (range) return low + (high - low) * share;
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

Axis read_axis(Mapping& in, const std::string& key, Bounds bounds, bool drawn) {
  if (!in.has(key)) in.fail(key, "is missing: a number, a list, or {from, to, count}");
  const YAML::Node node = in.raw(key);
  Axis a;
  if (node.IsScalar()) {
    a.values.push_back(in.number(key, bounds));
  } else if (node.IsSequence()) {
    a.values = in.numbers(key, bounds);
    if (a.values.empty()) in.fail(key, "is an empty list");
  } else {
    auto range = in.mapping(key);
    range->accept({"from", "to", "count", "spacing"});
    a.low = range->number("from", bounds);
    a.high = range->number("to", bounds);
    a.range = !range->has("count");
    const std::string spacing = range->has("spacing") ? range->choice("spacing", {"linear", "logarithmic"}) : "linear";
    if (a.range && !drawn) range->fail("count", "is missing");
    if (!a.range) {
      const auto count = static_cast<double>(range->whole("count", {1, static_cast<double>(max_curves)}));
      if (spacing == "logarithmic" && !(a.low > 0 && a.high > 0))
        range->fail("spacing", "logarithmic needs from and to above 0");
      for (double k = 0; k < count; ++k) {
        const double share = count == 1 ? 0 : k / (count - 1);
        a.values.push_back(spacing == "linear" ? a.low + (a.high - a.low) * share
                                               : a.low * std::pow(a.high / a.low, share));
      }
    }
    range->done();
  }
  return a;
}

}  // namespace tribotwin::twin
