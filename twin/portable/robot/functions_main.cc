/// Writes the C of a robot's FMU while the tree is built. Argument: 2 or 3.
#include <cstdio>
#include <string>

#include <tribotwin/twin/portable/robot/robot_functions.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin::twin;
  const std::string text =
      robot_fmu_functions(argc > 1 && std::string(argv[1]) == "3" ? FmiVersion::three : FmiVersion::two);
  return std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0 ? 0 : 1;
}
