#include <fmt/format.h>

#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/python/bindings.hpp>
#include <tribotwin/twin/python/hdf5_lock.hpp>

namespace tribotwin::python {
namespace {

constexpr const char* about_recording = R"(The record of a run: columns of numbers, joint by joint.

recording['joint2']['temperature_degC'] is an array with one value per time_s. Names carry units; those of a slide are
m, m/s and N, see units.)";

constexpr const char* about_read = R"(Reads the record of a run, finished, unfinished or growing.

path: folder of the run, or its telemetry.h5. Raises Error where a part of it is damaged.)";

struct PythonRecording {
  py::array_t<double> time_s, cycle_time_s;
  py::list joints;
  py::dict values, cycles, units, descriptions, joint_attributes, attributes;
  bool complete = false;
};

py::dict columns_of(const std::vector<twin::Channel>& channels, std::vector<std::vector<double>>& values) {
  py::dict all;
  for (std::size_t c = 0; c < channels.size() && c < values.size(); ++c)
    if (!values[c].empty()) all[py::str(channels[c].name)] = array_of(std::move(values[c]));
  return all;
}

py::dict joint_named(const py::dict& all, const PythonRecording& r, const std::string& joint) {
  if (!all.contains(joint))
    throw Failure(fmt::format("no joint '{}'; the joints are {}", joint, std::string(py::repr(r.joints))));
  return all[py::str(joint)];
}

py::object read_run(const std::filesystem::path& path) {
  const auto record = twin::record_of(path);
  if (!record) throw Failure(fmt::format("{}: is no folder of a run and no telemetry.h5", path.string()));
  const Hdf5Lock lock;  // and the GIL: HDF5 is not thread-safe
  return recording_of(or_raise(twin::read_telemetry(*record)));
}

}  // namespace

Hdf5Lock::Hdf5Lock() {
  try {
    lock_ = py::module_::import("h5py").attr("_objects").attr("phil");
    lock_.attr("acquire")();
  } catch (py::error_already_set& e) {
    if (!e.matches(PyExc_ImportError) && !e.matches(PyExc_AttributeError)) throw;
    lock_ = py::none();
  }
}
Hdf5Lock::~Hdf5Lock() {
  if (!lock_.is_none()) lock_.attr("release")();
}

py::object recording_of(twin::Recording r) {
  PythonRecording p;
  p.time_s = array_of(std::move(r.time_s)), p.cycle_time_s = array_of(std::move(r.cycle_time_s));
  p.complete = r.complete;
  for (const auto& [key, value] : r.attributes) p.attributes[py::str(key)] = value;
  for (const auto& channels : {r.channels, r.cycle_channels})
    for (const auto& channel : channels) p.descriptions[py::str(channel.name)] = channel.description;
  for (std::size_t j = 0; j < r.joints.size(); ++j) {
    const py::str joint(r.joints[j]);
    p.joints.append(joint);
    p.values[joint] = columns_of(r.channels, r.values[j]);
    p.cycles[joint] = j < r.cycle_values.size() ? columns_of(r.cycle_channels, r.cycle_values[j]) : py::dict();
    py::dict units, attributes;
    for (std::size_t c = 0; c < r.channels.size(); ++c)
      units[py::str(r.channels[c].name)] = j < r.units.size() ? r.units[j][c] : r.channels[c].unit;
    for (const auto& channel : r.cycle_channels) units[py::str(channel.name)] = channel.unit;
    if (j < r.joint_attributes.size())
      for (const auto& [key, value] : r.joint_attributes[j]) attributes[py::str(key)] = value;
    p.units[joint] = units;
    p.joint_attributes[joint] = attributes;
  }
  return py::cast(std::move(p));
}

void bind_records(py::module_& m) {
  using R = PythonRecording;
  py::class_<R>(m, "Recording", about_recording)
      .def_readonly("time_s", &R::time_s, "Time of the samples [s].")
      .def_readonly("cycle_time_s", &R::cycle_time_s, "End of each work cycle [s].")
      .def_readonly("joints", &R::joints, "Names of the joints.")
      .def_readonly("attributes", &R::attributes, "What the record says of itself: engine, scenario, seed, ...")
      .def_readonly("joint_attributes", &R::joint_attributes, "By joint: gear_ratio, torque_max_nm [Nm].")
      .def_readonly("units", &R::units, "By joint and column: the unit.")
      .def_readonly("descriptions", &R::descriptions, "By column: what it is.")
      .def_readonly("complete", &R::complete, "Whether the run ended by itself.")
      .def(
          "__getitem__", [](const R& r, const std::string& joint) { return joint_named(r.values, r, joint); },
          py::arg("joint"), "Columns of a joint by name, one value per time_s.")
      .def(
          "cycles", [](const R& r, const std::string& joint) { return joint_named(r.cycles, r, joint); },
          py::arg("joint"), "Columns of a joint by name, one value per cycle_time_s.")
      .def("__repr__", [](const R& r) {
        return fmt::format("<Recording of {} samples of {}{}>", r.time_s.size(), std::string(py::repr(r.joints)),
                           r.complete ? "" : ", not complete");
      });
  m.def("read_run", &read_run, py::arg("path"), about_read);
}

}  // namespace tribotwin::python
