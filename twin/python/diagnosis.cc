#include <fmt/format.h>
#include <pybind11/eigen.h>

#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/diagnosis/learn.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/python/bindings.hpp>
#include <tribotwin/twin/python/hdf5_lock.hpp>

namespace tribotwin::python {
namespace {

using namespace twin::diagnosis;
using Files = std::vector<std::filesystem::path>;

constexpr const char* about_learn = R"(The normal friction of a joint, learned from unloaded curves, cold to hot.

files: tables of friction curves, or records of a joint. loaded: curves of the same joint with load, from which its
effect is learned. torque_max_nm [Nm, arm side], gear_ratio: where the tables do not tell. joint: of a table of several.
load_sensitivity: relative rise of friction per load_norm, where nothing is loaded. robust: leave outliers out. lever_m:
of the payload about the joint [m].)";

constexpr const char* about_check = R"(Whether each curve is that of the healthy joint, and if not, the cause.

files: tables of friction curves, or records of the joint. false_alarm: how many healthy curves per region may be called
anomalous, 0 .. 1.)";

std::vector<ObservationFile> read(const Files& files, const ObservationOptions& options) {
  std::vector<ObservationFile> all;
  for (const auto& file : files) all.push_back(or_raise(read_observations(file, options)));
  return all;
}

HealthyState learn_state(const Files& files, const Files& loaded, const std::string& joint, double torque_max_nm,
                         double gear_ratio, double load_sensitivity, bool robust, double lever_m) {
  ObservationOptions options{
      .torque_max_nm = torque_max_nm, .gear_ratio = gear_ratio, .table = {}, .load_sensitivity = load_sensitivity};
  options.table.joint = joint;
  const Hdf5Lock lock;
  const auto healthy = read(files, options), with_load = read(loaded, options);
  auto state = or_raise(learn(healthy, with_load, load_sensitivity, {.robust = robust, .lever_m = lever_m}));
  if (state.joint.empty()) state.joint = joint;
  if (!(state.torque_max_nm > 0)) state.torque_max_nm = torque_max_nm;
  return state;
}

/// A verdict and the curve that it is of.
struct Judged {
  Observation observation;
  Verdict verdict;
};

std::vector<Judged> check_files(const HealthyState& state, const Files& files, double false_alarm,
                                const std::string& joint, double gear_ratio) {
  if (!(false_alarm > 0 && false_alarm < 1))
    throw Failure(fmt::format("false_alarm is {} but must be above 0 and below 1", false_alarm));
  ObservationOptions options{.torque_max_nm = state.torque_max_nm,
                             .gear_ratio = gear_ratio,
                             .table = {},
                             .load_sensitivity = state.load_sensitivity};
  options.table.joint = joint;
  const Hdf5Lock lock;
  std::vector<Judged> all;
  for (const auto& file : read(files, options)) {
    const auto verdicts = or_raise(check(state, file, {.false_alarm = false_alarm}));
    for (std::size_t i = 0; i < verdicts.size(); ++i) all.push_back({file.observations[i], verdicts[i]});
  }
  return all;
}

py::dict features_of(const Observation& o) {
  py::dict all;
  for (Eigen::Index i = 0; i < feature_count; ++i)
    all[py::str(std::string(feature_names[static_cast<std::size_t>(i)]))] = o.features(i);
  return all;
}

py::dict indicators_of(const Verdict& v) {
  py::dict all;
  for (std::size_t k = 0; k < indicator_count; ++k)
    if (v.indicators[k])
      all[py::str(std::string(indicators[k].name))] =
          py::make_tuple(v.indicators[k]->value, v.indicators[k]->limit, v.indicators[k]->anomalous);
  return all;
}

py::dict probabilities_of(const Verdict& v) {
  py::dict all;
  for (const auto& c : v.candidates) all[py::str(std::string(c.pattern ? c.pattern->name : "healthy"))] = c.probability;
  return all;
}

void bind_verdicts(py::module_& m) {
  py::class_<RegionVerdict>(m, "RegionVerdict", "One region of the friction curve: contact surfaces, or lubricant.")
      .def_readonly("distance", &RegionVerdict::distance, "Squared distance over all temperatures [-].")
      .def_readonly("statistic", &RegionVerdict::statistic, "T^2 at this temperature [-].")
      .def_readonly("limit", &RegionVerdict::limit, "Of T^2, at the rate of false alarms.")
      .def_readonly("by_chance", &RegionVerdict::by_chance, "Probability that a healthy joint has this T^2 or more.")
      .def_readonly("anomalous", &RegionVerdict::anomalous, "Whether T^2 is above its limit.");
  using J = Judged;
  py::class_<J>(m, "Verdict", "Whether a curve is that of the healthy joint.")
      .def_property_readonly(
          "anomalous", [](const J& j) { return j.verdict.anomalous; },
          "Whether a region or an indicator is beyond its limit.")
      .def_property_readonly(
          "pattern", [](const J& j) { return j.verdict.pattern; }, "Name of the cause, 'healthy' or 'unknown'.")
      .def_property_readonly(
          "severity", [](const J& j) { return j.verdict.severity; }, "In the unit of the cause.")
      .def_property_readonly(
          "confidence", [](const J& j) { return j.verdict.confidence; }, "Probability of the pattern, 0 .. 1.")
      .def_property_readonly(
          "probabilities", [](const J& j) { return probabilities_of(j.verdict); },
          "Of all causes that are possible, by name.")
      .def_property_readonly(
          "sentence", [](const J& j) { return j.verdict.sentence; }, "The verdict in words.")
      .def_property_readonly(
          "contact", [](const J& j) { return j.verdict.region[0]; }, "Region 1, contact surfaces: a RegionVerdict.")
      .def_property_readonly(
          "lubricant", [](const J& j) { return j.verdict.region[1]; }, "Region 2, lubricant: a RegionVerdict.")
      .def_property_readonly(
          "indicators", [](const J& j) { return indicators_of(j.verdict); }, "By name: (value, limit, anomalous).")
      .def_property_readonly(
          "features", [](const J& j) { return features_of(j.observation); },
          "Fc, Fs [Nm], Vs [rad/s], Fv [Nm (s/rad)^beta], beta of the curve.")
      .def_property_readonly(
          "temperature_degC", [](const J& j) { return j.observation.temperature_degC; },
          "Mean of the curve [degC]; None without a thermometer.")
      .def_property_readonly(
          "file", [](const J& j) { return j.observation.file; }, "File of the curve.")
      .def_property_readonly(
          "curve", [](const J& j) { return j.observation.curve; }, "Within the file, from 1.")
      .def("__repr__", [](const J& j) { return "<" + j.verdict.sentence + ">"; });
}

}  // namespace

void bind_diagnosis(py::module_& m) {
  bind_verdicts(m);
  using H = HealthyState;
  py::class_<H>(m, "Healthy", "The normal friction of a joint; see learn().")
      .def("check", &check_files, py::arg("files"), py::kw_only(), py::arg("false_alarm") = two_sigma_false_alarm,
           py::arg("joint") = "", py::arg("gear_ratio") = 0.0, about_check)
      .def(
          "save",
          [](const H& state, const std::filesystem::path& file, bool force) {
            or_raise(twin::write_file(file, to_yaml(state), twin::replace_if(force)));
          },
          py::arg("file"), py::kw_only(), py::arg("force") = false, "Writes healthy.yaml, which the programs read.")
      .def_readonly("joint", &H::joint, "Name of the joint; empty: not known.")
      .def_readonly("observations", &H::observations, "Curves that it was learned from.")
      .def_readonly("left_out", &H::left_out, "Curves that the robust estimate left out.")
      .def_readonly("temperature_low_degC", &H::temperature_low_degC, "Coldest curve [degC].")
      .def_readonly("temperature_high_degC", &H::temperature_high_degC, "Hottest curve [degC].")
      .def_readonly("knows_temperature", &H::knows_temperature, "Whether the effect of temperature was learned.")
      .def_property_readonly(
          "mean", [](const H& h) { return Eigen::VectorXd(h.mean); },
          "Mean of Fc, Fs [Nm], Vs [rad/s], Fv [Nm (s/rad)^beta], beta.")
      .def_property_readonly(
          "covariance", [](const H& h) { return Eigen::MatrixXd(h.covariance); }, "Covariance of the same.");
  m.def("learn", &learn_state, py::arg("files"), py::arg("loaded") = Files{}, py::kw_only(), py::arg("joint") = "",
        py::arg("torque_max_nm") = 0.0, py::arg("gear_ratio") = 0.0, py::arg("load_sensitivity") = 0.6,
        py::arg("robust") = false, py::arg("lever_m") = 0.0, about_learn);
  m.def(
      "read_healthy", [](const std::filesystem::path& file) { return or_raise(read_healthy(file)); }, py::arg("file"),
      "Reads healthy.yaml of Healthy.save() or `tribotwin diagnose learn`.");
}

}  // namespace tribotwin::python
