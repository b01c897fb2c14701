// The friction of one law over speed, load and temperature, without engine and robot. Laws and their parameters:
// plugins/README.md.
#include <cstdio>

#include <tribotwin/plugins/friction/law.hpp>

int main() {
  using namespace tribotwin;

  // A law with the numbers of its source: torque over the joint's maximum torque, speed of the motor.
  const auto law = friction::published_law("extended");
  if (!law) return std::fprintf(stderr, "%s\n", law.error().message.c_str()), 1;

  const double load_norm = 0.3;
  std::printf("speed rad/s   friction at 40 degC   at 80 degC\n");
  for (const double speed_rad_s : {10.0, 50.0, 150.0, 250.0})
    std::printf("%11.0f %21.4f %12.4f\n", speed_rad_s, friction::torque(*law, speed_rad_s, load_norm, 40),
                friction::torque(*law, speed_rad_s, load_norm, 80));

  // A mistake is a value with a message, not an exception.
  const auto mistaken = friction::make_law("polynomial", {{{"c1", 1.0}}});
  if (!mistaken) std::printf("%s\n", mistaken.error().message.c_str());
}

// Prints:
// speed rad/s   friction at 40 degC   at 80 degC
//          10                0.0749       0.1451
//          50                0.0544       0.0875
//         150                0.0863       0.0636
//         250                0.1185       0.0776
// law 'polynomial' has no parameter 'c1'; did you mean 'f1'? Parameters: f1, f2, f3, f4, a, T0
