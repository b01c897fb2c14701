#pragma once

#include <deque>
#include <functional>
#include <random>
#include <vector>

#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/can/wait_any.hpp>
#include <tribotwin/hil/faults/faults.hpp>

namespace tribotwin::hil {

/// A bus with injected faults. The same seed and frames give the same faults.
class FaultyBus final : public Transport, public Pollable {
 public:
  /// `time_s`: simulated time.
  FaultyBus(Transport& bus, std::vector<Fault> faults, std::uint64_t seed, std::function<double()> time_s);
  Sent send(const Frame& frame) override;
  bool receive(Frame& frame) override;
  void wait(std::int64_t deadline_ns) override;
  std::int64_t watch(std::vector<pollfd>& polled, std::int64_t deadline_ns) override;
  bool up() const override;
  std::string state() const override;
  const BusCounters& counters() const override { return bus_.counters(); }

  /// So many faults are at work that no other one is taken.
  bool is_full();
  /// A fault of this length begins now.
  void inject(Fault fault);
  /// The faults of drives that begin or end now; ask when simulated time has advanced. One that began and ended since
  /// the last question begins now and ends at the next. Drives are counted on this bus.
  std::vector<DriveFault> changed(int first_node);

 private:
  /// Time of the faults: simulated; while the bus is cut, and no SYNC can advance the simulation, the wall clock's.
  double now_s() const;
  /// Which faults are due, and until when: a list may have thousands, and every frame asks.
  void look() const;
  bool is_due(const Fault& fault) const;
  bool hits(const Fault& fault, const Frame& frame);
  /// Faults of drives that nobody was told of are not over yet.
  void prolong_missed();
  /// Applies the faults to a frame: none, one or two frames now; a delayed one later.
  void pass(const Frame& frame, std::deque<Frame>& out);
  bool cut() const;
  struct Later {
    std::int64_t at_ns;
    Frame frame;
    bool outgoing;
  };
  struct Listed {
    Fault fault;
    bool told = false;  ///< of a drive: that it has begun
  };

  Transport& bus_;
  std::vector<Listed> faults_;  ///< those that are over are taken out
  std::mt19937_64 random_;
  std::function<double()> time_s_;
  mutable double line_s_ = 0, simulated_s_ = 0;
  mutable std::int64_t asked_ns_ = 0;
  mutable bool was_cut_ = false;
  mutable std::vector<std::size_t> due_;  ///< places in faults_
  mutable double holds_until_s_ = 0;      ///< due_ is right before this time of the faults
  mutable bool news_ = true;              ///< due_ is not what was told by `changed`
  std::deque<Frame> ready_;
  std::deque<Later> later_;
};

}  // namespace tribotwin::hil
