#include <algorithm>
#include <cctype>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/plugins/drive/keys.hpp>
#include <tribotwin/plugins/drive/slide.hpp>
#include <tribotwin/twin/portable/c_law.hpp>
#include <tribotwin/twin/portable/c_source.hpp>
#include <tribotwin/twin/portable/joint_parameters.hpp>

namespace tribotwin::twin {
namespace {

using drive::Drive, drive::Dynamics;

/// Keywords of C99, and of C++, which may include the file.
constexpr std::string_view keywords[] = {
    "auto",   "bool",    "break",  "case",     "char",     "class",   "const",     "continue", "default",  "delete",
    "do",     "double",  "else",   "enum",     "extern",   "float",   "for",       "friend",   "goto",     "if",
    "inline", "int",     "long",   "new",      "operator", "private", "protected", "public",   "register", "restrict",
    "return", "short",   "signed", "sizeof",   "static",   "struct",  "switch",    "template", "this",     "throw",
    "try",    "typedef", "union",  "unsigned", "using",    "virtual", "void",      "volatile", "while"};

bool is_identifier(const std::string& name) {
  const auto letter = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; };
  return !name.empty() && name.size() <= 40 && std::isalpha(static_cast<unsigned char>(name[0])) &&
         std::ranges::all_of(name, letter) && std::ranges::find(keywords, name) == std::end(keywords);
}

constexpr const char* head =
    R"(/* A robot joint: friction over speed, load and temperature, and its heat. Written by `tribotwin export`.
 *
 *   law @LAW@: @EQUATION@
 *   from: @SOURCE@
 *   torque_max_nm @TORQUE_MAX_NOW@, gear ratio @GEAR_NOW@, friction @DYNAMICS@, thermal model @THERMAL@@WINDING_HEAD@
 *   validity: @VALIDITY@
 *
 * C99; no heap, no static data that changes. Of libm it uses @LIBM@. It does what drive::slide of tribotwin does, in
 * the same order of operations: do not let the compiler contract or reorder them (no -ffast-math, -ffp-contract=off).
 *
 * Torques are those of the arm side, friction is positive when it opposes positive motion. Not part of what
 * @NAME@_step returns: the offset of the drive, @OFFSET@ Nm against positive motion.
 *
 * Compile this file, and include it for its declarations:
 *
 *   #define @UPPER@_DECLARATIONS
 *   #include "@NAME@.c"
 *
 * -D@UPPER@_SELF_TEST adds @NAME@_self_test, which returns how many of its rows are wrong; -D@UPPER@_SELF_TEST_MAIN a
 * main that returns 0 where there is none. */
)";

constexpr const char* declarations = R"(#ifndef @UPPER@_STATE
#define @UPPER@_STATE

#ifdef __cplusplus
extern "C" {
#endif

@PARAMETERS@typedef struct {
  /* Inputs: 0 after @NAME@_init, set from outside between steps. */
  double ambient_K;         /* surroundings above T_amb, @T_AMB@ degC [K] */
  double boundary;          /* faults: relative change of boundary friction, above -1, */
  double stribeck_velocity; /* of the Stribeck velocities, */
  double viscous;           /* and of viscous friction */
  double ripple;            /* pitted bearing: friction (1 + ripple cos(motor angle)), 0 .. 1 */
  double backlash_rad;      /* [rad, arm side] */

  /* What a step hands to the next. */
  double node_K[2];         /* lubricant above T_amb, in two parts [K] */
  double load_nm;           /* load that friction sees [Nm] */
  double bristle;           /* deflection [rad, side of the law], of gear_loss [-] */
  double position_rad;      /* [rad] */
  double backlash_position; /* within the backlash, -1 .. 1 */
  double dt_s;              /* of `decay` */
  double decay[2];          /* what of the way to its target a node goes in dt_s */

  /* Results of the last step. */
  double temperature_degC;  /* at which friction was evaluated */
  double friction_nm;       /* [Nm] */
  double limit_nm;          /* up to which friction holds the joint [Nm] */
  double heat_J;            /* since @NAME@_init [J] */
  int outside;              /* not 0: an input lay outside the range of the law, or was no number */
@WINDING_STATE@@MEMBERS@} @NAME@_state;

/* At rest, healthy, at T_amb. */
void @NAME@_init(@NAME@_state *s);

/* A lubricant that has had this temperature for long. */
void @NAME@_set_temperature(@NAME@_state *s, double temperature_degC);

/* Temperature of the lubricant now [degC]. */
double @NAME@_temperature(const @NAME@_state *s);
@WINDING_DECLARATIONS@
/* The joint turns at speed_rad_s [rad/s, arm side] for dt_s [s], and its gear transmits load_nm [Nm] to the arm.
 * Returns the friction [Nm]; at speed 0 that of the bristles, or 0: limit_nm then holds the joint. Heat and temperature
 * advance by the step. A dt_s that is not above 0 advances nothing. Inputs that are no numbers count as 0. */
double @NAME@_step(@NAME@_state *s, double speed_rad_s, double load_nm, double dt_s);
@CHANGED_DECLARATION@
#ifdef __cplusplus
}
#endif
#endif

#ifndef @UPPER@_DECLARATIONS

#include <math.h>

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

)";

constexpr const char* within = R"(static double @NAME@_within(double x, double low, double high)
{
  return x < low ? low : (high < x ? high : x);
}

)";

constexpr const char* fade = R"(/* e^-x for x >= 0, and 0 for what is infinite or no number. */
static double @NAME@_fade(double x)
{
  return x < 750.0 ? exp(-x) : 0.0;
}

)";

constexpr const char* turning = R"(/* A factor of friction: it differs between the directions of motion. */
static double @NAME@_turning(double asymmetry, double w)
{
  return 1.0 + (w > 0.0 ? asymmetry : (w < 0.0 ? -asymmetry : fabs(asymmetry)));
}

)";

constexpr const char* table = R"(static const double @NAME@_speeds[@ROWS@] = {@SPEEDS@};
static const double @NAME@_loads[@COLUMNS@] = {@LOADS@};
static const double @NAME@_values[@ROWS@][@COLUMNS@] = {@VALUES@};

static double @NAME@_lerp(double a, double b, double t)
{
  double x;
  if ((a <= 0.0 && b >= 0.0) || (a >= 0.0 && b <= 0.0)) return t * b + (1.0 - t) * a;
  if (!(t < 1.0 || t > 1.0)) return b;
  x = a + t * (b - a);
  if ((t > 1.0) == (b > a)) return b < x ? x : b;
  return b > x ? x : b;
}

/* Where x lies on an axis of n numbers: between `below` and `above`. */
static double @NAME@_place(const double *axis, int n, double x, int *below, int *above)
{
  int i = 0;
  while (i < n && !(x < axis[i])) ++i;
  *below = i == 0 ? 0 : i - 1;
  *above = i == n ? n - 1 : i;
  return *above == *below ? 0.0 : (x - axis[*below]) / (axis[*above] - axis[*below]);
}

static double @NAME@_along(int row, int below, int above, double share)
{
  return @NAME@_lerp(@NAME@_values[row][below], @NAME@_values[row][above], share);
}

static double @NAME@_table_at(double w, double load)
{
  int r0, r1, c0, c1;
  const double row = @NAME@_place(@NAME@_speeds, @ROWS@, fabs(w), &r0, &r1);
  const double column = @NAME@_place(@NAME@_loads, @COLUMNS@, load, &c0, &c1);
  return @NAME@_lerp(@NAME@_along(r0, c0, c1, column), @NAME@_along(r1, c0, c1, column), row);
}

/* Friction beside that of the law, by the sign of the load. */
static double @NAME@_table(double w, double load)
{
  const double driven = @NAME@_table_at(w, w < 0.0 ? -load : load);
  if (w < 0.0 || w > 0.0) return driven;
  {
    const double drives = @NAME@_table_at(w, -load);
    return driven < drives ? drives : driven;
  }
}

)";

constexpr const char* advance = R"(/* The bristles after dt_s at the constant speed w; they settle at +- settled. */
static double @NAME@_advance(double z, double w, double settled, double dt_s)
{
  return z - (copysign(settled, w) - z) * expm1(-fabs(w) * dt_s / settled);
}

)";

constexpr const char* set_up = R"(void @NAME@_init(@NAME@_state *s)
{
  static const @NAME@_state fresh = {0};
  *s = fresh;
@DEFAULTS@  s->temperature_degC = @T_AMB@;
}
@CHANGED@
double @NAME@_temperature(const @NAME@_state *s)
{
  return @T_AMB@ + (s->node_K[0] + s->node_K[1]);
}

void @NAME@_set_temperature(@NAME@_state *s, double temperature_degC)
{
  const double rise = temperature_degC - @T_AMB@;
  s->node_K[0] = @RISE_0@;
  s->node_K[1] = @RISE_1@;
}

)";

constexpr const char* step_head =
    R"(double @NAME@_step(@NAME@_state *s, double speed_rad_s, double load_nm, double dt_s)
{
  const int speed_counts = fabs(speed_rad_s) <= @SPEED_MAX@, load_counts = fabs(load_nm) <= @LOAD_MAX@;
  const double speed = speed_counts ? speed_rad_s : 0.0, load = load_counts ? load_nm : 0.0;
  const int advances = dt_s > 0.0 && dt_s <= @DT_MAX@;
  @NAME@_coefficients c;
  double w = speed@SPEED_SCALE@, l, g, h, applied = 0.0, limit, end, power, ripple = 1.0;
@Z@
@LOAD@
  l = s->load_nm / @TORQUE_MAX@;
  s->temperature_degC = round(@NAME@_temperature(s) * 16384.0) / 16384.0;
  @NAME@_at(s, s->temperature_degC, &c);
  @NAME@_level(&c, w, l, &g, &h, &s->outside);
  if (!speed_counts || !load_counts) s->outside = 1;
  if (s->ripple > 0.0) ripple = 1.0 + s->ripple * cos(@GEAR@ * s->position_rad);
  g *= ripple;
)";

constexpr const char* step_tail = R"(  if (s->backlash_rad > 0.0 && fabs(s->backlash_position) < 1.0) {
    applied = 0.0;
    limit = 0.0;
  }
  limit = limit@SCALE@ < 1e-12 ? 1e-12 : limit@SCALE@;
  s->limit_nm = limit;
  s->friction_nm = applied + (speed > 0.0 ? limit : (speed < 0.0 ? -limit : 0.0));
@WINDING_LIMIT@  if (!advances) return s->friction_nm;

  power = s->friction_nm * speed;
@WINDING_STEP@  s->heat_J += power * dt_s;
@HEAT@
  end = s->position_rad + speed * dt_s;
  if (s->backlash_rad > 0.0) {
    const double crossed = s->backlash_position + 2.0 * (end - s->position_rad) / s->backlash_rad;
    s->backlash_position = crossed < -1.0 ? -1.0 : (1.0 < crossed ? 1.0 : crossed);
  }
@BRISTLE@
  s->position_rad = end;
  return s->friction_nm;
}
)";

constexpr const char* lugre_limit = R"(  {
    const double total = g + h, bent = s->bristle;
    if (!(h >= 0.0)) {
      g = total;
      h = 0.0;
    }
    most = @NAME@_most(&c, @SIGMA0@, l, g, bent, ripple);
    z = @NAME@_within(bent, -most, most);
    rate = g > 0.0 ? w - fabs(w) * z * @SIGMA0@ / g : 0.0;
    applied = (@SIGMA0@ * z + @SIGMA1@ * exp(-(w / @VD@) * (w / @VD@)) * rate)@SCALE@;
    limit = h;
  }
)";

constexpr const char* lugre_most = R"(/* The largest deflection of the bristles at this load and temperature. */
static double @NAME@_most(const @NAME@_coefficients *c, double sigma0, double l, double g, double z, double ripple)
{
  const double holds = @NAME@_at_rest(c, @L@) * ripple@TURNING_Z@;
  (void)z;
  return (g < holds ? holds : g) / sigma0;
}

)";

constexpr const char* lugre_end = R"(  {
    int ignored;
    w = (end - s->position_rad) / dt_s@SPEED_SCALE@;
    @NAME@_level(&c, w, l, &g, &h, &ignored);
    if (!(h >= 0.0)) g = g + h;
    g *= ripple;
    most = @NAME@_most(&c, @SIGMA0@, l, g, s->bristle, ripple);
    z = @NAME@_within(s->bristle, -most, most);
    if (g > 0.0)
      z = @NAME@_advance(z, w, g / @SIGMA0@, dt_s);
    else if (w < 0.0 || w > 0.0)
      z = 0.0;
    s->bristle = @NAME@_within(z, -most, most);
  })";

constexpr const char* loss_limit = R"(  {
    const double total = g + h, z = @NAME@_within(s->bristle, -1.0, 1.0);
    double level;
    if (!(h >= 0.0)) {
      g = total;
      h = 0.0;
    }
    level = g@OVER_TURNING@;
    applied = ((level@SCALE@ + @MU_AVG@ * fabs(s->load_nm)) * z + @MU_DIF@ * s->load_nm * z * z)@FACTOR_Z@;
    limit = h;
  }
)";

constexpr const char* loss_end = R"(  w = (end - s->position_rad) / dt_s@SPEED_SCALE@;
  s->bristle = @NAME@_advance(@NAME@_within(s->bristle, -1.0, 1.0), w / @LENGTH@, 1.0, dt_s);)";

std::string dynamics_name(const Drive& d) {
  return d.dynamics == Dynamics::none ? "static" : d.dynamics == Dynamics::lugre ? "lugre" : "gear_loss";
}

std::string validity_text(const friction::Law& law) {
  return law.validity == friction::Validity::extrapolate ? "the formula beyond the range of the law"
                                                         : "inputs are held at the edge of the range of the law";
}

std::string joined_numbers(std::span<const double> values) {
  std::string text;
  for (const double x : values) text += (text.empty() ? "" : ", ") + c_number(x);
  return text;
}

/// The numbers of a drive as C: literals, or members of the state.
struct Written {
  const Drive& drive;
  bool members;
  std::string operator()(std::string_view name, double value) const {
    return members ? fmt::format("s->p.{}", name) : c_number(value);
  }
  /// " * x", or nothing where x is 1 and stays so.
  std::string times(bool applies, std::string_view name, double value) const {
    return !applies || (!members && value == 1) ? "" : " * " + (*this)(name, value);
  }
  bool asymmetric() const { return members || drive.asymmetry != 0; }
  /// Of node i: time constant [s], steady rise [K/W], share of the ambient temperature.
  std::string node(const char* what, int i, double value) const {
    return members ? fmt::format("s->n.{}[{}]", what, i) : c_number(value);
  }
};

std::string heat(const Written& number) {
  const Drive& d = number.drive;
  if (d.thermal.order == thermal::Order::prescribed) return "";
  const int nodes = thermal::info(d.thermal.order).nodes;
  std::string fresh, moved;
  for (int i = 0; i < nodes; ++i) {
    fresh += fmt::format("    s->decay[{0}] = -expm1(-dt_s / {1});\n", i, number.node("t_s", i, d.thermal.t_s[i]));
    moved += fmt::format("  s->node_K[{0}] += ({1} * power + {2} * s->ambient_K - s->node_K[{0}]) * s->decay[{0}];\n",
                         i, number.node("rise_K_W", i, d.thermal.gain_K_J[i] * d.thermal.t_s[i]),
                         number.node("share", i, d.thermal.share(i)));
  }
  return "  if (s->dt_s < dt_s || s->dt_s > dt_s) {\n" + fresh + "    s->dt_s = dt_s;\n  }\n" + moved;
}

std::string load(const Written& number) {
  const Drive& d = number.drive;
  if (number.members)
    return "  if (!(s->p.load_filter_s > 0.0))\n    s->load_nm = load;\n  else if (advances)\n"
           "    s->load_nm += (load - s->load_nm) * -expm1(-dt_s / s->p.load_filter_s);";
  if (!(d.load_filter_s > 0)) return "  s->load_nm = load;";
  return fmt::format("  if (advances) s->load_nm += (load - s->load_nm) * -expm1(-dt_s / {});",
                     c_number(d.load_filter_s));
}

/// Law, load table and direction together.
std::string level(const Written& number) {
  const Drive& d = number.drive;
  const bool turns = number.asymmetric();
  std::string s =
      "static void @NAME@_level(const @NAME@_coefficients *c, double w, double l, double *g, double *h, int *outside)\n"
      "{\n";
  if (!d.load_table.values.empty()) s += "  double extra, total;\n";
  if (turns) s += "  const double turning = @NAME@_turning(@ASYMMETRY_C@, w);\n";
  s += "  @NAME@_law(c, w, l, g, h, outside);\n";
  if (!d.load_table.values.empty())
    s += "  extra = @NAME@_table(w, l);\n  total = *g + *h + extra;\n  total = total < 0.0 ? 0.0 : total;\n"
         "  *g += extra;\n  *g = *g < 0.0 ? 0.0 : *g;\n  *h = total - *g;\n";
  if (turns) s += "  *g *= turning;\n  *h *= turning;\n";
  return s + "}\n\n";
}

std::string limit(const Drive& d) {
  if (d.dynamics == Dynamics::lugre) return lugre_limit;
  if (d.dynamics == Dynamics::gear_loss) return loss_limit;
  return "  limit = g + h;\n";
}

std::string values_of(const drive::LoadTable& t) {
  std::string rows;
  for (std::size_t r = 0; r < t.speeds_rad_s.size(); ++r)
    rows += fmt::format("{}{{{}}}", r ? ",\n  " : "\n  ",
                        joined_numbers({t.values.data() + r * t.loads.size(), t.loads.size()}));
  return rows;
}

/// Of JointNumbers::members: what holds the numbers, and what follows from them.
struct Members {
  std::string parameters, state, defaults, declaration, changed;
};
/// `place` of a thermal model (thermal.cc): t_s and gain_K_J of its nodes.
std::string placed(thermal::Order order) {
  switch (order) {
    case thermal::Order::prescribed:
      return "";
    case thermal::Order::first:
      return "  gain_K_J[0] = s->p.R_th / s->p.kappa;\n  s->n.t_s[0] = s->p.kappa;\n";
    case thermal::Order::second:
      return "  gain_K_J[0] = s->p.c1;\n  gain_K_J[1] = s->p.c2;\n  s->n.t_s[0] = s->p.t1;\n  s->n.t_s[1] = s->p.t2;\n";
  }
  return "";
}
std::string nodes_changed(thermal::Order order) {
  if (order == thermal::Order::prescribed) return "";
  std::string all, total;
  const int nodes = thermal::info(order).nodes;
  for (int i = 0; i < nodes; ++i) {
    all += fmt::format("  s->n.rise_K_W[{0}] = gain_K_J[{0}] * s->n.t_s[{0}];\n", i);
    total += fmt::format("{}s->n.rise_K_W[{}]", i ? " + " : "", i);
  }
  all += fmt::format("  total = {};\n", total);
  for (int i = 0; i < nodes; ++i) all += fmt::format("  s->n.share[{0}] = s->n.rise_K_W[{0}] / total;\n", i);
  return placed(order) + all + "  s->dt_s = 0.0;\n";
}
Members members_of(const Drive& d) {
  Members m;
  std::string list;
  for (const JointParameter& p : joint_parameters(d)) {
    list += fmt::format("  double {};\n", p.name);
    m.defaults += fmt::format("  s->p.{} = {};\n", p.name, c_number(p.value));
  }
  m.defaults += "  @NAME@_changed(s);\n";
  const bool heats = d.thermal.order != thermal::Order::prescribed;
  m.parameters = "/* What may change between steps; call @NAME@_changed after it. */\ntypedef struct {\n" + list +
                 "} @NAME@_parameters;\n\n/* What follows from them. */\ntypedef struct {\n" + c_law_members() +
                 (heats ? "  double t_s[2], rise_K_W[2], share[2]; /* of the nodes of heat */\n" : "") +
                 "} @NAME@_numbers;\n\n";
  m.state = "\n  @NAME@_parameters p;\n  @NAME@_numbers n;\n";
  m.declaration = "\n/* After parameters have changed. */\nvoid @NAME@_changed(@NAME@_state *s);\n";
  m.changed = "\nvoid @NAME@_changed(@NAME@_state *s)\n{\n" +
              std::string(heats ? "  double gain_K_J[2], total;\n" : "") + c_law_changed(*d.law.info) +
              nodes_changed(d.thermal.order) + "}\n";
  return m;
}

std::string bristle_end(Dynamics dynamics) {
  return dynamics == Dynamics::lugre ? lugre_end : dynamics == Dynamics::gear_loss ? loss_end : "";
}

/// What stands for the words of the texts above: the numbers of the drive.
std::vector<std::pair<std::string, std::string>> number_words(const Written& number) {
  const Drive& d = number.drive;
  const auto& t = d.thermal;
  const bool turns = number.asymmetric(), motor = d.law.info->side == friction::Side::motor;
  std::vector<std::pair<std::string, std::string>> all = {
      {"@T_AMB@", c_number(t.T_amb_degC)},
      {"@RISE_0@", t.order == thermal::Order::prescribed ? "rise" : "rise * " + number.node("share", 0, t.share(0))},
      {"@RISE_1@", t.order == thermal::Order::second ? "rise * " + number.node("share", 1, t.share(1)) : "0.0"},
      {"@TURNING_Z@", turns ? " * @NAME@_turning(@ASYMMETRY_C@, z)" : ""},
      {"@OVER_TURNING@", turns ? " / @NAME@_turning(@ASYMMETRY@, speed)" : ""},
      {"@FACTOR_Z@", turns ? " * (1.0 + @ASYMMETRY@ * z)" : ""},
      {"@ASYMMETRY_C@", number.members ? "c->asymmetry" : c_number(d.asymmetry)},
      {"@ASYMMETRY@", number("asymmetry", d.asymmetry)},
      {"@L@", d.law.info->load_dependent
                  ? fmt::format("@NAME@_within(fabs(l), 0.0, {})", c_number(friction::held_range(d.law).load_max))
                  : "l"},
      {"@TORQUE_MAX@", number("torque_max_nm", d.torque_max_nm)},
      {"@GEAR@", number("gear_ratio", d.gear_ratio)},
      {"@SPEED_SCALE@", number.times(motor, "gear_ratio", d.gear_ratio)},
      {"@SCALE@", number.times(d.law.info->normalised, "torque_max_nm", d.torque_max_nm)},
      {"@SIGMA0@", number("sigma0", d.bristles.sigma0)},
      {"@SIGMA1@", number("sigma1", d.bristles.sigma1)},
      {"@VD@", number("vd", d.bristles.vd)},
      {"@MU_AVG@", number("mu_avg", d.gear_loss.mu_avg)},
      {"@MU_DIF@", number("mu_dif", d.gear_loss.mu_dif)},
      {"@LENGTH@", number("h", d.gear_loss.length_rad)},
      {"@ROWS@", fmt::format("{}", d.load_table.speeds_rad_s.size())},
      {"@COLUMNS@", fmt::format("{}", d.load_table.loads.size())},
      {"@SPEEDS@", joined_numbers(d.load_table.speeds_rad_s)},
      {"@LOADS@", joined_numbers(d.load_table.loads)},
      {"@VALUES@", values_of(d.load_table)},
      {"@OFFSET_NM@", number("offset_nm", d.offset_nm)}};
  thermal::Winding winding = d.winding;
  const auto values = drive::winding_values(winding);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::string key(drive::winding_keys()[i].name);
    all.emplace_back("@" + key + "@", number(key, *values[i]));
  }
  return all;
}

/// The same for parts of the text and for names.
std::vector<std::pair<std::string, std::string>> words(const Written& number, const std::string& name) {
  const Drive& d = number.drive;
  const Members m = number.members ? members_of(d) : Members{};
  const CWinding winding = c_winding(d);
  std::vector<std::pair<std::string, std::string>> all = {
      {"@LOAD@", load(number)},
      {"@HEAT@", heat(number)},
      {"@BRISTLE@", bristle_end(d.dynamics)},
      {"@WINDING_HEAD@", winding.head},
      {"@WINDING_STATE@", winding.state},
      {"@WINDING_DECLARATIONS@", winding.declarations},
      {"@WINDING_LIMIT@", winding.limit},
      {"@WINDING_STEP@", winding.step},
      {"@PARAMETERS@", m.parameters},
      {"@MEMBERS@", m.state},
      {"@DEFAULTS@", m.defaults},
      {"@CHANGED_DECLARATION@", m.declaration},
      {"@CHANGED@", m.changed},
      {"@Z@", d.dynamics == Dynamics::lugre ? "  double z, most, rate;" : ""},
      {"@LAW@", std::string(d.law.info->name)},
      {"@EQUATION@", std::string(d.law.info->equation)},
      {"@SOURCE@", std::string(d.law.info->source)},
      {"@TORQUE_MAX_NOW@", c_number(d.torque_max_nm)},
      {"@GEAR_NOW@", c_number(d.gear_ratio)},
      {"@DYNAMICS@", dynamics_name(d)},
      {"@THERMAL@", std::string(thermal::name(d.thermal.order))},
      {"@VALIDITY@", validity_text(d.law)},
      {"@OFFSET@", fmt::format("{}", d.offset_nm)},
      {"@SPEED_MAX@", c_number(drive::slide_speed_max_rad_s)},
      {"@LOAD_MAX@", c_number(drive::slide_load_max_nm)},
      {"@DT_MAX@", c_number(drive::slide_dt_max_s)}};
  for (auto& word : number_words(number)) all.push_back(std::move(word));
  all.emplace_back("@UPPER@", c_upper(name));
  all.emplace_back("@NAME@", name);
  return all;
}

/// The functions of libm that a text calls.
std::string libm_of(const std::string& text) {
  std::string used;
  for (const std::string_view name : {"copysign", "cos", "exp", "expm1", "fabs", "pow", "round"})
    for (std::size_t at = text.find(name); at != text.npos; at = text.find(name, at + 1)) {
      const bool whole = at > 0 && !std::isalnum(static_cast<unsigned char>(text[at - 1])) && text[at - 1] != '_';
      if (!whole || text[at + name.size()] != '(') continue;
      used += (used.empty() ? "" : ", ") + std::string(name);
      break;
    }
  return used;
}

/// A joint that starts, turns back, rests, is loaded, warms up and wears: one step a row.
std::string self_test_rows(const Drive& d) {
  drive::Sliding s;
  const double reach = std::min(d.law.range.speed_max_rad_s, 300 * d.speed_scale()) / d.speed_scale();
  std::string rows;
  for (int k = 0; k < 48; ++k) {
    const double shares[] = {0.02, 0.2, 0.9, 0, -0.02, -0.4, -1.1, 0.05};
    const double speed = reach * shares[k % 8], load = d.torque_max_nm * (0.11 * (k % 11) - 0.4),
                 dt = k % 3 ? 0.25 : 20;
    const double severity = k < 16 ? 0 : 0.01 * (k - 15);
    drive::Faults faults{};
    faults.boundary = faults.stribeck_velocity = severity, faults.viscous = -0.5 * severity;
    faults.ripple = k < 32 ? 0 : 0.1, faults.backlash_rad = k < 40 ? 0 : 1e-3;
    faults.torque_loss = d.winding.present() ? severity : 0;
    drive::set_faults(s.workspace, faults);
    const double friction = drive::slide(d, thermal::decay(d.thermal, dt), speed, load, s);
    std::vector<double> row = {speed,
                               load,
                               dt,
                               severity,
                               faults.viscous,
                               faults.ripple,
                               faults.backlash_rad,
                               friction,
                               drive::temperature_degC(d, s.state)};
    if (d.winding.present()) row.insert(row.end(), {drive::winding_degC(d, s.state), s.workspace.current_A});
    rows += fmt::format("  {{{}}},\n", joined_numbers(row));
  }
  return rows;
}

std::string self_test(const Drive& d, const std::string& name) {
  const bool winds = d.winding.present();
  return filled(R"(
#if defined(@UPPER@_SELF_TEST) || defined(@UPPER@_SELF_TEST_MAIN)
/* speed_rad_s, load_nm, dt_s, boundary and stribeck_velocity@LOSES@, viscous, ripple, backlash_rad; then
 * friction_nm and temperature_degC@WARMS@, as tribotwin computes them. */
static const double @NAME@_rows[48][@COLUMNS@] = {
@ROWS@};

static int @NAME@_differs(double x, double expected)
{
  return !(fabs(x - expected) <= 1e-9 * fabs(expected) + 1e-11);
}

int @NAME@_self_test(void);
int @NAME@_self_test(void)
{
  @NAME@_state s;
  int k, wrong = 0;
  @NAME@_init(&s);
  for (k = 0; k < 48; ++k) {
    const double *row = @NAME@_rows[k];
    double friction;
    s.boundary = row[3];
    s.stribeck_velocity = row[3];
@LOSS@    s.viscous = row[4];
    s.ripple = row[5];
    s.backlash_rad = row[6];
    friction = @NAME@_step(&s, row[0], row[1], row[2]);
    if (@NAME@_differs(friction, row[7]) || @NAME@_differs(@NAME@_temperature(&s), row[8])@WINDING@) ++wrong;
  }
  return wrong;
}
#endif

#ifdef @UPPER@_SELF_TEST_MAIN
int main(void)
{
  return @NAME@_self_test() != 0;
}
#endif

#endif
)",
                {{"@ROWS@", self_test_rows(d)},
                 {"@COLUMNS@", winds ? "11" : "9"},
                 {"@LOSES@", winds ? " and torque_loss" : ""},
                 {"@WARMS@", winds ? ", winding temperature and current_A" : ""},
                 {"@LOSS@", winds ? "    s.torque_loss = row[3];\n" : ""},
                 {"@WINDING@", winds ? " ||\n        @NAME@_differs(@NAME@_winding_temperature(&s), row[9]) || "
                                       "@NAME@_differs(s.current_A, row[10])"
                                     : ""},
                 {"@UPPER@", c_upper(name)},
                 {"@NAME@", name}});
}

}  // namespace

std::string c_upper(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

std::string filled(std::string text, const std::vector<std::pair<std::string, std::string>>& words) {
  for (const auto& [word, value] : words)
    for (std::size_t at = 0; (at = text.find(word, at)) != text.npos; at += value.size())
      text.replace(at, word.size(), value);
  return text;
}

Result<std::string> c_source(const Drive& d, const std::string& name, JointNumbers numbers) {
  if (!is_identifier(name))
    return tl::unexpected(fmt::format(
        "the name '{}' becomes part of C: use letters, digits and _, a letter first, at most 40, no keyword", name));
  const Written number{d, numbers == JointNumbers::members};
  const auto all = words(number, name);
  const std::string last = (d.dynamics == Dynamics::lugre ? lugre_most : std::string()) + set_up +
                           c_winding(d).functions + step_head + limit(d) + step_tail;
  const std::string main =
      filled(filled(c_law(d.law, name, numbers) + level(number) + last, all), {{"\n\n\n", "\n\n"}});
  std::string helpers;
  const auto helper = [&](const char* text, const char* called) {
    const std::string whole = filled(text, all);
    if ((main + helpers).find(name + called) != std::string::npos) helpers = whole + helpers;
  };
  helper(advance, "_advance(");
  helper(table, "_table(");
  helper(turning, "_turning(");
  helper(fade, "_fade(");
  helper(within, "_within(");
  std::string words_of_head = filled(head, {{"@LIBM@", libm_of(helpers + main)}});
  return filled(words_of_head, all) + filled(declarations, all) + helpers + main + self_test(d, name);
}

}  // namespace tribotwin::twin
