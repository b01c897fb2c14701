#include <csignal>

#include <tribotwin/twin/program/program.hpp>

namespace tribotwin::twin::program {
namespace {

std::atomic<bool> flag{false};

void interrupt(int signal) {
  flag = true;
  std::signal(signal, SIG_DFL);
}

}  // namespace

std::atomic<bool>& interrupted() {
  static const bool installed = [] {
    std::signal(SIGINT, interrupt);
    std::signal(SIGTERM, interrupt);
    return true;
  }();
  (void)installed;
  return flag;
}

}  // namespace tribotwin::twin::program
