#pragma once

#include <string>

#include <tribotwin/plugins/drive/drive.hpp>

/// The one joint that `export` writes for other tools.
namespace tribotwin::twin::program {

/// Of PARAMS.yaml (law and bristles; the temperature is that at which it is held) or of MODEL.xml (the whole drive).
struct JointSource {
  std::string file, joint;                   ///< joint: of a model with several
  double torque_max_nm = 0, gear_ratio = 0;  ///< where PARAMS.yaml holds none; 0: not given
};

/// Its drive, called `name`. Throws InputError where the file is wrong, std::runtime_error where no model could load
/// its parameters.
drive::Drive drive_of(const JointSource& source, const std::string& name);

/// A name in C of a joint: what is no letter or digit becomes _.
std::string c_name(const std::string& joint);

}  // namespace tribotwin::twin::program
