// Compiled with libfmt.
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>

std::vector<std::string> messages_of_libfmt() {
#include "messages.inc"
}
