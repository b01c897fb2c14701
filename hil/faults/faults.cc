#include <algorithm>
#include <iterator>
#include <string_view>

#include <fmt/format.h>

#include <tribotwin/hil/faults/faults.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::hil {
namespace {

using K = FaultKind;
using T = FaultTarget;

struct Row {
  K kind;
  std::string_view name;  ///< value of the key `kind`
  T target;
  bool needs_node;
};
constexpr Row rows[] = {{K::drop, "drop", T::frames, false},
                        {K::delay, "delay", T::frames, false},
                        {K::corrupt, "corrupt", T::frames, false},
                        {K::duplicate, "duplicate", T::frames, false},
                        {K::silence, "silence", T::frames, true},
                        {K::bus_off, "bus_off", T::link, false},
                        {K::link_down, "link_down", T::link, false},
                        {K::over_temperature, "over_temperature", T::drive, true},
                        {K::encoder_freeze, "encoder_freeze", T::drive, true},
                        {K::safe_torque_off, "safe_torque_off", T::drive, true}};

/// The bus of a fault, where there are several.
std::optional<std::size_t> read_bus(twin::Mapping& m, const Wiring& wiring) {
  if (wiring.size() < 2 || !m.has("bus")) return std::nullopt;
  std::vector<std::string> names;
  for (std::size_t bus = 0; bus < wiring.size(); ++bus) names.push_back(channel_of(bus));
  const std::vector<std::string_view> known(names.begin(), names.end());
  const std::string chosen = m.choice("bus", known);
  return static_cast<std::size_t>(std::ranges::find(names, chosen) - names.begin());
}

const Row& read_kind(twin::Mapping& m) {
  std::vector<std::string_view> names;
  for (const Row& row : rows) names.push_back(row.name);
  return *std::ranges::find(rows, m.choice("kind", names), &Row::name);
}

/// What a fault has beside its place.
Fault read_strength(twin::Mapping& m, const Row& row) {
  Fault f{.kind = row.kind};
  f.to_s = m.number("duration_s", {1e-6, 1e9});
  f.probability = m.number_or("probability", 1, {0, 1});
  f.delay_s = m.number_or("delay_s", 0.01, {0, 10});
  f.temperature_degC = m.number_or("temperature_degC", 150, {-100, 1000});
  return f;
}

Fault read(twin::Mapping& m, int first_node, int drives, const Wiring& wiring) {
  if (wiring.size() > 1)
    m.accept({"kind", "time_s", "duration_s", "node", "probability", "delay_s", "temperature_degC", "bus"});
  else
    m.accept({"kind", "time_s", "duration_s", "node", "probability", "delay_s", "temperature_degC"});
  const Row& row = read_kind(m);
  Fault f = read_strength(m, row);
  f.from_s = m.number("time_s", {0, 1e9});
  f.to_s += f.from_s;
  f.node = static_cast<int>(m.whole_or("node", 0, {0, 127}));
  f.bus = read_bus(m, wiring);
  if (f.bus) drives = static_cast<int>(wiring[*f.bus].size());
  if (f.node != 0 && wiring.size() > 1 && !f.bus) m.fail("bus", "is needed with a node: can0 or can1");
  if (f.node != 0 && (f.node < first_node || f.node >= first_node + drives))
    m.fail("node", fmt::format("{}: the drives are nodes {} to {}", f.node, first_node, first_node + drives - 1));
  if (row.needs_node && f.node == 0) m.fail("node", "is needed: which drive?");
  m.done();
  return f;
}

}  // namespace

std::string_view name_of(FaultKind kind) { return std::ranges::find(rows, kind, &Row::kind)->name; }

std::vector<std::string> fault_kinds() {
  std::vector<std::string> names;
  for (const Row& row : rows) names.emplace_back(row.name);
  return names;
}

Fault read_fault(twin::Mapping& m, const std::vector<std::string>& joints, int first_node, const Wiring& wiring) {
  m.accept({"kind", "duration_s", "joint", "probability", "delay_s", "temperature_degC"});
  const Row& row = read_kind(m);
  Fault f = read_strength(m, row);
  if (m.has("joint")) {
    if (row.target == T::link) m.fail("joint", fmt::format("{} is of the whole bus", row.name));
    const std::vector<std::string_view> known(joints.begin(), joints.end());
    const auto at = std::ranges::find(joints, m.choice("joint", known)) - joints.begin();
    const Place place = place_of(wiring, static_cast<std::size_t>(at));
    f.node = first_node + static_cast<int>(place.rank);
    if (wiring.size() > 1) f.bus = place.bus;
  } else if (row.needs_node) {
    m.fail("joint", "is needed: which drive?");
  }
  m.done();
  return f;
}

FaultTarget target_of(FaultKind kind) { return std::ranges::find(rows, kind, &Row::kind)->target; }

Result<std::vector<Fault>> load_faults(const std::filesystem::path& file, int first_node, int drives,
                                       const Wiring& wiring) try {
  twin::Mapping root(file.string(), "", twin::load_yaml(file));
  root.accept({"faults"});
  std::vector<Fault> all;
  for (auto& m : root.mappings("faults")) all.push_back(read(m, first_node, drives, wiring));
  root.done();
  return all;
} catch (const twin::InputError& error) {
  return tl::unexpected(Error(error.what()));
}

}  // namespace tribotwin::hil
