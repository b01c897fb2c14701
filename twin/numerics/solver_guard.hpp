#pragma once

namespace tribotwin::twin::identification {

/// From now on a broken invariant within Ceres ends `program` with one line on stderr and exit code 1, where glog would
/// print its stack and abort. It cannot be handled: glog's checks do not return. Files are written whole or not at all,
/// so nothing is half done. `program` must outlive the process's work.
void exit_on_solver_failure(const char* program);

}  // namespace tribotwin::twin::identification
