#pragma once

#include <string_view>
#include <utility>

#include <unistd.h>

namespace tribotwin::twin {

/// Owns a file descriptor (a file, a socket); -1 is none.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  operator int() const { return fd_; }
  int get() const { return fd_; }
  /// Closes it now. False with errno where that failed: the last write may be lost.
  bool close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_ = -1;
};

/// Writes all of `bytes`, waiting where a pipe is slow. Returns 0, or errno of the write that failed. A signal that
/// sets interrupted() ends the wait (EINTR).
int write_all(int descriptor, std::string_view bytes);

}  // namespace tribotwin::twin
