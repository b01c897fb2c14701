#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/numerics/executor/transport.hpp>

/// One program on several ranks of an MPI job. All run the same commands on the same input; where rank 0 has something
/// that the others lack (what a folder holds, results), they get it from it, so all go on alike. Only rank 0 prints,
/// writes and locks.
namespace tribotwin::twin {

/// Sleeps of a loop that asks for messages: short while there are some, 2 ms and more where there are none, because an
/// MPI call that waits would keep a core busy.
class Pause {
 public:
  void something() { next_us_ = 20; }
  /// The time to wait now [us]; twice as long the next time, up to the longest.
  long next_us(long longest_us = 2000);

 private:
  long next_us_ = 20;
};

class Ranks {
 public:
  enum class Kind : std::uint8_t { hello, share, ready, tasks, results, leave };
  struct Parcel {
    int from = 0;
    Kind kind{};
    std::string bytes;
  };

  /// A single process.
  Ranks() = default;
  /// One of several; not null.
  explicit Ranks(std::unique_ptr<Transport> transport) : transport_(std::move(transport)) {}

  int rank() const { return transport_ ? transport_->rank() : 0; }
  int size() const { return transport_ ? transport_->size() : 1; }
  bool root() const { return rank() == 0; }
  bool several() const { return size() > 1; }

  /// Collective, first of all: whether every rank has the same `identity` (program, arguments). Otherwise they are
  /// programs of their own, and each is alone from now on. `host`: of this rank, for messages.
  bool join(const std::string& identity, const std::string& host);
  /// Collective, last of all: rank 0 waits for the others and says what those failed with that failed alone.
  void leave(int code, const std::string& message);

  /// Collective: rank 0 makes it, all get it. ErrorKind::work where rank 0 has ended before.
  Result<std::string> from_root(const std::function<Result<std::string>()>& make);
  /// Collective: rank 0 does it, all get its outcome and go on when it is done.
  Result<void> on_root(const std::function<Result<void>()>& work);

  /// Of the executor. Each collective operation has a number; ranks get to it one after the other.
  std::uint64_t begin() { return ++operation_; }
  void post(int to, Kind kind, std::string_view bytes);
  /// The next parcel that is not for all ranks.
  std::optional<Parcel> poll();
  /// Rank 0: to all others, over a binomial tree.
  void share(std::uint64_t operation, const Result<std::string>& outcome);
  /// The others: what rank 0 has shared, once it is there; an error once rank 0 has ended.
  std::optional<Result<std::string>> shared(std::uint64_t operation);
  /// Rank 0: a warning for each rank that has ended with another code than this.
  void report_left(int code);
  /// "rank 3 (HOST)".
  std::string name_of(int rank) const;

 private:
  static constexpr std::uint64_t last = UINT64_MAX;  ///< the operation with which rank 0 ends
  void forward(const std::string& bytes);

  std::unique_ptr<Transport> transport_;
  std::uint64_t operation_ = 0;
  std::map<std::uint64_t, Result<std::string>> shared_;
  std::map<int, std::string> hosts_;
  struct Left {
    int rank, code;
    std::string message;
    bool reported = false;
  };
  std::vector<Left> left_;
  bool deserted_ = false;  ///< it failed because rank 0 did: no news to rank 0
};

/// Those of this process; one until join_ranks (mpi.hpp).
Ranks& ranks();

}  // namespace tribotwin::twin
