#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/linearised.hpp>
#include <tribotwin/twin/identification/verdict/negative_values.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using testing::AllOf, testing::HasSubstr;

constexpr double held = std::numeric_limits<double>::quiet_NaN();

struct Case {
  const char* name;
  const friction::LawInfo& law;
  std::vector<double> values, sigmas;  ///< of the law, then of the rotor's inertia
  std::vector<const char*> says;
  bool significant = false;
};

class NegativeValues : public testing::TestWithParam<Case> {};

Estimate estimate(std::string name, double value, double sigma) {
  Estimate e = without_sigma(std::move(name), "Nm", value, std::isnan(sigma) ? Status::held : Status::estimated);
  e.sigma = sigma;
  return e;
}

TEST_P(NegativeValues, AreNamedWithTheirSigmas) {
  const Case& c = GetParam();
  const auto model = *mujoco::load_string(
      R"(<mujoco><worldbody><body><joint name="elbow" axis="0 1 0"/><geom size=".1" pos=".3 0 0" mass="3"/></body>
      </worldbody></mujoco>)");
  const Regressor regressor = *Regressor::create(model->get());
  RobotFriction friction{JointFriction(c.law, {})};
  friction[0].hold_stribeck_speed(0.5);
  DynamicsFit fit;
  fit.joints = {{"elbow", 0.1, 1, 0.1, 1000}};
  const auto n = static_cast<Index>(c.law.parameters.size());
  fit.friction.emplace_back();
  fit.friction_covariance.push_back(MatrixXd::Constant(n, n, held));
  for (Index p = 0; p < n; ++p) {
    const auto at = static_cast<std::size_t>(p);
    fit.friction[0].push_back(estimate(std::string(c.law.parameters[at].name), c.values[at], c.sigmas[at]));
    for (Index k = 0; k < n; ++k) fit.friction_covariance[0](p, k) = p == k ? c.sigmas[at] * c.sigmas[at] : 0;
  }
  fit.base = {estimate("elbow.Ia", c.values.back(), c.sigmas.back())};
  std::vector<JointRange> ranges(1);
  ranges[0][static_cast<std::size_t>(Ranged::speed)] = {-2, 1};
  const auto found = negative_values(regressor, friction, fit, ranges);
  const auto lines = warnings_of(found);
  ASSERT_EQ(lines.size(), c.says.size()) << testing::PrintToString(lines);
  for (std::size_t k = 0; k < lines.size(); ++k) {
    EXPECT_THAT(lines[k], HasSubstr(c.says[k]));
    EXPECT_EQ(found[k].significant(), c.significant);
  }
}

/// Seven hinges whose Coulomb friction is that many sigmas from 0, and one without known friction.
double pooled(const std::vector<double>& sigmas, const friction::LawInfo& law = coulomb_viscous()) {
  std::string bodies;
  for (std::size_t j = 0; j <= sigmas.size(); ++j)
    bodies += fmt::format(R"(<body><joint name="j{}"/><geom size=".1" mass="3"/></body>)", j);
  const auto model = *mujoco::load_string("<mujoco><worldbody>" + bodies + "</worldbody></mujoco>");
  const Regressor regressor = *Regressor::create(model->get());
  RobotFriction friction(sigmas.size() + 1, JointFriction(law, {}));
  DynamicsFit fit;
  for (std::size_t j = 0; j <= sigmas.size(); ++j) {
    fit.joints.push_back({regressor.joint_name(static_cast<Index>(j)), 0.1, 1, 0.1, j < sigmas.size() ? 1000 : 0});
    fit.friction.push_back({estimate("Fc", j < sigmas.size() ? 2 * sigmas[j] : -100, 2), estimate("Fv", 1, 1)});
  }
  return pooled_friction(regressor, friction, fit);
}

TEST(PooledFriction, IsSignificantWhereThatOfNoJointIs) {
  EXPECT_NEAR(pooled({-1.9, -0.3, -0.6, -1, -1.9, -1.7, -1.7}), -9.1 / std::sqrt(7), 1e-12);
  EXPECT_NEAR(pooled({-40, 3, 2}), 0, 1e-12) << "one joint does not stand for all";
  EXPECT_EQ(pooled({-1, -1}, *friction::find_law("stribeck")), 0);
}

// The slope at 2 rad/s: Fv - Fs e^-4 / 0.5.
INSTANTIATE_TEST_SUITE_P(
    Fit, NegativeValues,
    testing::Values(
        Case{"None", coulomb_viscous(), {4, 2, 0.1}, {1, 1, 1}, {}},
        Case{"Viscous",
             coulomb_viscous(),
             {4, -2, 0.1},
             {1, 0.1, 1},
             {"viscous friction elbow.Fv is -2 +- 0.1 Nm: negative, 20.0 sigma below 0"},
             true},
        Case{"WithinTwoSigma",
             coulomb_viscous(),
             {-1, -2, -0.1},
             {1, 1.1, 0.2},
             {"rotor inertia elbow.Ia is -0.1 +- 0.2 Nm: negative, but 0 within 2 sigma", "Coulomb friction elbow.Fc",
              "viscous friction elbow.Fv"}},
        Case{"Rotor",
             coulomb_viscous(),
             {1, 1, -0.3},
             {1, 1, 0.1},
             {"rotor inertia elbow.Ia is -0.3 +- 0.1 Nm: negative, 3.0 sigma"},
             true},
        Case{"Held", coulomb_viscous(), {1, 1, -0.3}, {1, 1, held}, {"held: negative"}},
        Case{"Load",
             coulomb_viscous_load(),
             {4, 2, -5, 0.1},
             {1, 1, 1, 1},
             {"growth of friction with load elbow.Fcl is -5 +- 1"},
             true},
        Case{"StribeckIsNot", coulomb_viscous_stribeck(), {-1, 1, 3, 0.5, 0.1}, {0.1, 0.1, 0.1, held, 1}, {}},
        Case{"Standstill",
             coulomb_viscous_stribeck(),
             {3, 1, -7, 0.5, 0.1},
             {3, 0.1, 4, held, 1},
             {"friction at standstill elbow.Fc + Fs is -4 +- 5 Nm: negative, but 0 within"}},
        Case{"Slope",
             coulomb_viscous_stribeck(),
             {3, -1, -2, 0.5, 0.1},
             {3, 0.1, 0.001, held, 1},
             {"slope of friction at top speed elbow.Fv - 0.037 Fs is -0.927 +- 0.1"},
             true}),
    [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace tribotwin::twin::identification
