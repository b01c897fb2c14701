#pragma once

#include <string>

/// What --version prints.
namespace tribotwin::twin::program {

/// "tribotwin 0.1.0, MuJoCo 2.2.2" and a line with commit, compiler and build type. `engine`: MuJoCo's version.
std::string version_text(const std::string& program, const std::string& engine);

/// The same and the versions of the libraries as JSON.
std::string version_json(const std::string& program, const std::string& engine);

/// "0.1.0".
std::string version_number();
/// The day of the commit, or of the release in a source tree without history; "2026-11-22".
std::string version_date();

}  // namespace tribotwin::twin::program
