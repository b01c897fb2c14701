// tribotwin: runs, measures, identifies and exports; a command each in commands/. stdout carries results only;
// everything else goes to stderr.
#include <sstream>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/numerics/solver_guard.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin;
  twin::prepare_streams();
  mujoco::install_message_handlers();
  twin::identification::exit_on_solver_failure("tribotwin");

  CLI::App app{"tribotwin: a digital twin of robot joints whose friction knows load and temperature"};
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("tribotwin " TRIBOTWIN_VERSION ", MuJoCo ") + mj_versionString());
  int code = twin::done;
  for (const auto add : {twin::program::add_run, twin::program::add_curve, twin::program::add_lab,
                         twin::program::add_identify, twin::program::add_calibrate, twin::program::add_dynamics,
                         twin::program::add_predict, twin::program::add_excite, twin::program::add_thermal,
                         twin::program::add_diagnose, twin::program::add_recover, twin::program::add_export})
    add(app, code);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    std::ostringstream out, error;
    code = app.exit(e, out, error) == 0 ? twin::done : twin::wrong_input;
    twin::print_text(out.str());
    twin::report_text(error.str());
  } catch (const twin::InputError& e) {
    code = twin::program::report_error(twin::wrong_input, e.what());
  } catch (const std::exception& e) {
    code = twin::program::report_error(twin::failed, e.what());
  }
  return twin::finish("tribotwin", code);
}
