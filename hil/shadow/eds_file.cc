#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
#include <tribotwin/hil/shadow/eds_file.hpp>

namespace tribotwin::hil {
namespace {

constexpr double gear_tolerance = 0.01;
constexpr int tpdo_limit = 512, longest_map = 64, longest_pdo_bits = 512;

class DriveReader {
 public:
  DriveReader(const EdsFile& eds, const DriveParameters& p) : eds_(eds), p_(p) {
    drive_.node = eds.node_number ? *eds.node_number : p.node;
  }

  Result<CanopenDrive> read(std::optional<double> increments) {
    for (int i = 0; i < tpdo_limit; ++i)
      if (auto ok = tpdo(static_cast<std::uint16_t>(od::tpdo_communication + i)); !ok)
        return tl::unexpected(ok.error());
    if (auto ok = position(increments); !ok) return tl::unexpected(ok.error());
    if (auto ok = torque(); !ok) return tl::unexpected(ok.error());
    return std::move(drive_);
  }

 private:
  tl::unexpected<Error> fail(const EdsText& at, const std::string& what) const {
    return tl::unexpected(Error(fmt::format("{}:{}: {}", eds_.file.string(), at.line, what)));
  }
  const EdsText* value(std::uint16_t index, std::uint8_t sub) const {
    const EdsObject* object = eds_.find(index, sub);
    return object ? object->value() : nullptr;
  }
  /// None where the file has no value.
  Result<std::optional<std::int64_t>> get(std::uint16_t index, std::uint8_t sub, Type type = Type::u32) const {
    const EdsText* text = value(index, sub);
    if (!text) return std::nullopt;
    return eds_.number(*text, type, static_cast<std::uint8_t>(drive_.node), object_name(index, sub));
  }

  Result<void> tpdo(std::uint16_t index) {
    const std::uint16_t map = od::mapping_of(index);
    const auto id = get(index, 1), type = get(index, 2, Type::u8), count = get(map, 0, Type::u8);
    for (const auto* part : {&id, &type, &count})
      if (!*part) return tl::unexpected(part->error());
    if (!*id) return {};
    if (count->value_or(0) > longest_map) return fail(*value(map, 0), "a PDO has at most 64 mapped objects");
    set(index, 1, **id);
    set(index, 2, type->value_or(255));
    set(map, 0, count->value_or(0));
    std::int64_t bits = 0;
    for (std::uint8_t k = 1; k <= count->value_or(0); ++k) {
      const auto mapped = get(map, k);
      if (!mapped) return tl::unexpected(mapped.error());
      if (!*mapped)
        return fail(*value(map, 0),
                    fmt::format("{:04X}h maps {} objects, but has no value of :{:02X}", map, count->value_or(0), k));
      if (auto ok = mapping(*value(map, k), **mapped); !ok) return ok;
      bits += **mapped & 0xFF;
      if (bits > longest_pdo_bits) return fail(*value(map, k), fmt::format("{:04X}h maps more than 64 bytes", map));
      set(map, k, **mapped);
    }
    return {};
  }

  /// The objects that a shadow reads must have their size.
  Result<void> mapping(const EdsText& at, std::int64_t number) const {
    constexpr std::pair<std::uint16_t, int> sizes[] = {
        {od::statusword, 16}, {od::position_actual_value, 32}, {od::torque_actual_value, 16}};
    const auto entry = MappingEntry::of(number);
    for (const auto& [index, bits] : sizes)
      if (entry.index == index && entry.bits != bits)
        return fail(at, fmt::format("{:04X}h is mapped with {} bits; it has {}", index, entry.bits, bits));
    return {};
  }
  void set(std::uint16_t index, std::uint8_t sub, std::int64_t number) { drive_.tpdo_objects[{index, sub}] = number; }

  /// The quotient of an object's sub-indices 1 and 2, as 608Fh and 6091h have it; none where the file has no value.
  Result<std::optional<double>> quotient(std::uint16_t index) const {
    const auto over = get(index, 1), under = get(index, 2);
    if (!over) return tl::unexpected(over.error());
    if (!under) return tl::unexpected(under.error());
    if (!*over) return std::nullopt;
    for (const std::uint8_t sub : {std::uint8_t{1}, std::uint8_t{2}})
      if ((sub == 1 ? **over : under->value_or(1)) == 0)
        return fail(*value(index, sub), fmt::format("{:04X}h:{:02X} is 0; it must be at least 1", index, sub));
    return static_cast<double>(**over) / static_cast<double>(under->value_or(1));
  }

  Result<void> position(std::optional<double> increments) {
    const auto gear = quotient(od::gear_ratio);
    if (!gear) return tl::unexpected(gear.error());
    if (!increments) {
      const auto resolution = quotient(od::position_encoder_resolution);
      if (!resolution) return tl::unexpected(resolution.error());
      increments = *resolution;
    }
    if (!increments)
      return tl::unexpected(
          fmt::format("{}: no encoder resolution (608Fh:01) for {}: give the counts of 6064h per motor "
                      "turn with --increments",
                      eds_.file.string(), p_.name));
    if (*gear && **gear != 1 && std::abs(**gear / p_.gear_ratio - 1) > gear_tolerance)
      return fail(*value(od::gear_ratio, 1),
                  fmt::format("6091h has a gear ratio of {:.6g}, the scenario's {} one of {:.6g}", **gear, p_.name,
                              p_.gear_ratio));
    drive_.position_rad = 2 * std::numbers::pi / *increments / p_.gear_ratio;
    return {};
  }

  Result<void> torque() {
    const auto rated = get(od::motor_rated_torque, 0);
    if (!rated) return tl::unexpected(rated.error());
    const double rated_nm = rated->value_or(0) > 0 ? 1e-3 * static_cast<double>(**rated) : p_.rated_torque_nm;
    drive_.torque_nm = 1e-3 * rated_nm * p_.gear_ratio;
    return {};
  }

  const EdsFile& eds_;
  const DriveParameters& p_;
  CanopenDrive drive_;
};

}  // namespace

Result<CanopenDrive> read_eds(const std::filesystem::path& file, const DriveParameters& parameters,
                              std::optional<double> increments) {
  const auto eds = read_eds_file(file);
  if (!eds) return tl::unexpected(eds.error());
  if (std::ranges::find(eds->objects, od::tpdo_communication, &EdsObject::index) == eds->objects.end())
    return tl::unexpected(fmt::format("{}: no TPDO ([1800]): is it the EDS or DCF of a drive?", file.string()));
  return DriveReader(*eds, parameters).read(increments);
}

}  // namespace tribotwin::hil
