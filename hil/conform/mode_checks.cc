#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

struct Mode {
  int number;
  const char* name;
};
constexpr Mode modes[] = {{1, "PP"}, {2, "VL"},  {3, "PV"},  {4, "TQ"},  {6, "HM"},
                          {7, "IP"}, {8, "CSP"}, {9, "CSV"}, {10, "CST"}};

template <int index>
std::string accepts(Device& d) {
  constexpr Mode mode = modes[index];
  if (!d.supports(mode.number)) throw NotApplicable{fmt::format("6502h does not name {}", mode.name)};
  d.operational();
  d.set_mode(mode.number);
  return fmt::format("6061h = {}", mode.number);
}

std::string refuses_unsupported(Device& d) {
  d.needs(od::supported_drive_modes);
  std::vector<int> refused;
  const auto before = d.get_signed(od::modes_of_operation);
  for (const int mode : {1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 20}) {
    if (d.supports(mode)) continue;
    const auto code = d.refusal(od::modes_of_operation, 0, mode);
    if (!code) {  // accepted, then not taken up
      d.bus.listen(100 * ms_ns);
      const auto shown = d.get_signed(od::modes_of_operation_display);
      expect(shown != mode, fmt::format("6060h = {} is refused, or 6061h keeps its value", mode),
             fmt::format("6061h = {}", shown));
    } else {
      expect((*code >> 8) == 0x060900, fmt::format("6060h = {} ends with abort 06090030h", mode),
             fmt::format("abort {:08X}h", *code));
      const auto now = d.get_signed(od::modes_of_operation);
      expect(now == before, fmt::format("6060h stays {}", before), fmt::format("{}", now));
    }
    refused.push_back(mode);
  }
  return fmt::format("not taken up: {}", fmt::join(refused, ", "));
}

std::string display_follows(Device& d) {
  d.operational();
  std::vector<int> seen;
  for (const Mode& mode : modes)
    if (d.supports(mode.number)) {
      d.set_mode(mode.number);
      seen.push_back(mode.number);
    }
  if (seen.size() < 2) throw NotApplicable{"6502h names one mode"};
  return fmt::format("{}", fmt::join(seen, ", "));
}

constexpr auto none = Needs::nothing;

constexpr Check checks[] = {
    {"mode.pp", "CiA 402-2, 6060h, 6502h bit 0", "Profile position is accepted.", none, accepts<0>},
    {"mode.vl", "CiA 402-2, 6060h, 6502h bit 1", "Velocity is accepted.", none, accepts<1>},
    {"mode.pv", "CiA 402-2, 6060h, 6502h bit 2", "Profile velocity is accepted.", none, accepts<2>},
    {"mode.tq", "CiA 402-2, 6060h, 6502h bit 3", "Profile torque is accepted.", none, accepts<3>},
    {"mode.hm", "CiA 402-2, 6060h, 6502h bit 5", "Homing is accepted.", none, accepts<4>},
    {"mode.ip", "CiA 402-2, 6060h, 6502h bit 6", "Interpolated position is accepted.", none, accepts<5>},
    {"mode.csp", "CiA 402-2, 6060h, 6502h bit 7", "Cyclic synchronous position is accepted.", none, accepts<6>},
    {"mode.csv", "CiA 402-2, 6060h, 6502h bit 8", "Cyclic synchronous velocity is accepted.", none, accepts<7>},
    {"mode.cst", "CiA 402-2, 6060h, 6502h bit 9", "Cyclic synchronous torque is accepted.", none, accepts<8>},
    {"mode.unsupported", "CiA 402-2, 6060h", "A mode that 6502h does not name is not taken up.", none,
     refuses_unsupported},
    {"mode.display", "CiA 402-2, 6061h", "6061h follows 6060h.", none, display_follows},
};

}  // namespace

Checks mode_checks() { return checks; }

}  // namespace tribotwin::hil
