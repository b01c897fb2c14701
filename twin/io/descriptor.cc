#include <cerrno>

#include <poll.h>
#include <unistd.h>

#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::twin {

int write_all(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(written));
    } else if (written == 0) {
      return ENOSPC;
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      pollfd ready{.fd = descriptor, .events = POLLOUT, .revents = 0};
      (void)::poll(&ready, 1, 100);
      if (interrupted()) return EINTR;
    } else if (errno != EINTR || interrupted()) {
      return errno;
    }
  }
  return 0;
}

}  // namespace tribotwin::twin
