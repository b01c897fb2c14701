#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

/// What the files of the Python module share. Everything that computes is in the libraries; here is what Python sees.
namespace tribotwin::python {

namespace py = pybind11;

/// Contiguous doubles: an argument that is such an array is not copied.
using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// An Error on its way to Python, where it becomes tribotwin.Error.
struct Failure : std::runtime_error {
  explicit Failure(const Error& error) : std::runtime_error(error.message), kind(error.kind) {}
  ErrorKind kind;
};

/// The value, or its error as a Python exception.
template <class T>
T or_raise(Result<T> value) {
  if (!value) throw Failure(value.error());
  if constexpr (!std::is_void_v<T>) return std::move(*value);
}

/// A law as Python has it.
struct PythonLaw {
  friction::Law law;
};

/// An array that owns `values` without copying them.
py::array_t<double> array_of(std::vector<double> values);
py::array_t<double> array_of(std::vector<double> values, std::vector<py::ssize_t> shape);

/// Broadcasts arrays to one shape, as NumPy does; those that have it already are not copied.
std::vector<Array> broadcast(std::vector<py::object> values);

/// A record as tribotwin.Recording.
py::object recording_of(twin::Recording recording);

/// Python's own dict as text of the named keys: numbers in their shortest exact form.
std::string text_of(py::handle value);

void bind_laws(py::module_& m);
void bind_drives(py::module_& m);
void bind_twins(py::module_& m);
void bind_records(py::module_& m);
void bind_experiments(py::module_& m);
void bind_identification(py::module_& m);
void bind_diagnosis(py::module_& m);

}  // namespace tribotwin::python
