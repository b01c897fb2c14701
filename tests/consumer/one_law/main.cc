#include <cstdio>

#include <tribotwin/plugins/friction/law.hpp>

int main() {
  const auto law = tribotwin::friction::published_law("extended");
  std::printf("%.6f\n", tribotwin::friction::torque(*law, 100, 0.3, 50));
}
