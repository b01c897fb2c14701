#pragma once

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/motion/inputs.hpp>

/// Touch probes (CiA 402-2): 60B8h chooses input and edges, 60B9h says what was caught, 60BAh to 60BDh where. One byte
/// per probe in both words:
///
/// | bit | 60B8h | 60B9h |
/// |---|---|---|
/// | 0 | enabled | enabled |
/// | 1 | 0 the first event, 1 each | position of the rising edge stored |
/// | 2 | 0 the probe's own input, 1 the index pulse | position of the falling edge stored |
/// | 4, 5 | rising, falling edges | |
///
/// The first probe's own input is the home switch, the second one's that of 2130h:02.
namespace tribotwin::hil {

/// The inputs have moved, or, without them, 60B8h was written. Updates 60B9h to 60BDh; whether one of them changed.
bool update_touch_probes(const DriveObjects& objects, const Inputs* inputs);
/// Whether 60B8h may have this value: bit 3, a source by 60D0h, is not supported.
constexpr bool is_touch_probe_function(std::int64_t value) { return (value & 0x0808) == 0; }

}  // namespace tribotwin::hil
