#include <cmath>
#include <utility>

#include <tribotwin/hil/cia402/touch_probe.hpp>

namespace tribotwin::hil {
namespace {

enum Function { enable = 1, each_event = 2, index_pulse = 4, rising = 0x10, falling = 0x20 };
enum Stored { rising_stored = 2, falling_stored = 4 };

/// One edge of one probe; the new status.
int catch_edge(int function, int status, int wanted, int stored, bool happened, std::int64_t here, Object* position) {
  if (!(function & wanted)) return status & ~stored;
  if (!happened || ((status & stored) && !(function & each_event))) return status;
  position->value = here;
  return status | stored;
}

}  // namespace

bool update_touch_probes(const DriveObjects& o, const Inputs* inputs) {
  const struct {
    Input input;
    Object *rising_position, *falling_position;
  } probes[] = {{Input::home, o.probe_1_rising, o.probe_1_falling},
                {Input::probe_2, o.probe_2_rising, o.probe_2_falling}};
  std::int64_t word = 0;
  bool caught = false;
  for (int n = 0; n < 2; ++n) {
    const int function = static_cast<int>(o.touch_probe_function->value >> 8 * n) & 0xff;
    int status = static_cast<int>(o.touch_probe_status->value >> 8 * n) & 0xff;
    const Inputs::Edge edge =
        inputs ? inputs->edge(function & index_pulse ? Input::index : probes[n].input) : Inputs::Edge{};
    const std::int64_t here = saturated(Type::i32, std::llround((edge.position_rad - o.zero_rad) / o.increment_rad));
    status = function & enable ? status | enable : 0;
    if (status) {
      status = catch_edge(function, status, rising, rising_stored, edge.rising, here, probes[n].rising_position);
      status = catch_edge(function, status, falling, falling_stored, edge.falling, here, probes[n].falling_position);
      caught = caught || edge.rising || edge.falling;
    }
    word |= std::int64_t{status} << 8 * n;
  }
  return (std::exchange(o.touch_probe_status->value, word) != word) || caught;
}

}  // namespace tribotwin::hil
