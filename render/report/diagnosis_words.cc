#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/render/report/diagnosis_words.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

using namespace twin::diagnosis;

struct IndicatorWords {
  std::string_view name, unit;
};
constexpr std::array<IndicatorWords, indicator_count> indicator_words{
    {{"torque that repeats with the joint's angle", "Nm"}, {"lost motion", "rad"}, {"mean load", ""}}};

/// How far regions and indicators are from healthy. T^2 is a squared distance.
std::string excess(const Verdict& v) {
  std::vector<std::string> far, all;
  for (std::size_t r = 0; r < regions.size(); ++r)
    if (v.region[r].anomalous)
      far.push_back(
          fmt::format("{} {:.1f} times", regions[r].of, std::sqrt(v.region[r].statistic / v.region[r].limit)));
  if (!far.empty()) all.push_back(twin::joined(far, " and ") + " as far from healthy as a healthy curve may be");
  for (std::size_t k = 0; k < indicator_count; ++k)
    if (const auto& i = v.indicators[k]; i && i->anomalous)
      all.push_back(fmt::format("{} {} {}, of a healthy joint at most {} {}", indicator_words[k].name,
                                two_digits(i->value), indicator_words[k].unit, two_digits(i->limit),
                                indicator_words[k].unit));
  return twin::joined(all, "; ");
}

/// "8.9 % of the maximum torque (12 Nm)"
std::string share_text(const HealthyState& h, double load_norm, std::string_view of) {
  return fmt::format("{:.1f} %{}{}", 100 * load_norm, of,
                     h.torque_max_nm > 0 ? fmt::format(" ({})", load_text(h, load_norm)) : "");
}

}  // namespace

std::string in_words(std::string_view name) {
  std::string words(name);
  std::ranges::replace(words, '_', ' ');
  return words;
}

std::string severity_text(const Pattern& p, double severity) {
  if (p.unit == "1") return two_digits(100 * severity) + " %";
  if (p.unit == "of torque_max") return two_digits(100 * severity) + " % of the maximum torque";
  if (p.unit == "of Fs") return two_digits(100 * severity) + " % of standstill friction";
  return fmt::format("{} {}", two_digits(severity), p.unit);
}

std::string cause_text(const Verdict& v) {
  return fmt::format("{}, {} (confidence {})", v.cause->meaning, severity_text(*v.cause, v.severity),
                     probability_text(v.confidence));
}

std::string cause_sentence(const Verdict& v) {
  if (v.perhaps_healthy)
    return fmt::format("Of this curve alone, chance is likelier than any known cause (probability {}).",
                       probability_text(v.confidence));
  return v.cause ? fmt::format("It looks like {}.", cause_text(v)) : "No known cause changes friction like this.";
}

std::string plain_sentence(const HealthyState& h, const Observation& o, const Verdict& v, const std::string& name) {
  std::string s = fmt::format("{}: {}. ", name, excess(v));
  s += cause_sentence(v);
  if (v.region[0].anomalous && v.load.load_norm > 2 * v.load.sigma)
    s += fmt::format(" Its equivalent load is {}, {} the wear threshold of {}.",
                     share_text(h, v.load.load_norm, " of the maximum torque"),
                     v.load.load_norm > v.load.threshold ? "beyond" : "short of", share_text(h, v.load.threshold, ""));
  if (h.extrapolates(o))
    s += fmt::format(" The healthy joint was measured at {:.0f} to {:.0f} °C only.", h.temperature_low_degC,
                     h.temperature_high_degC);
  return s;
}

}  // namespace tribotwin::render
