#include <algorithm>

#include <tribotwin/plugins/drive/fault.hpp>

namespace tribotwin::drive {
namespace {

/// Combines the relative changes `total` and `by` as factors.
void change(double& total, double by) { total += (1 + total) * by; }

// Signs as in Zhou 2024, Table IV, whose rows for the lubricant have lost their names; the magnitudes are our choice.
constexpr FaultInfo table[] = {
    {Fault::wear, "wear", "1", 10, "Fc, Fs, Vs x (1 + s)",
     [](Faults& f, double s) { change(f.boundary, s), change(f.stribeck_velocity, s); }},
    {Fault::thickening, "thickening", "1", 10, "Fv x (1 + s), Vs x (1 + s/3)",
     [](Faults& f, double s) { change(f.viscous, s), change(f.stribeck_velocity, s / 3); }},
    {Fault::lubricant_loss, "lubricant_loss", "1", 0.95, "Fv x (1 - s), Vs x (1 + s)",
     [](Faults& f, double s) { change(f.viscous, -s), change(f.stribeck_velocity, s); }},
    {Fault::preload_loss, "preload_loss", "1", 0.95, "Fc, Fs x (1 - s)",
     [](Faults& f, double s) { change(f.boundary, -s); }},
    {Fault::backlash, "backlash", "rad", 0.1, "lost motion s", [](Faults& f, double s) { f.backlash_rad += s; }},
    {Fault::pitted_bearing, "pitted_bearing", "1", 1, "ripple s Fc once per motor turn",
     [](Faults& f, double s) { f.ripple = std::min(f.ripple + s, 1.0); }},
    {Fault::torque_constant, "torque_constant", "1", 0.9,
     "Fc, Fs, Fv and load x 1 / (1 - s), as computed from the current",
     [](Faults& f, double s) { f.torque_loss = 1 - (1 - f.torque_loss) * (1 - s); }},
};

constexpr bool ordered() {
  for (std::size_t i = 0; i < std::size(table); ++i)
    if (table[i].fault != static_cast<Fault>(i)) return false;
  return true;
}
static_assert(ordered(), "one row per Fault, in the order of the enumeration");

}  // namespace

std::span<const FaultInfo> faults() { return table; }

const FaultInfo& info(Fault fault) { return table[static_cast<std::size_t>(fault)]; }

const FaultInfo* find_fault(std::string_view name) {
  const auto found = std::ranges::find(table, name, &FaultInfo::name);
  return found == std::end(table) ? nullptr : found;
}

}  // namespace tribotwin::drive
