#pragma once

#include <string>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// A joint as a functional mock-up unit (FMU) for co-simulation: modelDescription.xml, the joint of c_source.hpp with
/// its numbers as tunable parameters, the functions of FMI 2.0 or 3.0 around it, and, where a C compiler is found, a
/// shared library for this machine. The same joint gives the same bytes, except for what the compiler makes.
namespace tribotwin::twin {

enum class FmiVersion { two = 2, three = 3 };

struct FmuFile {
  std::string name, content;  ///< name: path within the FMU
};

/// The files of an FMU called `name` (as in c_source), without its shared library. Fails where the name is none in C.
Result<std::vector<FmuFile>> fmu_files(const drive::Drive& drive, const std::string& name, FmiVersion version);

/// Where the shared library for this machine lies in the FMU; empty where the standard has no name for the machine.
std::string fmu_library_name(const std::string& name, FmiVersion version);

/// The shared library made of these files with the first of cc, gcc and clang that is found; empty where none is.
/// Fails with ErrorKind::work where the compiler does.
Result<std::string> fmu_library(const std::vector<FmuFile>& files, const std::string& name, FmiVersion version);

/// A zip archive of files. Fails with ErrorKind::work.
Result<std::string> zipped(const std::vector<FmuFile>& files);

}  // namespace tribotwin::twin
