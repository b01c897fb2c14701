#include <csignal>

#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::twin {
namespace {

std::atomic<bool> flag{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler writes it");

}  // namespace

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = [](int) { flag = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);  // and not SA_RESTART
  struct sigaction before {};
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    if (signal != SIGHUP || (::sigaction(signal, nullptr, &before) == 0 && before.sa_handler != SIG_IGN))  // nohup
      ::sigaction(signal, &action, nullptr);
}

std::atomic<bool>& interrupted() { return flag; }

}  // namespace tribotwin::twin
