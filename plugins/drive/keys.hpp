#pragma once

#include <array>
#include <span>
#include <string_view>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/key.hpp>

/// The tables of a drive's keys, from which reading, messages and documentation follow. The parameters of laws and
/// thermal models have their own tables.
namespace tribotwin::drive {

std::span<const Key> word_keys();
std::span<const Key> number_keys();
/// Lists of numbers, separated by spaces.
std::span<const Key> list_keys();

/// The keys of a winding. Without the first none of the others may be given.
std::span<const Key> winding_keys();
inline constexpr std::size_t winding_key_count = 12;
/// The numbers that they set, in their order.
std::array<double*, winding_key_count> winding_values(thermal::Winding& winding);

struct DynamicsInfo {
  const char* name;
  Dynamics dynamics;
  std::span<const Key> keys;
};
/// The values of the key `friction`.
std::span<const DynamicsInfo> dynamics_table();
/// The numbers that the keys of a drive's dynamics set, in the order of the keys.
std::array<double*, 3> dynamics_values(Drive& drive);

struct ControlInfo {
  const char* name;
  Control control;
};
/// The values of the key `control`.
std::span<const ControlInfo> controls();

struct ValidityInfo {
  const char* name;
  friction::Validity validity;
};
/// The values of the key `validity`.
std::span<const ValidityInfo> validities();

}  // namespace tribotwin::drive
