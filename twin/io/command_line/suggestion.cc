#include <algorithm>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/io/command_line/suggestion.hpp>

namespace tribotwin::twin {
namespace {

constexpr std::size_t most_errors = 2;

}  // namespace

std::size_t typing_errors(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), above(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before = std::exchange(above, row);
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({above[j] + 1, row[j - 1] + 1, above[j - 1] + (a[i - 1] != b[j - 1])});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row.back();
}

std::string did_you_mean(std::string_view given, std::span<const std::string> names) {
  std::string_view best;
  std::size_t fewest = most_errors + 1;
  for (const std::string& name : names) {
    const std::size_t dashes = std::min(name.find_first_not_of('-'), name.size());
    const std::size_t errors = typing_errors(given, name);
    if (errors < fewest && 2 * errors < name.size() - dashes) best = name, fewest = errors;
  }
  return best.empty() ? std::string() : fmt::format("; did you mean '{}'?", best);
}

}  // namespace tribotwin::twin
