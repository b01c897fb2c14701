#pragma once

#include <string>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// A joint as one C99 file for controllers and other programs: law, heat, bristles, load table, faults. It does what
/// drive::slide does, in the same order of operations: with the same libm and without contraction of products and sums
/// the results are the same doubles.
namespace tribotwin::twin {

/// `name` is the prefix of everything in the file and becomes part of C: letters, digits and _, no keyword. Fails where
/// it cannot.
Result<std::string> c_source(const drive::Drive& drive, const std::string& name);

}  // namespace tribotwin::twin
