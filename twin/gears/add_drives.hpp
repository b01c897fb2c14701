#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

/// Drives for a robot that has none: its actuators are replaced by tribotwin.drive, with starter parameters of a gear
/// class or identified ones.
namespace tribotwin::twin {

/// A joint that gets a drive.
struct JointChoice {
  std::string joint;
  std::string gear;  ///< a class or a family; empty: that of AddDrives, or the usual family of the joint's effort
};

/// PARAMS.yaml for one joint, or for all where `joint` is empty.
struct IdentifiedParameters {
  std::string joint, file;
  identification::ParameterFile parameters;
};

struct AddDrives {
  std::vector<JointChoice> joints;  ///< empty: every joint with an actuator, or every hinge and slide if none has one
  std::string gear;                 ///< of joints without one of their own
  std::vector<IdentifiedParameters> identified;
  PerJoint effort_nm;     ///< in place of what the model says [Nm; N]
  bool fix_base = false;  ///< floating bases of the chosen joints are fixed where the model puts them
};

/// What a joint got and lost; torques are forces [N] and angles lengths [m] for a slide.
struct AddedDrive {
  std::string joint, actuator, replaced;  ///< `replaced`: the kind of the old actuator, or empty
  bool slide = false;
  double effort_nm = 0;
  std::string effort_source;
  std::string parameters;  ///< the class and its scale, or the file
  std::string source;      ///< of the class; "identified" for those of a file
  bool is_starting_point() const { return source != "identified"; }
  double gear_ratio = 0, armature = 0;
  bool armature_of_model = false;
  double speed_max_rad_s = 0;
  double removed_damping = 0, removed_frictionloss = 0;
};

struct RobotWithDrives {
  std::string mjcf;                            ///< for a file in the folder that was named
  std::shared_ptr<const mujoco::Model> model;  ///< the same, loaded
  std::vector<AddedDrive> drives;              ///< in the order of the controls
  std::vector<std::string> notes;
  std::vector<std::string> warnings;         ///< efforts that were guessed, gears that do not fit their joints
  std::vector<std::filesystem::path> files;  ///< that were read
};

/// Reads a model (read_foreign_model) and writes it with drives, for a file in `folder`, to which paths of assets
/// become relative. Order and names of the controls stay; keyframes keep their poses and hold the motor torques that
/// carry them. The result has passed every check of the loader. Fails with the place and the remedy on joints that do
/// not exist, cannot have a drive or are moved through a tendon.
Result<RobotWithDrives> add_drives(const std::filesystem::path& file, const AddDrives& choice,
                                   const std::filesystem::path& folder);

}  // namespace tribotwin::twin
