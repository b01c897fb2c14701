#pragma once

#include <functional>
#include <optional>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>

/// MPI, loaded at run time: a program that no launcher has started needs none, and the same program runs on machines
/// without MPI.
namespace tribotwin::twin {

/// How many ranks a launcher (mpirun, srun) says it has started, and which launcher; none where the program was
/// started by itself. TRIBOTWIN_RANKS=alone: none in any case. `environment`: as getenv.
struct Launch {
  std::string launcher;
  int ranks = 1;
  bool reachable = true;  ///< false: srun without PMI, whose tasks do not know each other
};
std::optional<Launch> launch(const std::function<const char*(const char*)>& environment);

/// First call of a command that divides its work: makes twin::ranks() those of the job where a launcher has started
/// several with the same arguments. From then on only rank 0 prints. ErrorKind::work where the ranks cannot talk to
/// each other: they would all write into one folder.
Result<void> join_ranks();

/// Last call of main(): waits for the other ranks. The exit code of this process: that of rank 0, others have 0, so
/// that no launcher kills rank 0 while it says why.
int leave_ranks(int code);

}  // namespace tribotwin::twin
