#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/experiments/friction/experiment.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/python/bindings.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::python {
namespace {

constexpr const char* about_measure =
    R"(Measures a friction curve in simulation, as on a robot: back and forth at each speed.

model: an MJCF file with drives, or one that ships ('mjcf/irb6620.xml'). joint: name. speed_rad_s: of the motor [rad/s].
load_norm: load torque over torque_max_nm [-]. temperature_degC: at which the joint is held [degC]. load_by: 'torque'
(gravity removed) or 'pose' (gravity of a pose found for it). noise_nm: standard deviation of the measured torque [Nm,
arm side], drawn with seed. Returns arrays by name, with which identify() can be called: speed_rad_s, load_norm,
temperature_degC, friction_norm and, with noise, stderr_norm.)";

constexpr const char* about_keys = R"(The drives of a model: by joint, the keys with which Drive() makes the same.

model: an MJCF file, or one that ships ('mjcf/irb6620.xml').)";

std::shared_ptr<const mujoco::Model> model_of(const std::filesystem::path& file) {
  return or_raise(mujoco::load_file(twin::given_or_shipped(file.string(), ".xml")));
}

py::dict measure(const std::filesystem::path& file, const std::string& joint, const py::object& speed, double load_norm,
                 double temperature_degC, const std::string& load_by, double noise_nm, std::uint64_t seed) {
  const Array speeds(speed);
  if (load_by != "torque" && load_by != "pose")
    throw Failure(fmt::format("load_by is '{}' but must be 'torque' or 'pose'", load_by));
  for (py::ssize_t i = 0; i < speeds.size(); ++i)
    if (const double v = speeds.data()[i]; !(std::abs(v) > 0 && std::abs(v) < 1e6))
      throw Failure(
          fmt::format("speed_rad_s holds {} but a measurement needs speeds other than 0, below 1e6 [rad/s]", v));
  if (!(std::abs(load_norm) <= 1000))
    throw Failure(fmt::format("load_norm is {} but must be within -1000 .. 1000", load_norm));
  if (!(temperature_degC >= -273.15 && temperature_degC <= 1000))
    throw Failure(fmt::format("temperature_degC is {} but must be within -273.15 .. 1000 [degC]", temperature_degC));
  if (!(noise_nm >= 0)) throw Failure(fmt::format("noise_nm is {} but must be at least 0 [Nm]", noise_nm));
  const auto model = model_of(file);
  const std::size_t drive = or_raise(twin::find_drive(*model, joint));
  std::vector<twin::CurvePoint> points;
  {
    const std::span<const double> all(speeds.data(), static_cast<std::size_t>(speeds.size()));
    const py::gil_scoped_release release;
    points = or_raise(twin::measure_curve(*model, drive, all,
                                          {.load_norm = load_norm,
                                           .temperature_degC = temperature_degC,
                                           .load_by = load_by == "pose" ? twin::LoadBy::pose : twin::LoadBy::torque,
                                           .noise_nm = noise_nm,
                                           .seed = seed,
                                           .progress = {}}));
  }
  const double torque_max_nm = model->drives()[drive].drive.torque_max_nm;
  const auto column = [&](auto value) {
    std::vector<double> values;
    for (const twin::CurvePoint& point : points) values.push_back(value(point));
    return array_of(std::move(values));
  };
  py::dict all;
  all["speed_rad_s"] = column([](const auto& p) { return p.speed_rad_s; });
  all["load_norm"] = column([](const auto& p) { return p.load_norm; });
  all["temperature_degC"] = column([](const auto& p) { return p.temperature_degC; });
  all["friction_norm"] = column([](const auto& p) { return p.friction_norm; });
  if (noise_nm > 0) all["stderr_norm"] = column([&](const auto& p) { return p.stderr_nm / torque_max_nm; });
  return all;
}

py::dict drive_keys(const std::filesystem::path& file) {
  const auto model = model_of(file);
  py::dict all;
  for (const auto& binding : model->drives()) {
    py::dict keys;
    for (const auto& [key, value] : drive::configuration_of(binding.drive)) keys[py::str(key)] = value;
    all[py::str(twin::joint_name(model->get(), binding))] = keys;
  }
  return all;
}

}  // namespace

void bind_experiments(py::module_& m) {
  m.def("measure_curve", &measure, py::arg("model"), py::arg("joint"), py::arg("speed_rad_s"), py::kw_only(),
        py::arg("load_norm") = 0.0, py::arg("temperature_degC") = 50.0, py::arg("load_by") = "torque",
        py::arg("noise_nm") = 0.0, py::arg("seed") = 1, about_measure);
  m.def("drive_keys", &drive_keys, py::arg("model"), about_keys);
}

}  // namespace tribotwin::python
