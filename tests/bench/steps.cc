// steps ours|native INTEGRATOR static|lugre ROBOTS STEPS: steps one of the two robots of robots.hpp, for a counter of
// instructions.
#include <cstdio>
#include <cstdlib>
#include <string>

#include "robots.hpp"

int main(int argc, char** argv) {
  using namespace tribotwin::bench;
  if (argc != 6) {
    std::fputs("usage: steps ours|native INTEGRATOR static|lugre ROBOTS STEPS\n", stderr);
    return 2;
  }
  const Rivals both =
      rivals({.integrator = argv[2], .lugre = std::string(argv[3]) == "lugre", .count = std::atoi(argv[4])});
  Swing swing(both);
  if (std::string(argv[1]) == "ours")
    swing.step_ours(std::atoi(argv[5]));
  else
    swing.step_native(std::atoi(argv[5]));
}
