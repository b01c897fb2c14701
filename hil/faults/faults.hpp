#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/hil/drives/wiring.hpp>
#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {
class Mapping;
}

/// Injected faults of bus and bench, for tests of controllers: a list on the time line of the simulation. Faults inside
/// a joint (wear, backlash, ...) are those of plugins/drive/fault.hpp; a scenario's events set them.
namespace tribotwin::hil {

enum class FaultKind {
  drop,
  delay,
  corrupt,
  duplicate,
  silence,
  bus_off,
  link_down,
  over_temperature,
  encoder_freeze,
  safe_torque_off
};

/// What a fault acts on.
enum class FaultTarget {
  frames,  ///< frames of one node or of all
  link,    ///< the bus as a whole
  drive    ///< one drive of the robot
};
FaultTarget target_of(FaultKind kind);

struct Fault {
  FaultKind kind;
  double from_s = 0, to_s = 0;          ///< simulated time [s]
  int node = 0;                         ///< 0: all frames, all drives
  std::optional<std::size_t> bus = {};  ///< all without
  double probability = 1;               ///< of each frame: drop, delay, corrupt, duplicate
  double delay_s = 0.01;                ///< wall clock [s]
  double temperature_degC = 150;        ///< over_temperature
};

/// A fault of one drive that begins or ends.
struct DriveFault {
  FaultKind kind;
  std::size_t drive = 0;  ///< 0 is the first of the scenario
  bool on = false;
  double temperature_degC = 0;  ///< over_temperature
  bool operator==(const DriveFault&) const = default;
};

/// Reads a YAML file with the key `faults`, a list of mappings. Fails with file and key. Only of drives on several
/// buses a fault may have a bus, and one of a node must have one.
Result<std::vector<Fault>> load_faults(const std::filesystem::path& file, int first_node, int drives,
                                       const Wiring& wiring = {});

/// As lists of faults call it.
std::string_view name_of(FaultKind kind);
/// Names of all kinds.
std::vector<std::string> fault_kinds();

/// Reads a fault of one of `joints`, or of none, that begins when it is injected: `kind`, `duration_s`, `joint`, and
/// the keys of its kind. Its time begins at 0. Throws InputError.
Fault read_fault(twin::Mapping& keys, const std::vector<std::string>& joints, int first_node, const Wiring& wiring);

}  // namespace tribotwin::hil
