#include <tribotwin/twin/portable/fmu_texts.hpp>

namespace tribotwin::twin {

const char* const fmi_functions = R"(
static fmi@VERSION@Status fmi@VERSION@_status(int code)
{
  return code == fmu_done ? fmi@VERSION@OK : code == fmu_discarded ? fmi@VERSION@Discard : fmi@VERSION@Error;
}

/* Every function with an instance begins so. */
#define BEGIN(modes, function) \
  fmu_instance *const f = (fmu_instance *)instance; \
  static const char name[] = "fmi@VERSION@" #function; \
  if (!f || !fmu_allowed(f, modes, name)) return fmi@VERSION@Error

FMI_EXPORT fmi@VERSION@Status FMI(ExitInitializationMode)(void *instance)
{
  BEGIN(in_initialization, ExitInitializationMode);
  (void)name;
  fmu_evaluate(&f->now);
  f->now.mode = in_steps;
  return fmi@VERSION@OK;
}

FMI_EXPORT fmi@VERSION@Status FMI(Terminate)(void *instance)
{
  BEGIN(in_steps, Terminate);
  (void)name;
  f->now.mode = in_terminated;
  return fmi@VERSION@OK;
}

FMI_EXPORT fmi@VERSION@Status FMI(Reset)(void *instance)
{
  BEGIN(in_any, Reset);
  return fmi@VERSION@_status(fmu_reset(f, name));
}

FMI_EXPORT fmi@VERSION@Status FMI(Get@STATE@)(void *instance, void **state)
{
  BEGIN(in_any, Get@STATE@);
  return fmi@VERSION@_status(fmu_save(f, state, name));
}

FMI_EXPORT fmi@VERSION@Status FMI(Set@STATE@)(void *instance, void *state)
{
  BEGIN(in_any, Set@STATE@);
  return fmi@VERSION@_status(fmu_restore(f, state, name));
}

FMI_EXPORT fmi@VERSION@Status FMI(Free@STATE@)(void *instance, void **state)
{
  BEGIN(in_any, Free@STATE@);
  return fmi@VERSION@_status(fmu_release(f, state, name));
}

FMI_EXPORT fmi@VERSION@Status FMI(Serialized@STATE@Size)(void *instance, void *state, size_t *size)
{
  BEGIN(in_any, Serialized@STATE@Size);
  return fmi@VERSION@_status(fmu_serialized_size(f, state, size, name));
}

FMI_EXPORT fmi@VERSION@Status FMI(Serialize@STATE@)(void *instance, void *state, @BYTE@ bytes[], size_t size)
{
  BEGIN(in_any, Serialize@STATE@);
  return fmi@VERSION@_status(fmu_serialize(f, state, bytes, size, name));
}

FMI_EXPORT fmi@VERSION@Status FMI(@DESERIALIZE@)(void *instance, const @BYTE@ bytes[], size_t size, void **state)
{
  BEGIN(in_any, @DESERIALIZE@);
  return fmi@VERSION@_status(fmu_deserialize(f, bytes, size, state, name));
}
)";

}  // namespace tribotwin::twin
