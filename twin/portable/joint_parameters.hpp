#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>

namespace tribotwin::twin {

/// A number of a joint that may be tuned while it runs, under its name in MJCF.
struct JointParameter {
  std::string_view name;
  std::string unit;
  double value, minimum, maximum;  ///< the accepted range, inclusive
  std::string_view meaning;
};

/// Those of the law, of its bristles, of its heat and of its winding, and the drive's own that friction or the
/// winding's current depend on.
std::vector<JointParameter> joint_parameters(const drive::Drive& drive);

}  // namespace tribotwin::twin
