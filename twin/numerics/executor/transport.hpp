#pragma once

#include <optional>
#include <string>

namespace tribotwin::twin {

/// Messages between the ranks of a job; MPI in programs, queues in tests. One thread of a rank calls it.
class Transport {
 public:
  struct Message {
    int from = 0;
    std::string bytes;
  };
  virtual ~Transport() = default;
  virtual int rank() const = 0;
  virtual int size() const = 0;
  /// Does not wait for the receiver. Messages from one rank to another arrive in order.
  virtual void send(int to, const std::string& bytes) = 0;
  /// The next message from any rank; none where none has arrived. Does not wait.
  virtual std::optional<Message> receive() = 0;
  /// Collective: waits until all ranks have called it.
  virtual void close() = 0;
};

}  // namespace tribotwin::twin
