#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// Private to this folder: the header of a NumPy array, format versions 1.0, 2.0 and 3.0 (numpy.lib.format).
namespace tribotwin::twin::tables {

struct NumpyField {
  std::string name;      ///< empty: an array without fields
  char kind = 'f';       ///< f, i, u, b as in array interfaces; others hold no numbers, O are Python objects
  std::size_t size = 8;  ///< of one number, in bytes
  bool swapped = false;  ///< its bytes are in the other order than this machine's
  std::size_t offset = 0, count = 1;  ///< within an item; count: numbers side by side

  bool number() const;
};

struct NumpyHeader {
  std::vector<NumpyField> fields;
  std::vector<std::size_t> shape;
  bool fortran_order = false;
  std::size_t item_bytes = 0, header_bytes = 0;
};

/// `read` gives the next bytes, fewer at the end. Fails with what is wrong.
Result<NumpyHeader> read_numpy_header(const std::function<std::size_t(char*, std::size_t)>& read);

}  // namespace tribotwin::twin::tables
