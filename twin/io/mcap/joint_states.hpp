#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/mcap/reader.hpp>

/// The two messages that hold numbers of joints. sensor_msgs/msg/JointState: header, name[], position[], velocity[],
/// effort[]. control_msgs/msg/DynamicJointState: header, joint_names[], interface_values[] of interface_names[] and
/// values[]. Encoded as CDR (XCDR1 behind an encapsulation header, both byte orders), as of ROS 1, or as JSON with the
/// same field names.
namespace tribotwin::twin::mcap {

enum class JointMessage { joint_state, dynamic_joint_state };

/// The numbers of one message. Texts point into the message, or into `texts`.
struct JointNumbers {
  struct Value {
    std::string_view joint, interface;  ///< interface of a JointState: position, velocity, effort
    double value;
  };
  std::int64_t stamp_ns = 0;  ///< of the header
  std::vector<Value> values;
  std::vector<std::string_view> names;  ///< of the joints
  std::shared_ptr<const void> texts;
};

/// Nothing where the messages of a channel are others.
std::optional<JointMessage> joint_message_of(const Channel& channel);

/// Takes a message of a channel with such messages apart. Fails with what is wrong, without file and place.
Result<void> decode(const Channel& channel, std::string_view data, JointNumbers& out);

/// The definitions as ROS 2 stores them, with those that they contain.
std::string_view definition(JointMessage kind);
std::string_view type_name(JointMessage kind);

/// A JointState as little-endian CDR; each span is empty or as long as `names`.
std::string encode_joint_state(std::int64_t stamp_ns, std::span<const std::string> names,
                               std::span<const double> position, std::span<const double> velocity,
                               std::span<const double> effort);
/// A DynamicJointState as little-endian CDR; all joints have the same interfaces, values joint by joint.
std::string encode_dynamic_joint_state(std::int64_t stamp_ns, std::span<const std::string> names,
                                       std::span<const std::string> interfaces, std::span<const double> values);

}  // namespace tribotwin::twin::mcap
