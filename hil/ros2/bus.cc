#include <algorithm>
#include <array>
#include <optional>
#include <set>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/communication_objects.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/drives/identifier.hpp>
#include <tribotwin/hil/ros2/bus.hpp>

namespace tribotwin::hil {
namespace {

struct Entry {
  od::Index index;
  std::uint8_t sub = 0;
};

/// What ros2_canopen's driver for CiA 402 reads and writes cyclically, PDO by PDO. A PDO without objects is switched
/// off.
const std::array<std::vector<Entry>, pdo_count> receive{{
    {{od::controlword}, {od::modes_of_operation}, {od::target_torque}},
    {{od::target_position}, {od::target_velocity}},
    {{od::interpolation_data_record, 1}},
}};
const std::array<std::vector<Entry>, pdo_count> transmit{{
    {{od::statusword}, {od::modes_of_operation_display}, {od::torque_actual_value}},
    {{od::position_actual_value}, {od::velocity_actual_value}},
}};
constexpr std::uint8_t every_sync = 1;  // transmission type

void map_pdo(Dictionary& d, bool transmits, int number, const std::vector<Entry>& wanted) {
  const od::Index at = pdo_index(transmits, number), map = od::mapping_of(at);
  std::uint8_t mapped = 0;
  for (const Entry& entry : wanted)
    if (const Object* o = d.find(entry.index, entry.sub); o && o->mappable)
      d.set(map, ++mapped, MappingEntry{o->index, o->sub, 8 * size_of(o->type)}.value());
  d.set(map, 0, mapped);
  const std::int64_t cob = d.get(at, 1);
  d.set(at, 1, mapped ? cob & ~std::int64_t{cob::off} : cob | cob::off);
  if (mapped) d.set(at, 2, every_sync);
}

/// A number that YAML 1.1 takes for one: with a point also before an exponent.
std::string yaml(double value) {
  std::string text = fmt::format("{}", value);
  if (text.find('.') == std::string::npos) text.insert(std::min(text.find('e'), text.size()), ".0");
  return text;
}

std::string indexed(const Object& o) { return fmt::format("{{index: 0x{:04X}, sub_index: {}", o.index, o.sub); }

/// Of a time as 60C2h has it: a number up to 255 and a power of ten [s].
struct InterpolationTime {
  std::int64_t value, exponent;
};
InterpolationTime interpolation_time(std::uint32_t cycle_us) {
  InterpolationTime t{cycle_us, -6};
  while (t.exponent < -3 && t.value % 10 == 0) t.value /= 10, ++t.exponent;
  while (t.value > 255) t.value = (t.value + 5) / 10, ++t.exponent;
  return t;
}

/// The part of one drive.
class Joint {
 public:
  Joint(const DescribedDrive& drive, std::uint32_t cycle_us)
      : d_(*drive.dictionary), p_(*drive.parameters), cycle_us_(cycle_us) {}

  std::string text(std::string_view name) const {
    return fmt::format("\n\"{}\":\n", name) + driver() + modes() + scales() + parameters() + pdos(false) + pdos(true);
  }

 private:
  std::string driver() const {
    return fmt::format(
        "  node_id: {0}\n  dcf: \"node{0}.eds\"\n  driver: \"ros2_canopen::Cia402Driver\"\n"
        "  package: \"canopen_402_driver\"\n  polling: true\n  period: {1} # [ms] of the driver's loop: one SYNC\n"
        "  revision_number: {2}\n  boot_timeout_ms: 5000\n  sdo_timeout_ms: 100\n"
        "  heartbeat_producer: {3} # [ms], 1017h\n",
        p_.node, std::max(1U, cycle_us_ / 1000), d_.get(od::identity, 3), d_.get(od::producer_heartbeat_time));
  }

  /// For canopen_ros2_control; by 6502h.
  std::string modes() const {
    struct Row {
      const char* key;
      int number;
      const char* name;
    };
    constexpr Row rows[] = {{"position_mode", 8, "cyclic synchronous position"},
                            {"velocity_mode", 9, "cyclic synchronous velocity"},
                            {"effort_mode", 10, "cyclic synchronous torque"}};
    std::string s;
    for (const Row& row : rows)
      if (d_.get(od::supported_drive_modes) >> (row.number - 1) & 1)
        s += fmt::format("  {}: {} # {}\n", row.key, row.number, row.name);
    return s;
  }

  /// From and to the joint's SI units. Objects count at the motor; torques go from the drive only.
  std::string scales() const {
    const auto of = [&](od::Index index) { return d_.find(index, 0)->scale; };
    const double rad = of(od::position_actual_value) / p_.gear_ratio,
                 rad_s = of(od::velocity_actual_value) / p_.gear_ratio,
                 nm = of(od::torque_actual_value) * p_.gear_ratio;
    return fmt::format(
        "  scale_pos_to_dev: {} # [1/rad]\n  scale_pos_from_dev: {} # [rad]\n"
        "  scale_vel_to_dev: {} # [s/rad]\n  scale_vel_from_dev: {} # [rad/s]\n  scale_eff_from_dev: {} # [Nm]\n",
        yaml(1 / rad), yaml(rad), yaml(1 / rad_s), yaml(rad_s), yaml(nm));
  }

  /// What the master writes beside the PDOs.
  std::string parameters() const {
    const auto [time, exponent] = interpolation_time(cycle_us_);
    std::string s = "  sdo:\n";
    s += parameter({od::communication_cycle_period}, cycle_us_, "one SYNC [us]");
    s += parameter({od::interpolation_time_period, 1}, time, "from one set point to the next");
    s += parameter({od::interpolation_time_period, 2}, exponent, "power of ten [s]");
    s += parameter({od::profile_velocity}, std::nullopt, "profile position: speed [0.001 rpm]");
    s += parameter({od::profile_acceleration}, std::nullopt, "[0.001 rpm/s]");
    s += parameter({od::profile_deceleration}, std::nullopt, "[0.001 rpm/s], of a halt too");
    s += parameter({od::homing_method}, 0, "init does not home: the encoders are absolute");
    return s;
  }

  /// Of an object that may be missing; without a value its present one.
  std::string parameter(Entry entry, std::optional<std::int64_t> value, const char* what) const {
    const Object* o = d_.find(entry.index, entry.sub);
    if (!o) return "";
    return fmt::format("    - {}, value: {}}} # {}: {}\n", indexed(*o), value.value_or(o->value), o->name, what);
  }

  std::string pdos(bool transmits) const {
    std::string s = transmits ? "  tpdo: # from the drive\n" : "  rpdo: # to the drive\n";
    for (int n = 0; n < pdo_count; ++n) s += pdo(transmits, n);
    return s;
  }

  std::string pdo(bool transmits, int number) const {
    const PdoParameters pdo = pdo_parameters(d_, transmits, number);
    // An empty mapping, because dcfgen goes by it: a PDO that is only disabled stays in the master's dictionary.
    if (!pdo.exists) return fmt::format("    {}: {{enabled: false, mapping: []}}\n", number + 1);
    std::string s =
        fmt::format("    {}:\n      enabled: true\n      cob_id: 0x{:03X}\n      transmission: {}\n      mapping:\n",
                    number + 1, pdo.cob, pdo.type);
    for (const MappingEntry& m : pdo.map) {
      const Object& o = *d_.find(m.index, m.sub);
      s += fmt::format("        - {}}} # {}\n", indexed(o), o.name);
    }
    return s;
  }

  const Dictionary& d_;
  const DriveParameters& p_;
  std::uint32_t cycle_us_;
};

}  // namespace

int ros2_master_node(std::span<const DescribedDrive> drives) {
  const auto taken = [&](int node) {
    return std::ranges::any_of(drives, [&](const DescribedDrive& d) { return d.parameters->node == node; });
  };
  if (!taken(127)) return 127;
  for (int node = 1; node < 127; ++node)
    if (!taken(node)) return node;
  return 0;
}

void map_for_ros2(Dictionary& dictionary) {
  for (int n = 0; n < pdo_count; ++n) {
    map_pdo(dictionary, false, n, receive[static_cast<std::size_t>(n)]);
    map_pdo(dictionary, true, n, transmit[static_cast<std::size_t>(n)]);
  }
}

std::vector<std::string> ros2_names(std::span<const DescribedDrive> drives) {
  std::vector<std::string> names, numbers;
  std::set<std::string> different;
  bool usable = true;
  for (const auto& drive : drives) {
    names.push_back(identifier(drive.parameters->name));
    numbers.push_back(fmt::format("node{}", drive.parameters->node));
    // ros2_canopen takes a key with "master" in it for the master's, one with "options" for none of a drive.
    usable = usable && !drive.parameters->name.empty() && different.insert(names.back()).second &&
             names.back().find("master") == std::string::npos && names.back().find("options") == std::string::npos;
  }
  return usable ? names : numbers;
}

std::string ros2_bus(std::span<const DescribedDrive> drives, std::uint32_t cycle_us) {
  std::string s = fmt::format(
      "# Drives of tribotwin-hil for ros2_canopen; see README.md.\n"
      "options:\n  dcf_path: \"@BUS_CONFIG_PATH@\" # set by generate_dcf\n\n"
      "master:\n  node_id: {}\n  driver: \"ros2_canopen::MasterDriver\"\n  package: \"canopen_master_driver\"\n"
      "  sync_period: {} # [us]\n",
      ros2_master_node(drives), cycle_us);
  const auto names = ros2_names(drives);
  for (std::size_t i = 0; i < drives.size(); ++i) s += Joint(drives[i], cycle_us).text(names[i]);
  return s;
}

}  // namespace tribotwin::hil
