#include <algorithm>
#include <utility>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/setup/parameter_keeper.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::int64_t save = 0x65766173, load = 0x64616F6C;  // in ASCII, first letter in the lowest byte

bool is_parameter(const Object& o) {
  if (o.access != Access::read_write || o.index == od::predefined_error_field || ParameterKeeper::owns(o.index))
    return false;
  constexpr od::Index commands[] = {od::measured_temperature, od::controlword,     od::target_torque,
                                    od::target_position,      od::velocity_offset, od::torque_offset,
                                    od::touch_probe_function, od::digital_outputs, od::interpolation_data_record,
                                    od::target_velocity};
  const bool is_command = o.mappable && std::ranges::find(commands, o.index) != std::end(commands);
  return !is_command;
}

/// The areas of the sub-indices 1 to 4.
bool in_area(std::uint8_t area, od::Index index) {
  switch (area) {
    case 2:
      return od::is_communication(index);
    case 3:
      return index >= od::profile_area;
    case 4:
      return od::is_manufacturer(index);
    default:
      return true;
  }
}

}  // namespace

ParameterKeeper::ParameterKeeper(NodeContext& node, KeptParameters kept, Keep keep)
    : node_(node), kept_(std::move(kept)), keep_(std::move(keep)) {
  show();
}

bool ParameterKeeper::owns(std::uint16_t index) {
  return index == od::store_parameters || index == od::restore_default_parameters;
}

tl::expected<void, Abort> ParameterKeeper::may_obey(const Object& o, std::int64_t signature) const {
  if (keep_ && signature == (o.index == od::store_parameters ? save : load)) return {};
  return tl::unexpected(Abort::not_stored);
}

tl::expected<void, Abort> ParameterKeeper::obey(const Object& o, const Dictionary& defaults) {
  const bool stores = o.index == od::store_parameters;
  KeptParameters next = kept_;
  std::erase_if(next.values, [&](const ObjectValue& v) { return in_area(o.sub, v.index); });
  for (const Object& now : node_.dictionary.objects()) {
    if (!stores || !is_parameter(now) || !in_area(o.sub, now.index)) continue;
    const Object* before = defaults.find(now.index, now.sub);
    if (now.value != before->value || now.text != before->text) next.values.push_back(value_of(now));
  }
  if (!change(std::move(next))) return tl::unexpected(Abort::hardware);
  return {};
}

void ParameterKeeper::show() {
  for (const od::Index index : {od::store_parameters, od::restore_default_parameters})
    for (std::uint8_t area = 1; area <= 4; ++area) node_.dictionary.set(index, area, keep_ ? 1 : 0);
}

bool ParameterKeeper::keep_number(std::uint8_t number) {
  KeptParameters next = kept_;
  next.node_number = number;
  return change(std::move(next));
}

bool ParameterKeeper::change(KeptParameters next) {
  if (!keep_ || !keep_(next)) return false;
  kept_ = std::move(next);
  return true;
}

}  // namespace tribotwin::hil
