#include <tribotwin/twin/portable/c_law.hpp>
#include <tribotwin/twin/portable/fmu_texts.hpp>
#include <tribotwin/twin/portable/robot/robot_functions.hpp>

namespace tribotwin::twin {
namespace {

constexpr const char* head = R"(
typedef struct {
  double time_s, stop_s;
  int mode, has_stop;
} fmu_state;

typedef struct {
  fmu_state now;
  fmu_host host;
  struct tribotwin_robot *robot;
} fmu_instance;

typedef struct tribotwin_robot_variable fmu_variable;

static const fmu_variable fmu_time = {"time", 0, -HUGE_VAL, HUGE_VAL};

static const fmu_variable *fmu_find(const fmu_instance *f, fmu_reference reference)
{
  return reference == 0 ? &fmu_time : tribotwin_robot_find(f->robot, reference);
}

static double *fmu_place(fmu_instance *f, fmu_reference reference)
{
  return reference == 0 ? &f->now.time_s : tribotwin_robot_place(f->robot, reference);
}

static int fmu_is_boolean(const fmu_instance *f, fmu_reference reference)
{
  return reference == tribotwin_robot_boolean(f->robot);
}
)";

constexpr const char* robot = R"(
#define NO_COPIES "this FMU cannot copy its state: a twin has no checkpoint"

/* Values before the first step are those of the start, whatever the inputs. */
static void fmu_evaluate(fmu_state *s)
{
  (void)s;
}

static void fmu_changed(fmu_instance *f)
{
  (void)f;
}

static int fmu_is_outside(const fmu_instance *f)
{
  return tribotwin_robot_outside(f->robot);
}

static int fmu_reported(const fmu_instance *f, const char *function, const char *what)
{
  char text[2200];
  snprintf(text, sizeof text, "%.60s: %.2000s", function, what);
  fmu_report(&f->host, fmu_failed, text);
  return fmu_failed;
}

static int fmu_open(fmu_instance *f, const char *token, const char *resources, const char *function)
{
  char text[2000] = "";
  f->robot = tribotwin_robot_open(token, resources, text, sizeof text);
  if (!f->robot) return fmu_reported(f, function, text);
  f->now.mode = in_instantiated;
  return 1;
}

static void fmu_close(fmu_instance *f)
{
  tribotwin_robot_close(f->robot);
}

static int fmu_reset(fmu_instance *f, const char *function)
{
  static const fmu_state fresh = {0};
  char text[2000] = "";
  if (!tribotwin_robot_reset(f->robot, text, sizeof text)) return fmu_reported(f, function, text);
  f->now = fresh;
  f->now.mode = in_instantiated;
  return 1;
}

static int fmu_step(fmu_instance *f, double time_s, double dt_s, const char *function)
{
  char text[2000] = "";
  if (!fmu_step_allowed(f, time_s, dt_s, 1e6, function)) return 0;
  if (!tribotwin_robot_step(f->robot, dt_s, text, sizeof text)) return fmu_reported(f, function, text);
  f->now.time_s = time_s + dt_s;
  return 1;
}

static int fmu_save(const fmu_instance *f, void **to, const char *function)
{
  (void)to;
  return fmu_wrong(f, function, NO_COPIES);
}

static int fmu_restore(const fmu_instance *f, const void *from, const char *function)
{
  (void)from;
  return fmu_wrong(f, function, NO_COPIES);
}

static int fmu_release(const fmu_instance *f, void **state, const char *function)
{
  (void)state;
  return fmu_wrong(f, function, NO_COPIES);
}

static int fmu_serialized_size(const fmu_instance *f, const void *state, size_t *size, const char *function)
{
  (void)state, (void)size;
  return fmu_wrong(f, function, NO_COPIES);
}

static int fmu_serialize(const fmu_instance *f, const void *state, void *bytes, size_t size, const char *function)
{
  (void)state, (void)bytes, (void)size;
  return fmu_wrong(f, function, NO_COPIES);
}

static int fmu_deserialize(const fmu_instance *f, const void *bytes, size_t size, void **state, const char *function)
{
  (void)bytes, (void)size, (void)state;
  return fmu_wrong(f, function, NO_COPIES);
}
)";

}  // namespace

std::string robot_fmu_functions(FmiVersion version) {
  const bool two = version == FmiVersion::two;
  const std::string text = std::string(two ? fmi2_types : fmi3_types) + fmu_modes + head + fmu_calls + robot +
                           fmi_functions + (two ? fmi2_functions : fmi3_functions);
  return filled(text, {{"@WHAT@", "A robot"},
                       {"@NEEDS@", "the robot is a twin of tribotwin"},
                       {"@INCLUDE@", "#include <tribotwin/twin/portable/robot/robot_instance.h>\n"},
                       {"@VERSION@", two ? "2" : "3"},
                       {"@STATE@", two ? "FMUstate" : "FMUState"},
                       {"@DESERIALIZE@", two ? "DeSerializeFMUstate" : "DeserializeFMUState"},
                       {"@BYTE@", two ? "char" : "uint8_t"},
                       {"@NAME@", "robot"}});
}

}  // namespace tribotwin::twin
