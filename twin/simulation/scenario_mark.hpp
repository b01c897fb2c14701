#pragma once

#include <cstdint>

#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {

/// A checksum of everything that the steps of a scenario follow from: its keys, model, control, events and recording,
/// and the engine's version. The same wherever the files lie; another one for a scenario that differs in anything.
std::uint64_t scenario_mark(const Scenario& scenario);

}  // namespace tribotwin::twin
