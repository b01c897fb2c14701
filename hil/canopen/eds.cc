#include <algorithm>
#include <bit>
#include <iterator>
#include <map>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/communication_objects.hpp>
#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

/// Arrays of CiA 301 and 402; what else has sub-indices is a record.
bool is_array(std::uint16_t index) {
  constexpr std::uint16_t arrays[] = {od::predefined_error_field,
                                      od::store_parameters,
                                      od::restore_default_parameters,
                                      od::consumer_heartbeat_time,
                                      od::error_behavior,
                                      od::software_position_limit,
                                      od::position_encoder_resolution,
                                      od::gear_ratio,
                                      od::profile_jerk,
                                      od::homing_speeds,
                                      od::supported_homing_methods,
                                      od::interpolation_data_record,
                                      od::digital_outputs};
  return std::ranges::find(arrays, index) != std::end(arrays);
}

/// Of an array or a record, as CiA 301 and 402 call it; of our own ones, as their first entry is called.
std::string name_of_all(std::uint16_t index, const std::vector<const Object*>& objects) {
  static const std::map<std::uint16_t, std::string> standard{
      {od::predefined_error_field, "pre-defined error field"},
      {od::store_parameters, "store parameters"},
      {od::restore_default_parameters, "restore default parameters"},
      {od::consumer_heartbeat_time, "consumer heartbeat time"},
      {od::identity, "identity object"},
      {od::error_behavior, "error behavior"},
      {od::sdo_server_parameter, "SDO server parameter"},
      {od::software_position_limit, "software position limit"},
      {od::position_encoder_resolution, "position encoder resolution"},
      {od::gear_ratio, "gear ratio"},
      {od::profile_jerk, "profile jerk"},
      {od::homing_speeds, "homing speeds"},
      {od::supported_homing_methods, "supported homing methods"},
      {od::simulated_switches, "simulated switches"},
      {od::interpolation_data_record, "interpolation data record"},
      {od::digital_outputs, "digital outputs"},
      {od::velocity_control, "velocity control parameter set"},
      {od::position_control, "position control parameter set"},
      {od::interpolation_time_period, "interpolation time period"}};
  if (const auto known = standard.find(index); known != standard.end()) return known->second;
  if (index >= od::rpdo_communication && index < od::after_pdos)
    return fmt::format("{}PDO{} {} parameter", index < od::tpdo_communication ? 'R' : 'T', (index & 0x1ff) + 1,
                       (index & 0x200) ? "mapping" : "communication");
  return objects[objects.size() > 1 ? 1 : 0]->name;
}

using Indices = std::map<std::uint16_t, std::vector<const Object*>>;

std::string header(const DriveParameters& p) {
  return fmt::format(
      "[FileInfo]\nFileName=tribotwin_node{0}.eds\nFileVersion=1\nFileRevision=1\nEDSVersion=4.0\nDescription="
      "tribotwin drive {1}\n"
      // Constant times: the same drive gives the same file.
      "CreationTime=12:00AM\nCreationDate=01-01-2026\nCreatedBy=tribotwin-hil\nModificationTime=12:"
      "00AM\nModificationDate=01-01-2026\nModifiedBy=tribotwin-hil\n\n"
      "[DeviceInfo]\nVendorName=tribotwin\nVendorNumber=0x0\nProductName=tribotwin "
      "drive\nProductNumber=0x7477\nRevisionNumber=0x10000\nOrderCode=\n"
      "BaudRate_10=0\nBaudRate_20=0\nBaudRate_50=0\nBaudRate_125=1\nBaudRate_250=1\nBaudRate_500=1\nBaudRate_800="
      "1\nBaudRate_1000=1\n"
      "SimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=8\nDynamicChannelsSupported=0\nGroupMessaging="
      "0\nNrOfRXPDO={2}\nNrOfTXPDO={2}\nLSS_Supported=1\n\n"
      "[DummyUsage]\nDummy0001=0\nDummy0002=1\nDummy0003=1\nDummy0004=1\nDummy0005=1\nDummy0006=1\nDummy0007=1\n\n["
      "Comments]\nLines=0\n\n",
      p.node, twin::printable(p.name), pdo_count);
}

/// Which objects there are: mandatory, optional and our own.
std::string lists(const Indices& by_index) {
  std::string s;
  const auto mandatory = [](std::uint16_t i) {
    return i == od::device_type || i == od::error_register || i == od::identity;
  };
  const auto list = [&](const char* title, auto belongs) {
    std::string lines;
    int n = 0;
    for (const auto& [index, objects] : by_index)
      if (belongs(index)) lines += fmt::format("{}=0x{:04X}\n", ++n, index);
    s += fmt::format("[{}]\nSupportedObjects={}\n{}\n", title, n, lines);
  };
  list("MandatoryObjects", mandatory);
  list("OptionalObjects", [&](std::uint16_t i) { return !mandatory(i) && !od::is_manufacturer(i); });
  list("ManufacturerObjects", od::is_manufacturer);
  return s;
}

std::string default_value(const Object& o, std::uint8_t node) {
  if (o.plus_node) return fmt::format("$NODEID+0x{:X}", o.value - node);
  if (o.type == Type::real32) return fmt::format("{}", std::bit_cast<float>(static_cast<std::uint32_t>(o.value)));
  if (o.type == Type::real64) return fmt::format("{}", std::bit_cast<double>(o.value));
  if (is_number(o.type)) return fmt::to_string(o.value);
  if (o.type == Type::text) return twin::printable(o.text);
  std::string bytes;
  for (const char c : o.text) bytes += fmt::format("{}{:02X}", bytes.empty() ? "" : " ", static_cast<unsigned char>(c));
  return bytes;
}

/// The lines of one object.
std::string entry(const Object& o, std::uint8_t node) {
  constexpr int variable = 7, domain = 2;  // object types
  const bool number = is_number(o.type);
  std::string s =
      fmt::format("ParameterName={}\nObjectType=0x{:X}\nDataType=0x{:04X}\nAccessType={}\n", twin::printable(o.name),
                  o.type == Type::domain ? domain : variable, facts_of(o.type).code,
                  o.access == Access::read_write   ? "rw"
                  : o.access == Access::write_only ? "wo"
                  : o.access == Access::constant   ? "const"
                                                   : "ro");
  const bool limited = number && o.type != Type::real32 && o.type != Type::real64;
  if (limited && o.access != Access::read_only && o.access != Access::constant)
    s += fmt::format("LowLimit={}\nHighLimit={}\n", o.low, o.high);
  // CiA 306: a domain has no default value. Nor has the serial number: a master would refuse every other drive.
  if (o.type != Type::domain && !(o.index == od::identity && o.sub == 4))
    s += fmt::format("DefaultValue={}\n", default_value(o, node));
  return s + fmt::format("PDOMapping={}\n\n", o.mappable ? 1 : 0);
}

std::string sections(const Indices& by_index, std::uint8_t node) {
  std::string s;
  for (const auto& [index, objects] : by_index) {
    if (objects.size() == 1 && objects[0]->sub == 0) {
      s += fmt::format("[{:04X}]\n", index) + entry(*objects[0], node);
      continue;
    }
    s += fmt::format("[{:04X}]\nParameterName={}\nObjectType={}\nSubNumber={}\n\n", index,
                     twin::printable(name_of_all(index, objects)), is_array(index) ? "0x8" : "0x9", objects.size());
    for (const Object* o : objects) s += fmt::format("[{:04X}sub{:X}]\n", index, o->sub) + entry(*o, node);
  }
  return s;
}

}  // namespace

std::string eds(const Dictionary& dictionary, const DriveParameters& p) {
  Indices by_index;
  for (const Object& o : dictionary.objects()) by_index[o.index].push_back(&o);
  return header(p) + lists(by_index) + sections(by_index, p.node);
}

}  // namespace tribotwin::hil
