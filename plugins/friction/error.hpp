#pragma once

#include <string>
#include <utility>

#include <tl/expected.hpp>

namespace tribotwin {

/// Whose turn it is after an error. Programs map it to their exit code.
enum class ErrorKind {
  input,  ///< the user's: a file, key, option or value is wrong; the message says where and what would be right
  work,   ///< the machine's or the method's: a full disk, a lost bus, a search that found nothing
};

/// The text with control characters, but for tabs and line breaks, as \\xNN: what a file holds must not steer a
/// terminal.
std::string without_controls(std::string text);

/// Why a function has no result. The one error type of all libraries; a value, never an exception.
struct Error {
  std::string message;  ///< without control characters
  ErrorKind kind = ErrorKind::input;

  Error(std::string what, ErrorKind whose = ErrorKind::input)
      : message(without_controls(std::move(what))), kind(whose) {}
  Error(const char* what, ErrorKind whose = ErrorKind::input) : Error(std::string(what), whose) {}
};

/// A value, or why there is none.
template <class T>
using Result = tl::expected<T, Error>;

/// Returned by a function whose input was right and whose work failed.
inline tl::unexpected<Error> work_failed(std::string message) {
  return tl::unexpected<Error>(Error(std::move(message), ErrorKind::work));
}

}  // namespace tribotwin
