#include <cstdlib>

#include <glog/logging.h>

#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/numerics/solver_guard.hpp>

namespace tribotwin::twin::identification {
namespace {

const char* name_of_program = "";

// The attribute, unlike [[noreturn]], is part of the type, as clang wants it.
__attribute__((noreturn)) void give_up() {
  report_error(name_of_program, failed,
               "the solver met numbers that it cannot use; check the data for values that no joint can have");
  std::quick_exit(failed);
}

}  // namespace

void exit_on_solver_failure(const char* program) {
  name_of_program = program;
  FLAGS_minloglevel =
      google::NUM_SEVERITIES;  // not even the last words of a failed check, which name only lines of Ceres
  google::InstallFailureFunction(give_up);
}

}  // namespace tribotwin::twin::identification
