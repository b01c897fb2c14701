/* A crash where a curve is fitted, a joint is judged or explained, or a type is learned: preload it. With
   CRASH_AT_LOG=X log(X) writes a line to stderr and aborts, with CRASH_AT_POWER=Y pow(.., Y), with CRASH_AT_CHANGE=Z
   expm1(..) that is Z: a speed, days between two curves, a change of friction that one curve or joint alone has. With
   CRASH_ONCE=FILE only where that file can be created, so that the next attempt succeeds. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>

#define EXPORT __attribute__((visibility("default")))

static void* real(const char* name) {
  void* function = dlsym(RTLD_NEXT, name);
  if (!function) abort();
  return function;
}

static void crash_where(const char* name, double x) {
  const char* at = getenv(name);
  if (!at || strtod(at, NULL) != x) return;
  const char* once = getenv("CRASH_ONCE");
  if (once && open(once, O_CREAT | O_EXCL | O_CLOEXEC, 0600) < 0) return;
  fprintf(stderr, "singular at %g\n", x);
  abort();
}

EXPORT double log(double x) {
  static double (*function)(double);
  if (!function) function = (double (*)(double))real("log");
  crash_where("CRASH_AT_LOG", x);
  return function(x);
}

EXPORT double pow(double x, double y) {
  static double (*function)(double, double);
  if (!function) function = (double (*)(double, double))real("pow");
  crash_where("CRASH_AT_POWER", y);
  return function(x, y);
}

EXPORT double expm1(double x) {
  static double (*function)(double);
  if (!function) function = (double (*)(double))real("expm1");
  const double change = function(x);
  crash_where("CRASH_AT_CHANGE", change);
  return change;
}
