#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/batch.hpp>
#include <tribotwin/twin/python/bindings.hpp>

namespace tribotwin::python {
namespace {

constexpr const char* about_law = R"(A friction law: speed, load and temperature to friction torque.

Law(name, parameters=None, *, validity='clamp')

name: a law of laws(). parameters: its parameters by name, in the units of laws()[name].parameters; None: the numbers
that its source publishes. validity: 'clamp' holds inputs at the edge of the range in which the law was identified,
'extrapolate' evaluates the formula beyond it. outside() tells which inputs lie beyond.)";

constexpr const char* about_call = R"(Friction torque in the direction of motion, odd in speed, 0 at standstill.

speed_rad_s: speed of the shaft that `side` names [rad/s]. load_norm: load torque over torque_max_nm [-], its sign does
not matter; needed where load_dependent. temperature_degC: of the lubricant [degC]; needed where temperature_dependent.
Numbers or arrays, which are broadcast; contiguous arrays of doubles of one shape are not copied. Returns `unit`: '-' is
torque over torque_max_nm (friction_norm), 'Nm' arm side. Always finite: NaN counts as 0 and as outside().

Arrays take vectorised functions, which agree with those of a step to 1e-12 relative; with exact=True every element is
the same double as a number alone gives, and as a step of the simulation uses.)";

struct Inputs {
  std::vector<Array> arrays;  // speed, load, temperature
  bool number;                // all of them are numbers

  const double* at(std::size_t i) const { return arrays[i].data(); }
  std::size_t size() const { return static_cast<std::size_t>(arrays[0].size()); }
  std::vector<py::ssize_t> shape() const { return {arrays[0].shape(), arrays[0].shape() + arrays[0].ndim()}; }
};

Inputs inputs_of(const friction::LawInfo& law, py::object speed, py::object load, py::object temperature) {
  const auto given = [&](py::object value, bool needed, const char* name) -> py::object {
    if (!value.is_none()) return value;
    if (needed) throw Failure(fmt::format("law '{}' depends on {}: give a number or an array", law.name, name));
    return py::float_(0.0);
  };
  load = given(std::move(load), law.load_dependent, "load_norm");
  temperature = given(std::move(temperature), law.temperature_dependent, "temperature_degC");
  Inputs in{broadcast({std::move(speed), std::move(load), std::move(temperature)}), false};
  in.number = in.arrays[0].ndim() == 0;
  return in;
}

py::object evaluate(const PythonLaw& law, py::object speed, py::object load, py::object temperature, bool exact) {
  const Inputs in = inputs_of(*law.law.info, std::move(speed), std::move(load), std::move(temperature));
  if (in.number) return py::float_(friction::torque(law.law, *in.at(0), *in.at(1), *in.at(2)));
  const auto n = static_cast<Eigen::Index>(in.size());
  auto* result = new Eigen::ArrayXd;
  const py::capsule owner(result, [](void* p) { delete static_cast<Eigen::ArrayXd*>(p); });
  {
    const py::gil_scoped_release release;
    using Map = Eigen::Map<const Eigen::ArrayXd>;
    if (exact) {
      result->resize(n);
      for (Eigen::Index i = 0; i < n; ++i)
        (*result)(i) = friction::torque(law.law, in.at(0)[i], in.at(1)[i], in.at(2)[i]);
    } else {
      *result = friction::torque(law.law, Map(in.at(0), n), Map(in.at(1), n), Map(in.at(2), n));
    }
  }
  return py::array_t<double>(in.shape(), result->data(), owner);
}

py::object outside(const PythonLaw& law, py::object speed, py::object load, py::object temperature) {
  const Inputs in = inputs_of(*law.law.info, std::move(speed), std::move(load), std::move(temperature));
  py::array_t<bool> result(in.shape());
  bool* out = result.mutable_data();
  {
    const py::gil_scoped_release release;
    for (std::size_t i = 0; i < in.size(); ++i)
      out[i] =
          friction::level(law.law, friction::at_temperature(law.law, in.at(2)[i]), in.at(0)[i], in.at(1)[i]).outside;
  }
  if (in.number) return py::bool_(out[0]);
  return result;
}

PythonLaw make(const std::string& name, const py::object& parameters, const std::string& validity) {
  PythonLaw made;
  if (parameters.is_none()) {
    const auto known = friction::find_law(name) ? friction::published_law(name) : friction::make_law(name, {});
    made.law = or_raise(known);
  } else {
    std::vector<std::pair<std::string, double>> values;
    for (const auto& [key, value] : py::dict(parameters)) values.emplace_back(py::str(key), value.cast<double>());
    made.law = or_raise(friction::make_law(name, values));
  }
  if (validity == "extrapolate")
    made.law.validity = friction::Validity::extrapolate;
  else if (validity != "clamp")
    throw Failure(fmt::format("validity is '{}' but must be 'clamp' or 'extrapolate'", validity));
  return made;
}

py::dict parameters_of(const friction::Law& law) {
  py::dict all;
  for (std::size_t i = 0; i < law.info->parameters.size(); ++i)
    all[py::str(std::string(law.info->parameters[i].name))] = law.parameters[i];
  return all;
}

py::dict range_of(const friction::Range& range) {
  py::dict all;
  all["speed_max_rad_s"] = range.speed_max_rad_s;
  all["load_max"] = range.load_max;
  all["temperature_min_degC"] = range.temperature_min_degC;
  all["temperature_max_degC"] = range.temperature_max_degC;
  return all;
}

const char* side_of(const friction::LawInfo& law) { return law.side == friction::Side::motor ? "motor" : "arm"; }
const char* unit_of(const friction::LawInfo& law) { return law.normalised ? "-" : "Nm"; }

void bind_table(py::module_& m) {
  using friction::LawInfo, friction::Parameter;
  py::class_<Parameter>(m, "Parameter", "A parameter of a law, as the table of laws has it.")
      .def_readonly("name", &Parameter::name, "As in MJCF, YAML, JSON and tables.")
      .def_readonly("unit", &Parameter::unit, "Unit; '-' is torque over torque_max_nm.")
      .def_readonly("minimum", &Parameter::minimum, "Smallest accepted value.")
      .def_readonly("maximum", &Parameter::maximum, "Largest accepted value.")
      .def_readonly("published", &Parameter::published, "Value in the source; NaN where it gives none.")
      .def_readonly("sigma", &Parameter::sigma, "Standard deviation in the source; NaN where it gives none.")
      .def_readonly("meaning", &Parameter::meaning, "What it is.")
      .def("__repr__", [](const Parameter& p) {
        return fmt::format("<{} [{}]: {}, {:g} .. {:g}>", p.name, p.unit, p.meaning, p.minimum, p.maximum);
      });
  py::class_<LawInfo>(m, "LawInfo", "A row of the table of laws.")
      .def_readonly("name", &LawInfo::name, "Name of the law.")
      .def_readonly("equation", &LawInfo::equation, "Friction over speed v, load l and temperature T.")
      .def_readonly("source", &LawInfo::source, "Where it is from.")
      .def_property_readonly("side", &side_of, "Whose speed it takes: 'motor' or 'arm'.")
      .def_property_readonly("unit", &unit_of, "Of its result: '-' (torque over torque_max_nm) or 'Nm' (arm side).")
      .def_readonly("temperature_dependent", &LawInfo::temperature_dependent, "Whether it needs temperature_degC.")
      .def_readonly("load_dependent", &LawInfo::load_dependent, "Whether it needs load_norm.")
      .def_property_readonly(
          "range", [](const LawInfo& law) { return range_of(law.identified); },
          "Where its source identified it: speed_max_rad_s, load_max, temperature_min_degC, temperature_max_degC.")
      .def_property_readonly(
          "parameters",
          [](const LawInfo& law) { return std::vector<Parameter>(law.parameters.begin(), law.parameters.end()); },
          "Its parameters, in order.")
      .def("__repr__", [](const LawInfo& law) { return fmt::format("<law {}: {}>", law.name, law.equation); });
  m.def(
      "laws",
      [] {
        py::dict all;
        for (const LawInfo& law : friction::laws())
          all[py::str(std::string(law.name))] = py::cast(&law, py::return_value_policy::reference);
        return all;
      },
      "All friction laws by name, in the order of the documentation.");
}

}  // namespace

void bind_laws(py::module_& m) {
  bind_table(m);
  py::class_<PythonLaw>(m, "Law", about_law)
      .def(py::init(&make), py::arg("name"), py::arg("parameters") = py::none(), py::kw_only(),
           py::arg("validity") = "clamp")
      .def("__call__", &evaluate, py::arg("speed_rad_s"), py::arg("load_norm") = py::none(),
           py::arg("temperature_degC") = py::none(), py::kw_only(), py::arg("exact") = false, about_call)
      .def("outside", &outside, py::arg("speed_rad_s"), py::arg("load_norm") = py::none(),
           py::arg("temperature_degC") = py::none(),
           "Whether an input lies outside the range in which the law was identified; arguments as of a call.")
      .def_property_readonly(
          "name", [](const PythonLaw& l) { return l.law.info->name; }, "Name of the law.")
      .def_property_readonly(
          "equation", [](const PythonLaw& l) { return l.law.info->equation; }, "Its equation.")
      .def_property_readonly(
          "source", [](const PythonLaw& l) { return l.law.info->source; }, "Where it is from.")
      .def_property_readonly(
          "side", [](const PythonLaw& l) { return side_of(*l.law.info); }, "Whose speed it takes: 'motor' or 'arm'.")
      .def_property_readonly(
          "unit", [](const PythonLaw& l) { return unit_of(*l.law.info); },
          "Of its result: '-' (torque over torque_max_nm) or 'Nm' (arm side).")
      .def_property_readonly(
          "parameters", [](const PythonLaw& l) { return parameters_of(l.law); }, "Values of its parameters by name.")
      .def_property_readonly(
          "range", [](const PythonLaw& l) { return range_of(l.law.range); },
          "Where it was identified: speed_max_rad_s [rad/s], load_max [-], temperature_min_degC and "
          "temperature_max_degC [degC].")
      .def("__repr__", [](const PythonLaw& l) {
        return fmt::format("<Law {} {}>", l.law.info->name, std::string(py::repr(parameters_of(l.law))));
      });
}

}  // namespace tribotwin::python
