// tribotwin-hil: the joints of a robot as drives on a CAN bus; a command each in commands/. stdout carries results
// only; everything else goes to stderr.
#include <tribotwin/hil/commands/table.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/io/command_line/parse.hpp>
#include <tribotwin/twin/io/output.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin;
  twin::prepare_streams();
  mujoco::install_message_handlers();

  CLI::App app{"tribotwin-hil", "The joints of a robot as drives on a CAN bus"};
  app.require_subcommand(1);
  int code = twin::done;
  for (const auto add : hil::program::commands) add(app, code);
  return twin::program::parse("tribotwin-hil", mj_versionString(), app, argc, argv, code);
}
