#include <cmath>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/plugins/drive/slide.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/python/bindings.hpp>

namespace tribotwin::python {
namespace {

constexpr const char* about_drive = R"(One joint drive: motor, gear, friction, heat; without an engine, stepped by hand.

Drive(keys, *, name='joint')

keys: those of the MJCF element <config key= value=/> (plugins/README.md), values as numbers, text or lists of numbers:
Drive({'law': 'stribeck', 'Fc': 0.03, ..., 'torque_max_nm': 100, 'gear_ratio': 50, 'thermal': 'first_order', ...}).

slide() takes speed and load as known. begin_step() and end_step() are the two halves of a step of an engine of your
own, which decides whether the joint sticks.)";

constexpr const char* about_slide = R"(Slides for dt_s at a joint speed, while the gear transmits a load.

speed_rad_s: of the joint [rad/s, arm side]. load_nm: what the gear transmits to the arm [Nm, arm side]. dt_s: time step
[s]. Numbers, or arrays of one step after the other. Returns the friction of the gear [Nm, arm side, positive with
motion]; at speed 0 it is that of the bristles, or 0, and limit_nm has what holds.)";

constexpr const char* about_limit = R"(Limit of a joint's friction constraint [Nm, arm side], from numbers or arrays.

drive: its law and gear; its state, faults, brake and bristles do not count (Drive.begin_step has them). speed_rad_s: of
the joint [rad/s, arm side]; 0 gives what breaks it away. load_nm: gear torque of the step before [Nm, arm side].
temperature_degC: of the lubricant [degC].)";

constexpr const char* about_begin = R"(Starts a step and returns the limit of the friction constraint [Nm, arm side].

time_s: of its start [s]. speed_rad_s, position_rad: of the joint [rad/s, rad, arm side]. With bristles (friction
'lugre', 'gear_loss') applied_nm acts against the joint besides.)";

constexpr const char* about_end = R"(Ends a step: friction becomes heat, and the gear torque the load of the next step.

friction_nm: what the constraint transmitted [Nm, arm side, positive against positive motion]. torque_nm: motor torque
[Nm, arm side]. speed_rad_s, position_rad: of the joint at the end [rad/s, rad]. dt_s: time step [s].
rotor_inertia_kg_m2: of the motor, seen from the arm [kg m^2].)";

struct PythonDrive {
  drive::Drive drive;
  drive::Sliding sliding;
  drive::Faults faults{};
  thermal::Decay decay{};

  const thermal::Decay& decay_of(double dt_s) {
    if (decay.dt_s != dt_s) decay = thermal::decay(drive.thermal, dt_s);
    return decay;
  }
  drive::Workspace& workspace() { return sliding.workspace; }
};

PythonDrive make(const py::dict& keys, const std::string& name) {
  drive::Configuration configuration;
  for (const auto& [key, value] : keys) configuration.emplace_back(py::str(key), text_of(value));
  return {.drive = or_raise(drive::make_drive(name, configuration)), .sliding = {}};
}

py::object slide(PythonDrive& d, py::object speed, py::object load, double dt_s) {
  const auto arrays = broadcast({std::move(speed), std::move(load)});
  if (!(dt_s > 0 && dt_s <= drive::slide_dt_max_s))
    throw Failure(fmt::format("dt_s is {} but must be above 0 and at most {} [s]", dt_s, drive::slide_dt_max_s));
  const thermal::Decay decay = d.decay_of(dt_s);
  if (arrays[0].ndim() == 0)
    return py::float_(drive::slide(d.drive, decay, *arrays[0].data(), *arrays[1].data(), d.sliding));
  std::vector<double> friction(static_cast<std::size_t>(arrays[0].size()));
  {
    const double *speeds = arrays[0].data(), *loads = arrays[1].data();
    const py::gil_scoped_release release;
    for (std::size_t i = 0; i < friction.size(); ++i)
      friction[i] = drive::slide(d.drive, decay, speeds[i], loads[i], d.sliding);
  }
  return array_of(std::move(friction), {arrays[0].shape(), arrays[0].shape() + arrays[0].ndim()});
}

py::object friction_limit(const PythonDrive& d, py::object speed, py::object load, py::object temperature) {
  const auto arrays = broadcast({std::move(speed), std::move(load), std::move(temperature)});
  const auto limit = [&](double speed_rad_s, double load_nm, const friction::AtTemperature& at) {
    return drive::friction_nm(d.drive, at, speed_rad_s, load_nm / d.drive.torque_max_nm);
  };
  const double *speeds = arrays[0].data(), *loads = arrays[1].data(), *temperatures = arrays[2].data();
  if (arrays[0].ndim() == 0)
    return py::float_(limit(*speeds, *loads, friction::at_temperature(d.drive.law, *temperatures)));
  std::vector<double> limits(static_cast<std::size_t>(arrays[0].size()));
  {
    const py::gil_scoped_release release;
    for (std::size_t i = 0; i < limits.size(); ++i)
      limits[i] = limit(speeds[i], loads[i], friction::at_temperature(d.drive.law, temperatures[i]));
  }
  return array_of(std::move(limits), {arrays[0].shape(), arrays[0].shape() + arrays[0].ndim()});
}

double begin_step(PythonDrive& d, double time_s, double speed_rad_s, double position_rad) {
  return drive::begin_step(d.drive, d.sliding.state, d.workspace(), time_s, speed_rad_s, position_rad);
}

void end_step(PythonDrive& d, double dt_s, double friction_nm, double torque_nm, double speed_rad_s,
              double position_rad, double rotor_inertia_kg_m2) {
  if (!(dt_s > 0)) throw Failure(fmt::format("dt_s is {} but must be above 0 [s]", dt_s));
  if (d.workspace().step_open == 0) throw Failure("end_step() needs a begin_step() before");
  drive::end_step(d.drive, d.decay_of(dt_s),
                  {.friction_nm = friction_nm,
                   .torque_nm = torque_nm,
                   .qd_end_rad_s = speed_rad_s,
                   .q_end_rad = position_rad,
                   .rotor_inertia_kg_m2 = rotor_inertia_kg_m2},
                  dt_s, d.sliding.state, d.workspace());
}

const drive::FaultInfo& fault_named(const std::string& name) {
  if (const auto* known = drive::find_fault(name)) return *known;
  std::vector<std::string_view> names;
  for (const auto& fault : drive::faults()) names.push_back(fault.name);
  throw Failure(fmt::format("fault '{}' is not known; did you mean '{}'?", name, nearest(name, names)));
}

/// Adds to what is wrong already, as several faults of one joint do.
void add_fault(PythonDrive& d, const std::string& name, double severity) {
  const drive::FaultInfo& fault = fault_named(name);
  if (!(severity >= 0 && severity <= fault.maximum))
    throw Failure(fmt::format("severity of '{}' is {} but must be within 0 .. {} [{}]", name, severity, fault.maximum,
                              fault.unit));
  fault.add(d.faults, severity);
  drive::set_faults(d.workspace(), d.faults);
}

void repair(PythonDrive& d) {
  d.faults = {};
  drive::set_faults(d.workspace(), d.faults);
}

void set_wear(PythonDrive& d, const std::string& parameter, double factor) {
  const auto& parameters = d.drive.law.info->parameters;
  const auto found = std::ranges::find(parameters, parameter, &friction::Parameter::name);
  if (found == parameters.end()) {
    std::vector<std::string_view> names;
    for (const auto& p : parameters) names.push_back(p.name);
    throw Failure(fmt::format("'{}' is no parameter of law '{}'; did you mean '{}'?", parameter, d.drive.law.info->name,
                              nearest(parameter, names)));
  }
  if (!(factor >= 0 && factor <= 1000))
    throw Failure(fmt::format("factor of '{}' is {} but must be within 0 .. 1000", parameter, factor));
  drive::set_wear(d.workspace(), static_cast<std::size_t>(found - parameters.begin()), factor);
}

py::dict keys_of(const PythonDrive& d) {
  py::dict all;
  for (const auto& [key, value] : drive::configuration_of(d.drive)) all[py::str(key)] = value;
  return all;
}

void set_temperature(PythonDrive& d, double temperature_degC) {
  if (!(temperature_degC >= -273.15 && temperature_degC <= 1000))
    throw Failure(fmt::format("temperature_degC is {} but must be within -273.15 .. 1000 [degC]", temperature_degC));
  drive::set_temperature(d.drive, d.sliding.state, temperature_degC);
}

std::optional<double> winding_temperature(const PythonDrive& d) {
  if (!d.drive.winding.present()) return std::nullopt;
  return drive::winding_degC(d.drive, d.sliding.state);
}

void set_winding_temperature(PythonDrive& d, double temperature_degC) {
  if (!d.drive.winding.present())
    throw Failure(fmt::format("drive '{}' has no winding; the key winding_resistance_ohm gives it one", d.drive.name));
  if (!(temperature_degC >= -273.15 && temperature_degC <= 1000))
    throw Failure(
        fmt::format("winding_temperature_degC is {} but must be within -273.15 .. 1000 [degC]", temperature_degC));
  drive::set_winding(d.drive, d.sliding.state, temperature_degC);
}

void bind_faults(py::module_& m) {
  using drive::FaultInfo;
  py::class_<FaultInfo>(m, "FaultInfo", "A row of the table of faults.")
      .def_readonly("name", &FaultInfo::name, "As in YAML, JSON and tables.")
      .def_readonly("unit", &FaultInfo::unit, "Of the severity: '1' relative, 'rad' arm side.")
      .def_readonly("maximum", &FaultInfo::maximum, "Largest severity.")
      .def_readonly("footprint", &FaultInfo::footprint, "What a friction curve shows of it.")
      .def("__repr__", [](const FaultInfo& f) { return fmt::format("<fault {}: {}>", f.name, f.footprint); });
  m.def(
      "faults",
      [] {
        py::dict all;
        for (const FaultInfo& fault : drive::faults())
          all[py::str(std::string(fault.name))] = py::cast(&fault, py::return_value_policy::reference);
        return all;
      },
      "All faults of a drive by name, in the order of the documentation.");
}

/// A property that a step has left in the workspace.
void bind_output(py::class_<PythonDrive>& c, const char* name, double drive::Workspace::*member, const char* meaning) {
  c.def_property_readonly(
      name, [member](const PythonDrive& d) { return d.sliding.workspace.*member; }, meaning);
}

void bind_winding(py::class_<PythonDrive>& c) {
  bind_output(c, "motor_current_A", &drive::Workspace::current_A, "Current of the last step [A]; 0 without a winding.");
  bind_output(c, "motor_current_limit_A", &drive::Workspace::current_limit_A,
              "Largest current in the step under way, or the last one [A]; 0 without a winding.");
  bind_output(c, "copper_loss_J", &drive::Workspace::copper_loss_J, "Heat made in the winding since the start [J].");
  bind_output(c, "winding_heat_J", &drive::Workspace::winding_heat_J, "Of it, what has flowed to the gear [J].");
  c.def_property("winding_temperature_degC", &winding_temperature, &set_winding_temperature,
                 "Temperature of the winding now [degC]; None without a winding.")
      .def_property_readonly(
          "overload", [](const PythonDrive& d) { return d.sliding.state.winding.overload; },
          "Share of the overload that I^2 t protection allows, 0 .. 1; 0 without.")
      .def(
          "limited_torque",
          [](const PythonDrive& d, double torque_nm) {
            return drive::within_current_limit(d.drive, d.sliding.workspace, torque_nm);
          },
          py::arg("torque_nm"),
          "What the drive gives of a motor torque in the step under way [Nm, arm side], by its current limit.")
      .def_property_readonly(
          "delivered_share",
          [](const PythonDrive& d) {
            const drive::Workspace& s = d.sliding.workspace;
            return (1 - s.faults.torque_loss) * (1 - s.hot_torque_loss);
          },
          "Share of the torque by the current that acts in the step under way: warm magnets, the fault "
          "torque_constant.");
}

void bind_state(py::class_<PythonDrive>& c) {
  const auto output = [&c](const char* name, double drive::Workspace::*member, const char* meaning) {
    bind_output(c, name, member, meaning);
  };
  output("friction_nm", &drive::Workspace::friction_nm, "Friction of the last step [Nm, arm side, with motion].");
  output("limit_nm", &drive::Workspace::limit_nm, "Friction limit of the last step, brake included [Nm, arm side].");
  output("applied_nm", &drive::Workspace::applied_nm, "Torque of the bristles in the last step [Nm, arm side].");
  output("torque_nm", &drive::Workspace::torque_nm, "Motor torque by the current, last step [Nm, arm side].");
  output("heat_J", &drive::Workspace::heat_J, "Heat of the gear since the start, winding_heat_J included [J].");
  output("friction_work_J", &drive::Workspace::friction_work_J, "Work of friction since the start [J].");
  c.def_property(
       "temperature_degC", [](const PythonDrive& d) { return drive::temperature_degC(d.drive, d.sliding.state); },
       &set_temperature, "Temperature of the lubricant now [degC]; setting it is a restart in steady state.")
      .def_property(
          "load_nm", [](const PythonDrive& d) { return d.sliding.state.load_nm; },
          [](PythonDrive& d, double load_nm) { d.sliding.state.load_nm = load_nm; },
          "Load that friction sees in the next step [Nm, arm side].")
      .def_property(
          "ambient_degC",
          [](const PythonDrive& d) { return d.drive.thermal.T_amb_degC + d.sliding.workspace.ambient_offset_K; },
          [](PythonDrive& d, double degC) { d.workspace().ambient_offset_K = degC - d.drive.thermal.T_amb_degC; },
          "Temperature of the surroundings [degC].")
      .def_property(
          "position_rad", [](const PythonDrive& d) { return d.sliding.position_rad; },
          [](PythonDrive& d, double position_rad) { d.sliding.position_rad = position_rad; },
          "Angle of the joint in slide() [rad, arm side].")
      .def_property(
          "brake", [](const PythonDrive& d) { return d.sliding.workspace.brake_engaged; },
          [](PythonDrive& d, double engaged) { d.workspace().brake_engaged = engaged; },
          "Share of brake_torque_nm that holds, 0 .. 1.")
      .def_property_readonly(
          "outside", [](const PythonDrive& d) { return d.sliding.workspace.outside != 0; },
          "Whether an input of the last step lay outside the range of the law.");
}

}  // namespace

void bind_drives(py::module_& m) {
  bind_faults(m);
  py::class_<PythonDrive> c(m, "Drive", about_drive);
  c.def(py::init(&make), py::arg("keys"), py::kw_only(), py::arg("name") = "joint")
      .def("slide", &slide, py::arg("speed_rad_s"), py::arg("load_nm"), py::arg("dt_s"), about_slide)
      .def("begin_step", &begin_step, py::arg("time_s"), py::arg("speed_rad_s"), py::arg("position_rad") = 0.0,
           about_begin)
      .def("end_step", &end_step, py::arg("dt_s"), py::kw_only(), py::arg("friction_nm"), py::arg("torque_nm"),
           py::arg("speed_rad_s"), py::arg("position_rad") = 0.0, py::arg("rotor_inertia_kg_m2") = 0.0, about_end)
      .def("add_fault", &add_fault, py::arg("fault"), py::arg("severity"),
           "Adds a fault of faults(), as further damage; severity in its unit.")
      .def("repair", &repair, "Takes all faults away.")
      .def("set_wear", &set_wear, py::arg("parameter"), py::arg("factor"),
           "Multiplies a parameter of the law by a factor; 1 restores it.")
      .def_property_readonly(
          "name", [](const PythonDrive& d) { return d.drive.name; }, "Name of the drive.")
      .def_property_readonly(
          "law", [](const PythonDrive& d) { return PythonLaw{d.drive.law}; }, "Its friction law.")
      .def_property_readonly("keys", &keys_of, "The keys that would make the same drive.")
      .def_property_readonly(
          "torque_max_nm", [](const PythonDrive& d) { return d.drive.torque_max_nm; },
          "Unit of load_norm and of normalised laws [Nm, arm side].")
      .def_property_readonly(
          "gear_ratio", [](const PythonDrive& d) { return d.drive.gear_ratio; }, "Motor turns per joint turn.");
  bind_state(c);
  bind_winding(c);
  m.def("friction_limit", &friction_limit, py::arg("drive"), py::arg("speed_rad_s"), py::arg("load_nm"),
        py::arg("temperature_degC"), about_limit);
}

}  // namespace tribotwin::python
