// Preloaded into User-Mode Linux 6.1: its buffer for floating-point state has a fixed size, and processors with a
// larger state (AMX, AVX-512) refuse PTRACE_SETREGSET with less than all of it. So: read all, replace what was given,
// write all.
#define _GNU_SOURCE
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { xstate = 0x202 };  // NT_X86_XSTATE of <elf.h>

static long call(long request, long pid, long address, long data) {
  return syscall(SYS_ptrace, request, pid, address, data);
}

long ptrace(enum __ptrace_request request, ...) {
  va_list list;
  va_start(list, request);
  const long pid = va_arg(list, int), address = va_arg(list, long), data = va_arg(list, long);
  va_end(list);

  if (request >= PTRACE_PEEKTEXT && request <= PTRACE_PEEKUSER) {  // these return the word they read
    long word;
    if (call(request, pid, address, (long)&word) < 0) return -1;
    errno = 0;
    return word;
  }
  const long result = call(request, pid, address, data);
  if (request != PTRACE_SETREGSET || address != xstate || result == 0 || errno != EFAULT) return result;

  static char state[65536] __attribute__((aligned(64)));
  const struct iovec* given = (const struct iovec*)data;
  struct iovec all = {state, sizeof state};
  if (call(PTRACE_GETREGSET, pid, address, (long)&all)) return -1;
  memcpy(state, given->iov_base, given->iov_len < all.iov_len ? given->iov_len : all.iov_len);
  return call(request, pid, address, (long)&all);
}
