#include <tribotwin/twin/portable/fmu_texts.hpp>

namespace tribotwin::twin {

const char* const fmi3_types = R"(/* @WHAT@ as a functional mock-up unit for co-simulation, FMI 3.0.
 * Written by `tribotwin export --fmu` from the standard's lists of types and functions (https://fmi-standard.org).
 * C99; @NEEDS@.
 *
 * As source the functions have the prefix @NAME@_; FMI3_OVERRIDE_FUNCTION_PREFIX leaves it out, as in a shared library.
 */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

@INCLUDE@
#if !defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#ifndef FMI3_FUNCTION_PREFIX
#define FMI3_FUNCTION_PREFIX @NAME@_
#endif
#define FMI3_ACTUAL_FUNCTION_PREFIX FMI3_FUNCTION_PREFIX
#elif !defined(FMI3_ACTUAL_FUNCTION_PREFIX)
#define FMI3_ACTUAL_FUNCTION_PREFIX
#endif
#define FMU_PASTE(prefix, name) prefix##name
#define FMU_EXPAND(prefix, name) FMU_PASTE(prefix, name)
#define FMI(function) FMU_EXPAND(FMI3_ACTUAL_FUNCTION_PREFIX, fmi3##function)
#ifdef _WIN32
#define FMI_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI_EXPORT __attribute__((visibility("default")))
#else
#define FMI_EXPORT
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3Logger)(void *environment, fmi3Status status, const char *category, const char *message);
typedef void (*fmi3Update)(void *environment, double time_s, bool may_set, bool may_get, bool finished, bool may_return,
                           bool *return_early, double *return_s);
typedef enum {
  fmi3Independent,
  fmi3Constant,
  fmi3Fixed,
  fmi3Tunable,
  fmi3Discrete,
  fmi3Dependent
} fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;

typedef uint32_t fmu_reference;
enum { fmu_failed, fmu_done, fmu_discarded };

typedef struct {
  fmi3Logger logger;
  void *environment;
} fmu_host;

/* Errors are always reported. */
static void fmu_report(const fmu_host *host, int code, const char *text)
{
  if (!host->logger) return;
  if (code == fmu_discarded)
    host->logger(host->environment, fmi3Discard, "logStatusDiscard", text);
  else
    host->logger(host->environment, fmi3Error, "logStatusError", text);
}
)";

const char* const fmi3_functions = R"(
FMI_EXPORT const char *FMI(GetVersion)(void)
{
  return "3.0";
}

FMI_EXPORT fmi3Status FMI(SetDebugLogging)(void *instance, bool on, size_t count, const char *const categories[])
{
  BEGIN(in_any, SetDebugLogging);
  (void)on;
  if (count > 0 && !categories) return fmi3_status(fmu_wrong(f, name, "an array is NULL"));
  return fmi3OK;
}

static void *fmi3_refused(void *environment, fmi3Logger logger, const char *text)
{
  fmu_host host;
  host.environment = environment;
  host.logger = logger;
  fmu_report(&host, fmu_failed, text);
  return NULL;
}

FMI_EXPORT void *FMI(InstantiateCoSimulation)(const char *name, const char *token, const char *resources, bool visible,
                                              bool logging, bool event_mode, bool early_return,
                                              const fmu_reference intermediate[], size_t intermediate_count,
                                              void *environment, fmi3Logger logger, fmi3Update update)
{
  fmu_instance *f;
  (void)visible, (void)logging, (void)early_return, (void)intermediate, (void)intermediate_count;
  (void)update; /* the FMU provides no intermediate updates and never returns early */
  if (!name || !*name)
    return fmi3_refused(environment, logger, "fmi3InstantiateCoSimulation: an instance needs a name");
  if (event_mode)
    return fmi3_refused(environment, logger, "fmi3InstantiateCoSimulation: this FMU has no event mode");
  f = (fmu_instance *)calloc(1, sizeof *f);
  if (!f) return fmi3_refused(environment, logger, "fmi3InstantiateCoSimulation: no memory");
  f->host.environment = environment;
  f->host.logger = logger;
  if (fmu_open(f, token, resources, "fmi3InstantiateCoSimulation")) return f;
  free(f);
  return NULL;
}

FMI_EXPORT void *FMI(InstantiateModelExchange)(const char *name, const char *token, const char *resources, bool visible,
                                               bool logging, void *environment, fmi3Logger logger)
{
  (void)name, (void)token, (void)resources, (void)visible, (void)logging;
  return fmi3_refused(environment, logger, "fmi3InstantiateModelExchange: this FMU is for co-simulation only");
}

FMI_EXPORT void *FMI(InstantiateScheduledExecution)(const char *name, const char *token, const char *resources,
                                                    bool visible, bool logging, void *environment, fmi3Logger logger,
                                                    void (*clock_update)(void *), void (*lock)(void),
                                                    void (*unlock)(void))
{
  (void)name, (void)token, (void)resources, (void)visible, (void)logging;
  (void)clock_update, (void)lock, (void)unlock;
  return fmi3_refused(environment, logger, "fmi3InstantiateScheduledExecution: this FMU is for co-simulation only");
}

FMI_EXPORT void FMI(FreeInstance)(void *instance)
{
  if (instance) fmu_close((fmu_instance *)instance);
  free(instance);
}

FMI_EXPORT fmi3Status FMI(EnterInitializationMode)(void *instance, bool has_tolerance, double tolerance, double start_s,
                                                   bool has_stop, double stop_s)
{
  BEGIN(in_instantiated, EnterInitializationMode);
  (void)has_tolerance, (void)tolerance;
  if (!fmu_begin(f, start_s, has_stop, stop_s, name)) return fmi3Error;
  f->now.mode = in_initialization;
  return fmi3OK;
}

FMI_EXPORT fmi3Status FMI(GetFloat64)(void *instance, const fmu_reference references[], size_t count, double values[],
                                      size_t value_count)
{
  BEGIN(in_any, GetFloat64);
  return fmi3_status(fmu_get(f, references, count, values, value_count, name));
}

FMI_EXPORT fmi3Status FMI(SetFloat64)(void *instance, const fmu_reference references[], size_t count,
                                      const double values[], size_t value_count)
{
  BEGIN(in_instantiated | in_initialization | in_steps, SetFloat64);
  return fmi3_status(fmu_set(f, references, count, values, value_count, name));
}

FMI_EXPORT fmi3Status FMI(GetBoolean)(void *instance, const fmu_reference references[], size_t count, bool values[],
                                      size_t value_count)
{
  size_t i;
  BEGIN(in_any, GetBoolean);
  if (!fmu_boolean(f, references, count, value_count, values, name)) return fmi3Error;
  fmu_evaluate_if_new(f);
  for (i = 0; i < count; ++i) values[i] = fmu_is_outside(f);
  return fmi3OK;
}

FMI_EXPORT fmi3Status FMI(SetBoolean)(void *instance, const fmu_reference references[], size_t count,
                                      const bool values[], size_t value_count)
{
  BEGIN(in_instantiated | in_initialization | in_steps, SetBoolean);
  (void)references, (void)values, (void)value_count;
  return count == 0 ? fmi3OK : fmi3_status(fmu_wrong(f, name, "no Boolean of this FMU can be set"));
}

/* Types of which the FMU has no variables. */
#define NO_VARIABLES(type, ctype) \
  FMI_EXPORT fmi3Status FMI(Get##type)(void *instance, const fmu_reference references[], size_t count, ctype values[], \
                                       size_t value_count) \
  { \
    BEGIN(in_any, Get##type); \
    (void)references, (void)values, (void)value_count; \
    return count == 0 ? fmi3OK : fmi3_status(fmu_wrong(f, name, "this FMU has no variable of this type")); \
  } \
  FMI_EXPORT fmi3Status FMI(Set##type)(void *instance, const fmu_reference references[], size_t count, \
                                       const ctype values[], size_t value_count) \
  { \
    BEGIN(in_any, Set##type); \
    (void)references, (void)values, (void)value_count; \
    return count == 0 ? fmi3OK : fmi3_status(fmu_wrong(f, name, "this FMU has no variable of this type")); \
  }

typedef const char *fmu_string;
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(String, fmu_string)

/* What a function that the FMU lacks says. */
#define REFUSE(function, why) \
  BEGIN(in_any, function); \
  return fmi3_status(fmu_wrong(f, name, why))
#define NO_CLOCKS "this FMU has no clocks"
#define NO_EXCHANGE "this FMU is for co-simulation only"

FMI_EXPORT fmi3Status FMI(GetBinary)(void *instance, const fmu_reference references[], size_t count, size_t sizes[],
                                     const uint8_t *values[], size_t value_count)
{
  BEGIN(in_any, GetBinary);
  (void)references, (void)sizes, (void)values, (void)value_count;
  return count == 0 ? fmi3OK : fmi3_status(fmu_wrong(f, name, "this FMU has no variable of this type"));
}

FMI_EXPORT fmi3Status FMI(SetBinary)(void *instance, const fmu_reference references[], size_t count,
                                     const size_t sizes[], const uint8_t *const values[], size_t value_count)
{
  BEGIN(in_any, SetBinary);
  (void)references, (void)sizes, (void)values, (void)value_count;
  return count == 0 ? fmi3OK : fmi3_status(fmu_wrong(f, name, "this FMU has no variable of this type"));
}

FMI_EXPORT fmi3Status FMI(GetClock)(void *instance, const fmu_reference references[], size_t count, bool values[])
{
  BEGIN(in_any, GetClock);
  (void)references, (void)values;
  return count == 0 ? fmi3OK : fmi3_status(fmu_wrong(f, name, NO_CLOCKS));
}

FMI_EXPORT fmi3Status FMI(SetClock)(void *instance, const fmu_reference references[], size_t count, const bool values[])
{
  BEGIN(in_any, SetClock);
  (void)references, (void)values;
  return count == 0 ? fmi3OK : fmi3_status(fmu_wrong(f, name, NO_CLOCKS));
}

FMI_EXPORT fmi3Status FMI(DoStep)(void *instance, double time_s, double dt_s, bool no_way_back, bool *event,
                                  bool *terminate, bool *early_return, double *last_time_s)
{
  BEGIN(in_steps, DoStep);
  (void)no_way_back;
  if (!event || !terminate || !early_return || !last_time_s)
    return fmi3_status(fmu_wrong(f, name, "a result is NULL"));
  if (!fmu_step(f, time_s, dt_s, name)) return fmi3Error;
  *event = *terminate = *early_return = false;
  *last_time_s = f->now.time_s;
  return fmi3OK;
}

FMI_EXPORT fmi3Status FMI(EnterStepMode)(void *instance)
{
  REFUSE(EnterStepMode, "this FMU has no event mode");
}

FMI_EXPORT fmi3Status FMI(EnterEventMode)(void *instance)
{
  REFUSE(EnterEventMode, "this FMU has no event mode");
}

FMI_EXPORT fmi3Status FMI(EnterConfigurationMode)(void *instance)
{
  REFUSE(EnterConfigurationMode, "this FMU has no structural parameters");
}

FMI_EXPORT fmi3Status FMI(ExitConfigurationMode)(void *instance)
{
  REFUSE(ExitConfigurationMode, "this FMU has no structural parameters");
}

FMI_EXPORT fmi3Status FMI(GetNumberOfVariableDependencies)(void *instance, fmu_reference reference, size_t *count)
{
  (void)reference, (void)count;
  REFUSE(GetNumberOfVariableDependencies, "this FMU has no arrays");
}

FMI_EXPORT fmi3Status FMI(GetVariableDependencies)(void *instance, fmu_reference dependent, size_t elements[],
                                                   fmu_reference independents[], size_t independent_elements[],
                                                   fmi3DependencyKind kinds[], size_t count)
{
  (void)dependent, (void)elements, (void)independents, (void)independent_elements, (void)kinds, (void)count;
  REFUSE(GetVariableDependencies, "this FMU has no arrays");
}

#define NO_DERIVATIVES(function) \
  FMI_EXPORT fmi3Status FMI(function)(void *instance, const fmu_reference unknowns[], size_t unknown_count, \
                                      const fmu_reference knowns[], size_t known_count, const double seed[], \
                                      size_t seed_count, double values[], size_t value_count) \
  { \
    (void)unknowns, (void)unknown_count, (void)knowns, (void)known_count; \
    (void)seed, (void)seed_count, (void)values, (void)value_count; \
    REFUSE(function, "this FMU has no derivatives"); \
  }
NO_DERIVATIVES(GetDirectionalDerivative)
NO_DERIVATIVES(GetAdjointDerivative)

FMI_EXPORT fmi3Status FMI(GetOutputDerivatives)(void *instance, const fmu_reference references[], size_t count,
                                                const int32_t orders[], double values[], size_t value_count)
{
  (void)references, (void)count, (void)orders, (void)values, (void)value_count;
  REFUSE(GetOutputDerivatives, "this FMU has no derivatives of outputs");
}

/* Clocks: none. */
FMI_EXPORT fmi3Status FMI(GetIntervalDecimal)(void *instance, const fmu_reference references[], size_t count,
                                              double intervals[],
                                              fmi3IntervalQualifier qualifiers[])
{
  (void)references, (void)count, (void)intervals, (void)qualifiers;
  REFUSE(GetIntervalDecimal, NO_CLOCKS);
}

FMI_EXPORT fmi3Status FMI(GetIntervalFraction)(void *instance, const fmu_reference references[], size_t count,
                                               uint64_t counters[], uint64_t resolutions[],
                                               fmi3IntervalQualifier qualifiers[])
{
  (void)references, (void)count, (void)counters, (void)resolutions, (void)qualifiers;
  REFUSE(GetIntervalFraction, NO_CLOCKS);
}

#define NO_CLOCK_DECIMAL(function, type) \
  FMI_EXPORT fmi3Status FMI(function)(void *instance, const fmu_reference references[], size_t count, type values[]) \
  { \
    (void)references, (void)count, (void)values; \
    REFUSE(function, NO_CLOCKS); \
  }
NO_CLOCK_DECIMAL(GetShiftDecimal, double)
NO_CLOCK_DECIMAL(SetIntervalDecimal, const double)
NO_CLOCK_DECIMAL(SetShiftDecimal, const double)

#define NO_CLOCK_FRACTION(function, type) \
  FMI_EXPORT fmi3Status FMI(function)(void *instance, const fmu_reference references[], size_t count, \
                                      type counters[], type resolutions[]) \
  { \
    (void)references, (void)count, (void)counters, (void)resolutions; \
    REFUSE(function, NO_CLOCKS); \
  }
NO_CLOCK_FRACTION(GetShiftFraction, uint64_t)
NO_CLOCK_FRACTION(SetIntervalFraction, const uint64_t)
NO_CLOCK_FRACTION(SetShiftFraction, const uint64_t)

FMI_EXPORT fmi3Status FMI(EvaluateDiscreteStates)(void *instance)
{
  REFUSE(EvaluateDiscreteStates, "this FMU has no event mode");
}

FMI_EXPORT fmi3Status FMI(UpdateDiscreteStates)(void *instance, bool *update, bool *terminate, bool *nominals,
                                                bool *values, bool *has_next, double *next_s)
{
  (void)update, (void)terminate, (void)nominals, (void)values, (void)has_next, (void)next_s;
  REFUSE(UpdateDiscreteStates, "this FMU has no event mode");
}

/* Model exchange and scheduled execution: none. */
FMI_EXPORT fmi3Status FMI(EnterContinuousTimeMode)(void *instance)
{
  REFUSE(EnterContinuousTimeMode, NO_EXCHANGE);
}

FMI_EXPORT fmi3Status FMI(CompletedIntegratorStep)(void *instance, bool no_way_back, bool *event, bool *terminate)
{
  (void)no_way_back, (void)event, (void)terminate;
  REFUSE(CompletedIntegratorStep, NO_EXCHANGE);
}

FMI_EXPORT fmi3Status FMI(SetTime)(void *instance, double time_s)
{
  (void)time_s;
  REFUSE(SetTime, NO_EXCHANGE);
}

#define NO_STATES(function, type) \
  FMI_EXPORT fmi3Status FMI(function)(void *instance, type values[], size_t count) \
  { \
    (void)values, (void)count; \
    REFUSE(function, NO_EXCHANGE); \
  }
NO_STATES(SetContinuousStates, const double)
NO_STATES(GetContinuousStates, double)
NO_STATES(GetContinuousStateDerivatives, double)
NO_STATES(GetNominalsOfContinuousStates, double)
NO_STATES(GetEventIndicators, double)

#define NO_NUMBER(function) \
  FMI_EXPORT fmi3Status FMI(function)(void *instance, size_t *count) \
  { \
    (void)count; \
    REFUSE(function, NO_EXCHANGE); \
  }
NO_NUMBER(GetNumberOfEventIndicators)
NO_NUMBER(GetNumberOfContinuousStates)

FMI_EXPORT fmi3Status FMI(ActivateModelPartition)(void *instance, fmu_reference clock, double time_s)
{
  (void)clock, (void)time_s;
  REFUSE(ActivateModelPartition, NO_EXCHANGE);
}
)";

}  // namespace tribotwin::twin
