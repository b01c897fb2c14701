// Prints the generated part of a README: `readme_reference plugins` or `readme_reference hil`.
#include <cstdio>
#include <cstring>

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/plugins/drive/configuration.hpp>
int main(int, char** argv) {
  const bool hil = std::strcmp(argv[1], "hil") == 0;
  const auto dictionary =
      tribotwin::hil::drive_dictionary({.node = 1, .name = "joint1", .gear_ratio = 100, .rated_torque_nm = 10});
  std::fputs((hil ? tribotwin::hil::reference_markdown(dictionary) : tribotwin::drive::reference_markdown()).c_str(),
             stdout);
}
