#pragma once

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/live/protocol/messages.hpp>

namespace tribotwin::twin::live {

/// The friction limit of a drive in this state, wear and faults included, from -top speed to top speed of its motor.
/// Without brake, ripple and bristles.
Law law_of(const mujoco::Model& model, std::size_t drive, const drive::Workspace& state);

}  // namespace tribotwin::twin::live
