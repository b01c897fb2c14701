#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <tribotwin/render/pose/pose.hpp>

/// States of a robot at any time of a record.
namespace tribotwin::render {

/// Between the samples of a record. A multi-rate run has those of some work cycles only. Where a time falls between two
/// computed cycles its state is that of the same moment of both, interpolated as the run itself does with their heat;
/// temperatures are those of the cycle, which the record has for all. So every time has its own pose: no picture shows
/// another moment than it says.
class Moments {
 public:
  /// Both must outlive it.
  Moments(const mujoco::Model& model, const twin::Recording& record);

  double begin_s() const { return record_.time_s.front(); }
  /// Of the last sample.
  double end_s() const { return record_.time_s.back(); }
  /// Of a work cycle [s]; 0 where the motion does not repeat.
  double period_s() const { return period_s_; }

  /// The state at a time from begin_s to end_s. Its time_s is `time_s` where the record has samples around it or work
  /// cycles, else that of the nearest sample.
  PoseState at(double time_s) const;
  /// `count` states, evenly in time from begin to end; the end alone for one.
  std::vector<PoseState> evenly(std::size_t count) const;
  /// The times of a film of `frames`: all from begin to end or, where the motion is too fast for that, whole work
  /// cycles at moments evenly in time, each over `cycle_frames`.
  std::vector<double> film_times(std::size_t frames, std::size_t cycle_frames) const;
  /// `count` times from begin to end. Where the motion repeats and is too fast for that, each is in a later work cycle
  /// than the one before and 1/`per_cycle` of a cycle farther in it, as a stroboscope shows it; else evenly.
  std::vector<double> strobe_times(std::size_t count, std::size_t per_cycle) const;

 private:
  struct Sampled {
    std::size_t before, after;
    double weight;  ///< of `after`
  };
  /// The samples around a time; false where there is a gap.
  bool around(double time_s, Sampled& found) const;
  PoseState sampled(const Sampled& samples, double time_s) const;
  PoseState between(const PoseState& a, const PoseState& b, double weight, double time_s) const;
  double cycle_temperature(const std::string& joint, double time_s) const;

  const mujoco::Model& model_;
  const twin::Recording& record_;
  PoseState rest_;
  double step_s_ = 0, period_s_ = 0;
};

}  // namespace tribotwin::render
