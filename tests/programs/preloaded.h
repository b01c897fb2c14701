/* What libraries have in common that are preloaded to fail a program: the functions that they stand before, the folder
   and the programs concerned, the calls that open files. Included once, after _GNU_SOURCE. */
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))
#define REAL(name) ((__typeof__(&name))real(#name))

static void* real(const char* name) {
  void* function = dlsym(RTLD_NEXT, name);
  if (!function) abort();
  return function;
}

static char folder[PATH_MAX];
static size_t folder_length; /* 0: nothing is concerned */

static bool named(const char* list, const char* name) {
  const size_t length = strlen(name);
  for (const char* p = list; (p = strstr(p, name)); p += length)
    if ((p == list || p[-1] == ',') && (p[length] == 0 || p[length] == ',')) return true;
  return false;
}

/* Whether this program is among the comma-separated names; all are where there is no list. */
static bool is_concerned(const char* programs) {
  char self[PATH_MAX] = "";
  if (readlink("/proc/self/exe", self, sizeof self - 1) < 0) return false;
  return !programs || named(programs, strrchr(self, '/') + 1);
}

static bool inside(const char* path) {
  return folder_length && strncmp(path, folder, folder_length) == 0 &&
         (path[folder_length] == '/' || path[folder_length] == 0);
}

static bool path_of(int fd, char* path) {
  char link[40];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t n = readlink(link, path, PATH_MAX - 1);
  if (n > 0) path[n] = 0;
  return n > 0;
}

/* The absolute path of something that need not exist. */
static void resolve(int directory, const char* given, char* path) {
  char whole[2 * PATH_MAX], parent[PATH_MAX];
  if (given[0] == '/')
    snprintf(whole, sizeof whole, "%s", given);
  else {
    if (directory == AT_FDCWD ? !getcwd(parent, sizeof parent) : !path_of(directory, parent)) parent[0] = 0;
    snprintf(whole, sizeof whole, "%s/%s", parent, given);
  }
  for (size_t n = strlen(whole); n > 1 && whole[n - 1] == '/'; --n) whole[n - 1] = 0;
  char* name = strrchr(whole, '/');
  *name++ = 0;
  if (!realpath(whole[0] ? whole : "/", parent)) snprintf(parent, sizeof parent, "%.*s", PATH_MAX - 1, whole);
  snprintf(path, PATH_MAX, "%.*s/%.*s", PATH_MAX / 2, strcmp(parent, "/") ? parent : "", PATH_MAX / 2 - 2, name);
}

/* The calls that open a file: each fails where open_fails(call, directory, path, flags), errno set, says so. */
#define OPEN(name, declaration, directory, path, ...)                \
  EXPORT int name declaration {                                      \
    mode_t mode = 0;                                                 \
    if ((flags & O_CREAT) || (flags & O_TMPFILE) == O_TMPFILE) {     \
      va_list more;                                                  \
      va_start(more, flags);                                         \
      mode = va_arg(more, mode_t);                                   \
      va_end(more);                                                  \
    }                                                                \
    if (open_fails(#name, directory, path, flags)) return -1;        \
    return REAL(name)(__VA_ARGS__, flags, mode);                     \
  }
#define OPEN_CALLS                                                                                                  \
  OPEN(open, (const char* path, int flags, ...), AT_FDCWD, path, path)                                              \
  OPEN(open64, (const char* path, int flags, ...), AT_FDCWD, path, path)                                            \
  OPEN(openat, (int folder_fd, const char* path, int flags, ...), folder_fd, path, folder_fd, path)                 \
  OPEN(openat64, (int folder_fd, const char* path, int flags, ...), folder_fd, path, folder_fd, path)
