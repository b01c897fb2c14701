#pragma once

#include <algorithm>
#include <string_view>
#include <vector>

namespace tribotwin::hil {

/// The parts of a line between blanks.
inline std::vector<std::string_view> words(std::string_view line) {
  constexpr std::string_view blanks = " \t\r\n";
  std::vector<std::string_view> out;
  for (auto begin = line.find_first_not_of(blanks); begin != line.npos; begin = line.find_first_not_of(blanks, begin)) {
    const auto end = std::min(line.find_first_of(blanks, begin), line.size());
    out.push_back(line.substr(begin, end - begin));
    begin = end;
  }
  return out;
}

}  // namespace tribotwin::hil
