// Compiled with the plugin's own fmt/format.h.
#include <limits>
#include <vector>

#include <fmt/format.h>

std::vector<std::string> messages() {
#include "messages.inc"
}
