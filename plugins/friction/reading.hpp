#pragma once

#include <iosfwd>
#include <optional>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>

/// Files to their end. Where the machine cannot read on, a stream goes bad(); loops of getline and operator<< take that
/// for the end, and iterators throw.
namespace tribotwin {

/// All that follows in a stream that is open; nothing where the machine cannot read it to its end.
std::optional<std::string> rest_of(std::istream& stream);

/// "FILE: cannot be read to its end (reason)", failed work; at once after reading failed, for the reason is errno.
tl::unexpected<Error> not_read(std::string_view file);

}  // namespace tribotwin
