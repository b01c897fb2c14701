#pragma once

#include <span>
#include <string_view>

#include <tribotwin/plugins/drive/drive.hpp>

/// Faults by name. A severity is 0 in a healthy drive; what it means and what it leaves on a friction curve is said
/// beside it.
namespace tribotwin::drive {

struct FaultInfo {
  std::string_view name;       ///< as in YAML, JSON and tables
  std::string_view unit;       ///< of the severity: "1" relative, "rad" arm side
  double maximum;              ///< largest severity
  std::string_view footprint;  ///< on the parameters of Zhou 2024 (11) and on ripple, lost motion and load
  void (*add)(Faults& faults, double severity);  ///< to others that are there
};

/// All faults, in the order of the documentation.
std::span<const FaultInfo> faults();
const FaultInfo* find_fault(std::string_view name);

}  // namespace tribotwin::drive
