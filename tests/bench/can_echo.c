// can_echo IFACE IN_ID OUT_ID COUNT: answers COUNT frames IN_ID (hex) with OUT_ID and the same data. What an answer
// costs at least.
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

static int fail(const char* what) {
  perror(what);
  return 1;
}

int main(int argc, char** argv) {
  if (argc != 5) return fputs("usage: can_echo IFACE IN_ID OUT_ID COUNT\n", stderr), 2;
  const int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
  if (bus < 0) return fail("socket");
  const struct can_filter in = {(canid_t)strtoul(argv[2], NULL, 16), CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG};
  if (setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FILTER, &in, sizeof in)) return fail("filter");
  const struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(argv[1])};
  if (address.can_ifindex == 0 || bind(bus, (const struct sockaddr*)&address, sizeof address)) return fail(argv[1]);
  const canid_t out = (canid_t)strtoul(argv[3], NULL, 16);
  for (long count = atol(argv[4]); count > 0; --count) {
    struct can_frame frame;
    if (read(bus, &frame, sizeof frame) != sizeof frame) return fail("read");
    frame.can_id = out;
    if (write(bus, &frame, sizeof frame) != sizeof frame) return fail("write");
  }
  return close(bus);
}
