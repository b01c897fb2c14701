// can_round_trip IFACE OUT_ID IN_ID COUNT PAUSE_US: sends an empty frame OUT_ID (hex), waits for IN_ID, COUNT times.
// Prints median and 99 % in microseconds, answers per second, and how many did not come within 100 ms.
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static int fail(const char* what) {
  perror(what);
  return 1;
}

static double now_us(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

static int by_size(const void* a, const void* b) {
  const double x = *(const double*)a, y = *(const double*)b;
  return (x > y) - (x < y);
}

int main(int argc, char** argv) {
  if (argc != 6) return fputs("usage: can_round_trip IFACE OUT_ID IN_ID COUNT PAUSE_US\n", stderr), 2;
  const int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
  if (bus < 0) return fail("socket");
  const struct can_filter in = {(canid_t)strtoul(argv[3], NULL, 16), CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG};
  if (setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FILTER, &in, sizeof in)) return fail("filter");
  const struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(argv[1])};
  if (address.can_ifindex == 0 || bind(bus, (const struct sockaddr*)&address, sizeof address)) return fail(argv[1]);
  const struct can_frame out = {.can_id = (canid_t)strtoul(argv[2], NULL, 16)};
  const long count = atol(argv[4]), pause_us = atol(argv[5]);
  double* took = malloc((size_t)count * sizeof *took);
  long answered = 0, missing = 0;
  const double begin = now_us();
  double due = begin;
  for (long i = 0; i < count; ++i) {
    const double sent = now_us();
    if (write(bus, &out, sizeof out) != sizeof out) return fail("write");
    struct pollfd waits = {.fd = bus, .events = POLLIN};
    struct can_frame frame;
    if (poll(&waits, 1, 100) == 1 && read(bus, &frame, sizeof frame) == sizeof frame)
      took[answered++] = now_us() - sent;
    else
      ++missing;
    due += (double)pause_us;
    const double left = due - now_us();
    if (pause_us > 0 && left > 0) usleep((useconds_t)left);
  }
  const double all = now_us() - begin;
  qsort(took, (size_t)answered, sizeof *took, by_size);
  printf("%.1f %.1f %.0f %ld\n", answered ? took[answered / 2] : -1, answered ? took[answered * 99 / 100] : -1,
         1e6 * (double)answered / all, missing);
  free(took);
  return close(bus);
}
