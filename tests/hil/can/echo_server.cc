// Serves a bus, says on its first line where, answers every frame with the next identifier, ends after COUNT frames.
// Usage: echo_server ADDRESS COUNT. Exit code 1 if they do not come within a minute, 2 if the bus cannot be opened.
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include <tribotwin/hil/can/transport.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin::hil;
  if (argc != 3) return 2;
  const auto bus = open_bus(argv[1]);
  if (!bus) {
    std::fprintf(stderr, "%s\n", bus.error().message.c_str());
    return 2;
  }
  std::puts((*bus)->state().c_str());
  std::fflush(stdout);
  const auto deadline = std::chrono::steady_clock::now().time_since_epoch() + std::chrono::minutes(1);
  const long count = std::strtol(argv[2], nullptr, 10);
  for (long answered = 0; answered < count;) {
    if (std::chrono::steady_clock::now().time_since_epoch() >= deadline) return 1;
    (*bus)->wait(std::chrono::nanoseconds(deadline).count());
    for (Frame frame; (*bus)->receive(frame);) {
      frame.id = (frame.id + 1) & (frame.extended ? 0x1FFFFFFF : 0x7FF);
      if ((*bus)->send(frame) == Sent::done) ++answered;
    }
  }
  return 0;
}
