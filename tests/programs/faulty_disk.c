/* A disk that fills up or becomes read-only, or a machine that dies, at the N-th change of anything below one folder.
   Preload it:

     LD_PRELOAD=libfaulty_disk.so FAULTY_DISK_FOLDER=/tmp/x FAULTY_DISK_PROGRAMS=tribotwin,tribotwin-hil \
     FAULTY_DISK_AT=3 FAULTY_DISK_HOW=full FAULTY_DISK_LOG=/tmp/calls tribotwin run ...

   FAULTY_DISK_FOLDER    changes below this folder count; descriptors and paths elsewhere pass through
   FAULTY_DISK_PROGRAMS  names of the programs concerned; children of other names (gnuplot, ffmpeg) pass through
   FAULTY_DISK_AT        which change fails, from 1; 0 or absent: none
   FAULTY_DISK_HOW       full   it and all that follow fail with ENOSPC
                         once   it alone fails
                         read-only  it and all that follow fail with EROFS, also where there is space
                         short  a write writes half, returns that, and all that follows fails; other calls as `full`
                         kill   SIGKILL of the program and of this process of it in its place
                         torn   a write writes half, then SIGKILL; other calls as `kill`
                         SIGINT, SIGTERM, SIGHUP  that signal for the program just before it; nothing fails
   FAULTY_DISK_LOG       file to which each change adds a line: its number, the call, the path

   A change is: open for writing with O_CREAT, O_TRUNC or O_TMPFILE, fopen for writing, mkstemp and its kin, mkdir;
   write, pwrite, writev, pwritev, copy_file_range, sendfile, fwrite, fflush; truncate, ftruncate, fallocate,
   posix_fallocate; fsync, fdatasync; rename, link, symlink; and close of a descriptor that was written and not
   synchronised since, where network file systems report what they could not keep. The processes that a program forks
   count with it: there is one disk, and a machine dies with all of them. Removing and shortening are none:
   they work on a full disk. Nor does a full disk refuse a write into space that the file has already, by an earlier
   write or by fallocate (POSIX says so of the latter). A write that is torn by a kill ends between two pages: Linux
   looks for signals there.

   Limitation: glibc calls its own write() from within stdio. fopen, fwrite, fflush and fclose are therefore caught
   themselves; fprintf, fputs and what a buffer writes by itself are not. Mounting a small tmpfs catches those
   (disaster_test.py does). */
#define _GNU_SOURCE
#include <errno.h>
#include <signal.h>
#include <stdatomic.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>

#include "preloaded.h"

enum { descriptors = 4096 };
static enum { full, once, half, killed, torn, read_only, interrupted, terminated, hung_up } how;
static long at;
static atomic_long* count; /* of all processes of the program */
static pid_t program;
static int log_file = -1;
static atomic_bool unsynchronised[descriptors];

__attribute__((constructor)) static void start(void) {
  const char* where = getenv("FAULTY_DISK_FOLDER");
  if (!where || !realpath(where, folder) || !is_concerned(getenv("FAULTY_DISK_PROGRAMS"))) return;
  count = mmap(NULL, sizeof *count, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (count == MAP_FAILED) abort();
  program = getpid();
  folder_length = strlen(folder);
  const char* number = getenv("FAULTY_DISK_AT");
  at = number ? atol(number) : 0;
  const char* given = getenv("FAULTY_DISK_HOW");
  static const char* const names[] = {"full",      "once",   "short",   "kill",  "torn",
                                      "read-only", "SIGINT", "SIGTERM", "SIGHUP"};
  for (int i = 0; given && i < (int)(sizeof names / sizeof *names); ++i)
    if (strcmp(given, names[i]) == 0) how = i;
  const char* file = getenv("FAULTY_DISK_LOG");
  if (!file) return;
  const int opened = (int)syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  log_file = fcntl(opened, F_DUPFD_CLOEXEC, 1000); /* out of the way of descriptors that a test closes */
  syscall(SYS_close, opened);
}

static int reason(void) { return how == read_only ? EROFS : ENOSPC; }

static _Noreturn void die(void) {
  kill(program, SIGKILL);
  kill(getpid(), SIGKILL);
  for (;;) pause();
}

enum verdict { go_on, fail, write_half };

/* Counts a change, notes it, and says what becomes of it. */
static enum verdict change(const char* call, const char* path, bool is_write) {
  const long n = atomic_fetch_add(count, 1) + 1;
  if (log_file >= 0) {
    char line[PATH_MAX + 64];
    const int length = snprintf(line, sizeof line, "%ld %s %s\n", n, call, path);
    syscall(SYS_write, log_file, line, (size_t)length);
  }
  if (at == 0 || n < at) return go_on;
  if (n == at && is_write && (how == half || how == torn)) return write_half;
  if (n == at && (how == killed || how == torn)) die();
  if (how >= interrupted) {
    static const int signals[] = {SIGINT, SIGTERM, SIGHUP};
    if (n == at) getpid() == program ? raise(signals[how - interrupted]) : kill(program, signals[how - interrupted]);
    return go_on;
  }
  if (n > at && how == once) return go_on;
  errno = reason();
  return fail;
}

static enum verdict change_of_path(const char* call, int directory, const char* given) {
  char path[PATH_MAX];
  const int kept = errno;
  if (!folder_length) return go_on;
  resolve(directory, given, path);
  errno = kept;
  return inside(path) ? change(call, path, false) : go_on;
}

static enum verdict change_of_file(const char* call, int fd, bool is_write) {
  char path[PATH_MAX];
  const int kept = errno;
  struct stat s;
  if (!folder_length || !path_of(fd, path) || !inside(path)) {
    errno = kept;
    return go_on;
  }
  if (is_write && (fstat(fd, &s) != 0 || !S_ISREG(s.st_mode))) {
    errno = kept;
    return go_on;
  }
  errno = kept;
  if (is_write && fd < descriptors) atomic_store(&unsynchronised[fd], true);
  return change(call, path, is_write);
}

/* Whether the bytes have their place on the disk. */
static bool has_space(int fd, off_t to, size_t size) {
  struct stat s;
  return how <= half && fstat(fd, &s) == 0 && (off_t)s.st_blocks * 512 >= to + (off_t)size;
}

/* How many of `size` bytes are written before a failure. */
static size_t first_part(off_t to, size_t size) {
  enum { page = 4096 };
  if (how != torn) return size / 2;
  const off_t end = (to + (off_t)size / 2) / page * page;
  return end > to ? (size_t)(end - to) : 0;
}

/* Where write() writes. */
static off_t place(int fd) {
  struct stat s;
  return fcntl(fd, F_GETFL) & O_APPEND && fstat(fd, &s) == 0 ? s.st_size : lseek(fd, 0, SEEK_CUR);
}

/* What a write of `size` bytes may write: all, or a part of it and then the machine dies where that was asked for. */
#define WRITE(call, fd, to, size, whole, part)       \
  const size_t some = first_part(to, size);          \
  if (has_space(fd, to, size)) return whole;         \
  switch (change_of_file(call, fd, true)) {          \
    case fail:                                       \
      return -1;                                     \
    case write_half: {                               \
      const ssize_t written = some > 0 ? (part) : 0; \
      if (how == torn) die();                        \
      if (written > 0) return written;               \
      errno = ENOSPC;                                \
      return -1;                                     \
    }                                                \
    default:                                         \
      return whole;                                  \
  }

EXPORT ssize_t write(int fd, const void* data, size_t size){
    WRITE("write", fd, place(fd), size, REAL(write)(fd, data, size),
          REAL(write)(fd, data, some))} EXPORT ssize_t pwrite(int fd, const void* data, size_t size, off_t to){
    WRITE("pwrite", fd, to, size, REAL(pwrite)(fd, data, size, to), REAL(pwrite)(fd, data, some, to))} EXPORT ssize_t
    pwrite64(int fd, const void* data, size_t size, off64_t to){
        WRITE("pwrite", fd, to, size, REAL(pwrite64)(fd, data, size, to), REAL(pwrite64)(fd, data, some, to))}
/* Of several parts, a part of the first. */
EXPORT ssize_t writev(int fd, const struct iovec* parts,
                      int n){WRITE("writev", fd, place(fd), parts[0].iov_len, REAL(writev)(fd, parts, n),
                                   REAL(write)(fd, parts[0].iov_base, some))} EXPORT ssize_t
    pwritev(int fd, const struct iovec* parts, int n,
            off_t to){WRITE("pwritev", fd, to, parts[0].iov_len, REAL(pwritev)(fd, parts, n, to),
                            REAL(pwrite)(fd, parts[0].iov_base, some, to))} EXPORT ssize_t
    copy_file_range(int from, off64_t* from_at, int to, off64_t* to_at, size_t size,
                    unsigned flags){WRITE("copy_file_range", to, to_at ? *to_at : place(to), size,
                                          REAL(copy_file_range)(from, from_at, to, to_at, size, flags),
                                          REAL(copy_file_range)(from, from_at, to, to_at, some, flags))} ssize_t
    sendfile(int to, int from, off_t* from_at, size_t size);
ssize_t sendfile64(int to, int from, off64_t* from_at, size_t size);
EXPORT ssize_t sendfile(int to, int from, off_t* from_at,
                        size_t size){WRITE("sendfile", to, place(to), size, REAL(sendfile)(to, from, from_at, size),
                                           REAL(sendfile)(to, from, from_at, some))} EXPORT ssize_t
    sendfile64(int to, int from, off64_t* from_at, size_t size) {
  WRITE("sendfile", to, place(to), size, REAL(sendfile64)(to, from, from_at, size),
        REAL(sendfile64)(to, from, from_at, some))
}

#define FILE_CHANGE(name, declaration, fd, arguments, failure) \
  EXPORT int name declaration { return change_of_file(#name, fd, false) == fail ? (failure) : REAL(name) arguments; }

static bool shortens(int fd, off_t size) {
  struct stat s;
  return how <= half && fstat(fd, &s) == 0 && size <= s.st_size;
}
EXPORT int ftruncate(int fd, off_t size) {
  return !shortens(fd, size) && change_of_file("ftruncate", fd, false) == fail ? -1 : REAL(ftruncate)(fd, size);
}
EXPORT int ftruncate64(int fd, off64_t size) {
  return !shortens(fd, size) && change_of_file("ftruncate", fd, false) == fail ? -1 : REAL(ftruncate64)(fd, size);
}
FILE_CHANGE(fallocate, (int fd, int mode, off_t from, off_t size), fd, (fd, mode, from, size), -1)
FILE_CHANGE(fallocate64, (int fd, int mode, off64_t from, off64_t size), fd, (fd, mode, from, size), -1)
FILE_CHANGE(posix_fallocate, (int fd, off_t from, off_t size), fd, (fd, from, size), reason())
FILE_CHANGE(posix_fallocate64, (int fd, off64_t from, off64_t size), fd, (fd, from, size), reason())

static void is_synchronised(int fd) {
  if (fd >= 0 && fd < descriptors) atomic_store(&unsynchronised[fd], false);
}
EXPORT int fsync(int fd) {
  if (change_of_file("fsync", fd, false) == fail) return -1;
  is_synchronised(fd);
  return REAL(fsync)(fd);
}
EXPORT int fdatasync(int fd) {
  if (change_of_file("fdatasync", fd, false) == fail) return -1;
  is_synchronised(fd);
  return REAL(fdatasync)(fd);
}
EXPORT int close(int fd) {
  const bool late = fd >= 0 && fd < descriptors && atomic_exchange(&unsynchronised[fd], false);
  const bool failed = late && change_of_file("close", fd, false) == fail;
  const int result = REAL(close)(fd);
  if (!failed) return result;
  errno = reason();
  return -1;
}

#define PATH_CHANGE(name, declaration, directory, path, arguments) \
  EXPORT int name declaration { return change_of_path(#name, directory, path) == fail ? -1 : REAL(name) arguments; }
PATH_CHANGE(rename, (const char* from, const char* to), AT_FDCWD, to, (from, to))
PATH_CHANGE(renameat, (int a, const char* from, int b, const char* to), b, to, (a, from, b, to))
PATH_CHANGE(renameat2, (int a, const char* from, int b, const char* to, unsigned flags), b, to, (a, from, b, to, flags))
PATH_CHANGE(link, (const char* from, const char* to), AT_FDCWD, to, (from, to))
PATH_CHANGE(linkat, (int a, const char* from, int b, const char* to, int flags), b, to, (a, from, b, to, flags))
PATH_CHANGE(symlink, (const char* from, const char* to), AT_FDCWD, to, (from, to))
PATH_CHANGE(mkdir, (const char* path, mode_t mode), AT_FDCWD, path, (path, mode))
PATH_CHANGE(mkdirat, (int at_folder, const char* path, mode_t mode), at_folder, path, (at_folder, path, mode))
PATH_CHANGE(truncate, (const char* path, off_t size), AT_FDCWD, path, (path, size))
PATH_CHANGE(truncate64, (const char* path, off64_t size), AT_FDCWD, path, (path, size))
PATH_CHANGE(mkstemp, (char* name), AT_FDCWD, name, (name))
PATH_CHANGE(mkstemp64, (char* name), AT_FDCWD, name, (name))
PATH_CHANGE(mkostemp, (char* name, int flags), AT_FDCWD, name, (name, flags))
PATH_CHANGE(mkostemp64, (char* name, int flags), AT_FDCWD, name, (name, flags))
PATH_CHANGE(mkstemps, (char* name, int suffix), AT_FDCWD, name, (name, suffix))
PATH_CHANGE(mkstemps64, (char* name, int suffix), AT_FDCWD, name, (name, suffix))
PATH_CHANGE(mkostemps, (char* name, int suffix, int flags), AT_FDCWD, name, (name, suffix, flags))
PATH_CHANGE(mkostemps64, (char* name, int suffix, int flags), AT_FDCWD, name, (name, suffix, flags))
EXPORT char* mkdtemp(char* name) {
  return change_of_path("mkdtemp", AT_FDCWD, name) == fail ? NULL : REAL(mkdtemp)(name);
}

static bool makes_a_file(int flags) {
  return (flags & O_ACCMODE) != O_RDONLY && ((flags & (O_CREAT | O_TRUNC)) || (flags & O_TMPFILE) == O_TMPFILE);
}

static bool open_fails(const char* call, int directory, const char* path, int flags) {
  return makes_a_file(flags) && change_of_path(call, directory, path) == fail;
}
OPEN_CALLS
EXPORT int creat(const char* path, mode_t mode) { return open(path, O_WRONLY | O_CREAT | O_TRUNC, mode); }
EXPORT int creat64(const char* path, mode_t mode) { return open64(path, O_WRONLY | O_CREAT | O_TRUNC, mode); }

/* stdio: see the limitation above. */
EXPORT FILE* fopen(const char* path, const char* mode) {
  return mode[0] != 'r' && change_of_path("fopen", AT_FDCWD, path) == fail ? NULL : REAL(fopen)(path, mode);
}
EXPORT FILE* fopen64(const char* path, const char* mode) {
  return mode[0] != 'r' && change_of_path("fopen", AT_FDCWD, path) == fail ? NULL : REAL(fopen64)(path, mode);
}
EXPORT size_t fwrite(const void* data, size_t size, size_t n, FILE* file) {
  switch (change_of_file("fwrite", fileno(file), true)) {
    case fail:
      return 0;
    case write_half: {
      const size_t written = REAL(fwrite)(data, size, n / 2, file);
      REAL(fflush)(file);
      if (how == torn) die();
      errno = ENOSPC;
      return written;
    }
    default:
      return REAL(fwrite)(data, size, n, file);
  }
}
EXPORT int fflush(FILE* file) {
  return file && change_of_file("fflush", fileno(file), false) == fail ? EOF : REAL(fflush)(file);
}
EXPORT int fclose(FILE* file) {
  const int fd = fileno(file);
  const bool late = fd >= 0 && fd < descriptors && atomic_exchange(&unsynchronised[fd], false);
  const bool failed = late && change_of_file("fclose", fd, false) == fail;
  const int result = REAL(fclose)(file);
  if (!failed) return result;
  errno = reason();
  return EOF;
}
