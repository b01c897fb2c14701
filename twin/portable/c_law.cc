#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/portable/c_law.hpp>

namespace tribotwin::twin {
namespace {

using namespace friction::formula;
using friction::GeneralLaw;

constexpr const char* shape_names[] = {"constant",  "stribeck", "load_stribeck", "linear",
                                       "quadratic", "cubic",    "power"};
static_assert(std::size(shape_names) == shape_count);

/// Writes one law. Sums are formed in the order of formula.hpp.
class Writer {
 public:
  Writer(const friction::Law& law, const std::string& name) : law_(law), f_(law.general_law), name_(name) {}

  std::string text() const { return coefficients() + at() + rest() + parts(); }

 private:
  bool has(Shape shape, int load) const {
    return std::ranges::any_of(terms,
                               [&](const Term& t) { return t.shape == shape && t.load == load && f_.*t.number != 0; });
  }
  bool has(Shape shape) const { return has(shape, 0) || has(shape, 1); }
  bool has_loads() const {
    for (int shape = 0; shape < shape_count; ++shape)
      if (has(static_cast<Shape>(shape), 1)) return true;
    return false;
  }
  static std::string member(Shape shape, int load) {
    return fmt::format("{}{}", shape_names[shape], load ? "_per_load" : "");
  }
  bool fades() const { return has(stribeck) || has(load_stribeck); }

  /// number * factor * T^degree, in this order.
  static std::string product(double number, const char* factor, int degree) {
    std::string text = c_number(number);
    if (factor[0]) text += fmt::format(" * {}", factor);
    for (int k = 0; k < degree; ++k) text += " * T";
    return text;
  }
  std::string quantity(Quantity wanted, const char* factor) const {
    std::string sum;
    for (const ShapeNumber& row : shape_numbers)
      if (row.quantity == wanted && f_.*row.number != 0)
        sum += (sum.empty() ? "" : " + ") + product(f_.*row.number, factor, row.degree);
    return sum.empty() ? "0.0" : sum;
  }
  std::string amplitude_sum(Shape shape, int load) const {
    std::string sum;
    for (const Term& term : terms) {
      if (term.shape != shape || term.load != load || f_.*term.number == 0) continue;
      const char* factor = shape_infos[shape].weakening ? "boundary" : "viscous";
      sum += sum.empty() ? "" : " + ";
      sum += term.heat == vogel ? product(f_.*term.number, factor, 0) + " * thinned"
                                : product(f_.*term.number, factor, static_cast<int>(term.heat));
    }
    return sum;
  }
  std::string coefficients() const {
    std::string s = "/* The law at one temperature. */\ntypedef struct {\n";
    for (int i = 0; i < shape_count; ++i)
      for (const int load : {0, 1})
        if (has(static_cast<Shape>(i), load)) s += fmt::format("  double {};\n", member(static_cast<Shape>(i), load));
    if (has(stribeck)) s += "  double vs_power;\n";
    if (has(load_stribeck)) s += "  double vl_power;\n";
    if (has(power)) s += "  double beta;\n";
    return s + fmt::format("  int outside;\n}} {}_coefficients;\n\n", name_);
  }

  bool vogel_term() const {
    return std::ranges::any_of(terms, [&](const Term& t) { return t.heat == vogel && f_.*t.number != 0; });
  }
  /// What T is confined to, and whether it lies outside.
  std::string confinement() const {
    if (!law_.info->temperature_dependent) return "  (void)T_degC;\n  c->outside = 0;\n";
    const friction::Range held = friction::held_range(law_);
    std::vector<std::string> inside;
    if (std::isfinite(law_.range.temperature_min_degC))
      inside.push_back("T_degC >= " + c_number(law_.range.temperature_min_degC));
    if (std::isfinite(law_.range.temperature_max_degC))
      inside.push_back("T_degC <= " + c_number(law_.range.temperature_max_degC));
    return fmt::format("  const double T = {}_within(T_degC, {}, {});\n", name_, c_number(held.temperature_min_degC),
                       c_number(held.temperature_max_degC)) +
           factors() +
           (inside.empty() ? "  c->outside = 0;\n" : fmt::format("  c->outside = !({});\n", fmt::join(inside, " && ")));
  }
  bool strengthens() const {
    for (int i = 0; i < shape_count; ++i)
      if (!shape_infos[i].weakening && has(static_cast<Shape>(i))) return true;
    return false;
  }
  bool weakens() const {
    for (int i = 0; i < shape_count; ++i)
      if (shape_infos[i].weakening && has(static_cast<Shape>(i))) return true;
    return false;
  }
  /// Those of the faults; declared before the first statement that is no declaration, and only where used.
  std::string factors() const {
    std::string s;
    if (weakens()) s += "  const double boundary = 1.0 + s->boundary;\n";
    if (fades()) s += "  const double velocity = 1.0 + s->stribeck_velocity;\n";
    if (strengthens()) s += "  const double viscous = 1.0 + s->viscous;\n";
    if (vogel_term()) s += fmt::format("  const double thinned = exp(-T / {});\n", c_number(f_.T_V));
    if (f_.s_T != 0)
      s += fmt::format(
          "  const double warmth = 1.0 + {} * (T - {});\n  const double scale = warmth > 0.0 ? warmth : 0.0;\n",
          c_number(f_.s_T), c_number(f_.s_T0));
    if (s.empty()) s = "  (void)s;\n";
    return s;
  }
  std::string at() const {
    std::string s =
        fmt::format("static void {0}_at(const {0}_state *s, double T_degC, {0}_coefficients *c)\n{{\n", name_);
    if (law_.info->temperature_dependent)
      s += confinement();
    else
      s += factors() + confinement();
    for (int i = 0; i < shape_count; ++i)
      for (const int load : {0, 1})
        if (const Shape shape = static_cast<Shape>(i); has(shape, load)) {
          const std::string sum = amplitude_sum(shape, load);
          s += f_.s_T != 0 ? fmt::format("  c->{} = scale * ({});\n", member(shape, load), sum)
                           : fmt::format("  c->{} = {};\n", member(shape, load), sum);
        }
    const std::string alpha = c_number(-f_.alpha);
    if (has(stribeck))
      s += fmt::format("  c->vs_power = pow(fabs({}), {});\n", quantity(stribeck_velocity, "velocity"), alpha);
    if (has(load_stribeck))
      s += fmt::format("  c->vl_power = pow({}, {});\n", quantity(load_velocity, "velocity"), alpha);
    if (has(power))
      s += fmt::format("  c->beta = {}_within({}, {}, {});\n", name_, quantity(power_exponent, ""),
                       c_number(friction::exponent_min), c_number(friction::exponent_max));
    return s + "}\n\n";
  }

  std::string amplitude(Shape shape) const {
    const std::string still = "c->" + member(shape, 0), loaded = "c->" + member(shape, 1) + " * l";
    if (has(shape, 0) && has(shape, 1)) return fmt::format("({} + {})", still, loaded);
    return has(shape, 1) ? loaded : still;
  }
  std::string l_of() const { return has_loads() ? "" : "  (void)l;\n"; }
  std::string rest() const {
    std::string beyond;
    for (int i = 0; i < shape_count; ++i)
      if (const Shape shape = static_cast<Shape>(i); shape != constant && shape_infos[i].weakening && has(shape))
        beyond += (beyond.empty() ? "" : " + ") + amplitude(shape);
    std::string sum = has(constant) ? amplitude(constant) : "";
    if (!beyond.empty()) sum += sum.empty() ? beyond : fmt::format(" + ({})", beyond);
    if (sum.empty()) sum = "0.0";
    return fmt::format(
        "/* Friction at rest, up to which the joint sticks. */\nstatic double {0}_at_rest(const {0}_coefficients *c, "
        "double l)\n{{\n  const double level = {1};\n{2}{3}  return level < 0.0 ? 0.0 : level;\n}}\n\n",
        name_, sum, l_of(), weakens() ? "" : "  (void)c;\n");
  }
  /// From v^degree on, divided by v^(degree - 1).
  std::string polynomial(int degree) const {
    int here = -1;
    bool above = false;
    for (int i = 0; i < shape_count; ++i) {
      if (shape_infos[i].degree == degree && has(static_cast<Shape>(i))) here = i;
      above |= shape_infos[i].degree > degree && has(static_cast<Shape>(i));
    }
    if (here < 0 && !above) return "";
    if (here < 0) return fmt::format("v * ({})", polynomial(degree + 1));
    const std::string own = amplitude(static_cast<Shape>(here));
    return above ? fmt::format("v * ({} + {})", own, polynomial(degree + 1)) : fmt::format("v * {}", bracketed(own));
  }
  static std::string bracketed(const std::string& text) {
    return text.starts_with("(") || text.find(' ') == text.npos ? text : "(" + text + ")";
  }
  std::string parts() const {
    const friction::Range held = friction::held_range(law_);
    std::string s = fmt::format(
        "/* The law's two parts at the speed w [rad/s, {1}] and the load l: g falls with speed, h rises. */\n"
        "static void {0}_law(const {0}_coefficients *c, double w, double load, double *g, double *h, int *outside)\n"
        "{{\n  const double speed = fabs(w);\n",
        name_, law_.info->side == friction::Side::motor ? "motor" : "arm");
    std::vector<std::string> inside;
    if (std::isfinite(law_.range.speed_max_rad_s)) inside.push_back("speed <= " + c_number(law_.range.speed_max_rad_s));
    s += fmt::format("  const double v = speed > {0} ? {0} : speed;\n", c_number(held.speed_max_rad_s));
    if (law_.info->load_dependent) {
      if (std::isfinite(law_.range.load_max)) inside.push_back("fabs(load) <= " + c_number(law_.range.load_max));
      s += fmt::format("  const double l = {}_within(fabs(load), 0.0, {});\n", name_, c_number(held.load_max));
    } else {
      s += "  const double l = 0.0;\n";
    }
    s += "  double weak = 0.0, strong = 0.0, total;\n";
    if (!law_.info->load_dependent) s += "  (void)load;\n";
    s += inside.empty() ? "  *outside = c->outside;\n"
                        : fmt::format("  *outside = c->outside || !({});\n", fmt::join(inside, " && "));
    s += fmt::format("  if (!(v > 0.0)) {{\n    *g = {}_at_rest(c, l);\n    *h = 0.0;\n    return;\n  }}\n", name_);
    if (fades()) s += fmt::format("  {{\n    const double v_alpha = pow(v, {});\n", c_number(f_.alpha));
    const char* indent = fades() ? "    " : "  ";
    if (has(constant)) s += fmt::format("{}weak = {};\n", indent, amplitude(constant));
    if (has(stribeck))
      s += fmt::format("{}weak += {} * {}_fade(v_alpha * c->vs_power);\n", indent, amplitude(stribeck), name_);
    if (has(load_stribeck))
      s += fmt::format("{}weak += {} * {}_fade(v_alpha * c->vl_power);\n", indent, amplitude(load_stribeck), name_);
    if (fades()) s += "  }\n";
    if (const std::string sum = polynomial(1); !sum.empty()) s += fmt::format("  strong = {};\n", sum);
    if (has(power)) s += fmt::format("  strong += {} * pow(v, c->beta);\n", amplitude(power));
    if (!has_loads()) s += "  (void)l;\n";
    return s +
           "  total = weak + strong;\n  total = total < 0.0 ? 0.0 : total;\n"
           "  *g = weak < 0.0 ? 0.0 : weak;\n  *h = total - *g;\n}\n\n";
  }

  const friction::Law& law_;
  const GeneralLaw& f_;
  const std::string& name_;
};

}  // namespace

std::string c_number(double x) {
  std::string text = fmt::format("{}", x);
  if (text.find_first_of(".e") == text.npos) text += ".0";
  return x < 0 ? "(" + text + ")" : text;
}

std::string c_law(const friction::Law& law, const std::string& name) { return Writer(law, name).text(); }

}  // namespace tribotwin::twin
