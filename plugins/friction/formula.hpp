#pragma once

/// The friction formula, once, for everything that evaluates it: the scalar law of the step (law.cc), the batch
/// (batch_kernel.inc), the moments and residuals of identification (curves/moments_kernel.inc) and the gradient for
/// rigid-body identification. A term is one row of `terms`; its dependence on speed is a `Shape`, that on temperature a
/// `Heat`; a number that a law is not linear in is one row of `shape_numbers`.
///
/// This header includes nothing, and its functions are templates over a `Math` that each translation unit defines for
/// itself in an unnamed namespace: the kernels are compiled for several instruction sets, and the linker could keep the
/// AVX version of a shared inline function for all callers. Math has
///   exp(x), log(x), magnitude(x)
///   power(x, a)                    x^a for x >= 0
///   quotient(a, b)                 a / b; a loop may multiply by the reciprocal
///   static constexpr bool branches whether to branch around terms that are 0 (not in vectorised loops)
namespace tribotwin::friction {

/// Bounds of the viscous exponent beta(T): without them an extrapolated temperature could make v^beta infinite.
inline constexpr double exponent_min = 0.01, exponent_max = 5;

/// The numbers of the general law (law.hpp). Torques in the unit of the law, speeds on its side, T in degC.
struct GeneralLaw {
  double A = 0, A_T = 0, A_TT = 0, A_l = 0;
  double B = 0, B_T = 0, B_TT = 0, B_l = 0, vs = 1, vs_T = 0, vs_TT = 0;
  double C_l = 0, vl = 1;
  double alpha = 1;
  double F1 = 0, F1_t = 0, F1_tt = 0, F1_T = 0, T_V = 1, F2 = 0, F3 = 0, Fb = 0, Fb_T = 0, beta = 1, beta_T = 0;
  double s_T = 0, s_T0 = 0;
};

namespace formula {

/// Functions of the speed v > 0 [rad/s, the law's side]; `Form` below evaluates them.
enum Shape : int { constant, stribeck, load_stribeck, linear, quadratic, cubic, power, shape_count };

/// Functions of the temperature T [degC]: 1, T, T^2, e^(-T/T_V).
enum Heat : int { cold, per_degree, per_square_degree, vogel };

/// number * Heat(T) * Shape(v) * l^load, all times s(T).
struct Term {
  double GeneralLaw::*number;
  Shape shape;
  Heat heat = cold;
  int load = 0;  ///< 0 or 1
  /// Of two terms that data cannot separate, identification keeps the one with the lower rank.
  int rank = 6;
  /// Terms that few laws have, and new ones, are compiled into the batch loop of all terms only.
  bool rare = true;
};

using G = GeneralLaw;
/// A sum over terms is formed in this order.
inline constexpr Term terms[] = {
    {&G::A, constant, cold, 0, 0, false},
    {&G::A_T, constant, per_degree, 0, 2},
    {&G::A_TT, constant, per_square_degree, 0, 7},
    {&G::A_l, constant, cold, 1, 1, false},
    {&G::B, stribeck, cold, 0, 4, false},
    {&G::B_T, stribeck, per_degree, 0, 6, false},
    {&G::B_TT, stribeck, per_square_degree, 0, 7},
    {&G::B_l, stribeck, cold, 1, 5, false},
    {&G::C_l, load_stribeck, cold, 1, 5, false},
    {&G::F1, linear, cold, 0, 3, false},
    {&G::F1_t, linear, per_degree},
    {&G::F1_tt, linear, per_square_degree, 0, 7},
    {&G::F1_T, linear, vogel, 0, 6, false},
    {&G::F2, quadratic, cold, 0, 6, false},
    {&G::F3, cubic, cold, 0, 6, false},
    {&G::Fb, power, cold, 0, 3},
    {&G::Fb_T, power, vogel, 0, 3},
};
inline constexpr int term_count = sizeof(terms) / sizeof(*terms);

/// What the numbers that a law is not linear in describe. A quantity is the sum of its numbers times T^degree.
enum Quantity : int {
  stribeck_velocity,  ///< vs(T) [rad/s]
  load_velocity,      ///< vl [rad/s]
  stribeck_exponent,  ///< alpha
  vogel_scale,        ///< T_V [K]
  power_exponent,     ///< beta(T)
  scale_slope,        ///< s_T [1/K]
  scale_reference     ///< s_T0 [degC], a convention that identification fixes
};

struct ShapeNumber {
  double GeneralLaw::*number;
  Quantity quantity;
  int degree = 0;  ///< of T
  int rank = 22;   ///< as in Term
  /// Where identification starts its search for the quantity; empty where the trust region finds it from 0.
  /// `of_speeds`: shares of the decades between the slowest and the fastest speed measured.
  struct {
    int count = 0;
    double values[3] = {};
    bool of_speeds = false;
  } starts = {};
  bool rare = true;  ///< as in Term
};
inline constexpr ShapeNumber shape_numbers[] = {
    {&G::vs, stribeck_velocity, 0, 20, {3, {0.15, 0.42, 0.7}, true}, false},
    {&G::vs_T, stribeck_velocity, 1, 22, {}, false},
    {&G::vs_TT, stribeck_velocity, 2, 23},
    {&G::vl, load_velocity, 0, 20, {2, {0.15, 0.42}, true}, false},
    {&G::alpha, stribeck_exponent, 0, 21, {1, {1.4}}, false},
    {&G::T_V, vogel_scale, 0, 22, {1, {20}}, false},
    {&G::beta, power_exponent, 0, 21, {3, {0.45, 0.7, 1.4}}},
    {&G::beta_T, power_exponent, 1},
    {&G::s_T, scale_slope, 0, 22, {3, {-0.01, -0.003, 0.003}}, false},
    {&G::s_T0, scale_reference, 0, 22, {}, false},
};
inline constexpr int shape_number_count = sizeof(shape_numbers) / sizeof(*shape_numbers);

/// Properties of a shape that do not depend on the speed; `Form` below evaluates the shape.
struct ShapeInfo {
  bool weakening;       ///< part of g, else of h
  int degree = 0;       ///< of v, where the shape is a power of v
  double at_rest = 0;   ///< its value at v = 0
  int slope_count = 0;  ///< quantities that it depends on
  Quantity slopes[2] = {};
};
inline constexpr ShapeInfo shape_infos[shape_count] = {
    {.weakening = true, .at_rest = 1},
    {.weakening = true, .at_rest = 1, .slope_count = 2, .slopes = {stribeck_velocity, stribeck_exponent}},
    {.weakening = true, .at_rest = 1, .slope_count = 2, .slopes = {load_velocity, stribeck_exponent}},
    {.weakening = false, .degree = 1},
    {.weakening = false, .degree = 2},
    {.weakening = false, .degree = 3},
    {.weakening = false, .slope_count = 1, .slopes = {power_exponent}},
};

/// The law at one temperature, to be evaluated at a speed and a load.
struct Coefficients {
  double amplitude[shape_count][2] = {};  ///< of each shape, without load and per load
  double vs_pow = 0, vl_pow = 0;          ///< |vs(T)|^-alpha, infinite for a Stribeck velocity of 0; vl^-alpha
  double alpha = 1, beta = 1;
};

/// f<0>(), f<1>(), ... f<count - 1>().
template <int count, int from = 0, class F>
[[gnu::always_inline]] inline constexpr void each(F&& f) {
  if constexpr (from < count) {
    f.template operator()<from>();
    each<count, from + 1>(f);
  }
}

template <class Math>
struct Basics {
  static constexpr double minimum(double a, double b) { return a < b ? a : b; }
  static constexpr double maximum(double a, double b) { return a > b ? a : b; }

  /// e^-x for x >= 0. With a Stribeck velocity of 0 the term is 0 above standstill: x is then infinite, or NaN where
  /// v^alpha underflows.
  [[gnu::always_inline]] static double fade(double x) {
    if constexpr (Math::branches)
      return x < 750 ? Math::exp(-x) : 0.0;
    else
      return x < 750 ? Math::exp(-minimum(x, 750)) : 0.0;
  }

  [[gnu::always_inline]] static double times_power(double x, double T, int degree) {
    for (int k = 0; k < degree; ++k) x *= T;
    return x;
  }

  /// A quantity at a temperature.
  template <Quantity quantity, bool all = true>
  [[gnu::always_inline]] static double at(const GeneralLaw& f, double T) {
    double sum = 0;
    bool first = true;
    each<shape_number_count>([&]<int n>() __attribute__((always_inline)) {
      constexpr ShapeNumber row = shape_numbers[n];
      if constexpr (row.quantity == quantity && (all || !row.rare)) {
        const double x = times_power(f.*row.number, T, row.degree);
        sum = first ? x : sum + x;
        first = false;
      }
    });
    return sum;
  }

  /// The factor of all terms, floored at 0: a negative factor would make friction drive the joint.
  [[gnu::always_inline]] static double scale(const GeneralLaw& f, double T) {
    return maximum(1 + f.s_T * (T - f.s_T0), 0);
  }
};

/// Per shape: `value` at v > 0 from the coefficients, v^alpha given; and, for identification, `sample`: the same from
/// the numbers themselves, with its slopes by the quantities of its ShapeInfo. Identification may search anywhere, so
/// powers and the squares of their products stay finite. `warm`: the quantities may depend on T. A sample takes `steps`
/// steps of one transcendental function each, called in turn with the same three variables. In a loop over samples that
/// does one step, the processor can overlap these functions.
template <Shape shape, class Math>
struct Form {  // a power of v
  static constexpr int steps = 1;
  template <int step, bool warm>
  [[gnu::always_inline]] static void sample(const GeneralLaw&, double v, double, double, double& value, double&,
                                            double&) {
    value = Basics<Math>::times_power(1, v, shape_infos[shape].degree);
  }
};

/// A step of e^-x with x = (v/u)^alpha and its slopes by u and alpha. Powers are limited to e^6: beyond it the term is
/// 0, its slopes are infinity times 0, and the vector functions are slow.
template <class Math, int step>
[[gnu::always_inline]] inline void stribeck_sample(double u, double alpha, double log_v, double& value, double& by_u,
                                                   double& by_alpha) {
  if constexpr (step == 0) {
    by_alpha = log_v - Math::log(Math::magnitude(u));
  } else if constexpr (step == 1) {
    by_u = Math::exp(Basics<Math>::minimum(alpha * by_alpha, 6));
  } else {
    const double x = by_u, log_ratio = by_alpha;
    value = Math::exp(-x);
    by_u = value * x * alpha / u;
    by_alpha = -value * x * log_ratio;
  }
}

template <class Math>
struct Form<stribeck, Math> {
  [[gnu::always_inline]] static double value(const Coefficients& c, double, double v_alpha) {
    return Basics<Math>::fade(v_alpha * c.vs_pow);
  }
  static constexpr int steps = 3;
  template <int step, bool warm>
  [[gnu::always_inline]] static void sample(const GeneralLaw& f, double, double log_v, double T, double& value,
                                            double& by_vs, double& by_alpha) {
    const double vs = warm ? Basics<Math>::template at<stribeck_velocity>(f, T) : f.vs;
    stribeck_sample<Math, step>(Math::magnitude(vs) < 1e-9 ? 1e-9 : vs, f.alpha, log_v, value, by_vs, by_alpha);
  }
};

template <class Math>
struct Form<load_stribeck, Math> {
  [[gnu::always_inline]] static double value(const Coefficients& c, double, double v_alpha) {
    return Basics<Math>::fade(v_alpha * c.vl_pow);
  }
  static constexpr int steps = 3;
  template <int step, bool warm>
  [[gnu::always_inline]] static void sample(const GeneralLaw& f, double, double log_v, double, double& value,
                                            double& by_vl, double& by_alpha) {
    stribeck_sample<Math, step>(f.vl, f.alpha, log_v, value, by_vl, by_alpha);
  }
};

template <class Math>
struct Form<power, Math> {
  [[gnu::always_inline]] static double value(const Coefficients& c, double v, double) { return Math::power(v, c.beta); }
  static constexpr int steps = 1;
  template <int step, bool warm>
  [[gnu::always_inline]] static void sample(const GeneralLaw& f, double, double log_v, double T, double& value,
                                            double& by_beta, double&) {
    using B = Basics<Math>;
    const double beta = warm ? B::template at<power_exponent>(f, T) : f.beta;
    value = Math::exp(B::minimum(B::maximum(beta * log_v, -700), 150));
    by_beta = value * log_v;
  }
};

/// e^(-T/T_V) and its slope by T_V, for identification.
template <class Math>
[[gnu::always_inline]] inline void vogel_sample(double T_V, double T, double& value, double& slope) {
  const double per_K = 1 / T_V;
  value = Math::exp(Basics<Math>::minimum(Basics<Math>::maximum(-T * per_K, -700), 150));
  slope = value * T * (per_K * per_K);
}

constexpr bool has_term(Shape shape, int load, bool all) {
  for (const Term& term : terms)
    if (term.shape == shape && term.load == load && (all || !term.rare)) return true;
  return false;
}

/// The law itself. `all` = false leaves out the rare terms, which must be 0; `loaded` = false the load terms.
template <class Math, bool loaded = true, bool all = true>
struct Evaluator {
  using B = Basics<Math>;

  /// Coefficients that no temperature changes. Without a load term vl is only a default, and its power would make the
  /// vector library's exp take the slow path for tiny results.
  static Coefficients constants(const GeneralLaw& f) {
    return {.vl_pow = f.C_l == 0 ? 0 : Math::power(f.vl, -f.alpha), .alpha = f.alpha};
  }

  /// All other coefficients at T [degC]. Returns the factor that the caller applies to both parts: s(T) in a vectorised
  /// loop, where one product at the end costs less than one per amplitude, else 1.
  [[gnu::always_inline]] static double set_temperature(const GeneralLaw& f, double T, Coefficients& c) {
    c.vs_pow = Math::power(Math::magnitude(B::template at<stribeck_velocity, all>(f, T)), -f.alpha);
    double thinned = 0;
    if (!Math::branches || has_vogel_term(f)) thinned = Math::exp(Math::quotient(-T, f.T_V));
    const double s = B::scale(f, T);
    each<2 * shape_count>([&]<int i>() __attribute__((always_inline)) {
      constexpr Shape shape = static_cast<Shape>(i / 2);
      constexpr int load = i % 2;
      if constexpr (has_term(shape, load, all) && (loaded || load == 0)) {
        double sum = 0;
        bool first = true;
        each<term_count>([&]<int k>() __attribute__((always_inline)) {
          constexpr Term term = terms[k];
          if constexpr (term.shape == shape && term.load == load && (all || !term.rare)) {
            const double x = term.heat == vogel ? f.*term.number * thinned
                                                : B::times_power(f.*term.number, T, static_cast<int>(term.heat));
            sum = first ? x : sum + x;
            first = false;
          }
        });
        c.amplitude[shape][load] = Math::branches ? s * sum : sum;
      }
    });
    if constexpr (all)
      c.beta = B::minimum(B::maximum(B::template at<power_exponent>(f, T), exponent_min), exponent_max);
    return Math::branches ? 1 : s;
  }

  struct Parts {
    double weakening, strengthening;
  };
  /// Both parts at v > 0 and l >= 0, neither floored. `v_alpha` is v^alpha. It does not depend on temperature; the
  /// caller computes it early, so that the processor can overlap more work.
  [[gnu::always_inline]] static Parts parts(const Coefficients& c, double v, double v_alpha, double l) {
    Parts sum{amplitude<constant>(c, l), polynomial<1>(c, v, l)};
    each<shape_count>([&]<int i>() __attribute__((always_inline)) {
      constexpr Shape shape = static_cast<Shape>(i);
      if constexpr (shape != constant && shape_infos[i].degree == 0 && in_use(shape)) {
        const double a = amplitude<shape>(c, l);
        if (!Math::branches || a != 0)
          (shape_infos[i].weakening ? sum.weakening : sum.strengthening) += a * Form<shape, Math>::value(c, v, v_alpha);
      }
    });
    return sum;
  }

  /// The weakening part at standstill, not floored.
  static double breakaway(const Coefficients& c, double l) {
    double beyond = 0;
    each<shape_count>([&]<int i>() {
      constexpr Shape shape = static_cast<Shape>(i);
      if constexpr (shape != constant && shape_infos[i].weakening)
        beyond += shape_infos[i].at_rest * amplitude<shape>(c, l);
    });
    return amplitude<constant>(c, l) + beyond;
  }

 private:
  static constexpr bool in_use(Shape shape) { return has_term(shape, 0, all) || (loaded && has_term(shape, 1, all)); }
  static bool has_vogel_term(const GeneralLaw& f) {
    bool any = false;
    each<term_count>([&]<int k>() __attribute__((always_inline)) {
      if constexpr (terms[k].heat == vogel) any |= f.*terms[k].number != 0;
    });
    return any;
  }
  template <Shape shape>
  [[gnu::always_inline]] static double amplitude(const Coefficients& c, double l) {
    constexpr bool still = has_term(shape, 0, all), per_load = loaded && has_term(shape, 1, all);
    if constexpr (still && per_load)
      return c.amplitude[shape][0] + c.amplitude[shape][1] * l;
    else if constexpr (per_load)
      return c.amplitude[shape][1] * l;
    else if constexpr (still)
      return c.amplitude[shape][0];
    else
      return 0;
  }
  /// The sum of the shapes that are powers of v, from v^degree on, divided by v^(degree - 1).
  template <int degree>
  [[gnu::always_inline]] static double polynomial(const Coefficients& c, double v, double l) {
    constexpr int here = [] {
      for (int i = 0; i < shape_count; ++i)
        if (shape_infos[i].degree == degree) return i;
      return -1;
    }();
    if constexpr (here < 0) {
      return 0;
    } else if constexpr (degree_above(degree)) {
      return v * (amplitude<static_cast<Shape>(here)>(c, l) + polynomial<degree + 1>(c, v, l));
    } else {
      return v * amplitude<static_cast<Shape>(here)>(c, l);
    }
  }
  static constexpr bool degree_above(int degree) {
    for (const ShapeInfo& info : shape_infos)
      if (info.degree > degree) return true;
    return false;
  }
};

/// Identification: a column is the derivative of the law by one number, or a part of it that several share:
/// shape or one of its slopes, times e^(-T/T_V) or its slope, times T^degree l^load.
struct Column {
  Shape shape;
  int slope = -1;  ///< of the shape; -1: the shape itself
  int vogel = 0;   ///< 1: times e^(-T/T_V), 2: times its slope by T_V
  int degree = 0, load = 0;

  constexpr bool operator==(const Column&) const = default;
  constexpr bool before(const Column& o) const {
    const int mine[] = {shape, slope, vogel, degree + load, load};
    const int other[] = {o.shape, o.slope, o.vogel, o.degree + o.load, o.load};
    for (int k = 0; k < 5; ++k)
      if (mine[k] != other[k]) return mine[k] < other[k];
    return false;
  }
};

struct Columns {
  /// First the terms, in their order; then the slopes of terms by shape numbers, each once.
  Column column[term_count + term_count * 4] = {};
  int count = term_count;
  /// Column of the slope of a term by a shape number, without the scale s(T); -1 where there is none.
  int slope[term_count][shape_number_count] = {};
};

/// The slope of a term by a shape number; `exists` = false where it has none.
struct Slope {
  bool exists = false;
  Column column = {};
};
constexpr Slope slope_of(const Term& term, const ShapeNumber& number) {
  Column c{.shape = term.shape,
           .vogel = term.heat == vogel,
           .degree = (term.heat == vogel ? 0 : static_cast<int>(term.heat)) + number.degree,
           .load = term.load};
  if (number.quantity == vogel_scale && term.heat == vogel) {
    c.vogel = 2;
    return {true, c};
  }
  const ShapeInfo& info = shape_infos[term.shape];
  for (int i = 0; i < info.slope_count; ++i)
    if (info.slopes[i] == number.quantity) {
      c.slope = i;
      return {true, c};
    }
  return {};
}

inline constexpr Columns columns = [] {
  Columns all;
  for (int k = 0; k < term_count; ++k)
    all.column[k] = {.shape = terms[k].shape,
                     .vogel = terms[k].heat == vogel,
                     .degree = terms[k].heat == vogel ? 0 : static_cast<int>(terms[k].heat),
                     .load = terms[k].load};
  const auto place = [&](const Column& wanted) {
    int i = term_count;
    while (i < all.count && !(all.column[i] == wanted)) ++i;
    return i;
  };
  for (const Term& term : terms)
    for (const ShapeNumber& number : shape_numbers)
      if (const Slope slope = slope_of(term, number); slope.exists)
        if (const int i = place(slope.column); i == all.count) {
          int to = all.count++;
          for (; to > term_count && slope.column.before(all.column[to - 1]); --to) all.column[to] = all.column[to - 1];
          all.column[to] = slope.column;
        }
  for (int k = 0; k < term_count; ++k)
    for (int n = 0; n < shape_number_count; ++n) {
      const Slope slope = slope_of(terms[k], shape_numbers[n]);
      all.slope[k][n] = slope.exists ? place(slope.column) : -1;
    }
  return all;
}();

/// The law at v > 0 and its derivatives by the numbers of `terms` and of `shape_numbers`.
template <class Math>
double gradient(const GeneralLaw& f, double v, double l, double T, double* by_terms, double* by_shape_numbers) {
  using B = Basics<Math>;
  const double s = B::scale(f, T), log_v = Math::log(v);
  double value[shape_count], slopes[shape_count][2], heat[3] = {1};
  each<shape_count>([&]<int i>() {
    using Of = Form<static_cast<Shape>(i), Math>;
    each<Of::steps>(
        [&]<int step>() { Of::template sample<step, true>(f, v, log_v, T, value[i], slopes[i][0], slopes[i][1]); });
  });
  vogel_sample<Math>(f.T_V, T, heat[1], heat[2]);
  const auto at = [&](const Column& c) {
    const double x = (c.slope < 0 ? value[c.shape] : slopes[c.shape][c.slope]) * heat[c.vogel];
    return s * B::times_power(c.load ? x * l : x, T, c.degree);
  };
  double sum = 0;
  for (int n = 0; n < shape_number_count; ++n) by_shape_numbers[n] = 0;
  for (int k = 0; k < term_count; ++k) {
    by_terms[k] = at(columns.column[k]);
    const double number = f.*terms[k].number;
    sum += number * by_terms[k];
    for (int n = 0; n < shape_number_count; ++n)
      if (columns.slope[k][n] >= 0) by_shape_numbers[n] += number * at(columns.column[columns.slope[k][n]]);
  }
  const double unscaled = s > 0 ? sum / s : 0;
  for (int n = 0; n < shape_number_count; ++n) {
    if (shape_numbers[n].quantity == scale_slope) by_shape_numbers[n] = unscaled * (T - f.s_T0);
    if (shape_numbers[n].quantity == scale_reference) by_shape_numbers[n] = -unscaled * f.s_T;
  }
  return sum;
}

}  // namespace formula
}  // namespace tribotwin::friction
