// tribotwin-report: pages and pictures of runs and models. stdout carries the names of the files written.
#include <charconv>
#include <cmath>
#include <functional>
#include <sstream>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/pose/video.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/render/report/days_report.hpp>
#include <tribotwin/render/report/diagnosis_report.hpp>
#include <tribotwin/render/report/fit_report.hpp>
#include <tribotwin/render/report/report.hpp>
#include <tribotwin/render/report/study_report.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/table.hpp>
#include <tribotwin/twin/numerics/solver_guard.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace {

using namespace tribotwin;
namespace fs = std::filesystem;
using twin::done, twin::failed, twin::wrong_input, twin::InputError, twin::Progress, twin::note, twin::print,
    twin::or_wrong_input, twin::or_fail;

constexpr const char* program = "tribotwin-report";

void write(const twin::Destination& output, std::string_view bytes) {
  or_fail(twin::write_file(output.file, bytes, output.existing()));
  print("{}\n", output.file);
}

/// What is read of the folder of a run.
std::vector<fs::path> run_files(const fs::path& directory) {
  return {directory / "telemetry.h5", directory / "scenario.yaml", directory / "summary.json"};
}

/// Before any work: the file must have one of the endings, and must not be an input.
void check(const twin::Destination& output, const char* what, const char* ending, const fs::path& target) {
  if (!output.file.ends_with(ending))
    throw InputError(fmt::format("-o {}: the name of {} must end in {}", output.file, what, ending));
  auto inputs = run_files(target);
  inputs.push_back(target);
  or_wrong_input(output.check(inputs));
}

/// NAME=NUMBER
std::pair<std::string, double> assignment(const char* option, const std::string& given) {
  const auto equals = given.rfind('=');
  double value = 0;
  if (equals != std::string::npos && equals > 0) {
    const char* end = given.data() + given.size();
    const auto [at, error] = std::from_chars(given.data() + equals + 1, end, value);
    if (error == std::errc{} && at == end && std::isfinite(value)) return {given.substr(0, equals), value};
  }
  throw InputError(fmt::format("{} {}: must be JOINT=NUMBER, for example joint2=0.5", option, given));
}

render::Size size_of(const std::string& given) {
  render::Size size;
  const char *at = given.data(), *end = at + given.size();
  const auto first = std::from_chars(at, end, size.width);
  if (first.ec == std::errc{} && first.ptr != end && *first.ptr == 'x') {
    const auto second = std::from_chars(first.ptr + 1, end, size.height);
    if (second.ec == std::errc{} && second.ptr == end) return size;
  }
  throw InputError(fmt::format("--size {}: must be WIDTHxHEIGHT in pixels, for example 1280x960", given));
}

struct PictureArguments {
  std::string target, size, camera, colour_by;
  twin::Destination output;
  std::optional<double> azimuth, elevation, distance;
  std::vector<double> look_at;
  bool quiet = false;

  void add_to(CLI::App& command, const char* target_help, const char* default_size, const char* default_output) {
    size = default_size;
    output.file = default_output;
    command.add_option("TARGET", target, target_help)->required();
    output.add_to(command, "File to write")->capture_default_str();
    command
        .add_option("--size", size,
                    fmt::format("WIDTHxHEIGHT in pixels, {} to {} a side", render::side_min, render::side_most))
        ->capture_default_str();
    command.add_option("--colour-by", colour_by, "What the joint housings show")
        ->check(CLI::IsMember({"temperature", "friction", "nothing"}));
    command.add_option("--camera", camera, "A camera of the model (default: overview, where there is one)");
    command.add_option("--azimuth", azimuth, "Free camera: about the vertical [deg]");
    command.add_option("--elevation", elevation, "Free camera: up from the horizontal [deg], negative looks down");
    command.add_option("--distance", distance, "Free camera: from what it looks at [m]");
    command.add_option("--look-at", look_at, "Free camera: X Y Z [m]")->expected(3);
    command.add_flag("--quiet", quiet, "No progress");
  }
  render::View view() const {
    render::View v{.camera = camera, .azimuth_deg = azimuth, .elevation_deg = elevation, .distance_m = distance};
    for (const auto& [option, value] :
         {std::pair{"--azimuth", azimuth}, {"--elevation", elevation}, {"--distance", distance}})
      if (value && !std::isfinite(*value)) throw InputError(fmt::format("{}: must be a finite number", option));
    if (distance && *distance <= 0) throw InputError(fmt::format("--distance {}: must be above 0 m", *distance));
    if (!look_at.empty()) v.look_at_m = {look_at[0], look_at[1], look_at[2]};
    return v;
  }
  render::ColourBy colours(render::ColourBy usual) const {
    return colour_by.empty()            ? usual
           : colour_by == "temperature" ? render::ColourBy::temperature
           : colour_by == "friction"    ? render::ColourBy::friction
                                        : render::ColourBy::nothing;
  }
};

/// The model and the samples of a run, for pictures of it.
std::unique_ptr<render::RunData> run_with_model(const std::string& directory) {
  auto run = or_wrong_input(render::load_run(directory));
  if (!run->model() || run->record.time_s.empty())
    throw InputError(run->missing.empty() ? directory + ": has no samples" : run->missing.front());
  for (const auto& what : run->missing) note("{}", what);
  return run;
}

/// Messages about cameras and sizes are the user's to mend; all else is not.
template <class T>
T drawn(Result<T> value) {
  if (!value && (value.error().message.starts_with("camera '") || value.error().message.starts_with("a picture of") ||
                 value.error().message.starts_with("a contact sheet of")))
    throw InputError(value.error().message);
  return or_fail(std::move(value));
}

struct PoseArguments : PictureArguments {
  std::vector<std::string> pose, temperature;
  std::optional<double> time;
};

int pose(const PoseArguments& a) {
  std::shared_ptr<const mujoco::Model> model;
  std::unique_ptr<render::RunData> run;
  render::PoseState state;
  check(a.output, "a pose", ".png", a.target);
  const render::Size size = size_of(a.size);
  if (fs::is_directory(a.target)) {
    run = run_with_model(a.target);
    model = run->scenario->model;
    const auto& time = run->record.time_s;
    std::size_t index = time.size() - 1;
    if (a.time) {
      if (!(*a.time >= time.front() && *a.time <= time.back()))
        throw InputError(fmt::format("--time {}: the record spans {} to {} s", *a.time, time.front(), time.back()));
      index = static_cast<std::size_t>(std::ranges::lower_bound(time, *a.time) - time.begin());
    }
    state = render::recorded(*model, run->record, index);
  } else {
    if (a.time) throw InputError("--time: is for the folder of a run, not for a model");
    model = or_wrong_input(mujoco::load_file(a.target));
    state = render::rest(*model);
  }
  const mjModel* m = model->get();
  for (const auto& given : a.pose) {
    if (given.find('=') == std::string::npos) {
      const int key = mj_name2id(m, mjOBJ_KEY, given.c_str());
      if (key < 0) {
        std::string names;
        for (int i = 0; i < m->nkey; ++i)
          if (const char* name = mj_id2name(m, mjOBJ_KEY, i)) names += std::string(names.empty() ? "" : ", ") + name;
        throw InputError(fmt::format("--pose {}: is neither JOINT=RAD nor a keyframe; the model has {}", given,
                                     names.empty() ? "no keyframes" : "the keyframes " + names));
      }
      state.qpos.assign(m->key_qpos + key * m->nq, m->key_qpos + (key + 1) * m->nq);
      continue;
    }
    const auto [name, value] = assignment("--pose", given);
    const int joint = mj_name2id(m, mjOBJ_JOINT, name.c_str());
    if (joint < 0 || (m->jnt_type[joint] != mjJNT_HINGE && m->jnt_type[joint] != mjJNT_SLIDE)) {
      std::string names;
      for (int i = 0; i < m->njnt; ++i)
        if (const char* other = mj_id2name(m, mjOBJ_JOINT, i); other && m->jnt_type[i] >= mjJNT_SLIDE)
          names += std::string(names.empty() ? "" : ", ") + other;
      throw InputError(fmt::format("--pose {}: the model has the hinge and slide joints {}", given, names));
    }
    state.qpos[static_cast<std::size_t>(m->jnt_qposadr[joint])] = value;
  }
  for (const auto& given : a.temperature) {
    const auto [name, value] = assignment("--temperature", given);
    const auto index = twin::find_drive(*model, name);
    if (!index) throw InputError(fmt::format("--temperature {}: {}", given, index.error().message));
    state.joints[*index].temperature_degC = value;
  }
  render::PoseOptions options;
  options.view = a.view();
  const bool speaks = run || !a.temperature.empty() || !a.colour_by.empty();
  options.colour_by = a.colours(speaks ? render::ColourBy::temperature : render::ColourBy::nothing);
  options.panel = speaks && options.colour_by != render::ColourBy::nothing;
  options.scale = run && options.colour_by == render::ColourBy::friction
                      ? render::scale_of(*model, run->record, options.colour_by)
                      : render::scale_of(*model, state, options.colour_by);
  auto painter = drawn(render::PosePainter::create(model, size));
  write(a.output, render::png(drawn(painter.draw(state, options))));
  return done;
}

/// How all pictures of one run look: one scale.
render::PoseOptions run_options(const PictureArguments& a, const render::RunData& run) {
  render::PoseOptions options;
  options.view = a.view();
  options.colour_by = a.colours(render::ColourBy::temperature);
  options.scale = render::scale_of(*run.model(), run.record, options.colour_by);
  return options;
}

struct SheetArguments : PictureArguments {
  std::size_t count = 6;
};

int sheet(const SheetArguments& a) {
  check(a.output, "a contact sheet", ".png", a.target);
  const render::Size size = size_of(a.size);
  const auto run = run_with_model(a.target);
  const auto& model = run->scenario->model;
  const render::PoseOptions options = run_options(a, *run);
  Progress progress(a.quiet, "poses");
  write(a.output,
        render::png(drawn(render::contact_sheet(model, run->record, render::evenly_in_time(run->record.time_s, a.count),
                                                options, size, [&](double share) { progress(share); }))));
  return done;
}

struct VideoArguments : PictureArguments {
  double seconds = 20;
  int frames_per_s = 25;
};

int video(const VideoArguments& a) {
  check(a.output, "a film", ".mp4", a.target);
  const render::Size size = size_of(a.size);
  const auto run = run_with_model(a.target);
  const auto& model = run->scenario->model;
  const render::PoseOptions options = run_options(a, *run);
  {
    Progress progress(a.quiet, "film");
    drawn(render::write_video(a.output.file, a.output.existing(), model, run->record, options,
                              {.size = size, .frames_per_s = a.frames_per_s, .length_s = a.seconds},
                              [&](double share) { progress(share); }));
  }
  print("{}\n", a.output.file);
  return done;
}

struct CurveArguments {
  std::string model, joint, over = "temperature";
  twin::Destination output{.file = "curve.svg"};
  std::vector<std::string> points;
  twin::identification::ReadOptions read;
  std::vector<double> temperatures, loads;
  std::optional<double> speed_max;
};

int curve(const CurveArguments& a) {
  const render::Format format = or_wrong_input(render::format_of(a.output.file));
  std::vector<fs::path> inputs(a.points.begin(), a.points.end());
  inputs.push_back(a.model);
  or_wrong_input(a.output.check(inputs));
  drive::Drive drive;
  std::string name = a.joint;
  twin::identification::ReadOptions read;
  if (a.model.ends_with(".yaml")) {
    if (!a.joint.empty())
      throw InputError(fmt::format("{}: an identified law has no joint; leave --joint out", a.model));
    const auto file = or_wrong_input(render::read_parameter_file(a.model, a.read));
    drive = render::drawn_drive(file);
    read = {.torque_max_nm = file.torque_max_nm, .gear_ratio = file.gear_ratio};
    name = fs::path(a.model).stem().string();
  } else {
    if (a.joint.empty()) throw InputError("--joint is needed: a model has several");
    if (a.read.torque_max_nm > 0 || a.read.gear_ratio > 0)
      throw InputError("--tau-max, --gear-ratio: are for PARAMS.yaml; a model has its own");
    const auto model = or_wrong_input(mujoco::load_file(a.model));
    const auto index = twin::find_drive(*model, a.joint);
    if (!index) throw InputError(fmt::format("{}: --joint {}", a.model, index.error().message));
    drive = model->drives()[*index].drive;
    read = {.torque_max_nm = drive.torque_max_nm, .gear_ratio = drive.gear_ratio};
  }
  const auto& law = *drive.law.info;
  const auto measured = or_wrong_input(
      twin::identification::read_samples(std::vector<fs::path>(a.points.begin(), a.points.end()), law, read));
  constexpr std::size_t points_most = 5000;
  if (measured.size() > points_most) note("{} of the {} points are drawn, chosen evenly", points_most, measured.size());
  const auto points = render::friction_points(drive, measured, render::thinned(measured.size(), points_most));
  const double speed_points = measured.size() ? std::ranges::max(measured.speed) / drive.speed_scale() : 0;
  const auto limit = [](double given, double otherwise) {
    return std::abs(given) < friction::unlimited ? given : otherwise;
  };
  const friction::Range& range = drive.law.range;
  // Shown without being asked: the points or the law's own range, where that has an end.
  const double range_speed = limit(range.speed_max_rad_s / drive.speed_scale(), 280 / drive.gear_ratio);
  const double speed = a.speed_max        ? *a.speed_max / drive.gear_ratio
                       : speed_points > 0 ? std::min(1.05 * speed_points, std::max(speed_points, range_speed))
                                          : range_speed;
  const auto spread = [](double from, double to, int count) {
    std::vector<double> v;
    for (int i = 0; i < count; ++i) v.push_back(from + (to - from) * i / (count - 1));
    return from < to ? v : std::vector{from};
  };
  const double t_low = limit(range.temperature_min_degC, 20), t_high = limit(range.temperature_max_degC, 80),
               load_high = limit(range.load_max, 0.8);
  auto temperatures = a.temperatures, loads = a.loads;
  const bool over_load = a.over == "load";
  if (temperatures.empty()) temperatures = over_load ? std::vector{(t_low + t_high) / 2} : spread(t_low, t_high, 8);
  if (loads.empty()) loads = over_load ? spread(0, load_high, 6) : std::vector{0.0};
  if (over_load && temperatures.size() != 1)
    throw InputError("--temperature: curves over load are drawn at one temperature");
  if (!over_load && loads.size() != 1) throw InputError("--load: curves over temperature are drawn at one load");
  const auto at_load = [&] {
    return fmt::format("{}: law '{}'{}", name, law.name,
                       law.load_dependent ? fmt::format(" at a load of {:g}", loads[0]) : "");
  };
  if (!law.temperature_dependent && !over_load) note("law '{}' does not depend on temperature", law.name);
  if (!law.load_dependent && over_load) note("law '{}' does not depend on load", law.name);
  render::Figure figure;
  if (over_load)
    figure = render::friction_against_load(
        drive,
        fmt::format("{}: law '{}'{}", name, law.name,
                    law.temperature_dependent ? fmt::format(" at {:.4g} °C", temperatures[0]) : ""),
        speed, temperatures[0], loads, points);
  else if (a.over == "surface")
    figure = render::friction_surface(drive, at_load(), speed, loads[0], std::ranges::min(temperatures),
                                      std::max(std::ranges::max(temperatures), std::ranges::min(temperatures) + 1));
  else if (!law.temperature_dependent)
    figure = render::friction_against_speed(drive, at_load(), speed, loads[0], points);
  else
    figure = render::friction_against_temperature(drive, at_load(), speed, loads[0], temperatures, points);
  write(a.output, or_fail(render::draw(figure, format)));
  return done;
}

/// Options of every page.
struct PageArguments {
  twin::Destination output;
  bool png = false, pdf = false, quiet = false;

  void add_to(CLI::App& command, const char* help) {
    output.add_to(command, help);
    command.add_flag("--png", png, "Also every figure as PNG, in a folder beside the page");
    command.add_flag("--pdf", pdf, "Also every figure as PDF, in a folder beside the page");
    command.add_flag("--quiet", quiet, "No progress");
  }
};

struct ReportArguments : PageArguments {
  std::vector<std::string> runs;
};

/// The page and its figures as files: what was asked for is checked before any work, written at the end.
class PageFile {
 public:
  /// The page is `otherwise` where no -o says so.
  PageFile(const PageArguments& a, const fs::path& otherwise, const std::vector<fs::path>& inputs)
      : output_(a.output), quiet_(a.quiet) {
    if (!output_.named()) output_.file = otherwise.string();
    or_wrong_input(output_.check(inputs));
    if (a.png) formats_.push_back(render::Format::png);
    if (a.pdf) formats_.push_back(render::Format::pdf);
    figures_ = output_.file;
    figures_.replace_extension();
    figures_ += "_figures";
    if (!formats_.empty() && !output_.force && fs::exists(figures_))
      throw InputError(fmt::format("{}: exists; choose another name with -o, or replace what is in it with --force",
                                   figures_.string()));
  }

  /// What `report` makes of the options, as files.
  int make(const std::string& command,
           const std::function<Result<render::Report>(const render::ReportOptions&)>& report) const {
    const render::Report made = [&] {
      Progress progress(quiet_, "report");
      return or_fail(
          report({.figure_files = formats_, .command = command, .progress = [&](double share) { progress(share); }}));
    }();
    write_all(made);
    return done;
  }

 private:
  void write_all(const render::Report& made) const {
    for (const auto& text : made.notes) note("{}", text);
    if (!made.figures.empty()) {
      std::error_code error;
      fs::create_directory(figures_, error);
      if (error)
        throw std::runtime_error(fmt::format("{}: cannot be created ({})", figures_.string(), error.message()));
      for (const auto& file : made.figures)
        or_fail(twin::write_file(figures_ / file.name, file.bytes, output_.existing()));
      print("{}/ ({} figures)\n", figures_.string(), made.figures.size());
    }
    write(output_, made.html);
  }

  twin::Destination output_;
  bool quiet_;
  fs::path figures_;
  std::vector<render::Format> formats_;
};

int report(const ReportArguments& a, const std::string& command) {
  if (a.runs.empty()) throw InputError("names no folder of a run; 'tribotwin-report --help' shows how it is used");
  std::vector<std::unique_ptr<render::RunData>> runs;
  for (const auto& directory : a.runs)
    std::ranges::move(or_wrong_input(render::load_runs(directory)), std::back_inserter(runs));
  std::vector<fs::path> inputs;
  for (const auto& directory : a.runs) std::ranges::move(run_files(directory), std::back_inserter(inputs));
  const PageFile page(a, a.runs.size() == 1 ? fs::path(a.runs[0]) / "report.html" : fs::path("report.html"), inputs);
  return page.make(command, [&](const render::ReportOptions& options) { return render::make_report(runs, options); });
}

struct FitArguments : PageArguments {
  std::string parameters;
  std::vector<std::string> data;
  twin::identification::ReadOptions read;
};

std::vector<fs::path> with(const std::vector<std::string>& files, const fs::path& file) {
  std::vector<fs::path> all(files.begin(), files.end());
  all.push_back(file);
  return all;
}

int fit(const FitArguments& a, const std::string& command) {
  const PageFile page(a, "fit.html", with(a.data, a.parameters));
  const auto data = or_wrong_input(render::load_fit(a.parameters, {a.data.begin(), a.data.end()}, a.read));
  return page.make(command,
                   [&](const render::ReportOptions& options) { return render::make_fit_report(data, options); });
}

struct DiagnosisArguments : PageArguments {
  std::string healthy;
  std::vector<std::string> data;
  twin::diagnosis::ObservationOptions read;
  render::DiagnosisOptions diagnosis;
};

int diagnosis(const DiagnosisArguments& a, const std::string& command) {
  const PageFile page(a, "diagnosis.html", with(a.data, a.healthy));
  const auto data =
      or_wrong_input(render::load_diagnosis(a.healthy, {a.data.begin(), a.data.end()}, a.read, a.diagnosis));
  return page.make(command,
                   [&](const render::ReportOptions& options) { return render::make_diagnosis_report(data, options); });
}

struct FolderArguments : PageArguments {
  std::string directory;

  void add_to(CLI::App& command, const char* directory_help) {
    command.add_option("DIR", directory, directory_help)->required();
    PageArguments::add_to(command, "The page (default: DIR/report.html)");
  }
  PageFile page() const { return {*this, fs::path(directory) / "report.html", {}}; }
};

int days(const FolderArguments& a, const std::string& command) {
  const PageFile page = a.page();
  const auto data = or_wrong_input(render::load_days(a.directory));
  return page.make(command,
                   [&](const render::ReportOptions& options) { return render::make_days_report(data, options); });
}

int study(const FolderArguments& a, const std::string& command) {
  const auto joints = render::load_study_folder(a.directory);
  const PageFile page = a.page();
  return page.make(command, [&](const render::ReportOptions& options) {
    return render::make_study_report(a.directory, joints, options);
  });
}

}  // namespace

int main(int argc, char** argv) {
  twin::prepare_streams();
  mujoco::install_message_handlers();
  twin::identification::exit_on_solver_failure(program);

  CLI::App app{"tribotwin-report: runs, laws and poses as one page or single pictures; needs no display"};
  app.set_version_flag("--version",
                       std::string("tribotwin-report " TRIBOTWIN_VERSION ", MuJoCo ") + mj_versionString());
  app.require_subcommand(0, 1);
  ReportArguments r;
  app.add_option("RUNDIR", r.runs, "Folders of runs, or of a scenario that varies; several runs are compared");
  r.add_to(app, "The page (default: RUNDIR/report.html; report.html for several)");
  app.footer("Example:\n  tribotwin-report runs/irb6620_warmup -o report.html");

  PoseArguments p;
  auto* pose_command = app.add_subcommand("pose", "A picture of a model, or of a run at one time");
  p.add_to(*pose_command, "MJCF model, or the folder of a run", "1280x960", "pose.png");
  pose_command
      ->add_option("--pose", p.pose, "JOINT=RAD (metres for a slide) or the name of a keyframe; may be repeated")
      ->allow_extra_args(false);
  pose_command->add_option("--temperature", p.temperature, "JOINT=DEGC; may be repeated")->allow_extra_args(false);
  pose_command->add_option("--time", p.time, "Time of the run [s] (default: its end)");
  pose_command->footer(
      "Example:\n  tribotwin-report pose mjcf/irb6620.xml --pose joint2=0.6 --temperature joint2=72 -o pose.png");

  CurveArguments c;
  auto* curve_command = app.add_subcommand("curve", "The friction law of a joint, or an identified one, as a figure");
  curve_command->add_option("MODEL", c.model, "MJCF model, or PARAMS.yaml of tribotwin identify")->required();
  curve_command->add_option("--joint", c.joint, "Joint with a drive, of a model");
  curve_command->add_option("--over", c.over, "What the curves differ in")
      ->check(CLI::IsMember({"temperature", "load", "surface"}))
      ->capture_default_str();
  curve_command->add_option("--temperature", c.temperatures, "One or more [degC] (default: the law's range)")
      ->check(CLI::Range(-273.15, 1000.0));
  curve_command
      ->add_option("--load", c.loads, "One or more, load torque / torque_max_nm [-] (default: 0, or the law's range)")
      ->check(CLI::Range(-1000.0, 1000.0));
  curve_command->add_option("--speed-max", c.speed_max, "Largest speed, motor side [rad/s] (default: the law's range)")
      ->check(CLI::Range(1e-6, 1e6));
  curve_command
      ->add_option(
          "--points", c.points,
          "Measured friction, with error bars where the file has them, as for tribotwin identify; may be repeated")
      ->allow_extra_args(false);
  c.output.add_to(*curve_command, "File to write: .svg, .png or .pdf")->capture_default_str();
  curve_command->footer("Example:\n  tribotwin-report curve mjcf/irb6620.xml --joint joint2 -o curve.svg");

  const auto add_units = [](CLI::App& command, twin::identification::ReadOptions& read) {
    command
        .add_option("--tau-max", read.torque_max_nm,
                    "Largest manipulation torque [Nm], arm side (default: that of PARAMS.yaml)")
        ->check(CLI::Range(1e-9, 1e9));
    command.add_option("--gear-ratio", read.gear_ratio, "Motor turns per joint turn (default: that of PARAMS.yaml)")
        ->check(CLI::Range(1e-6, 1e6));
  };
  add_units(*curve_command, c.read);

  FitArguments f;
  auto* fit_command =
      app.add_subcommand("fit", "An identified law as a page: parameters, curves over points, residuals, correlation");
  fit_command->add_option("PARAMS", f.parameters, "PARAMS.yaml of tribotwin identify or calibrate")->required();
  fit_command->add_option(
      "DATA", f.data,
      "Friction curves, recordings or telemetry.h5 to show the law with (default: those that PARAMS.yaml names)");
  f.add_to(*fit_command, "The page (default: fit.html)");
  add_units(*fit_command, f.read);
  fit_command->add_option("--joint", f.read.joint, "Joint of a telemetry.h5");
  fit_command->footer("Example:\n  tribotwin-report fit params.yaml -o fit.html");

  DiagnosisArguments d;
  auto* diagnosis_command =
      app.add_subcommand("diagnosis", "Verdicts on a joint as a page: distances, regions, causes, trend");
  diagnosis_command->add_option("HEALTHY", d.healthy, "healthy.yaml of tribotwin diagnose learn")->required();
  diagnosis_command->add_option("CURVES", d.data, "Friction curves, recordings or telemetry.h5, in the order of time")
      ->required();
  d.add_to(*diagnosis_command, "The page (default: diagnosis.html)");
  diagnosis_command->add_option("--false-alarm", d.diagnosis.check.false_alarm, "As of tribotwin diagnose check")
      ->check(CLI::Range(1e-9, 0.5))
      ->capture_default_str();
  diagnosis_command
      ->add_option("--tau-max", d.read.torque_max_nm,
                   "Largest manipulation torque [Nm], arm side, for curves in friction_norm alone")
      ->check(CLI::Range(1e-9, 1e9));
  diagnosis_command->add_option("--gear-ratio", d.read.gear_ratio, "Motor turns per joint turn, for recordings")
      ->check(CLI::Range(1e-6, 1e6));
  diagnosis_command->add_option("--joint", d.read.joint, "Joint of a telemetry.h5");
  diagnosis_command->footer(
      "Example:\n  tribotwin-report diagnosis healthy.yaml lab/br609/curves.csv -o diagnosis.html");

  FolderArguments days_arguments;
  auto* days_command = app.add_subcommand("days",
                                          "Robots over working days as a page: time constants, friction over the day, "
                                          "torques cold and hot, parameters over tests, changes");
  days_arguments.add_to(*days_command, "Folder of tribotwin lab for a campaign of working days");
  days_command->footer("Example:\n  tribotwin-report days lab/days -o days.html");

  FolderArguments study_arguments;
  auto* study_command = app.add_subcommand("study",
                                           "Paper 2's study as a page: friction cold to hot and under load, features, "
                                           "regions, distances, faults, ROC curves");
  study_arguments.add_to(*study_command, "Folder of tribotwin lab for a study of joints");
  study_command->footer("Example:\n  tribotwin-report study lab/diagnosis -o study.html");

  SheetArguments s;
  auto* sheet_command = app.add_subcommand("sheet", "Poses over a run in one picture");
  s.add_to(*sheet_command, "Folder of a run", "640x480", "sheet.png");
  sheet_command->add_option("--count", s.count, "How many, evenly in time")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  sheet_command->footer("Example:\n  tribotwin-report sheet runs/irb6620_warmup --count 9 -o sheet.png");

  VideoArguments v;
  auto* video_command = app.add_subcommand("video", "A run as a film (needs ffmpeg)");
  v.add_to(*video_command, "Folder of a run", "960x720", "video.mp4");
  video_command->add_option("--seconds", v.seconds, "Length of the film [s]")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  video_command->add_option("--fps", v.frames_per_s, "Frames per second")
      ->check(CLI::Range(1, 240))
      ->capture_default_str();
  video_command->footer("Example:\n  tribotwin-report video runs/irb6620_warmup --seconds 4 -o warmup.mp4");

  return twin::finish(program, [&]() -> int {
    try {
      app.parse(argc, argv);
      if (*pose_command) return pose(p);
      if (*curve_command) return curve(c);
      if (*sheet_command) return sheet(s);
      if (*video_command) return video(v);
      std::string command = program;
      for (int i = 1; i < argc; ++i) command += " " + render::shell_word(argv[i]);
      if (*diagnosis_command) return diagnosis(d, command);
      if (*days_command) return days(days_arguments, command);
      if (*study_command) return study(study_arguments, command);
      return *fit_command ? fit(f, command) : report(r, command);
    } catch (const CLI::ParseError& e) {
      std::ostringstream out, error;
      const int code = app.exit(e, out, error);
      twin::print_text(out.str());
      twin::report_text(error.str());
      return code == 0 ? done : wrong_input;
    } catch (const InputError& e) {
      return report_error(program, wrong_input, e.what());
    } catch (const std::exception& e) {
      return report_error(program, failed, e.what());
    }
  }());
}
