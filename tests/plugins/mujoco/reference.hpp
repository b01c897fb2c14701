#pragma once

#include <cstdio>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

/// The rows that `dynamics_reference.py CASE` prints (scipy, 1e-10).
inline std::vector<std::vector<double>> reference(const std::string& what) {
  const std::string command =
      "/usr/bin/python3 " TRIBOTWIN_SOURCE_DIR "/tests/plugins/mujoco/dynamics_reference.py " + what;
  FILE* pipe = popen(command.c_str(), "r");
  if (!pipe) throw std::runtime_error(command);
  std::string text;
  char part[4096];
  while (const std::size_t n = fread(part, 1, sizeof part, pipe)) text.append(part, n);
  if (pclose(pipe) != 0) throw std::runtime_error("failed: " + command);
  std::vector<std::vector<double>> rows;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream numbers(line);
    rows.emplace_back();
    for (double x; numbers >> x;) rows.back().push_back(x);
  }
  return rows;
}
