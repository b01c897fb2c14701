#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <pybind11/eigen.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/identification/curves/direction.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/python/bindings.hpp>

namespace tribotwin::python {
namespace {

using namespace twin::identification;

constexpr const char* about_identify = R"(The parameters of a friction law from measured friction, with uncertainties.

law: name of the law (laws()). Arrays with one value per measured level, as the columns of a curve file:
speed_rad_s: speed of the motor [rad/s]; both signs where friction was measured in both directions. load_norm: load
torque over torque_max_nm [-]. temperature_degC: of the lubricant [degC]. friction_norm [-] or friction_nm [Nm, arm
side]: measured friction, positive when it opposes positive motion. stderr_norm, stderr_nm: standard error of each
level; with it levels are weighed. curve: number of the curve that a level belongs to; without it, a new curve begins
where speeds fall. Of load_norm and temperature_degC one number stands for all levels.

fixed: parameters that are known, by name. robust: 'squares', 'huber' or 'cauchy'. staged: load terms first, from one
temperature. torque_max_nm [Nm, arm side], gear_ratio: where the law is normalised and friction is not, and the other
way round. threads: at work.

A number is one only where not_identifiable does not name it: look there first.)";

constexpr const char* about_fit = R"(An identified law.

fit.parameters['Fc0'].value, .sigma, .low, .high (95 %), .unit, .status; fit.not_identifiable names those that these
data do not determine, fit.lacking says why and what to record; fit.law evaluates it.)";

struct PythonFit {
  Fit fit;
  std::vector<std::string> data;
  double torque_max_nm = 0, gear_ratio = 0;
};

const char* status_of(const Estimate& e) {
  static constexpr const char* names[] = {"estimated", "fixed", "held", "at_bound"};
  return names[static_cast<int>(e.status)];
}

std::vector<double> column(const py::object& value) {
  if (value.is_none()) return {};
  const Array array(value);
  if (array.ndim() > 1) throw Failure("columns are arrays of one dimension");
  return {array.data(), array.data() + array.size()};
}

/// A column that may be one number for all levels.
std::vector<double> column(const py::object& value, std::size_t rows) {
  auto values = column(value);
  const bool number = py::isinstance<py::float_>(value) || py::isinstance<py::int_>(value);
  if (number) values.assign(rows, values[0]);
  return values;
}

const friction::LawInfo& law_named(const std::string& name) {
  if (const auto* law = friction::find_law(name)) return *law;
  throw Failure(friction::make_law(name, {}).error());
}

FitOptions options_of(const py::dict& fixed, const std::string& robust, unsigned threads) {
  FitOptions options{.threads = threads};
  for (const auto& [name, value] : fixed) options.fixed.emplace_back(py::str(name), value.cast<double>());
  constexpr std::pair<std::string_view, Loss> losses[] = {
      {"squares", Loss::squares}, {"huber", Loss::huber}, {"cauchy", Loss::cauchy}};
  const auto loss = std::ranges::find(losses, robust, [](const auto& row) { return row.first; });
  if (loss == std::end(losses))
    throw Failure(fmt::format("robust is '{}' but must be 'squares', 'huber' or 'cauchy'", robust));
  options.loss = loss->second;
  return options;
}

void check_fixed(const friction::LawInfo& law, const FitOptions& options) {
  std::vector<std::string_view> names;
  for (const auto& p : law.parameters) names.push_back(p.name);
  names.insert(names.end(), {asymmetry_name, offset_name});
  for (const auto& [name, value] : options.fixed)
    if (std::ranges::find(names, name) == names.end())
      throw Failure(fmt::format("fixed: law '{}' has no parameter '{}'; did you mean '{}'?", law.name, name,
                                nearest(name, names)));
}

PythonFit fitted(const friction::LawInfo& law, const Samples& samples, const FitOptions& options, bool staged) {
  check_fixed(law, options);
  const py::gil_scoped_release release;
  PythonFit result{or_raise(staged ? fit_staged(law, samples, options) : fit(law, samples, options))};
  result.fit.notes.insert(result.fit.notes.begin(), samples.notes.begin(), samples.notes.end());
  return result;
}

PythonFit identify(const std::string& name, const py::object& speed, const py::object& load,
                   const py::object& temperature, const py::object& friction_norm, const py::object& friction_nm,
                   const py::object& stderr_norm, const py::object& stderr_nm, const py::object& curve,
                   const py::dict& fixed, const std::string& robust, bool staged, double torque_max_nm,
                   double gear_ratio, unsigned threads) {
  const friction::LawInfo& law = law_named(name);
  CurveColumns c{.speed_rad_s = column(speed)};
  const std::size_t rows = c.speed_rad_s.size();
  c.load_norm = column(load, rows), c.temperature_degC = column(temperature, rows);
  c.friction_norm = column(friction_norm), c.friction_nm = column(friction_nm);
  c.stderr_norm = column(stderr_norm), c.stderr_nm = column(stderr_nm), c.curve = column(curve);
  if (c.friction_norm.empty() && c.friction_nm.empty())
    throw Failure("identify() needs friction_norm (over torque_max_nm) or friction_nm [Nm]");
  const auto samples = or_raise(
      samples_of(c, "identify()", law, {.torque_max_nm = torque_max_nm, .gear_ratio = gear_ratio, .table = {}}));
  auto result = fitted(law, samples, options_of(fixed, robust, threads), staged);
  result.torque_max_nm = torque_max_nm, result.gear_ratio = gear_ratio;
  return result;
}

PythonFit identify_files(const std::string& name, const std::vector<std::filesystem::path>& files,
                         const std::string& joint, const py::dict& fixed, const std::string& robust, bool staged,
                         double torque_max_nm, double gear_ratio, unsigned threads) {
  const friction::LawInfo& law = law_named(name);
  ReadOptions options{.torque_max_nm = torque_max_nm, .gear_ratio = gear_ratio, .table = {}};
  options.table.joint = joint;
  const auto samples = or_raise(read_samples(files, law, options));
  auto result = fitted(law, samples, options_of(fixed, robust, threads), staged);
  for (const auto& file : files) result.data.push_back(file.string());
  result.torque_max_nm = torque_max_nm, result.gear_ratio = gear_ratio;
  return result;
}

void save(const PythonFit& f, const std::filesystem::path& file, bool force) {
  or_raise(usable(f.fit, f.fit.law.info));
  or_raise(twin::write_file(file, to_yaml(parameter_file(f.fit, f.data, f.torque_max_nm, f.gear_ratio)),
                            twin::replace_if(force)));
}

py::dict residual_of(const Fit& fit) {
  py::dict r;
  r["mean"] = fit.residual.mean;
  r["std"] = fit.residual.std;
  r["max_abs"] = fit.residual.max_abs;
  r["arcs"] = fit.residual.arcs;
  return r;
}

std::string text_of_fit(const PythonFit& f) {
  std::string s = fmt::format("<Fit of law {} to {} levels", f.fit.law.info->name, f.fit.samples);
  for (const auto& e : f.fit.parameters)
    s += fmt::format("\n  {:<10} {:>12.6g} +- {:<10.2g} {} {}", e.name, e.value, e.sigma, e.unit, status_of(e));
  return s + ">";
}

void bind_estimates(py::module_& m) {
  py::class_<Estimate>(m, "Estimate", "An identified number.")
      .def_readonly("name", &Estimate::name, "Name of the parameter.")
      .def_readonly("unit", &Estimate::unit, "Its unit.")
      .def_readonly("value", &Estimate::value, "Value.")
      .def_readonly("sigma", &Estimate::sigma, "One standard deviation; NaN unless estimated.")
      .def_readonly("low", &Estimate::low, "Lower end of the 95 % interval; NaN unless estimated.")
      .def_readonly("high", &Estimate::high, "Upper end of the 95 % interval; NaN unless estimated.")
      .def_property_readonly("status", &status_of,
                             "'estimated', 'fixed' (given), 'held' (these data show no effect) or 'at_bound'.")
      .def("__repr__", [](const Estimate& e) {
        return fmt::format("<{} = {:.6g} +- {:.2g} {}, {}>", e.name, e.value, e.sigma, e.unit, status_of(e));
      });
  py::class_<Lacking>(m, "Lacking", "Why a parameter is no number, or a doubtful one.")
      .def_readonly("parameter", &Lacking::parameter, "Name of the parameter.")
      .def_readonly("reason", &Lacking::reason, "Why.")
      .def_readonly("next", &Lacking::next, "What to record next.")
      .def_readonly("withheld", &Lacking::withheld, "Whether it is no number; else a doubt that its sigma counts.")
      .def("__repr__", [](const Lacking& l) { return "<" + sentence(l) + ">"; });
}

void bind_fit(py::module_& m) {
  py::class_<PythonFit>(m, "Fit", about_fit)
      .def_property_readonly(
          "parameters",
          [](const PythonFit& f) {
            py::dict all;
            for (const auto& e : f.fit.parameters) all[py::str(e.name)] = e;
            return all;
          },
          "Estimates by name, in the order of the law; then asymmetry and offset where the directions differ.")
      .def_property_readonly(
          "not_identifiable", [](const PythonFit& f) { return f.fit.unidentifiable; },
          "Names of the parameters that are not identifiable from these data.")
      .def_property_readonly(
          "lacking", [](const PythonFit& f) { return f.fit.lacking; },
          "What keeps parameters from being numbers, or makes them doubtful.")
      .def_property_readonly(
          "covariance", [](const PythonFit& f) { return f.fit.covariance; },
          "Covariance of the parameters, in their order; NaN rows where not estimated.")
      .def_property_readonly(
          "law", [](const PythonFit& f) { return PythonLaw{f.fit.law}; },
          "The law with these parameters; its range is that of the data.")
      .def_property_readonly(
          "residual", [](const PythonFit& f) { return residual_of(f.fit); },
          "Measured minus predicted [unit of the law]: mean, std, max_abs; arcs: share of their mean "
          "square that is no noise.")
      .def_property_readonly(
          "r_squared", [](const PythonFit& f) { return f.fit.r_squared; }, "R squared.")
      .def_property_readonly(
          "aicc", [](const PythonFit& f) { return f.fit.aicc; }, "Corrected Akaike criterion.")
      .def_property_readonly(
          "condition_number", [](const PythonFit& f) { return f.fit.condition_number; },
          "Of the Jacobian with unit columns.")
      .def_property_readonly(
          "samples", [](const PythonFit& f) { return f.fit.samples; }, "Levels in the fit.")
      .def_property_readonly(
          "notes", [](const PythonFit& f) { return f.fit.notes; }, "Limits of the result.")
      .def("save", &save, py::arg("file"), py::kw_only(), py::arg("force") = false,
           "Writes PARAMS.yaml, which the programs read.")
      .def("__repr__", &text_of_fit);
}

}  // namespace

void bind_identification(py::module_& m) {
  const auto none = py::none();
  bind_estimates(m);
  bind_fit(m);
  m.def("identify", &identify, py::arg("law"), py::kw_only(), py::arg("speed_rad_s"), py::arg("load_norm") = none,
        py::arg("temperature_degC") = none, py::arg("friction_norm") = none, py::arg("friction_nm") = none,
        py::arg("stderr_norm") = none, py::arg("stderr_nm") = none, py::arg("curve") = none,
        py::arg("fixed") = py::dict(), py::arg("robust") = "squares", py::arg("staged") = false,
        py::arg("torque_max_nm") = 0.0, py::arg("gear_ratio") = 0.0, py::arg("threads") = 2u, about_identify);
  m.def("identify_files", &identify_files, py::arg("law"), py::arg("files"), py::kw_only(), py::arg("joint") = "",
        py::arg("fixed") = py::dict(), py::arg("robust") = "squares", py::arg("staged") = false,
        py::arg("torque_max_nm") = 0.0, py::arg("gear_ratio") = 0.0, py::arg("threads") = 2u,
        "identify() of tables and records as `tribotwin identify` reads them: CSV, telemetry.h5, .npz, .mat, .mcap.");
}

}  // namespace tribotwin::python
