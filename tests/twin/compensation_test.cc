#include <cmath>
#include <numbers>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/compensation/servo.hpp>

namespace tribotwin::twin {
namespace {

std::shared_ptr<const mujoco::Model> bench() {
  const auto model = mujoco::load_file(std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/rh380n_bench.xml");
  EXPECT_TRUE(model.has_value()) << model.error();
  return *model;
}

TEST(HysteresisInverse, GivesBackTheTorsionOfAnyWay) {
  const auto model = bench();
  const transmission::Hysteresis& h = model->springs()[0].hysteresis;
  for (const double temperature : {20.0, 47.0}) {
    HysteresisInverse inverse(h);
    double x = 0, last = 0;
    for (int i = 1; i <= 4000; ++i) {
      const double t = 0.004 * i, torsion = 1.4e-3 * std::sin(t) + 4e-4 * std::sin(7.3 * t);
      x = transmission::advanced(h, x, torsion - last);
      last = torsion;
      ASSERT_NEAR(inverse.update(transmission::torque_nm(h, torsion, x, temperature), temperature), torsion, 1e-9) << i;
    }
  }
}

}  // namespace
}  // namespace tribotwin::twin
