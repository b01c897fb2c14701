#include <fmt/format.h>

#include <tribotwin/twin/portable/c_law.hpp>

namespace tribotwin::twin {
namespace {

constexpr const char* state = R"(
  /* Of the motor. Input, 0 after @NAME@_init: */
  double torque_loss; /* fault: share of the torque computed from the current that does not come, 0 .. 0.9 */
  /* What a step hands to the next. */
  double winding_K; /* winding above T_amb [K] */
  double overload;  /* share of the overload that I^2 t protection allows */
  /* Results of the last step. */
  double current_A;       /* what load, friction and offset need, at most the limit */
  double current_limit_A; /* at the temperature and the overload with which the step began */
  double copper_loss_J;   /* since @NAME@_init: made in the winding, */
  double winding_heat_J;  /* and of it, what has flowed to the gear: a part of heat_J */
)";

constexpr const char* declarations = R"(
/* A winding that has this temperature. */
void @NAME@_set_winding_temperature(@NAME@_state *s, double temperature_degC);

/* Temperature of the winding now [degC]. */
double @NAME@_winding_temperature(const @NAME@_state *s);
)";

constexpr const char* temperatures = R"(double @NAME@_winding_temperature(const @NAME@_state *s)
{
  return @T_AMB@ + s->winding_K;
}

void @NAME@_set_winding_temperature(@NAME@_state *s, double temperature_degC)
{
  s->winding_K = temperature_degC - @T_AMB@;
}

/* Neither a resistance nor a torque constant vanishes, however wrong the temperature. */
static double @NAME@_some(double x)
{
  return x < 0.05 ? 0.05 : x;
}

)";

constexpr const char* limit_head = R"(/* The largest current that the drive gives [A]. */
static double @NAME@_current_limit(const @NAME@_state *s, double winding_degC)
{
  double limit = @current_max_A@;
)";
constexpr const char* limit_of_overload = R"(  limit += (@current_rated_A@ - @current_max_A@) *
           @NAME@_within((s->overload - 0.8) / (1.0 - 0.8), 0.0, 1.0);
)";
constexpr const char* limit_tail = R"(  return limit * @NAME@_within((@winding_limit_degC@ - winding_degC) /
                               (@winding_limit_degC@ - @winding_warning_degC@), 0.0, 1.0);
}

)";

constexpr const char* heat_head =
    R"(/* A step in which the gear with its friction needs needed_nm of the motor [Nm, arm side]. Returns what
 * flows from the winding to the gear [W]. */
static double @NAME@_winding(@NAME@_state *s, double winding_degC, double needed_nm, double dt_s)
{
  const double per_A = @GEAR@ * @torque_constant_nm_A@, most = per_A * s->current_limit_A;
  const double cold = 1.0 - @NAME@_some(1.0 - @winding_magnet_1_K@ * (winding_degC - @winding_reference_degC@));
  double copper, change, flow;
  s->current_A = @NAME@_within(needed_nm / (1.0 - s->torque_loss) / (1.0 - cold), -most, most) / per_A;
  copper = s->current_A * s->current_A *
           (@winding_resistance_ohm@ *
            @NAME@_some(1.0 + @winding_copper_1_K@ * (winding_degC - @winding_reference_degC@)));
  change = ((s->node_K[0] + s->node_K[1]) + @winding_thermal_resistance_K_W@ * copper - s->winding_K) *
           -expm1(-dt_s / (@winding_thermal_resistance_K_W@ * @winding_heat_capacity_J_K@));
  s->winding_K += change;
)";
constexpr const char* heat_overload = R"(  {
    const double rated = @current_rated_A@ * @current_rated_A@;
    const double rate = (s->current_A * s->current_A - rated) /
                        (@overload_s@ * (@current_max_A@ * @current_max_A@ - rated));
    s->overload = @NAME@_within(s->overload + rate * dt_s, 0.0, 1.0);
  }
)";
constexpr const char* heat_tail = R"(  flow = copper - @winding_heat_capacity_J_K@ * change / dt_s;
  s->copper_loss_J += copper * dt_s;
  s->winding_heat_J += flow * dt_s;
  return flow;
}

)";

}  // namespace

CWinding c_winding(const drive::Drive& drive) {
  if (!drive.winding.present()) return {};
  const bool protects = drive.winding.current_rated_A > 0;
  return {.head = fmt::format(
              "\n *   winding: {:g} ohm and {:g} Nm/A at {:g} degC, {:g} J/K, {:g} K/W to the gear, at most {:g} A",
              drive.winding.resistance_ohm, drive.winding.torque_constant_nm_A, drive.winding.reference_degC,
              drive.winding.heat_capacity_J_K, drive.winding.thermal_resistance_K_W, drive.winding.current_max_A),
          .state = state,
          .declarations = declarations,
          .functions = std::string(temperatures) + limit_head + (protects ? limit_of_overload : "  (void)s;\n") +
                       limit_tail + heat_head + (protects ? heat_overload : "") + heat_tail,
          .limit =
              "  const double winding_degC = @NAME@_winding_temperature(s);\n"
              "  s->current_limit_A = @NAME@_current_limit(s, winding_degC);\n",
          .step = "  power += @NAME@_winding(s, winding_degC, load + s->friction_nm + @OFFSET_NM@, dt_s);\n"};
}

}  // namespace tribotwin::twin
