#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/python/bindings.hpp>

namespace tribotwin::python {
namespace {

constexpr const char* about = R"(One robot joint whose friction depends on speed, load and temperature, from C++.

Units are in the names: rad, rad/s, Nm, s, degC, K. Torques are those of the arm side unless the name says motor_;
`_norm` is a torque over torque_max_nm. See help() of Law, Drive, Twin, identify, learn and read_run.)";

constexpr const char* about_error = R"(What went wrong, in the words of the programs.

kind: 'input' where a file, a key or a value is wrong (the message says where and what would be right), 'work' where
the input was right and the work failed.)";

/// The class lives as long as the interpreter.
PyObject* error_class = nullptr;

void raise(const char* message, ErrorKind kind) {
  const py::object error = py::reinterpret_borrow<py::object>(error_class)(message);
  error.attr("kind") = kind == ErrorKind::input ? "input" : "work";
  PyErr_SetObject(error_class, error.ptr());
}

void translate(std::exception_ptr thrown) {
  try {
    if (thrown) std::rethrow_exception(thrown);
  } catch (const Failure& e) {
    raise(e.what(), e.kind);
  } catch (const twin::InputError& e) {
    raise(e.what(), ErrorKind::input);
  } catch (const py::builtin_exception&) {
    throw;  // IndexError, TypeError and the like, which pybind11 translates
  } catch (const std::runtime_error& e) {
    raise(e.what(), ErrorKind::work);
  }
}

}  // namespace

py::array_t<double> array_of(std::vector<double> values) {
  const auto size = static_cast<py::ssize_t>(values.size());
  return array_of(std::move(values), {size});
}

py::array_t<double> array_of(std::vector<double> values, std::vector<py::ssize_t> shape) {
  auto* owned = new std::vector<double>(std::move(values));
  const py::capsule owner(owned, [](void* p) { delete static_cast<std::vector<double>*>(p); });
  return py::array_t<double>(std::move(shape), owned->data(), owner);
}

std::vector<Array> broadcast(std::vector<py::object> values) {
  std::vector<Array> arrays;
  for (const auto& value : values) arrays.emplace_back(value);
  const auto shape = [](const Array& a) { return std::vector<py::ssize_t>(a.shape(), a.shape() + a.ndim()); };
  bool same = true;
  for (const auto& array : arrays) same &= shape(array) == shape(arrays.front());
  if (same) return arrays;
  py::tuple all(arrays.size());
  for (std::size_t i = 0; i < arrays.size(); ++i) all[i] = arrays[i];
  const py::list wide = py::module_::import("numpy").attr("broadcast_arrays")(*all);
  for (std::size_t i = 0; i < arrays.size(); ++i) arrays[i] = Array(py::object(wide[i]));
  return arrays;
}

std::string text_of(py::handle value) {
  if (!py::isinstance<py::list>(value) && !py::isinstance<py::tuple>(value)) return py::str(value);
  std::string text;
  for (const auto item : value) text += (text.empty() ? "" : " ") + std::string(py::str(item));
  return text;
}

PYBIND11_MODULE(_tribotwin, m) {
  m.doc() = about;
  m.attr("__version__") = TRIBOTWIN_VERSION;
  error_class = PyErr_NewExceptionWithDoc("tribotwin.Error", about_error, nullptr, nullptr);
  m.attr("Error") = py::reinterpret_borrow<py::object>(error_class);
  py::register_exception_translator(translate);
  for (const auto bind :
       {bind_laws, bind_drives, bind_records, bind_twins, bind_experiments, bind_identification, bind_diagnosis})
    bind(m);
}

}  // namespace tribotwin::python
