// Program tribotwin: runs, measures, identifies, exports. Each command is a file in commands/. stdout carries results
// only; everything else goes to stderr.
#include <malloc.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/commands/table.hpp>
#include <tribotwin/twin/gears/gear_class.hpp>
#include <tribotwin/twin/io/command_line/parse.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>
#include <tribotwin/twin/numerics/solver_guard.hpp>

namespace {

/// A search takes and frees the same matrices thousands of times. Their memory stays with the program, up to 64 MiB:
/// otherwise the C library gives it back to the kernel each time, which clears it each time.
void keep_freed_memory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 64 << 20);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tribotwin;
  twin::prepare_streams();
  keep_freed_memory();
  mujoco::install_message_handlers();
  twin::identification::exit_on_solver_failure("tribotwin");

  CLI::App app{"tribotwin", "A digital twin of robot joints whose friction depends on load and temperature"};
  app.require_subcommand(1);
  int code = twin::done;
  for (const auto add : twin::program::commands) add(app, code);
  const auto gears = twin::gear_names();
  code = twin::program::parse("tribotwin", mj_versionString(), app, argc, argv, code,
                              {{"--gear", {gears.begin(), gears.end()}}, {"--law", {"bouc_wen", "lugre"}}});
  return twin::leave_ranks(code);
}
