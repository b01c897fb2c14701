#pragma once

#include <tribotwin/twin/io/mcap/joint_states.hpp>

/// Private to this folder: the same messages as JSON.
namespace tribotwin::twin::mcap {

/// The fields of a JointState that hold one number per joint.
constexpr const char* joint_state_fields[] = {"position", "velocity", "effort"};

/// {"header": {"stamp": {"sec", "nanosec"}}, "name": [..], "position": [..], ..}; nsec may stand for nanosec, null for
/// a number that is none, and the header may be missing.
Result<void> decode_json(JointMessage kind, std::string_view data, JointNumbers& out);

}  // namespace tribotwin::twin::mcap
