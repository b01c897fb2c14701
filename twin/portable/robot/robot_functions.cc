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

/* A state outside the instance: numbers of the twin and what the functions know. Its bytes are `head` with a checksum
 * and the numbers. */
typedef struct {
  double order; /* of the numbers' bytes */
  fmu_state now;
  size_t count;
  uint64_t hash;
} fmu_head;

typedef struct {
  fmu_head head;
  double numbers[1]; /* head.count */
} fmu_saved;

static size_t fmu_size(size_t count)
{
  return sizeof(fmu_head) + count * sizeof(double);
}

/* Over the head without its hash, and the numbers. */
static uint64_t fmu_hash(const fmu_saved *saved)
{
  fmu_head head = saved->head;
  head.hash = 0;
  return fmu_checksum(fmu_checksum(fmu_of_nothing, &head, sizeof head), saved->numbers,
                      saved->head.count * sizeof(double));
}

/* Room for a state in *to, which may be one of before. */
static fmu_saved *fmu_room(void **to, size_t count)
{
  fmu_saved *saved = (fmu_saved *)*to;
  if (saved && saved->head.count == count) return saved;
  saved = (fmu_saved *)calloc(1, fmu_size(count));
  if (!saved) return NULL;
  free(*to);
  *to = saved;
  return saved;
}

static int fmu_save(const fmu_instance *f, void **to, const char *function)
{
  char text[2000] = "";
  const size_t count = tribotwin_robot_save(f->robot, NULL, text, sizeof text);
  fmu_saved *saved;
  if (!to) return fmu_wrong(f, function, "the state is NULL");
  if (count == 0) return fmu_reported(f, function, text);
  saved = fmu_room(to, count);
  if (!saved) return fmu_wrong(f, function, "no memory");
  if (tribotwin_robot_save(f->robot, saved->numbers, text, sizeof text) != count)
    return fmu_reported(f, function, text);
  memset(&saved->head, 0, sizeof saved->head);
  saved->head.order = fmu_order;
  saved->head.now = f->now;
  saved->head.count = count;
  saved->head.hash = fmu_hash(saved);
  return 1;
}

static int fmu_restore(fmu_instance *f, const void *from, const char *function)
{
  const fmu_saved *saved = (const fmu_saved *)from;
  char text[2000] = "";
  if (!saved) return fmu_wrong(f, function, "the state is NULL");
  if (!tribotwin_robot_restore(f->robot, saved->numbers, saved->head.count, text, sizeof text))
    return fmu_reported(f, function, text);
  f->now = saved->head.now;
  return 1;
}

static int fmu_serialized_size(const fmu_instance *f, const void *state, size_t *size, const char *function)
{
  if (!state || !size) return fmu_wrong(f, function, "the state or the size is NULL");
  *size = fmu_size(((const fmu_saved *)state)->head.count);
  return 1;
}

static int fmu_serialize(const fmu_instance *f, const void *state, void *bytes, size_t size, const char *function)
{
  size_t needed;
  if (!state || !bytes) return fmu_wrong(f, function, "the state or the bytes are NULL");
  needed = fmu_size(((const fmu_saved *)state)->head.count);
  if (size < needed) return fmu_wrong(f, function, "the bytes are too few");
  memcpy(bytes, state, needed);
  return 1;
}

/* Whether bytes are a whole state of this robot. */
static int fmu_is_whole(const fmu_saved *saved, size_t size, size_t count)
{
  return saved->head.count == count && size == fmu_size(count) && saved->head.order == fmu_order &&
         saved->head.hash == fmu_hash(saved);
}

static int fmu_deserialize(const fmu_instance *f, const void *bytes, size_t size, void **state, const char *function)
{
  const size_t count = size > sizeof(fmu_head) ? (size - sizeof(fmu_head)) / sizeof(double) : 0;
  void *read = NULL;
  fmu_saved *saved;
  if (!bytes || !state) return fmu_wrong(f, function, "the state or the bytes are NULL");
  if (count == 0) return fmu_wrong(f, function, "the bytes are not a whole state of this FMU and machine");
  saved = fmu_room(&read, count);
  if (!saved) return fmu_wrong(f, function, "no memory");
  memcpy(saved, bytes, fmu_size(count));
  if (!fmu_is_whole(saved, size, count)) {
    free(saved);
    return fmu_wrong(f, function, "the bytes are not a whole state of this FMU and machine");
  }
  free(*state);
  *state = saved;
  return 1;
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
