#include <chrono>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/robot/excitation.hpp>

namespace tribotwin::twin::program {
namespace {

using Json = nlohmann::ordered_json;

struct Arguments {
  std::string model;
  Destination output;
  ExcitationOptions options;
  double rate_hz = 250, heating_min = 3;
  bool json = false, quiet = false, inertia_only = false;
};

Result<Exit> execute(Arguments& a) {
  const Robot robot = load_robot(a.model);
  ExcitationOptions& o = a.options;
  o.heating_s = a.inertia_only ? 0 : 60 * a.heating_min;
  o.friction = !a.inertia_only;
  catch_interrupts();
  o.stop = &interrupted();
  const auto found = [&] {
    Progress progress(a.quiet, "searching");
    const auto started = std::chrono::steady_clock::now();
    o.progress = [&](double share, double) {
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
      progress(share, share > 0.01 ? seconds * (1 / share - 1) : -1);
    };
    return excite(*robot.model, robot.regressor, robot.base, o);
  }();
  if (!found) return work_failed(fmt::format("{}: {}", a.model, found.error().message));
  if (!a.quiet)
    for (const auto& text : found->notes) note("{}", text);
  if (a.output.named())
    if (auto ok = deliver(to_csv(*found, robot.regressor, a.rate_hz), a.output); !ok) return ok;
  Json j{{"condition_number", found->condition_number},
         {"first_condition_number", found->first_condition_number},
         {"base_parameters", robot.base.size()},
         {"duration_s", found->duration_s()},
         {"sections_s", {found->inertia_s, found->friction_s, found->duration_s()}},
         {"interrupted", found->interrupted}};
  std::string text = fmt::format("condition number {:.1f} (the first tried: {:.3g}), {} base parameters\n",
                                 found->condition_number, found->first_condition_number, robot.base.size());
  text += fmt::format("section 1, inertia: 0 .. {:.1f} s\n", found->inertia_s);
  if (!a.inertia_only) {
    text += fmt::format("section 2, friction joint by joint: .. {:.1f} s, the others at", found->friction_s);
    for (Eigen::Index k = 0; k < found->pose.size(); ++k) {
      text += fmt::format(" {}={:.3g}", robot.regressor.joint_name(k), found->pose(k));
      j["pose"][robot.regressor.joint_name(k)] = found->pose(k);
    }
    text += fmt::format("\nsection 3, heating: .. {:.1f} s\n", found->duration_s());
  }
  if (auto ok = deliver(a.json ? j.dump(2) + "\n" : text); !ok) return ok;
  if (!found->interrupted) return done;
  return work_failed(
      fmt::format("interrupted; the best motion so far is complete{}", a.output.named() ? " in " + a.output.file : ""));
}

}  // namespace

void add_excite(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand(
      "excite", "Design a motion that identifies a robot's dynamics: inertia, friction joint by joint, heating");
  c->add_option("MODEL", a->model, "MJCF model")->required();
  a->output.add_to(*c, "CSV of set points to write: time_s, section, position_JOINT_rad, velocity_JOINT_rad_s");
  c->add_option("--share", a->options.share, "Share of the speeds and torques that the model allows")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
  c->add_option("--period", a->options.period_s, "Period of the Fourier series [s]")
      ->check(CLI::Range(1.0, 1000.0))
      ->capture_default_str();
  c->add_option("--harmonics", a->options.harmonics, "Harmonics of the Fourier series")
      ->check(CLI::Range(2, 20))
      ->capture_default_str();
  c->add_option("--periods", a->options.periods, "Repetitions of the series")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  c->add_option("--heating", a->heating_min, "Length of the third section [min]")
      ->check(CLI::Range(0.0, 600.0))
      ->capture_default_str();
  c->add_flag("--inertia-only", a->inertia_only, "Only the first section");
  c->add_option("--evaluations", a->options.evaluations, "Number of motions to evaluate")
      ->check(CLI::Range(10, 10000000))
      ->capture_default_str();
  c->add_option("--seed", a->options.seed, "Seed of the search")->capture_default_str();
  c->add_option("--sampling,--rate", a->rate_hz, "Sampling rate of the set points [Hz]")
      ->check(CLI::Range(1.0, 100000.0))
      ->capture_default_str();
  c->add_flag("--json", a->json, "Print JSON instead of text");
  c->add_flag("--quiet", a->quiet, "No progress, no notes");
  c->footer("Example:\n  tribotwin excite mjcf/er3a_c60.xml -o motion.csv");
  c->callback([a, &code] {
    check(a->output, {a->model});
    code = or_throw(execute(*a));
  });
}

}  // namespace tribotwin::twin::program
