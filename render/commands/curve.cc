#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/render/commands/program.hpp>
#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/report/fit_data.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/numerics/median.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render::program {
namespace {

using twin::InputError, twin::identification::ReadOptions;

constexpr std::size_t points_max = 5000;
/// A point this close to the condition of the curves is drawn with them.
constexpr double temperature_window_K = 3, load_window = 0.05;

struct Arguments {
  std::string model, joint, over = "temperature", size = "640x430";
  twin::Destination output{.file = "curve.svg"};
  std::vector<std::string> points;
  ReadOptions read;
  twin::TableArguments tables;
  std::vector<double> temperatures, loads;
  std::optional<double> speed_max;
};

FigureSize size_of(const std::string& given) {
  const auto sides = width_and_height(given);
  if (sides && std::min(sides->first, sides->second) >= 200 && std::max(sides->first, sides->second) <= 4000)
    return {sides->first, sides->second};
  throw InputError(fmt::format("--size {}: must be WIDTHxHEIGHT, 200 to 4000 a side, for example 640x430", given));
}

/// The drive whose law is drawn.
struct Subject {
  std::string name;
  drive::Drive drive;
  ReadOptions read;  ///< of measured points
  bool slide = false;
  std::optional<friction::Uncertainty> uncertainty{};  ///< of an identified law
  const friction::Uncertainty* band() const { return uncertainty ? &*uncertainty : nullptr; }
};

Subject identified_law(const Arguments& a) {
  if (!a.joint.empty()) throw InputError(fmt::format("{}: an identified law has no joint; leave --joint out", a.model));
  const auto file = twin::or_wrong_input(read_parameter_file(a.model, a.read));
  return {.name = std::filesystem::path(a.model).stem().string(),
          .drive = drawn_drive(file),
          .read = {.torque_max_nm = file.torque_max_nm, .gear_ratio = file.gear_ratio},
          .uncertainty = uncertainty_of(file)};
}

Subject joint_of_model(const Arguments& a) {
  if (a.joint.empty()) throw InputError("--joint is needed: a model has several");
  if (a.read.torque_max_nm > 0 || a.read.gear_ratio > 0)
    throw InputError("--tau-max, --gear-ratio: are for PARAMS.yaml; a model has its own");
  const auto model = twin::or_wrong_input(mujoco::load_file(twin::given_or_shipped(a.model, ".xml")));
  const auto index = twin::find_drive(*model, a.joint);
  if (!index) throw InputError(fmt::format("{}: --joint {}", a.model, index.error().message));
  const auto& drive = model->drives()[*index].drive;
  return {.name = a.joint,
          .drive = drive,
          .read = {.torque_max_nm = drive.torque_max_nm, .gear_ratio = drive.gear_ratio},
          .slide = twin::is_slide(model->get(), model->drives()[*index])};
}

/// Where the curves are drawn. At least one of the lists has one entry.
struct Conditions {
  double speed_max_rad_s;  ///< joint side
  std::vector<double> temperatures, loads;
};

double limit(double given, double otherwise) { return std::abs(given) < friction::unlimited ? given : otherwise; }

/// Curves through points are drawn where most of these were measured.
double of_points(const std::vector<double>& column, double without_points) {
  return column.empty() ? without_points : twin::identification::median_of(column);
}

/// What was asked for; otherwise, through points, the load or the temperature of most of them; up to the fastest point,
/// or over the law's own range where that has an end.
Conditions conditions_of(const Arguments& a, const drive::Drive& drive, const twin::identification::Samples& measured) {
  const friction::Range& range = drive.law.range;
  const double points = measured.size() ? std::ranges::max(measured.speed) / drive.speed_scale() : 0,
               law = limit(range.speed_max_rad_s / drive.speed_scale(), 280 / drive.gear_ratio);
  Conditions c{.speed_max_rad_s = a.speed_max  ? *a.speed_max / drive.gear_ratio
                                  : points > 0 ? std::min(1.05 * points, std::max(points, law))
                                               : law,
               .temperatures = a.temperatures,
               .loads = a.loads};
  const double t_low = limit(range.temperature_min_degC, 20), t_high = limit(range.temperature_max_degC, 80),
               load_high = limit(range.load_max, 0.8);
  const bool over_load = a.over == "load";
  if (c.temperatures.empty())
    c.temperatures =
        over_load ? std::vector{of_points(measured.temperature_degC, (t_low + t_high) / 2)} : evenly(t_low, t_high, 8);
  if (c.loads.empty()) c.loads = over_load ? evenly(0, load_high, 6) : std::vector{of_points(measured.load, 0)};
  if (over_load && c.temperatures.size() != 1)
    throw InputError("--temperature: curves over load are drawn at one temperature");
  if (!over_load && c.loads.size() != 1) throw InputError("--load: curves over temperature are drawn at one load");
  return c;
}

/// The samples that were measured where the curves are drawn: points of another load or temperature would seem to
/// contradict them.
std::vector<std::size_t> measured_there(const Arguments& a, const Subject& subject, const Conditions& c,
                                        const twin::identification::Samples& measured) {
  const auto& law = *subject.drive.law.info;
  const bool over_load = a.over == "load";
  const auto near = [](const std::vector<double>& column, std::size_t i, double at, double window) {
    return column.empty() || std::abs(column[i] - at) <= window;
  };
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < measured.size(); ++i)
    if (over_load
            ? !law.temperature_dependent || near(measured.temperature_degC, i, c.temperatures[0], temperature_window_K)
            : !law.load_dependent || near(measured.load, i, c.loads[0], load_window))
      rows.push_back(i);
  const std::string where = over_load ? fmt::format("{:.4g} degC +- {:g}", c.temperatures[0], temperature_window_K)
                                      : fmt::format("a load of {:.3g} +- {:g}", c.loads[0], load_window);
  if (rows.size() < measured.size())
    twin::note("{} of the {} points are not drawn: they were not measured at {}, where the curves are",
               measured.size() - rows.size(), measured.size(), where);
  return rows;
}

Figure figure_of(const std::string& over, const Subject& subject, const Conditions& c,
                 const std::vector<FrictionPoint>& points) {
  const auto& law = *subject.drive.law.info;
  const std::string of = fmt::format("{}: law '{}'", subject.name, law.name);
  if (over == "load") {
    if (!law.load_dependent) twin::note("law '{}' does not depend on load", law.name);
    const std::string at = law.temperature_dependent ? fmt::format(" at {:.4g} °C", c.temperatures[0]) : "";
    return friction_against_load(subject.drive, of + at, c.speed_max_rad_s, c.temperatures[0], c.loads, points,
                                 subject.band());
  }
  if (!law.temperature_dependent) twin::note("law '{}' does not depend on temperature", law.name);
  const std::string title = of + (law.load_dependent ? fmt::format(" at a load of {:g}", c.loads[0]) : "");
  if (over == "surface") {
    const auto [low, high] = std::ranges::minmax(c.temperatures);
    return friction_surface(subject.drive, title, c.speed_max_rad_s, c.loads[0], low, std::max(high, low + 1));
  }
  if (!law.temperature_dependent)
    return friction_against_speed(subject.drive, title, c.speed_max_rad_s, c.loads[0], points, subject.band());
  return friction_against_temperature(subject.drive, title, c.speed_max_rad_s, c.loads[0], c.temperatures, points,
                                      subject.band());
}

int execute(const Arguments& a) {
  const Format format = twin::or_throw(format_of(a.output.file));
  twin::or_wrong_input(a.output.check(inputs(a.points, a.model)));
  const FigureSize size = size_of(a.size);
  const Subject subject = a.model.ends_with(".yaml") ? identified_law(a) : joint_of_model(a);
  ReadOptions read = subject.read;
  read.table = twin::or_wrong_input(a.tables.options());
  read.table.joint = a.joint;
  const auto measured = twin::or_wrong_input(twin::identification::read_samples(
      std::vector<std::filesystem::path>(a.points.begin(), a.points.end()), *subject.drive.law.info, read));
  const Conditions conditions = conditions_of(a, subject.drive, measured);
  const auto there = measured_there(a, subject, conditions, measured);
  if (there.size() > points_max) twin::note("{} of the {} points are drawn, chosen evenly", points_max, there.size());
  std::vector<std::size_t> rows;
  for (const std::size_t i : thinned(there.size(), points_max)) rows.push_back(there[i]);
  const auto points = friction_points(subject.drive, measured, rows);
  write(a.output,
        twin::or_throw(draw(in_units_of(figure_of(a.over, subject, conditions, points), subject.slide), format, size)));
  return twin::done;
}

}  // namespace

void add_curve(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("curve", "The friction law of a joint, or an identified one, as a figure");
  command->add_option("MODEL", a->model, "MJCF model, or PARAMS.yaml of tribotwin identify")->required();
  command->add_option("--joint", a->joint, "Joint with a drive, of a model");
  command->add_option("--over", a->over, "What the curves differ in")
      ->check(CLI::IsMember({"temperature", "load", "surface"}))
      ->capture_default_str();
  command->add_option("--temperature", a->temperatures, "One or more [degC] (default: the law's range)")
      ->check(CLI::Range(-273.15, 1000.0));
  command
      ->add_option("--load", a->loads, "One or more, load torque / torque_max_nm [-] (default: 0, or the law's range)")
      ->check(CLI::Range(-1000.0, 1000.0));
  command->add_option("--speed-max", a->speed_max, "Largest speed, motor side [rad/s] (default: the law's range)")
      ->check(CLI::Range(1e-6, 1e6));
  command
      ->add_option(
          "--points", a->points,
          "Measured friction, with error bars where the file has them, as for tribotwin identify; may be repeated")
      ->allow_extra_args(false);
  a->output.add_to(*command, "File to write: .svg, .png or .pdf")->capture_default_str();
  a->output.add_json_to(*command);
  command->add_option("--size", a->size, "WIDTHxHEIGHT [1/96 inch]; a PNG has twice the pixels")->capture_default_str();
  add_units(*command, a->read);
  a->tables.add_to(*command);
  command->footer("Example:\n  tribotwin-report curve mjcf/irb6620.xml --joint joint2 -o curve.svg");
  command->callback([a, &call] { call.code = execute(*a); });
}

}  // namespace tribotwin::render::program
