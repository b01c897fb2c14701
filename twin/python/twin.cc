#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <string_view>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/python/bindings.hpp>
#include <tribotwin/twin/python/hdf5_lock.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>
#include <tribotwin/twin/simulation/channels.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::python {
namespace {

using twin::DriveCommand, twin::Scenario, twin::Status;

constexpr const char* about_twin = R"(A robot in time: one simulation of a scenario, step by step.

Twin(scenario, settings=None, *, commanded=False, record=False)

scenario: a YAML file, or one that ships ('irb6620_warmup'). settings: keys of the scenario to replace, {'duration_s':
20} or ['duration_s=20']. commanded: the drives follow step(torque_nm=...) and command() instead of the scenario's
motion and control, and the twin never finishes. record: keep samples at telemetry_rate_hz in telemetry.

One twin belongs to one thread at a time; different twins may run in different threads. Arrays have one value per joint,
in the order of `joints`; of a slide rad, rad/s and Nm are m, m/s and N.)";

constexpr const char* about_step = R"(Advances n time steps; False once the scenario is over.

torque_nm: of a commanded twin, motor torque per joint [Nm, arm side] in these steps. Raises Error when the simulation
diverges or a drive of validity 'error' leaves its range; a failed twin stays failed.)";

constexpr const char* about_command = R"(What a drive of a commanded twin does from the next step on.

joint: name or index. mode: 'off', 'torque', 'velocity' or 'position'. position_rad: set point [rad]. velocity_rad_s:
set point [rad/s], or added to the position loop's output. torque_nm: set point [Nm, arm side], or added to the speed
loop's output. torque_limit_nm: limit of its torque [Nm].)";

constexpr const char* about_happen = R"(Something happens now, before the next step.

event: an entry of `events` of a scenario without time_s, such as {'type': 'fault', 'joint': 'joint2', 'fault': 'wear',
'severity': 0.2}, {'type': 'payload', 'mass_kg': 5} or {'type': 'ambient', 'temperature_degC': 35}.)";

constexpr const char* about_save = R"(The state of the twin now, as bytes for restore().

Everything that the next steps depend on, and the sums since the start; not the samples of record=True. The bytes are
for the same version of tribotwin and the same kind of machine. Raises Error after happen(), whose events have no place
in a state: give them in the scenario's `events`.)";

constexpr const char* about_restore = R"(Goes to a state that save() returned, of this twin or of another one.

Its steps are then the same to the last bit, and telemetry starts anew. state: bytes of a twin of the same scenario;
those of another one (other keys, model, events or `commanded`) and damaged ones raise Error and change nothing.)";

constexpr const char* about_run = R"(Simulates a scenario to its end, as the program does, into a folder.

directory: gets telemetry.h5, scenario.yaml and summary.json; None: nothing is written. settings: as of Twin. force:
replaces a run that the folder holds. progress: called with the share that is done, 0 .. 1. Returns the summary.
Ctrl-C ends it after the current step; what was recorded stays.)";

/// Python's signals are looked at once in so many steps.
constexpr std::int64_t steps_between_signals = 1024;

struct PythonTwin {
  std::unique_ptr<twin::Twin> twin;
  std::int64_t every = 0;  ///< steps per sample; 0: nothing is recorded
  std::vector<double> time_s, row;
  std::vector<std::vector<std::vector<double>>> values;  ///< [joint][channel][sample]

  std::size_t drives() const { return twin->model().drives().size(); }
  const mujoco::Binding& binding(std::size_t i) const { return twin->model().drives()[i]; }
};

std::vector<std::string> settings_of(const py::object& settings) {
  std::vector<std::string> all;
  if (settings.is_none()) return all;
  if (!py::isinstance<py::dict>(settings)) return settings.cast<std::vector<std::string>>();
  for (const auto& [key, value] : py::dict(settings)) {
    // YAML reads what Python prints of numbers, texts, lists and mappings; not its constants.
    const std::string text = value.is(py::handle(Py_True))    ? "true"
                             : value.is(py::handle(Py_False)) ? "false"
                                                              : std::string(py::str(value));
    all.push_back(fmt::format("{}={}", std::string(py::str(key)), text));
  }
  return all;
}

std::filesystem::path file_of(const std::filesystem::path& given, std::string_view ending) {
  return twin::given_or_shipped(given.string(), ending);
}

PythonTwin make(const std::filesystem::path& file, const py::object& settings, bool commanded, bool record) {
  Scenario scenario = or_raise(twin::load_scenario(file_of(file, ".yaml"), settings_of(settings)));
  PythonTwin p;
  if (record) p.every = twin::steps_per_sample(scenario);
  p.twin = commanded ? std::make_unique<twin::Twin>(std::move(scenario), twin::Twin::commanded)
                     : std::make_unique<twin::Twin>(std::move(scenario));
  const std::size_t channels = twin::channels(p.twin->model()).size();
  p.row.resize(p.drives() * channels);
  p.values.assign(p.drives(), std::vector<std::vector<double>>(channels));
  return p;
}

void keep_sample(PythonTwin& p, std::int64_t step) {
  twin::read_channels(*p.twin, p.row);
  p.time_s.push_back(static_cast<double>(step) * p.twin->model()->opt.timestep);
  const std::size_t channels = p.row.size() / p.drives();
  for (std::size_t i = 0; i < p.row.size(); ++i) p.values[i / channels][i % channels].push_back(p.row[i]);
}

Result<Status> step_once(PythonTwin& p) {
  const std::int64_t k = p.twin->steps();
  auto status = p.twin->step();
  if (p.every > 0 && status && *status == Status::running && k % p.every == 0) keep_sample(p, k);
  return status;
}

/// Steps without the GIL, which it takes back now and then to see whether the user interrupts.
Status steps(PythonTwin& p, std::int64_t n) {
  for (std::int64_t done = 0; done < n;) {
    Result<Status> status = Status::running;
    {
      const py::gil_scoped_release release;
      const std::int64_t until = std::min(n, done + steps_between_signals);
      while (done < until && status && *status == Status::running) status = step_once(p), ++done;
    }
    if (or_raise(status) == Status::finished) return Status::finished;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }
  return Status::running;
}

void need_commands(const PythonTwin& p) {
  if (!p.twin->takes_commands())
    throw Failure("this twin follows its scenario; Twin(..., commanded=True) takes commands");
}

void set_torques(PythonTwin& p, const py::object& torque_nm) {
  need_commands(p);
  const Array torques(torque_nm);
  if (static_cast<std::size_t>(torques.size()) != p.drives())
    throw Failure(fmt::format("torque_nm has {} values but must have {}, one per joint", torques.size(), p.drives()));
  const double* values = torques.data();
  for (std::size_t i = 0; i < p.drives(); ++i) {
    DriveCommand& command = p.twin->commands()[i];
    command = {.mode = DriveCommand::Mode::torque, .torque_nm = values[i]};
  }
}

bool step(PythonTwin& p, std::int64_t n, const py::object& torque_nm) {
  if (!torque_nm.is_none()) set_torques(p, torque_nm);
  if (n == 1) return or_raise(step_once(p)) == Status::running;  // too short to hand the GIL over
  if (n < 0) throw Failure(fmt::format("n is {} but must be at least 0", n));
  return steps(p, n) == Status::running;
}

py::object json_loads(const std::string& text) { return py::module_::import("json").attr("loads")(text); }

py::object summary(const PythonTwin& p) {
  py::object all = json_loads(twin::summary_json(twin::summarize(*p.twin, 0)));
  for (const char* of_wall_clock : {"wall_s", "realtime_factor"})
    if (all.contains(of_wall_clock)) all.attr("pop")(of_wall_clock);
  return all;
}

py::object run_to_end(PythonTwin& p) {
  if (p.twin->takes_commands()) throw Failure("a commanded twin never finishes; use step()");
  while (steps(p, steps_between_signals) == Status::running) {
  }
  return summary(p);
}

std::size_t joint_index(const PythonTwin& p, const py::object& joint) {
  if (py::isinstance<py::int_>(joint)) {
    const auto i = joint.cast<std::int64_t>();
    if (i < 0 || static_cast<std::size_t>(i) >= p.drives())
      throw Failure(fmt::format("joint {} does not exist; the joints are 0 .. {}", i, p.drives() - 1));
    return static_cast<std::size_t>(i);
  }
  const std::vector<std::string> names = twin::joint_names(p.twin->model());
  const std::string name = py::str(joint);
  const auto found = std::ranges::find(names, name);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  const std::vector<std::string_view> accepted(names.begin(), names.end());
  throw Failure(fmt::format("no joint '{}'; did you mean '{}'? The joints are {}", name, nearest(name, accepted),
                            fmt::join(names, ", ")));
}

constexpr std::pair<std::string_view, DriveCommand::Mode> modes[] = {{"off", DriveCommand::Mode::off},
                                                                     {"torque", DriveCommand::Mode::torque},
                                                                     {"velocity", DriveCommand::Mode::velocity},
                                                                     {"position", DriveCommand::Mode::position}};

void command(PythonTwin& p, const py::object& joint, const std::string& mode, double position_rad,
             double velocity_rad_s, double torque_nm, double torque_limit_nm) {
  need_commands(p);
  const auto chosen = std::ranges::find(modes, mode, [](const auto& row) { return row.first; });
  if (chosen == std::end(modes))
    throw Failure(fmt::format("mode is '{}' but must be 'off', 'torque', 'velocity' or 'position'", mode));
  p.twin->commands()[joint_index(p, joint)] = {.mode = chosen->second,
                                               .position_rad = position_rad,
                                               .velocity_rad_s = velocity_rad_s,
                                               .torque_nm = torque_nm,
                                               .torque_limit_nm = torque_limit_nm};
}

/// A Python value as a YAML node.
YAML::Node node_of(const py::handle& value) {
  if (py::isinstance<py::dict>(value)) {
    YAML::Node node(YAML::NodeType::Map);
    for (const auto& [key, item] : py::reinterpret_borrow<py::dict>(value))
      node[std::string(py::str(key))] = node_of(item);
    return node;
  }
  if (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) {
    YAML::Node node(YAML::NodeType::Sequence);
    for (const auto item : value) node.push_back(node_of(item));
    return node;
  }
  return YAML::Node(std::string(py::str(value)));
}

void happen(PythonTwin& p, const py::dict& event) {
  YAML::Node node = node_of(event);
  if (node["time_s"]) throw Failure("time_s: the event happens now; leave the key out");
  node["time_s"] = p.twin->time_s();
  const double until_s = std::max(p.twin->scenario().duration_s, p.twin->time_s());
  p.twin->happen(twin::read_event(twin::Mapping("event", "", node), p.twin->model(), until_s));
}

double checksum(std::span<const double> numbers) {
  twin::Fingerprint sum;
  sum.add(numbers);
  return static_cast<double>(sum.value() >> 12);
}

py::bytes save(PythonTwin& p) {
  std::vector<double> numbers = or_raise(p.twin->save());
  numbers.push_back(checksum(numbers));
  return {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(double)};
}

void restore(PythonTwin& p, const py::bytes& state) {
  const std::string_view bytes(state);
  std::vector<double> numbers(bytes.size() / sizeof(double));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(double));
  const bool whole = !numbers.empty() && bytes.size() % sizeof(double) == 0 &&
                     numbers.back() == checksum(std::span(numbers).first(numbers.size() - 1));
  if (!whole)
    throw Failure(
        fmt::format("state: {} bytes that are no whole state; give the bytes that save() returned", bytes.size()));
  numbers.pop_back();
  or_raise(p.twin->restore(numbers));
  p.time_s.clear();
  for (auto& joint : p.values)
    for (auto& channel : joint) channel.clear();
}

void hold_temperature(PythonTwin& p, const py::object& joint, std::optional<double> temperature_degC) {
  if (temperature_degC && !(*temperature_degC >= -273.15 && *temperature_degC <= 1000))
    throw Failure(fmt::format("temperature_degC is {} but must be within -273.15 .. 1000 [degC]", *temperature_degC));
  p.twin->set_measured_temperature(joint_index(p, joint), temperature_degC);
}

py::object telemetry(const PythonTwin& p) {
  if (p.every == 0) throw Failure("this twin keeps no samples; Twin(..., record=True) does");
  twin::Recording r{.complete = p.twin->steps() >= p.twin->steps_total(),
                    .attributes = {{"engine", "MuJoCo"},
                                   {"engine_version", mj_versionString()},
                                   {"scenario", p.twin->scenario().name},
                                   {"seed", std::to_string(p.twin->scenario().seed)}},
                    .joints = twin::joint_names(p.twin->model()),
                    .channels = twin::channels(p.twin->model()),
                    .time_s = p.time_s,
                    .values = p.values};
  for (std::size_t i = 0; i < p.drives(); ++i) {
    const auto& drive = p.binding(i).drive;
    r.units.push_back(twin::units(p.twin->model(), p.binding(i)));
    r.joint_attributes.push_back({{"gear_ratio", drive.gear_ratio}, {"torque_max_nm", drive.torque_max_nm}});
  }
  return recording_of(std::move(r));
}

/// A run that Python's signals end.
class Watched {
 public:
  explicit Watched(py::object progress) : progress_(std::move(progress)) {}
  const std::atomic<bool>* stop() const { return &stop_; }
  void operator()(double share) {
    const py::gil_scoped_acquire gil;
    if (stop_) return;
    try {
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
      if (!progress_.is_none()) progress_(share);
    } catch (...) {
      thrown_ = std::current_exception();
      stop_ = true;
    }
  }
  void rethrow() const {
    if (thrown_) std::rethrow_exception(thrown_);
  }

 private:
  py::object progress_;
  std::atomic<bool> stop_ = false;
  std::exception_ptr thrown_;
};

py::object run(const std::filesystem::path& given, std::optional<std::filesystem::path> directory,
               const py::object& settings, bool force, py::object progress) {
  const auto file = file_of(given, ".yaml");
  const Scenario scenario = or_raise(twin::load_scenario(file, settings_of(settings)));
  if (twin::load_yaml(file)["vary"])
    throw Failure(fmt::format("{}: lists several runs ('vary'); the program computes them: tribotwin run {}",
                              file.string(), file.string()));
  Watched watched(std::move(progress));
  const Hdf5Lock lock;
  std::optional<Result<twin::Summary>> summary;
  {
    const py::gil_scoped_release release;
    summary = twin::run(scenario, {.directory = directory.value_or(""),
                                   .existing = twin::replace_if(force),
                                   .stop = watched.stop(),
                                   .progress = [&](double share, double) { watched(share); }});
  }
  watched.rethrow();
  return json_loads(twin::summary_json(or_raise(std::move(*summary))));
}

/// An array with one value per joint.
template <class Value>
void bind_array(py::class_<PythonTwin>& c, const char* name, Value value, const char* meaning) {
  c.def_property_readonly(
      name,
      [value](const PythonTwin& p) {
        py::array_t<double> all(static_cast<py::ssize_t>(p.drives()));
        double* out = all.mutable_data();
        for (std::size_t i = 0; i < p.drives(); ++i) out[i] = value(p, i);
        return all;
      },
      meaning);
}

/// Arrays that are NaN for joints whose motor has no winding.
void bind_windings(py::class_<PythonTwin>& c) {
  const auto bind = [&c](const char* name, auto value, const char* meaning) {
    bind_array(
        c, name,
        [value](const PythonTwin& p, std::size_t i) {
          return p.binding(i).drive.winding.present() ? value(*p.twin, i) : std::numeric_limits<double>::quiet_NaN();
        },
        meaning);
  };
  using T = const twin::Twin&;
  bind(
      "winding_temperature_degC", [](T t, std::size_t i) { return t.winding_degC(i); },
      "Temperatures of the windings now [degC]; NaN without a winding.");
  bind(
      "motor_current_A", [](T t, std::size_t i) { return t.drive(i).current_A; },
      "Motor currents in the last step [A]; NaN without a winding.");
  bind(
      "motor_current_limit_A", [](T t, std::size_t i) { return t.drive(i).current_limit_A; },
      "Largest currents of the drives in the last step [A]; NaN without a winding.");
  bind(
      "copper_loss_J", [](T t, std::size_t i) { return t.drive(i).copper_loss_J; },
      "Heat made in the windings since the start [J]; NaN without a winding.");
}

void bind_arrays(py::class_<PythonTwin>& c) {
  using P = const PythonTwin&;
  bind_array(
      c, "position_rad",
      [](P p, std::size_t i) {
        return p.twin->data()->qpos[twin::position_address(p.twin->model().get(), p.binding(i))];
      },
      "Angles of the joints now [rad].");
  bind_array(
      c, "velocity_rad_s", [](P p, std::size_t i) { return p.twin->data()->qvel[p.binding(i).dof]; },
      "Speeds of the joints now [rad/s].");
  bind_array(
      c, "temperature_degC", [](P p, std::size_t i) { return p.twin->temperature_degC(i); },
      "Temperatures of the lubricant now [degC].");
  bind_array(
      c, "friction_nm", [](P p, std::size_t i) { return p.twin->drive(i).friction_nm; },
      "Friction in the last step [Nm, arm side], positive when it opposes positive motion.");
  bind_array(
      c, "torque_nm", [](P p, std::size_t i) { return p.twin->drive(i).torque_nm; },
      "Motor torques by their current in the last step [Nm, arm side].");
  bind_array(
      c, "load_nm", [](P p, std::size_t i) { return p.twin->drive(i).load_used_nm; },
      "Gear torques at which friction of the last step was evaluated [Nm, arm side].");
  bind_array(
      c, "heat_J", [](P p, std::size_t i) { return p.twin->drive(i).heat_J; }, "Heat since the start [J].");
  bind_windings(c);
}

void bind_properties(py::class_<PythonTwin>& c) {
  using P = const PythonTwin&;
  c.def_property_readonly(
       "time_s", [](P p) { return p.twin->time_s(); }, "Simulated time [s].")
      .def_property_readonly(
          "timestep_s", [](P p) { return p.twin->model()->opt.timestep; }, "Time step [s].")
      .def_property_readonly(
          "duration_s", [](P p) { return p.twin->scenario().duration_s; }, "Duration of the scenario [s].")
      .def_property_readonly(
          "steps", [](P p) { return p.twin->steps(); }, "Time steps so far.")
      .def_property_readonly(
          "commanded", [](P p) { return p.twin->takes_commands(); }, "Whether it takes commands.")
      .def_property_readonly(
          "finished", [](P p) { return p.twin->steps() >= p.twin->steps_total(); }, "Whether the scenario is over.")
      .def_property_readonly(
          "name", [](P p) { return p.twin->scenario().name; }, "Name of the scenario.")
      .def_property_readonly(
          "joints", [](P p) { return twin::joint_names(p.twin->model()); },
          "Names of the joints with a drive, in the order of all arrays.")
      .def_property_readonly("telemetry", &telemetry,
                             "What telemetry.h5 would hold, of a twin with record=True: a Recording (a copy).")
      .def_property_readonly(
          "balance_J", [](P p) { return p.twin->balance_J(); }, "Residual of the energy balance since the start [J].");
}

/// An engine that nobody has told where to put its messages would wait for a key.
void quiet_engine() {
  if (!mju_user_error && !mju_user_warning) mujoco::install_message_handlers();
}

}  // namespace

void bind_twins(py::module_& m) {
  quiet_engine();
  py::class_<PythonTwin> c(m, "Twin", about_twin);
  c.def(py::init(&make), py::arg("scenario"), py::arg("settings") = py::none(), py::kw_only(),
        py::arg("commanded") = false, py::arg("record") = false)
      .def("step", &step, py::arg("n") = 1, py::arg("torque_nm") = py::none(), about_step)
      .def("run", &run_to_end, "Steps to the end of the scenario, every step computed; returns summary().")
      .def("summary", &summary, "The figures of summary.json so far, but for those of the wall clock.")
      .def("command", &command, py::arg("joint"), py::arg("mode"), py::kw_only(), py::arg("position_rad") = 0.0,
           py::arg("velocity_rad_s") = 0.0, py::arg("torque_nm") = 0.0,
           py::arg("torque_limit_nm") = friction::unlimited, about_command)
      .def("happen", &happen, py::arg("event"), about_happen)
      .def("save", &save, about_save)
      .def("restore", &restore, py::arg("state"), about_restore)
      .def(
          "set_brake",
          [](PythonTwin& p, const py::object& joint, bool on) { p.twin->set_brake(joint_index(p, joint), on); },
          py::arg("joint"), py::arg("engaged"), "Engages or releases the holding brake of a joint.")
      .def("hold_temperature", &hold_temperature, py::arg("joint"), py::arg("temperature_degC"),
           "Holds a joint at a measured temperature [degC]; None: its thermal model goes on from there.")
      .def("__repr__", [](const PythonTwin& p) {
        return fmt::format("<Twin {} at {:g} s of {:g} s>", p.twin->scenario().name, p.twin->time_s(),
                           p.twin->scenario().duration_s);
      });
  bind_arrays(c);
  bind_properties(c);
  m.def("run", &run, py::arg("scenario"), py::arg("directory") = py::none(), py::arg("settings") = py::none(),
        py::kw_only(), py::arg("force") = false, py::arg("progress") = py::none(), about_run);
}

}  // namespace tribotwin::python
