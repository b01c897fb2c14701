#include <tribotwin/twin/portable/fmu_texts.hpp>

namespace tribotwin::twin {

const char* const fmu_modes = R"(
enum { in_instantiated = 1, in_initialization = 2, in_steps = 4, in_terminated = 8, in_any = 15 };
/* Kinds of variables: what may be set, and when. */
enum { is_result, is_input, is_tunable, is_fixed };
)";

const char* const fmu_calls = R"(
/* What every FMU of tribotwin does alike: which calls are allowed, values by their references. */

static void fmu_evaluate(fmu_state *s);
static void fmu_changed(fmu_instance *f);

static int fmu_finite(double x)
{
  return fabs(x) <= DBL_MAX;
}

/* Whether the function may be called now. */
static int fmu_allowed(const fmu_instance *f, int modes, const char *function)
{
  char text[200];
  const int mode = f->now.mode;
  if (mode & modes) return 1;
  sprintf(text, "%s: not allowed %s", function,
          mode == in_instantiated     ? "before initialization"
          : mode == in_initialization ? "in initialization mode"
          : mode == in_steps          ? "after initialization"
                                      : "after termination");
  fmu_report(&f->host, fmu_failed, text);
  return 0;
}

static int fmu_wrong(const fmu_instance *f, const char *function, const char *what)
{
  char text[200];
  sprintf(text, "%.60s: %.120s", function, what);
  fmu_report(&f->host, fmu_failed, text);
  return fmu_failed;
}

/* Of a state as bytes: a number that tells the order of bytes, and a checksum (FNV-1a), of nothing to begin with. */
static const double fmu_order = 1.2345678901234567;
static const uint32_t fmu_of_nothing = 2166136261u;

static uint32_t fmu_checksum(uint32_t hash, const void *data, size_t size)
{
  const unsigned char *bytes = (const unsigned char *)data;
  size_t i;
  for (i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 16777619u;
  return hash;
}

static int fmu_release(const fmu_instance *f, void **state, const char *function)
{
  if (!state) return fmu_wrong(f, function, "the state is NULL");
  free(*state);
  *state = NULL;
  return 1;
}

static void fmu_evaluate_if_new(fmu_instance *f)
{
  if (f->now.mode & (in_instantiated | in_initialization)) fmu_evaluate(&f->now);
}

static int fmu_known(const fmu_instance *f, size_t count, size_t values, const void *references, const void *target,
                     const char *function)
{
  if (count != values) return fmu_wrong(f, function, "as many values as value references are needed");
  if (count > 0 && (!references || !target)) return fmu_wrong(f, function, "an array is NULL");
  return 1;
}

static int fmu_get(fmu_instance *f, const fmu_reference *references, size_t count, double *values, size_t value_count,
                   const char *function)
{
  size_t i;
  if (!fmu_known(f, count, value_count, references, values, function)) return 0;
  for (i = 0; i < count; ++i)
    if (!fmu_find(f, references[i])) return fmu_wrong(f, function, "no such value reference");
  fmu_evaluate_if_new(f);
  for (i = 0; i < count; ++i) values[i] = *fmu_place(f, references[i]);
  return 1;
}

/* A value beyond its range changes nothing, and the simulation may go on. */
static int fmu_settable(const fmu_instance *f, const fmu_variable *v, double value, const char *function)
{
  char text[300];
  int code = fmu_failed;
  if (v->kind == is_result) {
    sprintf(text, "%.60s: %.60s is a result and cannot be set", function, v->name);
  } else if (v->kind == is_fixed && f->now.mode == in_steps) {
    sprintf(text, "%.60s: %.60s is fixed after initialization", function, v->name);
  } else if (v->minimum >= -DBL_MAX && !(value >= v->minimum && value <= v->maximum)) {
    sprintf(text, "%.60s: %.60s is %.17g but must be within %.17g .. %.17g", function, v->name, value, v->minimum,
            v->maximum);
    code = fmu_discarded;
  } else {
    return fmu_done;
  }
  fmu_report(&f->host, code, text);
  return code;
}

/* All values or none. */
static int fmu_set(fmu_instance *f, const fmu_reference *references, size_t count, const double *values,
                   size_t value_count, const char *function)
{
  const fmu_variable *variable;
  size_t i;
  int code;
  if (!fmu_known(f, count, value_count, references, values, function)) return fmu_failed;
  for (i = 0; i < count; ++i) {
    variable = fmu_find(f, references[i]);
    if (!variable) return fmu_wrong(f, function, "no such value reference");
    code = fmu_settable(f, variable, values[i], function);
    if (code != fmu_done) return code;
  }
  for (i = 0; i < count; ++i) *fmu_place(f, references[i]) = values[i];
  fmu_changed(f);
  return 1;
}

/* Whether references name Booleans. */
static int fmu_boolean(const fmu_instance *f, const fmu_reference *references, size_t count, size_t values,
                       const void *target, const char *function)
{
  size_t i;
  if (!fmu_known(f, count, values, references, target, function)) return 0;
  for (i = 0; i < count; ++i)
    if (!fmu_is_boolean(f, references[i])) return fmu_wrong(f, function, "no such value reference");
  return 1;
}

static int fmu_begin(fmu_instance *f, double start_s, int has_stop, double stop_s, const char *function)
{
  if (!fmu_finite(start_s)) return fmu_wrong(f, function, "the start time must be finite");
  if (has_stop && !(stop_s >= start_s && fmu_finite(stop_s)))
    return fmu_wrong(f, function, "the stop time must be finite and not before the start time");
  f->now.time_s = start_s;
  f->now.stop_s = stop_s;
  f->now.has_stop = has_stop;
  return 1;
}

/* Times are sums of steps, so a rounding of them is no error. */
static double fmu_tolerance(double time_s)
{
  return 1e-9 * (1.0 + fabs(time_s));
}

static int fmu_step_allowed(const fmu_instance *f, double time_s, double dt_s, double longest_s, const char *function)
{
  const fmu_state *s = &f->now;
  char text[100];
  if (!fmu_finite(time_s) || fabs(time_s - s->time_s) > fmu_tolerance(time_s))
    return fmu_wrong(f, function, "the communication point is not the end of the last step");
  sprintf(text, "the step must be above 0 s and at most %.9g s long", longest_s);
  if (!(dt_s > 0.0 && dt_s <= longest_s)) return fmu_wrong(f, function, text);
  if (s->has_stop && time_s + dt_s > s->stop_s + fmu_tolerance(s->stop_s))
    return fmu_wrong(f, function, "the step ends after the stop time");
  return 1;
}
)";

const char* const fmu_joint_head = R"(
/* The joint under both versions of the standard: state, variables, steps. */

/* Everything that a copy of the state holds. */
typedef struct {
  @NAME@_state joint;
  double time_s, stop_s, speed_rad_s, load_nm, @WARMTH@_degC, @START@heat_W, temperature_degC;
  int mode, has_stop;
} fmu_state;

typedef struct {
  fmu_state now;
  fmu_host host;
} fmu_instance;

typedef struct {
  const char *name;
  size_t offset; /* of its double in fmu_state */
  int kind;
  double minimum, maximum;
} fmu_variable;

/* By their value references. */
static const fmu_variable fmu_variables[@COUNT@] = {
@VARIABLES@};
enum { fmu_variable_count = @COUNT@, fmu_outside = @COUNT@ /* the one Boolean */ };

static const char fmu_token[] = "@TOKEN@";

static const fmu_variable *fmu_find(const fmu_instance *f, fmu_reference reference)
{
  (void)f;
  return reference < fmu_variable_count ? &fmu_variables[reference] : NULL;
}

static double *fmu_place(fmu_instance *f, fmu_reference reference)
{
  return (double *)((char *)&f->now + fmu_variables[reference].offset);
}

static int fmu_is_boolean(const fmu_instance *f, fmu_reference reference)
{
  (void)f;
  return reference == fmu_outside;
}
)";

const char* const fmu_joint = R"(
static void fmu_start(fmu_state *s)
{
  static const fmu_state fresh = {0};
  *s = fresh;
  @NAME@_init(&s->joint);
  s->@WARMTH@_degC = @T_AMB@;
@START_VALUE@  s->temperature_degC = @T_AMB@;
  s->mode = in_instantiated;
}

static void fmu_changed(fmu_instance *f)
{
  @NAME@_changed(&f->now.joint);
}

static int fmu_is_outside(const fmu_instance *f)
{
  return f->now.joint.outside != 0;
}

static int fmu_open(fmu_instance *f, const char *token, const char *resources, const char *function)
{
  (void)resources;
  if (!token || strcmp(token, fmu_token) != 0)
    return fmu_wrong(f, function, "the GUID or token is not that of this FMU's modelDescription.xml");
  fmu_start(&f->now);
  return 1;
}

static void fmu_close(fmu_instance *f)
{
  (void)f;
}

static int fmu_reset(fmu_instance *f, const char *function)
{
  (void)function;
  fmu_start(&f->now);
  return 1;
}

static void fmu_surroundings(fmu_state *s)
{
@SURROUNDINGS@}

/* The results of inputs and parameters before the first step: nothing advances. */
static void fmu_evaluate(fmu_state *s)
{
@START_TEMPERATURE@  fmu_surroundings(s);
  @NAME@_step(&s->joint, s->speed_rad_s, s->load_nm, 0.0);
  s->heat_W = s->joint.friction_nm * (fabs(s->speed_rad_s) <= @SPEED_MAX@ ? s->speed_rad_s : 0.0);
  s->temperature_degC = @NAME@_temperature(&s->joint);
@RESULTS@}

static int fmu_step(fmu_instance *f, double time_s, double dt_s, const char *function)
{
  fmu_state *s = &f->now;
  if (!fmu_step_allowed(f, time_s, dt_s, @DT_MAX@, function)) return 0;
  fmu_surroundings(s);
  @NAME@_step(&s->joint, s->speed_rad_s, s->load_nm, dt_s);
  s->heat_W = s->joint.friction_nm * (fabs(s->speed_rad_s) <= @SPEED_MAX@ ? s->speed_rad_s : 0.0);
  s->temperature_degC = @NAME@_temperature(&s->joint);
@RESULTS@  s->time_s = time_s + dt_s;
  return 1;
}

/* A state as bytes: token, size and order of the numbers, state, checksum. */
enum {
  fmu_token_size = sizeof fmu_token,
  fmu_head_size = fmu_token_size + sizeof(double),
  fmu_body_size = fmu_head_size + sizeof(fmu_state),
  fmu_bytes_size = fmu_body_size + sizeof(uint32_t)
};

static void fmu_pack(const fmu_state *s, unsigned char *bytes)
{
  uint32_t hash;
  memcpy(bytes, fmu_token, fmu_token_size);
  memcpy(bytes + fmu_token_size, &fmu_order, sizeof fmu_order);
  memcpy(bytes + fmu_head_size, s, sizeof *s);
  hash = fmu_checksum(fmu_of_nothing, bytes, fmu_body_size);
  memcpy(bytes + fmu_body_size, &hash, sizeof hash);
}

static int fmu_unpack(const unsigned char *bytes, size_t size, fmu_state *s)
{
  uint32_t hash;
  if (size != fmu_bytes_size || memcmp(bytes, fmu_token, fmu_token_size) != 0 ||
      memcmp(bytes + fmu_token_size, &fmu_order, sizeof fmu_order) != 0)
    return 0;
  memcpy(&hash, bytes + fmu_body_size, sizeof hash);
  if (hash != fmu_checksum(fmu_of_nothing, bytes, fmu_body_size)) return 0;
  memcpy(s, bytes + fmu_head_size, sizeof *s);
  return 1;
}

/* A copy of the state in *to, which may be one of before. */
static int fmu_save(const fmu_instance *f, void **to, const char *function)
{
  if (!to) return fmu_wrong(f, function, "the state is NULL");
  if (!*to) *to = calloc(1, sizeof(fmu_state));
  if (!*to) return fmu_wrong(f, function, "no memory");
  memcpy(*to, &f->now, sizeof f->now);
  return 1;
}

static int fmu_restore(fmu_instance *f, const void *from, const char *function)
{
  if (!from) return fmu_wrong(f, function, "the state is NULL");
  memcpy(&f->now, from, sizeof f->now);
  return 1;
}

static int fmu_serialized_size(const fmu_instance *f, const void *state, size_t *size, const char *function)
{
  if (!state || !size) return fmu_wrong(f, function, "the state or the size is NULL");
  *size = fmu_bytes_size;
  return 1;
}

static int fmu_serialize(const fmu_instance *f, const void *state, void *bytes, size_t size, const char *function)
{
  if (!state || !bytes) return fmu_wrong(f, function, "the state or the bytes are NULL");
  if (size < fmu_bytes_size) return fmu_wrong(f, function, "the bytes are too few");
  fmu_pack((const fmu_state *)state, (unsigned char *)bytes);
  return 1;
}

static int fmu_deserialize(const fmu_instance *f, const void *bytes, size_t size, void **state, const char *function)
{
  fmu_state unpacked;
  if (!bytes || !state) return fmu_wrong(f, function, "the state or the bytes are NULL");
  if (!fmu_unpack((const unsigned char *)bytes, size, &unpacked))
    return fmu_wrong(f, function, "the bytes are not a whole state of this FMU and machine");
  if (!*state) *state = calloc(1, sizeof(fmu_state));
  if (!*state) return fmu_wrong(f, function, "no memory");
  memcpy(*state, &unpacked, sizeof unpacked);
  return 1;
}
)";

}  // namespace tribotwin::twin
