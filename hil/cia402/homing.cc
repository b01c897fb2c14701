#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/hil/cia402/words.hpp>

namespace tribotwin::hil {
namespace {

// number, seek_way, index_way, meaning
constexpr HomingMethod methods[] = {{1, -1, 1, "negative limit switch, then index"},
                                    {2, 1, -1, "positive limit switch, then index"},
                                    {17, -1, 0, "negative limit switch"},
                                    {18, 1, 0, "positive limit switch"},
                                    {33, 0, -1, "next index in negative direction"},
                                    {34, 0, 1, "next index in positive direction"},
                                    {35, 0, 0, "here"},
                                    {37, 0, 0, "here"}};

}  // namespace

std::span<const HomingMethod> homing_methods() { return methods; }

std::vector<const HomingMethod*> methods_of(const DriveParameters& p) {
  std::vector<const HomingMethod*> all;
  for (const auto& method : methods)
    if (method.seek_way == 0 || p.limited) all.push_back(&method);
  return all;
}

std::string homing_method_names() {
  std::vector<std::string> all{"0 none"};
  for (const auto& method : methods) all.push_back(fmt::format("{} {}", method.number, method.meaning));
  return fmt::format("{}", fmt::join(all, ", "));
}

namespace homing {
namespace {

using Phase = HomingRun::Phase;

bool runs(const HomingRun& run) {
  return run.phase == Phase::seek || run.phase == Phase::leave || run.phase == Phase::index;
}

Input limit_switch(int way) { return way < 0 ? Input::negative_limit : Input::positive_limit; }

void begin(HomingRun& run, const DriveObjects& o) {
  const auto method = std::ranges::find(methods, o.homing_method->value, &HomingMethod::number);
  run = {};
  if (method == std::end(methods)) {
    run.phase = Phase::failed;
    return;
  }
  run.method = method;
  run.phase = method->seek_way != 0 ? Phase::seek : method->index_way != 0 ? Phase::index : Phase::leave;
}

void find(HomingRun& run, double home_rad) {
  run.home_rad = home_rad;
  run.found = true;
  run.phase = Phase::stop;
}

/// What the inputs did in the last step.
void look(HomingRun& run, const Inputs& inputs, double here_rad) {
  const int seek = run.method->seek_way;
  if (seek == 0 && run.method->index_way == 0) return find(run, here_rad);
  if (run.phase == Phase::seek && inputs.active(limit_switch(seek))) {
    run.phase = Phase::leave;
  } else if (run.phase == Phase::leave && inputs.edge(limit_switch(seek)).falling) {
    run.phase = Phase::index;
    if (run.method->index_way == 0) find(run, inputs.edge(limit_switch(seek)).position_rad);
  } else if (run.phase == Phase::index && inputs.edge(Input::index).rising) {
    find(run, inputs.edge(Input::index).position_rad);
  }
  const int way = run.phase == Phase::leave ? -seek : run.phase == Phase::index ? run.method->index_way : 0;
  if (way != 0 && inputs.active(limit_switch(way))) run.phase = Phase::failed;
}

double speed(const HomingRun& run, const DriveObjects& o) {
  const double fast = o.velocity_rad_s(o.homing_speed_switch), slow = o.velocity_rad_s(o.homing_speed_zero);
  if (run.phase == Phase::seek) return run.method->seek_way * fast;
  if (run.phase == Phase::leave) return -run.method->seek_way * slow;
  if (run.phase == Phase::index) return run.method->index_way * slow;
  return 0;
}

}  // namespace

void control(Demand& d, const DriveObjects& o, std::int64_t before, std::int64_t now) {
  if (now & ~before & operation_specific) begin(d.homing, o);
  if (!(now & operation_specific) && runs(d.homing)) d.homing.phase = Phase::idle;
}

void resume(Demand& d, const Demand& before, const DriveObjects&) { d.homing = before.homing; }

twin::DriveCommand command(Demand& d, const DriveObjects& o, const Feedback& f, double dt) {
  if (runs(d.homing)) look(d.homing, *d.inputs, f.position_rad + o.zero_rad);
  const double acceleration = o.velocity_rad_s(o.homing_acceleration);
  d.motion = speed_profile({o.speed_max_rad_s(), acceleration, acceleration}, d.motion, speed(d.homing, o)).at(dt);
  d.position_rad = d.motion.position_rad;
  return {.mode = twin::DriveCommand::Mode::position,
          .position_rad = d.motion.position_rad,
          .velocity_rad_s = d.motion.speed_rad_s};
}

void observe(Demand& d, const DriveObjects& o, const Feedback& f, double) {
  d.homing.stands =
      (d.halted || d.motion.speed_rad_s == 0) && std::abs(f.velocity_rad_s) <= o.velocity_rad_s(o.velocity_threshold);
}

int status(const Demand& d) {
  const HomingRun& run = d.homing;
  return (!runs(run) && run.stands ? target_reached : 0) | (run.found ? mode_bit_12 : 0) |
         (run.phase == Phase::failed ? mode_bit_13 : 0);
}

}  // namespace homing
}  // namespace tribotwin::hil
