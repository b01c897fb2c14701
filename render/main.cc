// tribotwin-report: pages and pictures of runs, laws and poses; a command each in commands/. stdout carries the names
// of the files written; everything else goes to stderr.
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/render/commands/table.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/twin/io/command_line/parse.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/numerics/solver_guard.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin;
  constexpr const char* program = "tribotwin-report";
  twin::prepare_streams();
  mujoco::install_message_handlers();
  twin::identification::exit_on_solver_failure(program);

  CLI::App app{"tribotwin-report", "Runs, laws and poses as one page or single pictures; needs no display"};
  app.require_subcommand(0, 1);
  render::program::Call call{.command_line = program};
  for (int i = 1; i < argc; ++i) call.command_line += " " + render::shell_word(argv[i]);
  for (const auto add : render::program::commands) add(app, call);
  return twin::program::parse(program, mj_versionString(), app, argc, argv, call.code);
}
