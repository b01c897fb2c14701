// Prints the generated part of a README, prose in lines of at most 120 columns: `readme_reference plugins`, `hil` or
// `twin/io/tables`.
#include <cstdio>
#include <cstring>
#include <sstream>
#include <string>

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/mujoco/sensor.hpp>
#include <tribotwin/twin/io/tables/column.hpp>

namespace {

/// Columns of UTF-8 text.
std::size_t columns(const std::string& text) {
  std::size_t count = 0;
  for (const char c : text) count += (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  return count;
}

/// Rows of tables stay whole: Markdown cannot break them. The lines of a list's entry are indented.
void print_wrapped(const std::string& line) {
  const std::string indent(line.starts_with("- ") ? 2 : 0, ' ');
  std::istringstream words(line);
  std::string out, word;
  while (!line.starts_with('|') && columns(line) > 120 && words >> word) {
    if (!out.empty() && columns(out) + 1 + columns(word) > 120) {
      std::printf("%s\n", out.c_str());
      out = indent + word;
    } else {
      out += (out.empty() ? "" : " ") + word;
    }
  }
  std::printf("%s\n", out.empty() ? line.c_str() : out.c_str());
}

}  // namespace

int main(int, char** argv) {
  const bool hil = std::strcmp(argv[1], "hil") == 0, tables = std::strcmp(argv[1], "twin/io/tables") == 0;
  const auto dictionary =
      tribotwin::hil::drive_dictionary({.node = 1, .name = "joint1", .gear_ratio = 100, .rated_torque_nm = 10});
  std::istringstream text(tables ? tribotwin::twin::column_reference_markdown()
                          : hil  ? tribotwin::hil::reference_markdown(dictionary)
                                 : tribotwin::drive::reference_markdown() +
                                      tribotwin::mujoco::sensor_reference_markdown());
  for (std::string line; std::getline(text, line);) print_wrapped(line);
}
