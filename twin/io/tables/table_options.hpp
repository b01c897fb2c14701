#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// A number for all joints, or for some: "KT" and "JOINT=KT" of the command line.
class PerJoint {
 public:
  /// Fails with `option` and what would be right; numbers must be above 0.
  static Result<PerJoint> of(std::string_view option, const std::vector<std::string>& texts);

  /// Of a joint, or of all; nothing where neither is known.
  std::optional<double> find(std::string_view joint) const;
  /// What counts where no number is given for the joint.
  void add_default(std::string joint, double value);
  void set_all(double value) { all_ = value, given_ = true; }
  bool given() const { return given_; }
  /// The joints that were given by name.
  const std::vector<std::pair<std::string, double>>& named() const { return named_; }

 private:
  bool given_ = false;
  std::optional<double> all_;
  std::vector<std::pair<std::string, double>> named_, defaults_;
};

/// How a reader takes the columns of a table: what no table says about itself.
struct TableOptions {
  std::filesystem::path columns;  ///< YAML that maps foreign names; empty: none
  PerJoint torque_constant;       ///< Nm/A, motor side: turns currents into torques
  PerJoint gear_ratio;            ///< motor turns per joint turn, for that
  std::string joint;              ///< for readers of one joint; may be empty where a table has one only
  bool any_joint = false;         ///< for readers that suit slides too: m, m/s, N may stand for rad, rad/s, Nm
  std::string topic;              ///< of MCAP; may be empty where a file has one of joints only
};

/// With a gear ratio for all joints, unless it is 0 or the options have ratios of their own.
TableOptions with_gear_ratio(TableOptions options, double gear_ratio);

/// The same as it stands on a command line, one set of options for all commands that read tables.
struct TableArguments {
  std::string columns, topic;
  std::vector<std::string> torque_constant, gear_ratio;

  /// Adds --columns, --topic and --torque-constant to a CLI::App.
  template <class Command>
  void add_to(Command& command) {
    command.add_option("--columns", columns,
                       "YAML that maps foreign column names: NAME_UNIT: FOREIGN or {from, unit, scale, offset, sign}");
    command.add_option("--topic", topic, "Of MCAP recordings with several topics of joints: the one to read");
    command
        .add_option("--torque-constant", torque_constant,
                    "[JOINT=]KT [Nm/A], motor side: torque from current_JOINT_a; may be repeated")
        ->allow_extra_args(false);
  }
  /// Adds --gear-ratio [JOINT=]N, for commands that have no such option of their own.
  template <class Command>
  void add_gear_ratio_to(Command& command) {
    command
        .add_option("--gear-ratio", gear_ratio,
                    "[JOINT=]N, motor turns per joint turn, for --torque-constant; may be repeated")
        ->allow_extra_args(false);
  }
  /// Fails where an option is not as it must be.
  Result<TableOptions> options() const;
};

}  // namespace tribotwin::twin
