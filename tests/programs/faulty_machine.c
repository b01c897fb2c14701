/* A machine that fails a program in other ways than by a full disk (faulty_disk.c). Preload it:

     LD_PRELOAD=libfaulty_machine.so FAULTY_MACHINE=read FAULTY_MACHINE_AT=3 FAULTY_MACHINE_FOLDER=/tmp/x \
     FAULTY_MACHINE_PROGRAMS=tribotwin FAULTY_MACHINE_COUNT=/tmp/count FAULTY_MACHINE_LOG=/tmp/log tribotwin run ...

   FAULTY_MACHINE        what fails:
                         read         the N-th read of a file of the folder, with EIO
                         open         the N-th opening of a file of the folder, with EMFILE
                         list         the N-th read of an entry of a folder in the folder, with EIO
                         write        the N-th write to a file of the folder, with EIO
                         sync         the N-th fsync, fdatasync or syncfs, with EIO
                         memory       the N-th allocation after the beginning of main(), with a null pointer
                         interrupted  every second read, write and wait, at random, with EINTR
                         short        every read and write of more than a byte moves half of it
                         clock_back, clock_forth   from the N-th look on the wall clock is 30 days off
   FAULTY_MACHINE_AT     N, from 1; 0 or absent: nothing of the first six fails
   FAULTY_MACHINE_FOLDER files below this folder count
   FAULTY_MACHINE_PROGRAMS  names of the programs concerned
   FAULTY_MACHINE_COUNT  file of 8 bytes that counts what may fail; the processes that a program forks count with it
   FAULTY_MACHINE_LOG    file to which a failure adds a line: the call and the path

   Limitation: what glibc calls within itself is not seen, such as the read() of fread(). */
#define _GNU_SOURCE
#include <dirent.h>
#include <errno.h>
#include <poll.h>
#include <stdatomic.h>
#include <stddef.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <time.h>

#include "preloaded.h"

enum fault { none, reading, opening, listing, writing, syncing, memory, interrupted, short_moves,
             clock_back, clock_forth };
static const char* const fault_names[] = {"",       "read",        "open",  "list",       "write",      "sync",
                                          "memory", "interrupted", "short", "clock_back", "clock_forth"};
static enum fault fault;
static long at;
static atomic_long* count;
static const char* log_name;
static bool started; /* main() has begun */

static void prepare(void) {
  const char *what = getenv("FAULTY_MACHINE"), *where = getenv("FAULTY_MACHINE_FOLDER"),
             *programs = getenv("FAULTY_MACHINE_PROGRAMS"), *number = getenv("FAULTY_MACHINE_AT"),
             *counter = getenv("FAULTY_MACHINE_COUNT");
  if (!what || !where || !programs || !counter || !realpath(where, folder)) return;
  if (!is_concerned(programs)) return;
  const int fd = (int)syscall(SYS_openat, AT_FDCWD, counter, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (fd < 0 || syscall(SYS_ftruncate, fd, sizeof *count) != 0) abort();
  count = mmap(NULL, sizeof *count, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (count == MAP_FAILED) abort();
  syscall(SYS_close, fd);
  folder_length = strlen(folder);
  at = number ? atol(number) : 0;
  log_name = getenv("FAULTY_MACHINE_LOG");
  for (int i = reading; i <= clock_forth; ++i)
    if (strcmp(what, fault_names[i]) == 0) fault = i;
  started = true;
}

/* Before main() nothing fails: the program could not say it. */
static int (*real_main)(int, char**, char**);
static int main_with_faults(int argc, char** argv, char** environment) {
  prepare();
  return real_main(argc, argv, environment);
}
typedef int start_function(int (*)(int, char**, char**), int, char**, void (*)(void), void (*)(void), void (*)(void),
                           void*);
EXPORT int __libc_start_main(int (*main)(int, char**, char**), int argc, char** argv, void (*init)(void),
                             void (*fini)(void), void (*rtld_fini)(void), void* stack_end) {
  real_main = main;
  start_function* const start = (start_function*)real("__libc_start_main");
  return start(main_with_faults, argc, argv, init, fini, rtld_fini, stack_end);
}

static void note(const char* call, const char* path) {
  if (!log_name) return;
  const int fd = (int)syscall(SYS_openat, AT_FDCWD, log_name, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  for (const char* part = call; part; part = part == call ? " " : part == path ? NULL : path)
    syscall(SYS_write, fd, part, strlen(part));
  syscall(SYS_write, fd, "\n", 1);
  syscall(SYS_close, fd);
}

/* Whether this is the call of its kind that fails. */
static bool is_chosen(void) { return atomic_fetch_add(count, 1) + 1 == at; }

static bool fails_at(enum fault kind, const char* call, const char* path, int error) {
  if (fault != kind || !inside(path) || !is_chosen()) return false;
  note(call, path);
  errno = error;
  return true;
}
static bool fails_of(enum fault kind, const char* call, int fd, int error) {
  char path[PATH_MAX];
  const int kept = errno;
  if (!started || fault != kind || !path_of(fd, path)) return false;
  errno = kept;
  return fails_at(kind, call, path, error);
}

/* At random, for a loop of two calls would meet every second one for ever; the same from run to run. */
static bool is_interrupted(void) {
  static _Thread_local unsigned random = 1;
  if (!started || fault != interrupted) return false;
  random = random * 1664525u + 1013904223u;
  if (random < 1u << 31) return false;
  atomic_fetch_add(count, 1);
  errno = EINTR;
  return true;
}
static size_t moved(size_t size) {
  if (!started || fault != short_moves || size < 2) return size;
  atomic_fetch_add(count, 1);
  return size / 2;
}

#define READ(name, declaration, fd, ...)                                  \
  EXPORT ssize_t name declaration {                                       \
    if (is_interrupted() || fails_of(reading, #name, fd, EIO)) return -1; \
    return REAL(name)(fd, __VA_ARGS__);                                   \
  }
READ(read, (int fd, void* data, size_t size), fd, data, moved(size))
READ(pread, (int fd, void* data, size_t size, off_t from), fd, data, moved(size), from)
READ(pread64, (int fd, void* data, size_t size, off64_t from), fd, data, moved(size), from)
READ(readv, (int fd, const struct iovec* parts, int n), fd, parts, n)

EXPORT struct dirent* readdir(DIR* of) {
  return fails_of(listing, "readdir", dirfd(of), EIO) ? NULL : REAL(readdir)(of);
}

#define WRITE(name, declaration, ...)                                     \
  EXPORT ssize_t name declaration {                                       \
    if (is_interrupted() || fails_of(writing, #name, fd, EIO)) return -1; \
    return REAL(name)(__VA_ARGS__);                                       \
  }
WRITE(write, (int fd, const void* data, size_t size), fd, data, moved(size))
WRITE(pwrite, (int fd, const void* data, size_t size, off_t to), fd, data, moved(size), to)
WRITE(pwrite64, (int fd, const void* data, size_t size, off64_t to), fd, data, moved(size), to)
WRITE(writev, (int fd, const struct iovec* parts, int n), fd, parts, n)

EXPORT int poll(struct pollfd* files, nfds_t n, int timeout_ms) {
  return is_interrupted() ? -1 : REAL(poll)(files, n, timeout_ms);
}

#define SYNC(name) \
  EXPORT int name(int fd) { return fails_of(syncing, #name, fd, EIO) ? -1 : REAL(name)(fd); }
SYNC(fsync)
SYNC(fdatasync)
SYNC(syncfs)

static bool open_fails(const char* call, int directory, const char* given, int flags) {
  char path[PATH_MAX];
  (void)flags;
  if (!started || fault != opening) return false;
  const int kept = errno;
  resolve(directory, given, path);
  errno = kept;
  return fails_at(opening, call, path, EMFILE);
}
OPEN_CALLS
EXPORT FILE* fopen(const char* path, const char* mode) {
  return open_fails("fopen", AT_FDCWD, path, 0) ? NULL : REAL(fopen)(path, mode);
}
EXPORT FILE* fopen64(const char* path, const char* mode) {
  return open_fails("fopen", AT_FDCWD, path, 0) ? NULL : REAL(fopen64)(path, mode);
}

/* glibc's own names: to look a function up takes memory itself. */
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t n, size_t size);
void* __libc_realloc(void* old, size_t size);
void* __libc_memalign(size_t alignment, size_t size);

/* HDF5 1.10 itself crashes where it gets no memory while it starts (H5_init_library): there none is refused. */
static _Thread_local bool hdf5_starts;
EXPORT int H5open(void) {
  hdf5_starts = true;
  const int result = REAL(H5open)();
  hdf5_starts = false;
  return result;
}

static bool no_memory(void) {
  if (!started || fault != memory || hdf5_starts || !is_chosen()) return false;
  note("malloc", "");
  errno = ENOMEM;
  return true;
}
EXPORT void* malloc(size_t size) { return no_memory() ? NULL : __libc_malloc(size); }
EXPORT void* calloc(size_t n, size_t size) { return no_memory() ? NULL : __libc_calloc(n, size); }
EXPORT void* realloc(void* old, size_t size) { return size && no_memory() ? NULL : __libc_realloc(old, size); }
EXPORT void* aligned_alloc(size_t alignment, size_t size) {
  return no_memory() ? NULL : __libc_memalign(alignment, size);
}
EXPORT void* memalign(size_t alignment, size_t size) { return no_memory() ? NULL : __libc_memalign(alignment, size); }
EXPORT int posix_memalign(void** result, size_t alignment, size_t size) {
  if (no_memory()) return ENOMEM;
  *result = __libc_memalign(alignment, size);
  return *result ? 0 : ENOMEM;
}

static long days_off(void) {
  enum { month_s = 30 * 24 * 3600 };
  if (!started || (fault != clock_back && fault != clock_forth)) return 0;
  if (atomic_fetch_add(count, 1) + 1 < at) return 0;
  return fault == clock_back ? -month_s : month_s;
}
EXPORT int clock_gettime(clockid_t clock, struct timespec* now) {
  const int result = (int)syscall(SYS_clock_gettime, clock, now);
  if (result == 0 && clock == CLOCK_REALTIME) now->tv_sec += days_off();
  return result;
}
EXPORT time_t time(time_t* to) {
  struct timespec now;
  syscall(SYS_clock_gettime, CLOCK_REALTIME, &now);
  now.tv_sec += days_off();
  return to ? *to = now.tv_sec : now.tv_sec;
}
EXPORT int gettimeofday(struct timeval* restrict now, void* restrict zone) {
  const int result = (int)syscall(SYS_gettimeofday, now, zone);
  if (result == 0) now->tv_sec += days_off();
  return result;
}
