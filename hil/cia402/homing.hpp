#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/drives/bus_drive.hpp>
#include <tribotwin/hil/motion/inputs.hpp>
#include <tribotwin/hil/motion/motion_profile.hpp>

/// Homing (CiA 402-2, mode 6): bit 4 of the controlword starts method 6098h, which finds the home position; the zero of
/// all positions is then at home + home offset 607Ch, so that home has the position -607Ch. Bits 10, 12 and 13 of the
/// statusword: 000 moves, 001 stands and nothing is found, 010 found and not at rest, 011 done, 10x error.
namespace tribotwin::hil {

struct Demand;

struct HomingMethod {
  std::int8_t number;  ///< value of 6098h
  int seek_way;        ///< direction in which it looks for a limit switch, at 6099h:01; 0: it does not
  int index_way;       ///< direction in which it looks for the index pulse, at 6099h:02; 0: it does not
  const char* meaning;
};
std::span<const HomingMethod> homing_methods();
/// Those that a joint has the switches for.
std::vector<const HomingMethod*> methods_of(const DriveParameters& parameters);
/// "35 here" and the like, for the dictionary.
std::string homing_method_names();

struct HomingRun {
  enum class Phase : std::uint8_t { idle, seek, leave, index, stop, failed };
  Phase phase = Phase::idle;
  const HomingMethod* method = nullptr;
  bool found = false, stands = true;
  std::optional<double> home_rad;  ///< just found; whoever moves the zero there takes it
};

namespace homing {

void control(Demand& demand, const DriveObjects& objects, std::int64_t before, std::int64_t now);
/// Continues after a halt.
void resume(Demand& demand, const Demand& before, const DriveObjects& objects);
twin::DriveCommand command(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
void observe(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
int status(const Demand& demand);

}  // namespace homing
}  // namespace tribotwin::hil
