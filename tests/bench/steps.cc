// steps ours|shared|native INTEGRATOR static|lugre ROBOTS STEPS: steps one of the robots of robots.hpp, for a counter
// of instructions. `shared`: ours with one plugin instance.
#include <cstdio>
#include <cstdlib>
#include <string>

#include "robots.hpp"

int main(int argc, char** argv) {
  using namespace tribotwin::bench;
  if (argc != 6) {
    std::fputs("usage: steps ours|shared|native INTEGRATOR static|lugre ROBOTS STEPS\n", stderr);
    return 2;
  }
  const std::string which = argv[1];
  const Rivals both = rivals({.integrator = argv[2],
                              .lugre = std::string(argv[3]) == "lugre",
                              .count = std::atoi(argv[4]),
                              .one_instance = which == "shared"});
  Swing swing(both);
  if (which == "native")
    swing.step_native(std::atoi(argv[5]));
  else
    swing.step_ours(std::atoi(argv[5]));
}
