#pragma once

#include <span>
#include <string_view>

#include <tribotwin/plugins/drive/drive.hpp>

/// The faults a drive can have: one table, from which scenarios, campaigns, diagnosis and reports take them. A severity
/// is 0 in a healthy drive.
namespace tribotwin::drive {

/// In the order of the table and of the documentation.
enum class Fault { wear, thickening, lubricant_loss, preload_loss, backlash, pitted_bearing, torque_constant };

struct FaultInfo {
  Fault fault;
  std::string_view name;       ///< as in YAML, JSON and tables
  std::string_view unit;       ///< of the severity: "1" relative, "rad" arm side
  double maximum;              ///< largest severity
  std::string_view footprint;  ///< on the parameters of Zhou 2024 (11) and on ripple, lost motion and load
  void (*add)(Faults& faults, double severity);  ///< to the faults already present
};

/// All faults.
std::span<const FaultInfo> faults();
const FaultInfo& info(Fault fault);
/// Null where no fault has this name.
const FaultInfo* find_fault(std::string_view name);

}  // namespace tribotwin::drive
