#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/twin/commands/joint_export.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/gears/drive_elements.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/samples/recording.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/robot/native_model.hpp>

namespace tribotwin::twin::program {
namespace {

void require_record(const std::string& directory) {
  if (!std::filesystem::exists(std::filesystem::path(directory) / "telemetry.h5"))
    throw InputError(fmt::format("{}/telemetry.h5: does not exist", directory));
}

Result<Exit> recover_record(const std::string& directory, bool json) {
  require_record(directory);
  FolderLock lock;
  or_fail(lock.take(directory));
  const auto result = recover(directory);
  if (!result) return work_failed(result.error().message);
  if (json) {
    const nlohmann::ordered_json done_so{{"file", directory + "/telemetry.h5"},  {"was_complete", result->was_plain},
                                         {"samples", result->samples},           {"last_time_s", result->last_time_s},
                                         {"lost_samples", result->lost_samples}, {"lost_cycles", result->lost_cycles}};
    return deliver(dump_json(done_so, 2) + "\n");
  }
  if (result->was_plain) {
    print("{}/telemetry.h5 is a complete HDF5 file without damage; there was nothing to recover\n", directory);
    return done;
  }
  print("{0}/telemetry.h5: {1} samples up to {2:.6g} s recovered; the original is kept as {0}/telemetry.h5.original\n",
        directory, result->samples, result->last_time_s);
  if (result->lost_samples > 0 || result->lost_cycles > 0)
    note("{} samples and {} work cycles are damaged (cut off, or with a wrong checksum) and left out",
         result->lost_samples, result->lost_cycles);
  return done;
}

Result<Exit> export_record(const std::string& directory, const Destination& options) {
  require_record(directory);
  if (options.named() && std::filesystem::path(options.file).extension() != ".csv")
    throw InputError(fmt::format("-o {}: --csv writes a table; the name must end in .csv", options.file));
  for (const auto& file : csv_files(directory, options.file)) or_wrong_input(check_output(file, options.existing()));
  FolderLock lock;
  or_fail(lock.take(directory));
  Progress progress(false);
  const auto files = export_csv(
      directory, options.existing(), [&](double share) { progress(share); }, options.file);
  if (!files) return work_failed(files.error().message);
  if (options.json) {
    std::vector<std::string> names;
    for (const auto& file : *files) names.push_back(file.string());
    return deliver(files_json(names));
  }
  for (const auto& file : *files) print("{}\n", file.string());
  return done;
}

/// The record as MCAP: in `output`, or beside the record.
Result<Exit> export_messages(const std::string& directory, Destination output, McapMessages messages) {
  require_record(directory);
  const std::filesystem::path record = std::filesystem::path(directory) / "telemetry.h5";
  if (!output.named()) output.file = (std::filesystem::path(directory) / "telemetry.mcap").string();
  or_wrong_input(check_output(output.file, output.existing(), std::array{record}));
  FolderLock lock;
  or_fail(lock.take(directory));
  Progress progress(false);
  const auto written =
      export_mcap(directory, output.file, output.existing(), messages, [&](double share) { progress(share); });
  if (!written) return work_failed(written.error().message);
  if (output.json) return deliver(files_json(std::array{output.file}));
  print("{}\n", output.file);
  return done;
}

double typical_step(const std::vector<double>& time) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::ranges::nth_element(steps, middle);
  return *middle;
}

/// A channel that has a number at every sample.
std::span<const double> whole_channel(const Recording& record, const std::string& directory, const std::string& joint,
                                      std::string_view channel) {
  const auto values = record.channel(joint, channel);
  if (values.size() != record.time_s.size())
    throw InputError(fmt::format("{}/telemetry.h5: {}: has no channel {}", directory, joint, channel));
  const auto wrong = std::ranges::find_if_not(values, [](double x) { return std::isfinite(x); });
  if (wrong != values.end())
    throw InputError(fmt::format("{}/telemetry.h5: {}: {} is {} at sample {} but must be a finite number", directory,
                                 joint, channel, *wrong, wrong - values.begin()));
  return values;
}

/// ",position_JOINT_rad,torque_JOINT_nm,temperature_JOINT_degC" in the units that the joint has.
std::string heads_of(const Recording& record, std::size_t joint) {
  std::string heads;
  for (const std::string_view wanted : {"position_rad", "torque_nm", "temperature_degC"}) {
    const auto channel = std::ranges::find(record.channels, wanted, &Channel::name) - record.channels.begin();
    const std::string column = column_name(wanted, record.units[joint][static_cast<std::size_t>(channel)]);
    const auto end = column.find('_');
    heads += fmt::format(",{}_{}{}", column.substr(0, end), record.joints[joint], column.substr(end));
  }
  return heads;
}

/// A run as the robot's controller would have recorded it: the columns of tribotwin dynamics. `torque_noise_share` is a
/// share of torque_max_nm.
Result<Exit> export_recording(const std::string& directory, Sensors sensors, double torque_noise_share,
                              std::uint64_t seed, const Destination& output) {
  require_record(directory);
  const auto record = read_telemetry(std::filesystem::path(directory) / "telemetry.h5");
  if (!record) throw InputError(record.error().message);
  if (record->time_s.size() < 2)
    return work_failed(fmt::format("{}/telemetry.h5: holds {} samples", directory, record->time_s.size()));
  const auto& time = record->time_s;
  // Skipped work cycles are gaps in the recording, too.
  const double step_s = typical_step(time), rate = 1 / step_s;
  std::vector<std::size_t> starts{0};
  for (std::size_t i = 1; i < time.size(); ++i)
    if (time[i] - time[i - 1] > 1.5 * step_s) starts.push_back(i);
  starts.push_back(time.size());
  if (sensors.sampling_hz == 0) sensors.sampling_hz = rate;
  if (sensors.sampling_hz > rate * 1.001)
    throw InputError(
        fmt::format("--sampling {:g}: the run was recorded at {:.6g} Hz; run it with --set telemetry_rate_hz={:g}",
                    sensors.sampling_hz, rate, sensors.sampling_hz));
  std::vector<JointRecording> joints;
  std::string text = "time_s";
  for (std::size_t j = 0; j < record->joints.size(); ++j) {
    const auto& name = record->joints[j];
    double torque_max_nm = 0;
    for (const auto& [key, value] : record->joint_attributes[j])
      if (key == "torque_max_nm") torque_max_nm = value;
    sensors.torque_noise_nm = torque_noise_share * torque_max_nm;
    auto& joint = joints.emplace_back();
    for (std::size_t s = 0; s + 1 < starts.size(); ++s) {
      const auto part = [&](const auto& values) {
        return std::vector<double>(values.begin() + static_cast<std::ptrdiff_t>(starts[s]),
                                   values.begin() + static_cast<std::ptrdiff_t>(starts[s + 1]));
      };
      const auto column = [&](std::string_view channel) {
        return part(whole_channel(*record, directory, name, channel));
      };
      const auto recorded = sensed({.time_s = part(time),
                                    .position_rad = column("position_rad"),
                                    .torque_nm = column("torque_nm"),
                                    .temperature_degC = column("temperature_degC")},
                                   sensors, seed + j + s * record->joints.size());
      for (auto channel : {&JointRecording::time_s, &JointRecording::position_rad, &JointRecording::torque_nm,
                           &JointRecording::temperature_degC})
        (joint.*channel).insert((joint.*channel).end(), (recorded.*channel).begin(), (recorded.*channel).end());
    }
    text += heads_of(*record, j);
  }
  text += '\n';
  for (std::size_t i = 0; i < joints.front().size(); ++i) {
    text += fmt::format("{:.9g}", joints.front().time_s[i]);
    for (const auto& joint : joints)
      text +=
          fmt::format(",{:.12g},{:.9g},{:.7g}", joint.position_rad[i], joint.torque_nm[i], joint.temperature_degC[i]);
    text += '\n';
  }
  return deliver(text, output);
}

Result<Exit> export_native(const std::string& file, std::optional<double> temperature_degC,
                           std::optional<double> speed_max_rad_s, const Destination& output) {
  const auto native = native_model(file, temperature_degC, speed_max_rad_s);
  if (!native) return tl::unexpected(native.error());
  return deliver(native->xml, output);
}

Result<Exit> export_elements(const std::string& file, const std::string& name, const std::string& on_drive,
                             double torque_max_nm, double gear_ratio, const Destination& output) {
  if (const auto law = load_yaml(file)["law"]; law && law.IsScalar() && law.Scalar() == "bouc_wen") {
    const auto spring = identification::hysteresis_of(file, name, on_drive);
    if (!spring && spring.error().kind == ErrorKind::input) return tl::unexpected(spring.error());
    if (!spring) return work_failed(fmt::format("{}: {}", file, spring.error().message));
    return deliver(spring_elements(name, *spring), output);
  }
  return deliver(drive_elements(name, joint_of({file, "", torque_max_nm, gear_ratio}, name).drive), output);
}

struct ExportArguments {
  std::string from, name = "joint", on_drive = "motor", joint, c_file, fmu_file, table_file, bam_file, actuator,
                    commands = "scenario";
  int fmi = 2;
  Destination output;
  double torque_max_nm = 0, gear_ratio = 0, torque_noise_share = 0;
  Sensors sensors{.sampling_hz = 0};
  std::uint64_t seed = 1;
  std::optional<double> temperature_degC, speed_max_rad_s;
  bool csv = false, mjcf = false, recording = false, native = false, mcap = false, urdf = false;
  std::string messages = "ros2";
};

/// What the controller of --recording measures with.
void add_sensors(CLI::App& command, CLI::Option* recording, ExportArguments& a) {
  command
      .add_option("--sampling", a.sensors.sampling_hz, "Sampling rate of the recording [Hz] (default: that of the run)")
      ->check(CLI::Range(1e-3, 1e6))
      ->needs(recording);
  command
      .add_option("--encoder", a.sensors.encoder_increments_per_turn,
                  "Encoder increments per turn of the joint (default: ideal)")
      ->check(CLI::Range(1.0, 1e12))
      ->needs(recording);
  command
      .add_option("--torque-noise", a.torque_noise_share, "Standard deviation of the torque, a share of torque_max_nm")
      ->check(CLI::Range(0.0, 10.0))
      ->needs(recording);
  command.add_option("--seed", a.seed, "Seed of the noise")->needs(recording);
}

CLI::Option* add_mcap(CLI::App& command, std::initializer_list<CLI::Option*> others, ExportArguments& a) {
  auto* mcap = command.add_flag("--mcap", a.mcap, "telemetry.mcap for ROS 2, Foxglove and Lichtblick");
  for (auto* other : others) mcap->excludes(other);
  command
      .add_option("--messages", a.messages,
                  "Of the .mcap: ros2 (/joint_states and /dynamic_joint_states), or json (/joints/NAME, as --web sends "
                  "them to Foxglove and Lichtblick)")
      ->check(CLI::IsMember({"ros2", "json"}))
      ->capture_default_str()
      ->needs(mcap);
  return mcap;
}

/// One joint for other tools.
void add_joint(CLI::App& command, std::initializer_list<CLI::Option*> others, ExportArguments& a) {
  auto* c =
      command.add_option("--c", a.c_file,
                         "C99 file to write: the joint of PARAMS.yaml or MODEL.xml for controllers, with a test of "
                         "itself (law, heat, bristles, faults)");
  auto* fmu = command.add_option("--fmu", a.fmu_file,
                                 "FMU to write: the same joint for co-simulation, as source and, where a C compiler is "
                                 "found, as a library; its parameters can be tuned. Of SCENARIO.yaml the whole robot, "
                                 "MuJoCo inside");
  auto* table = command.add_option("--table", a.table_file,
                                   "CSV file to write: friction of a joint over speed, load and temperature, for "
                                   "lookup tables");
  auto* bam =
      command.add_option("--bam", a.bam_file,
                         "JSON file to write: friction of a joint as BAM's model m4, exact where the law is its "
                         "own, else the best fit at a temperature");
  command.add_option("--actuator", a.actuator, "Of --bam: the actuator's name in BAM, such as mx64")->needs(bam);
  for (auto* other : others) c->excludes(other), fmu->excludes(other), table->excludes(other), bam->excludes(other);
  fmu->excludes(c), table->excludes(c), table->excludes(fmu), bam->excludes(c), bam->excludes(fmu),
      bam->excludes(table);
  command.add_option("--fmi", a.fmi, "Version of the FMI standard for --fmu")
      ->check(CLI::IsMember({2, 3}))
      ->capture_default_str()
      ->needs(fmu);
  command
      .add_option("--commands", a.commands,
                  "Of a robot's FMU, who moves the joints: the scenario, or an input per joint: torque, velocity, "
                  "position")
      ->check(CLI::IsMember({"scenario", "torque", "velocity", "position"}))
      ->capture_default_str()
      ->needs(fmu);
  command.add_option("--joint", a.joint, "Joint of MODEL.xml for --c, --fmu, --table and --bam, where it has several");
}

/// The one kind of export that was asked for, with options that belong to it; its file, where it names one.
void require_one_kind(ExportArguments& a) {
  const std::string file = a.c_file + a.fmu_file + a.table_file + a.bam_file;  // one of them
  const bool to_file = !file.empty();
  if (a.csv + a.mjcf + a.recording + a.native + a.mcap + a.urdf + !a.c_file.empty() + !a.fmu_file.empty() +
          !a.table_file.empty() + !a.bam_file.empty() !=
      1)
    throw InputError(
        "export needs --csv, --mcap or --recording (of a run), --mjcf (of PARAMS.yaml), --native or --urdf (of "
        "MODEL.xml), --c FILE, --fmu FILE, --table FILE or --bam FILE (of either)");
  if (!to_file && !a.joint.empty())
    throw InputError(fmt::format("--joint {}: belongs to --c, --fmu, --table and --bam", a.joint));
  if ((a.temperature_degC || a.speed_max_rad_s) && !a.native && !a.urdf && a.table_file.empty() && a.bam_file.empty())
    throw InputError("--temperature and --joint-speed belong to --native, --urdf, --table and --bam");
  if (to_file && a.output.named())
    throw InputError(fmt::format("-o {}: --c, --fmu, --table and --bam name their file themselves", a.output.file));
  if (to_file) a.output.file = file;
  if (!a.bam_file.empty() && a.actuator.empty())
    throw InputError("--bam: --actuator is missing; BAM loads a file for an actuator that it knows, such as mx64");
}

/// Options of a joint do not belong to a robot, and the other way round.
void require_one_thing(const ExportArguments& a, bool robot) {
  if (!robot && a.commands != "scenario")
    throw InputError(fmt::format("--commands {}: belongs to --fmu of a scenario, the FMU of a robot", a.commands));
  if (robot && (!a.joint.empty() || a.torque_max_nm > 0 || a.gear_ratio > 0))
    throw InputError(
        fmt::format("{}: is a scenario, whose FMU has all joints with their own numbers; --joint, --tau-max and "
                    "--gear-ratio belong to one joint",
                    a.from));
}

}  // namespace

void add_recover(CLI::App& app, int& code) {
  auto directory = std::make_shared<std::string>();
  auto json = std::make_shared<bool>();
  auto* command = app.add_subcommand("recover", "Turn the record of a killed run into a plain HDF5 file");
  command->add_option("RUNDIR", *directory, "Folder of the run")->required();
  command->add_flag("--json", *json, "Print JSON instead of text");
  command->footer("Example:\n  tribotwin run irb6620_hold -o runs/hold\n  tribotwin recover runs/hold");
  command->callback([directory, json, &code] { code = or_throw(recover_record(*directory, *json)); });
}

void add_export(CLI::App& app, int& code) {
  // Long: one list of options, which exclude or need each other.
  auto a = std::make_shared<ExportArguments>();
  auto* command = app.add_subcommand("export",
                                     "Export the record of a run as CSV, complete or as a controller records it, or as "
                                     "MCAP, parameters as a MuJoCo element, a model "
                                     "without plugins, one joint as C, FMU or table, or a robot as FMU");
  command->add_option("FROM", a->from, "Folder of a run, PARAMS.yaml, MODEL.xml, or SCENARIO.yaml")->required();
  auto* csv = command->add_flag("--csv", a->csv,
                                "The samples as telemetry.csv and, where there are work cycles, these as cycles.csv");
  auto* mjcf = command
                   ->add_flag("--mjcf", a->mjcf,
                              "The elements that the law in PARAMS.yaml makes of a joint: extension, joint, actuator "
                              "(bouc_wen: extension, tendon, actuator)")
                   ->excludes(csv);
  auto* recording =
      command->add_flag("--recording", a->recording, "CSV as the robot's controller records it, for tribotwin dynamics")
          ->excludes(csv)
          ->excludes(mjcf);
  auto* native = command
                     ->add_flag("--native", a->native,
                                "MODEL.xml without plugins, for MJX, Warp and WASM: friction of each drive as "
                                "frictionloss and damping, the error of the fit in a comment")
                     ->excludes(csv)
                     ->excludes(mjcf)
                     ->excludes(recording);
  auto* urdf = command
                   ->add_flag("--urdf", a->urdf,
                              "The <dynamics> elements of a URDF for the joints of MODEL.xml: the friction of --native")
                   ->excludes(csv)
                   ->excludes(mjcf)
                   ->excludes(recording)
                   ->excludes(native);
  auto* mcap = add_mcap(*command, {csv, mjcf, recording, native, urdf}, *a);
  add_joint(*command, {csv, mjcf, recording, native, urdf, mcap}, *a);
  command
      ->add_option("--temperature", a->temperature_degC,
                   "Temperature of the friction of --native, --urdf, --bam and --table [degC] (default: T_amb, within "
                   "the range of the "
                   "law; of --table that range)")
      ->check(CLI::Range(-273.15, 1000.0));
  command
      ->add_option("--joint-speed,--speed", a->speed_max_rad_s,
                   "Fastest joint speed of the same [rad/s] (default: the end of the law's range)")
      ->check(CLI::Range(1e-9, 1e6));
  add_sensors(*command, recording, *a);
  auto* name = command
                   ->add_option("--name", a->name,
                                "Name of the joint, instance and actuator; with --c and --fmu what all names begin "
                                "with (default there: the joint of the model)")
                   ->capture_default_str();
  command
      ->add_option("--drive", a->on_drive,
                   "For bouc_wen: the tribotwin.drive instance that supplies its temperature and receives its heat")
      ->capture_default_str();
  command->add_option("--tau-max", a->torque_max_nm, "torque_max_nm [Nm], where the file holds none")
      ->check(CLI::Range(1e-9, 1e9));
  command->add_option("--gear-ratio", a->gear_ratio, "Motor turns per joint turn, where the file holds none")
      ->check(CLI::Range(1e-6, 1e6));
  a->output.add_to(*command,
                   "File for the elements or the recording (default: stdout), the .csv of --csv or the .mcap of --mcap "
                   "(default: beside the record)");
  a->output.add_json_to(*command);
  command->footer(
      "Example:\n  tribotwin run irb6620_hold -o runs/hold\n  tribotwin export runs/hold --csv\n  tribotwin export "
      "runs/hold --mcap\n  tribotwin lab "
      "rh380n_friction -o lab/rh380n\n  tribotwin identify --law stribeck_T lab/rh380n/curves/00[89].csv "
      "lab/rh380n/curves/01?.csv -o params.yaml\n  tribotwin export params.yaml --mjcf --tau-max 20 --gear-ratio 1\n  "
      "tribotwin export "
      "mjcf/irb6620.xml --joint joint2 --c joint2.c\n  tribotwin export mjcf/irb6620.xml --joint joint2 --fmu "
      "joint2.fmu");
  command->callback([a, name, &code] {
    require_one_kind(*a);
    if (!(a->csv || a->mcap) || a->output.named())
      check(a->output, {a->from, std::filesystem::path(a->from) / "telemetry.h5"});
    const auto messages = a->messages == "json" ? McapMessages::json : McapMessages::ros2;
    const JointSource source{a->from, a->joint, a->torque_max_nm, a->gear_ratio};
    const std::string prefix = name->count() ? a->name : "";
    const bool robot = !a->fmu_file.empty() && is_scenario(a->from);
    require_one_thing(*a, robot);
    code = or_throw(
        !a->c_file.empty()       ? export_c(source, prefix, a->output)
        : robot                  ? export_robot_fmu(a->from, prefix, a->commands, a->fmi, a->output)
        : !a->fmu_file.empty()   ? export_fmu(source, prefix, a->fmi, a->output)
        : !a->table_file.empty() ? export_table(source, a->temperature_degC, a->speed_max_rad_s, a->output)
        : !a->bam_file.empty()   ? export_bam(source, a->actuator, a->temperature_degC, a->speed_max_rad_s, a->output)
        : a->urdf                ? export_urdf(a->from, a->temperature_degC, a->speed_max_rad_s, a->output)
        : a->recording           ? export_recording(a->from, a->sensors, a->torque_noise_share, a->seed, a->output)
        : a->csv                 ? export_record(a->from, a->output)
        : a->mcap                ? export_messages(a->from, a->output, messages)
        : a->native              ? export_native(a->from, a->temperature_degC, a->speed_max_rad_s, a->output)
                    : export_elements(a->from, a->name, a->on_drive, a->torque_max_nm, a->gear_ratio, a->output));
  });
}

}  // namespace tribotwin::twin::program
