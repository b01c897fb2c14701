#pragma once

#include <pybind11/pybind11.h>

namespace tribotwin::python {

/// While it lives, h5py of other threads waits: both use one HDF5 library, which is not thread-safe. Needs the GIL when
/// it is made and destroyed, not in between.
class Hdf5Lock {
 public:
  Hdf5Lock();
  ~Hdf5Lock();
  Hdf5Lock(const Hdf5Lock&) = delete;
  Hdf5Lock& operator=(const Hdf5Lock&) = delete;

 private:
  pybind11::object lock_;
};

}  // namespace tribotwin::python
