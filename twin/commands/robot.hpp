#pragma once

#include <memory>
#include <string>
#include <vector>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>
#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

/// The part that the commands on a whole robot's dynamics share.
namespace tribotwin::twin::program {

struct Robot {
  std::shared_ptr<const mujoco::Model> model;
  Regressor regressor;
  BaseParameters base;
};

/// Throws InputError where the model cannot be loaded or is no rigid tree of hinges and slides.
Robot load_robot(const std::string& file);

/// Options of how recordings are prepared.
void add_preparation(CLI::App& command, identification::Preparation& preparation);

/// Reads recordings, with the gear ratios of the model where no others are given. Throws InputError.
std::vector<identification::RobotRecording> read_recordings(const Robot& robot, const std::vector<std::string>& files,
                                                            const TableArguments& tables);

/// Reads and prepares recordings; prints notes on them unless `quiet`. Throws InputError.
identification::JointMotion read_motion(const Robot& robot, const std::vector<std::string>& files,
                                        const identification::Preparation& preparation, const TableArguments& tables,
                                        bool quiet);

}  // namespace tribotwin::twin::program
