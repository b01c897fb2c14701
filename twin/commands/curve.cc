#include <cmath>
#include <cstdint>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/experiments/friction/experiment.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::program {
namespace {

/// FROM:TO:COUNT, evenly spaced.
std::vector<double> speeds_of(const std::string& text) {
  double parts[3];
  std::string_view rest = text;
  for (double& part : parts) {
    const bool last = &part == parts + 2;
    const auto colon = rest.find(':');
    const auto value = to_number(rest.substr(0, colon));
    if (!value || last != (colon == rest.npos))
      throw InputError(fmt::format("--speeds {}: must be FROM:TO:COUNT in motor rad/s, for example 1:280:50", text));
    part = *value;
    if (!last) rest.remove_prefix(colon + 1);
  }
  const double count = parts[2];
  if (!(std::isfinite(parts[0]) && std::isfinite(parts[1])) || count < 1 || count > 1e6 || count != std::floor(count))
    throw InputError(
        fmt::format("--speeds {}: FROM and TO must be finite and COUNT a whole number from 1 to 1000000", text));
  std::vector<double> speeds;
  for (int i = 0; i < static_cast<int>(count); ++i)
    speeds.push_back(count == 1 ? parts[0] : parts[0] + (parts[1] - parts[0]) * i / (count - 1));
  return speeds;
}

struct Arguments {
  std::string model, joint, speeds = "1:280:50", load_by = "torque";
  Destination output;
  double temperature = 50, load = 0, noise = 0;
  std::uint64_t seed = 1;
  bool experiment = false, json = false, quiet = false;
};

/// The columns of a curve; both directions where they differ.
struct Column {
  const char* name;
  double (*value)(const CurvePoint& p, double torque_max_nm);
  bool of_direction = false;
};
constexpr Column columns[] = {
    {"speed_rad_s", [](const CurvePoint& p, double) { return p.speed_rad_s; }},
    {"load_norm", [](const CurvePoint& p, double) { return p.load_norm; }},
    {"temperature_degC", [](const CurvePoint& p, double) { return p.temperature_degC; }},
    {"friction_norm", [](const CurvePoint& p, double) { return p.friction_norm; }},
    {"friction_nm", [](const CurvePoint& p, double) { return p.friction_nm; }},
    {"stderr_nm", [](const CurvePoint& p, double) { return p.stderr_nm; }},
    {"friction_forward_norm", [](const CurvePoint& p, double max) { return p.forward_nm / max; }, true},
    {"friction_backward_norm", [](const CurvePoint& p, double max) { return p.backward_nm / max; }, true},
    {"friction_forward_nm", [](const CurvePoint& p, double) { return p.forward_nm; }, true},
    {"friction_backward_nm", [](const CurvePoint& p, double) { return p.backward_nm; }, true},
};

std::vector<Column> columns_of(const drive::Drive& drive) {
  std::vector<Column> shown(std::begin(columns), std::end(columns));
  if (drive.asymmetry == 0 && drive.offset_nm == 0)
    std::erase_if(shown, [](const Column& c) { return c.of_direction; });
  return shown;
}

std::string json_of(const drive::Drive& drive, const std::vector<CurvePoint>& points) {
  nlohmann::ordered_json json{{"law", drive.law.info->name}, {"points", nlohmann::ordered_json::array()}};
  for (const auto& p : points) {
    nlohmann::ordered_json point;
    for (const Column& c : columns_of(drive)) point[c.name] = c.value(p, drive.torque_max_nm);
    json["points"].push_back(std::move(point));
  }
  return dump_json(json, 2) + "\n";
}

std::string csv_of(const drive::Drive& drive, const std::vector<CurvePoint>& points) {
  std::string text;
  const auto shown = columns_of(drive);
  for (const Column& c : shown) text += fmt::format("{}{}", text.empty() ? "" : ",", c.name);
  text += "\n";
  for (const auto& p : points)
    for (const Column& c : shown)
      text += fmt::format("{}{}", c.value(p, drive.torque_max_nm), &c == &shown.back() ? "\n" : ",");
  return text;
}

Result<Exit> deliver_points(const Arguments& a, const drive::Drive& drive, const std::vector<CurvePoint>& points) {
  int outside = 0;
  for (const auto& p : points)
    outside += friction::level(drive.law, friction::at_temperature(drive.law, p.temperature_degC),
                               p.speed_rad_s / drive.gear_ratio * drive.speed_scale(), p.load_norm)
                   .outside;
  if (outside && !a.quiet)
    note("{} of {} points lie outside the range in which law '{}' was identified; its validity policy applies", outside,
         points.size(), drive.law.info->name);
  return deliver(a.json ? json_of(drive, points) : csv_of(drive, points), a.output);
}

/// The curve of an identified law. Where the file does not say the largest torque or the gear, normalised torque stays
/// so.
Result<Exit> of_parameters(const Arguments& a, const std::vector<double>& speeds) {
  if (a.experiment || !a.joint.empty())
    throw InputError(fmt::format("{}: an identified law has no joint to experiment with; give a model", a.model));
  const auto file = or_wrong_input(identification::read_parameters(a.model));
  drive::Drive drive;
  drive.law = file.law;
  drive.torque_max_nm = file.torque_max_nm > 0 ? file.torque_max_nm : 1;
  drive.gear_ratio = file.gear_ratio > 0 ? file.gear_ratio : 1;
  drive.asymmetry = file.asymmetry;
  drive.offset_nm = file.offset * drive.torque_scale_nm();
  if (!(file.torque_max_nm > 0) && !a.quiet)
    note("{}: holds no torque_max_nm; {} is that of 1 Nm", a.model,
         file.law.info->normalised ? "friction_nm" : "friction_norm");
  return deliver_points(a, drive, law_curve(drive, speeds, a.load, a.temperature));
}

Result<Exit> execute(const Arguments& a) {
  const auto speeds = speeds_of(a.speeds);
  for (const auto& [option, value] :
       {std::pair{"--temperature", a.temperature}, {"--load", a.load}, {"--torque-noise-nm", a.noise}})
    if (!std::isfinite(value)) throw InputError(fmt::format("{} {}: must be a finite number", option, value));
  if (a.model.ends_with(".yaml")) return of_parameters(a, speeds);
  if (a.joint.empty()) throw InputError("--joint is needed: a model has several");
  const auto model = mujoco::load_file(given_or_shipped(a.model, ".xml"));
  if (!model) throw InputError(model.error().message);
  const auto found = find_drive(**model, a.joint);
  if (!found) throw InputError(fmt::format("{}: --joint {}", a.model, found.error().message));
  const std::size_t index = *found;
  const auto& drive = (*model)->drives()[index].drive;
  std::vector<CurvePoint> points;
  if (a.experiment) {
    for (const double v : speeds)
      if (v == 0) throw InputError("--speeds: a measurement needs a speed other than 0");
    Progress progress(a.quiet);
    auto measured = measure_curve(**model, index, speeds,
                                  {.load_norm = a.load,
                                   .temperature_degC = a.temperature,
                                   .load_by = a.load_by == "pose" ? LoadBy::pose : LoadBy::torque,
                                   .noise_nm = a.noise,
                                   .seed = a.seed,
                                   .progress = [&](double share) { progress(share); }});
    points = or_throw(std::move(measured));
  } else {
    points = law_curve(drive, speeds, a.load, a.temperature);
  }
  if (!a.quiet) note_starting_point(**model, (*model)->drives()[index]);
  return deliver_points(a, drive, points);
}

}  // namespace

void add_curve(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("curve", "Friction over speed: the law, or as an experiment measures it");
  command->add_option("MODEL", a->model, "MJCF model, or PARAMS.yaml of tribotwin identify")->required();
  command->add_option("--joint", a->joint, "Joint with a drive, of a model");
  command->add_option("--temperature", a->temperature, "Lubricant temperature [degC]")
      ->capture_default_str()
      ->check(CLI::Range(-273.15, 1000.0));
  command->add_option("--load", a->load, "Load torque / torque_max_nm [-]")
      ->capture_default_str()
      ->check(CLI::Range(-1000.0, 1000.0));
  command->add_option("--speeds", a->speeds, "FROM:TO:COUNT, motor side [rad/s]")->capture_default_str();
  command->add_flag("--experiment", a->experiment,
                    "Measure in simulation by the plus-minus procedure of Bittencourt 2012");
  command->add_option("--load-by", a->load_by, "What holds the load in the experiment")
      ->check(CLI::IsMember({"torque", "pose"}))
      ->capture_default_str();
  command
      ->add_option("--torque-noise-nm,--noise", a->noise,
                   "Standard deviation of the measured motor torque, arm side [Nm]")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e9));
  command->add_option("--seed", a->seed, "Seed of the noise")->capture_default_str();
  a->output.add_to(*command, "CSV to write (default: stdout)", ",--csv");
  command->add_flag("--json", a->json, "Print JSON instead of CSV");
  command->add_flag("--quiet", a->quiet, "No progress, no notes");
  command->footer(
      "Example:\n  tribotwin curve mjcf/irb6620.xml --joint joint2 --temperature 50 --load 0.3 --speeds 1:280:10 "
      "--experiment");
  command->callback([a, &code] {
    check(a->output, {a->model});
    code = or_throw(execute(*a));
  });
}

}  // namespace tribotwin::twin::program
