#include <tribotwin/twin/portable/fmu_texts.hpp>

namespace tribotwin::twin {

const char* const fmi2_types = R"(/* @WHAT@ as a functional mock-up unit for co-simulation, FMI 2.0.
 * Written by `tribotwin export --fmu` from the standard's lists of types and functions (https://fmi-standard.org).
 * C99; @NEEDS@.
 *
 * As source the functions have the prefix @NAME@_; FMI2_OVERRIDE_FUNCTION_PREFIX leaves it out, as in a shared library.
 */
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

@INCLUDE@
/* FMPy defines the macro of FMI 3 for both versions. */
#if !defined(FMI2_OVERRIDE_FUNCTION_PREFIX) && !defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#ifndef FMI2_FUNCTION_PREFIX
#define FMI2_FUNCTION_PREFIX @NAME@_
#endif
#define FMI2_ACTUAL_FUNCTION_PREFIX FMI2_FUNCTION_PREFIX
#elif !defined(FMI2_ACTUAL_FUNCTION_PREFIX)
#define FMI2_ACTUAL_FUNCTION_PREFIX
#endif
#define FMU_PASTE(prefix, name) prefix##name
#define FMU_EXPAND(prefix, name) FMU_PASTE(prefix, name)
#define FMI(function) FMU_EXPAND(FMI2_ACTUAL_FUNCTION_PREFIX, fmi2##function)
#ifdef _WIN32
#define FMI_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI_EXPORT __attribute__((visibility("default")))
#else
#define FMI_EXPORT
#endif

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*fmi2Logger)(void *environment, const char *name, fmi2Status status, const char *category,
                           const char *message, ...);
typedef struct {
  fmi2Logger logger;
  void *(*allocate)(size_t count, size_t size);
  void (*release)(void *memory);
  void (*finished)(void *environment, fmi2Status status);
  void *environment;
} fmi2Callbacks;

typedef unsigned int fmu_reference;
enum { fmu_failed, fmu_done, fmu_discarded };

typedef struct {
  char *name;
  fmi2Logger logger;
  void *environment;
} fmu_host;

/* Errors are always reported. */
static void fmu_report(const fmu_host *host, int code, const char *text)
{
  if (!host->logger) return;
  if (code == fmu_discarded)
    host->logger(host->environment, host->name, fmi2Discard, "logStatusDiscard", "%s", text);
  else
    host->logger(host->environment, host->name, fmi2Error, "logStatusError", "%s", text);
}
)";

const char* const fmi2_functions = R"(
FMI_EXPORT const char *FMI(GetTypesPlatform)(void)
{
  return "default";
}

FMI_EXPORT const char *FMI(GetVersion)(void)
{
  return "2.0";
}

FMI_EXPORT fmi2Status FMI(SetDebugLogging)(void *instance, int on, size_t count, const char *const categories[])
{
  BEGIN(in_any, SetDebugLogging);
  (void)on;
  if (count > 0 && !categories) return fmi2_status(fmu_wrong(f, name, "an array is NULL"));
  return fmi2OK;
}

static char *fmu_copy(const char *text)
{
  const size_t size = strlen(text) + 1;
  char *copy = (char *)malloc(size);
  if (copy) memcpy(copy, text, size);
  return copy;
}

FMI_EXPORT void *FMI(Instantiate)(const char *name, fmi2Type type, const char *token, const char *resources,
                                  const fmi2Callbacks *callbacks, int visible, int logging)
{
  fmu_host host = {NULL, NULL, NULL};
  fmu_instance *f;
  (void)visible, (void)logging;
  if (callbacks) {
    host.logger = callbacks->logger;
    host.environment = callbacks->environment;
  }
  host.name = fmu_copy(name ? name : "");
  f = (fmu_instance *)calloc(1, sizeof *f);
  if (!f || !host.name || !name || !*name)
    fmu_report(&host, fmu_failed, "fmi2Instantiate: an instance needs a name and memory");
  else if (type != fmi2CoSimulation)
    fmu_report(&host, fmu_failed, "fmi2Instantiate: this FMU is for co-simulation only");
  else {
    f->host = host;
    if (fmu_open(f, token, resources, "fmi2Instantiate")) return f;
  }
  free(host.name);
  free(f);
  return NULL;
}

FMI_EXPORT void FMI(FreeInstance)(void *instance)
{
  fmu_instance *const f = (fmu_instance *)instance;
  if (!f) return;
  fmu_close(f);
  free(f->host.name);
  free(f);
}

FMI_EXPORT fmi2Status FMI(SetupExperiment)(void *instance, int has_tolerance, double tolerance, double start_s,
                                           int has_stop, double stop_s)
{
  BEGIN(in_instantiated, SetupExperiment);
  (void)has_tolerance, (void)tolerance;
  return fmi2_status(fmu_begin(f, start_s, has_stop != 0, stop_s, name));
}

FMI_EXPORT fmi2Status FMI(EnterInitializationMode)(void *instance)
{
  BEGIN(in_instantiated, EnterInitializationMode);
  (void)name;
  f->now.mode = in_initialization;
  return fmi2OK;
}

FMI_EXPORT fmi2Status FMI(GetReal)(void *instance, const fmu_reference references[], size_t count, double values[])
{
  BEGIN(in_any, GetReal);
  return fmi2_status(fmu_get(f, references, count, values, count, name));
}

FMI_EXPORT fmi2Status FMI(SetReal)(void *instance, const fmu_reference references[], size_t count,
                                   const double values[])
{
  BEGIN(in_instantiated | in_initialization | in_steps, SetReal);
  return fmi2_status(fmu_set(f, references, count, values, count, name));
}

FMI_EXPORT fmi2Status FMI(GetBoolean)(void *instance, const fmu_reference references[], size_t count, int values[])
{
  size_t i;
  BEGIN(in_any, GetBoolean);
  if (!fmu_boolean(f, references, count, count, values, name)) return fmi2Error;
  fmu_evaluate_if_new(f);
  for (i = 0; i < count; ++i) values[i] = fmu_is_outside(f);
  return fmi2OK;
}

FMI_EXPORT fmi2Status FMI(SetBoolean)(void *instance, const fmu_reference references[], size_t count,
                                      const int values[])
{
  BEGIN(in_instantiated | in_initialization | in_steps, SetBoolean);
  (void)references, (void)values;
  return count == 0 ? fmi2OK : fmi2_status(fmu_wrong(f, name, "no Boolean of this FMU can be set"));
}

/* Types of which the FMU has no variables. */
#define NO_VARIABLES(function, type) \
  FMI_EXPORT fmi2Status FMI(function)(void *instance, const fmu_reference references[], size_t count, type values[]) \
  { \
    BEGIN(in_any, function); \
    (void)references, (void)values; \
    return count == 0 ? fmi2OK : fmi2_status(fmu_wrong(f, name, "this FMU has no variable of this type")); \
  }

NO_VARIABLES(GetInteger, int)
NO_VARIABLES(SetInteger, const int)
NO_VARIABLES(GetString, const char *)
NO_VARIABLES(SetString, const char *const)

FMI_EXPORT fmi2Status FMI(GetDirectionalDerivative)(void *instance, const fmu_reference unknowns[],
                                                    size_t unknown_count, const fmu_reference knowns[],
                                                    size_t known_count, const double seed[], double derivative[])
{
  BEGIN(in_any, GetDirectionalDerivative);
  (void)unknowns, (void)unknown_count, (void)knowns, (void)known_count, (void)seed, (void)derivative;
  return fmi2_status(fmu_wrong(f, name, "this FMU has no directional derivatives"));
}

FMI_EXPORT fmi2Status FMI(SetRealInputDerivatives)(void *instance, const fmu_reference references[], size_t count,
                                                   const int orders[], const double values[])
{
  BEGIN(in_any, SetRealInputDerivatives);
  (void)references, (void)count, (void)orders, (void)values;
  return fmi2_status(fmu_wrong(f, name, "this FMU does not interpolate inputs"));
}

FMI_EXPORT fmi2Status FMI(GetRealOutputDerivatives)(void *instance, const fmu_reference references[], size_t count,
                                                    const int orders[], double values[])
{
  BEGIN(in_any, GetRealOutputDerivatives);
  (void)references, (void)count, (void)orders, (void)values;
  return fmi2_status(fmu_wrong(f, name, "this FMU has no derivatives of outputs"));
}

FMI_EXPORT fmi2Status FMI(DoStep)(void *instance, double time_s, double dt_s, int no_way_back)
{
  BEGIN(in_steps, DoStep);
  (void)no_way_back;
  return fmi2_status(fmu_step(f, time_s, dt_s, name));
}

FMI_EXPORT fmi2Status FMI(CancelStep)(void *instance)
{
  BEGIN(in_any, CancelStep);
  return fmi2_status(fmu_wrong(f, name, "no step is under way: steps are done when fmi2DoStep returns"));
}

FMI_EXPORT fmi2Status FMI(GetRealStatus)(void *instance, fmi2StatusKind kind, double *value)
{
  BEGIN(in_steps | in_terminated, GetRealStatus);
  if (kind != fmi2LastSuccessfulTime || !value)
    return fmi2_status(fmu_wrong(f, name, "of the real ones only fmi2LastSuccessfulTime is known"));
  *value = f->now.time_s;
  return fmi2OK;
}

/* No step is ever pending or discarded, so there is nothing to say. */
#define NO_STATUS(function, type) \
  FMI_EXPORT fmi2Status FMI(function)(void *instance, fmi2StatusKind kind, type *value) \
  { \
    BEGIN(in_any, function); \
    (void)kind, (void)value; \
    (void)fmu_wrong(f, name, "no step is pending: steps are done when fmi2DoStep returns"); \
    return fmi2Discard; \
  }

NO_STATUS(GetStatus, fmi2Status)
NO_STATUS(GetIntegerStatus, int)
NO_STATUS(GetBooleanStatus, int)
NO_STATUS(GetStringStatus, const char *)
)";

}  // namespace tribotwin::twin
