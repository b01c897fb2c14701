#include <algorithm>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/wait_any.hpp>

namespace tribotwin::hil {

void wait_any(std::span<Transport* const> buses, std::int64_t deadline_ns) {
  constexpr std::int64_t second_ns = 1'000'000'000, ask_again_ns = 1'000'000;
  std::vector<pollfd> polled;
  std::int64_t wake_ns = deadline_ns;
  for (Transport* bus : buses) {
    auto* pollable = dynamic_cast<Pollable*>(bus);
    wake_ns = std::min(wake_ns, pollable ? pollable->watch(polled, deadline_ns) : clock_ns() + ask_again_ns);
  }
  const std::int64_t left_ns = std::max<std::int64_t>(wake_ns - clock_ns(), 0);
  const timespec timeout{.tv_sec = left_ns / second_ns, .tv_nsec = left_ns % second_ns};
  ::ppoll(polled.data(), polled.size(), &timeout, nullptr);
  for (Transport* bus : buses) bus->wait(0);  // follows links, accepts connections
}

}  // namespace tribotwin::hil
