#include <cmath>
#include <cstdlib>

#include <gmock/gmock.h>

#include <tribotwin/tests/twin/experiments/temporary_file.hpp>
#include <tribotwin/twin/experiments/sweep/design.hpp>
#include <tribotwin/twin/experiments/sweep/parameter_set.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_friction.hpp>

namespace tribotwin::twin::sweep {
namespace {

using Eigen::MatrixXd, Eigen::VectorXd;

constexpr char law[] = R"(
law: load
parameters: {Fc0: 0.03, Fcl: 0.02, Fs0: 0.04, Fsl: 0.1, vs: 10, alpha: 1.3, Fv: 3e-5}
status: {Fc0: estimated, Fcl: estimated, Fs0: estimated, Fsl: held, vs: estimated, alpha: fixed, Fv: at_bound}
sigma: {Fc0: 0.001, Fcl: 0.002, Fs0: 0.003, vs: 0.5}
confidence_95: {vs: [8.72, 11.28]}
correlation:
  Fc0: [1, -0.6, 0.3, 0]
  Fcl: [-0.6, 1, -0.2, 0.5]
  Fs0: [0.3, -0.2, 1, 0.1]
  vs: [0, 0.5, 0.1, 1]
)";

/// The law's file with other text in the place of this, once each.
std::string with(std::initializer_list<std::pair<std::string, std::string>> changes) {
  std::string text = law;
  for (const auto& [from, to] : changes) text.replace(text.find(from), from.size(), to);
  return text;
}

ParameterSet set_of(const std::string& text) {
  const TemporaryFile file(text);
  const auto model = *mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/irb6620.xml");
  auto set = law_parameters(file.path, *model, "joint2");
  EXPECT_TRUE(set) << set.error().message;
  return set ? *set : ParameterSet{};
}

TEST(ParameterSet, DrawsReproduceTheCovariance) {
  const ParameterSet set = set_of(law);
  ASSERT_EQ(set.keys, (std::vector<std::string>{"drives.joint2.Fc0", "drives.joint2.Fcl", "drives.joint2.Fs0",
                                                "drives.joint2.vs"}));
  const Eigen::Index n = 40000;
  const auto u = unit_points(DesignType::random, n, 4, 3);
  MatrixXd x(n, 4);
  for (Eigen::Index i = 0; i < n; ++i) x.row(i) = set.draw(std::span(u).subspan(static_cast<std::size_t>(4 * i), 4));
  const VectorXd mean = x.colwise().mean();
  const MatrixXd centred = x.rowwise() - mean.transpose(), covariance = centred.transpose() * centred / (n - 1);
  const double sigma[] = {0.001, 0.002, 0.003, 1.28 / 1.96};  // of vs: by its interval
  const double correlation[4][4] = {{1, -0.6, 0.3, 0}, {-0.6, 1, -0.2, 0.5}, {0.3, -0.2, 1, 0.1}, {0, 0.5, 0.1, 1}};
  const double value[] = {0.03, 0.02, 0.04, 10};
  for (int a = 0; a < 4; ++a) {
    EXPECT_NEAR(mean(a), value[a], 4 * sigma[a] / std::sqrt(double(n))) << set.keys[static_cast<std::size_t>(a)];
    for (int b = 0; b < 4; ++b)
      EXPECT_NEAR(covariance(a, b) / sigma[a] / sigma[b], correlation[a][b], 0.02) << a << " " << b;
  }
}

TEST(ParameterSet, SaysWhatItDoesNotDraw) {
  const ParameterSet set = set_of(law);
  ASSERT_EQ(set.notes.size(), 1u);
  EXPECT_THAT(set.notes[0], testing::HasSubstr("Fsl, Fv of joint2 have no sigma"));
  EXPECT_THAT(set.fixed, testing::Contains(testing::Pair("drives.joint2.law", "load")));
  EXPECT_THAT(set.fixed, testing::Contains(testing::Pair("drives.joint2.alpha", "1.3")));
}

TEST(ParameterSet, ADrawBeyondTheRangeHasItsEnd) {
  std::string wide = law;
  wide.replace(wide.find("Fc0: 0.001"), 10, "Fc0: 10000");
  const ParameterSet set = set_of(wide);
  const VectorXd low = set.draw(std::vector{0.01, 0.5, 0.5, 0.5}), high = set.draw(std::vector{0.99, 0.5, 0.5, 0.5});
  EXPECT_EQ(low(0), set.low(0));
  EXPECT_EQ(high(0), set.high(0));
  EXPECT_TRUE(set.at_limit(0, low(0)) && set.at_limit(0, high(0)));
  EXPECT_FALSE(set.at_limit(0, set.mean(0)));
}

TEST(ParameterSet, RefusesWhatItCannotDraw) {
  const auto model = *mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/irb6620.xml");
  struct Case {
    const char* what;
    std::string text, joint, says;
  };
  const std::string without = std::string(law).substr(0, std::string(law).find("status"));
  const Case cases[] = {
      {"no such joint", law, "joint9", "joint9"},
      {"no sigma at all", without, "joint2", "nothing can be drawn"},
      {"another torque_max_nm", std::string("torque_max_nm: 5") + law, "joint2", "torque_max_nm is 5, but the drive"},
      {"a row that is not the column", with({{"[-0.6, 1,", "[0.6, 1,"}}), "joint2",
       "Fc0 with Fcl is -0.6, Fcl with Fc0"},
      {"correlations that contradict each other",
       with({{"[1, -0.6, 0.3, 0]", "[1, 0.99, -0.99, 0]"},
             {"[-0.6, 1, -0.2,", "[0.99, 1, 0.99,"},
             {"[0.3, -0.2,", "[-0.99, 0.99,"}}),
       "joint2", "contradict each other"},
      {"an interval that ends before it begins", with({{"[8.72, 11.28]", "[11.28, 8.72]"}}), "joint2",
       "vs goes from 11.28 to 8.72"},
      {"half a row of correlations", std::string(law).replace(std::string(law).find("[1, -0.6, 0.3, 0]"), 17, "[1, 0]"),
       "joint2", "must hold 4 numbers"},
  };
  for (const Case& c : cases) {
    const TemporaryFile file(c.text);
    const auto set = law_parameters(file.path, *model, c.joint);
    ASSERT_FALSE(set) << c.what;
    EXPECT_THAT(set.error().message, testing::HasSubstr(c.says)) << c.what;
    EXPECT_EQ(set.error().kind, ErrorKind::input) << c.what;
  }
}

constexpr char robot[] = R"(
friction_law: load
base_parameters: {}
friction:
  joint2:
    Fc0: {value: 0.03, sigma: 0.001, unit: "-"}
    Fcl: {value: 0.02, sigma: 0.002, unit: "-"}
    Fs0: {value: 0.04, unit: "-"}
    Fsl: {value: 0.1, unit: "-"}
    vs: {value: 10, unit: rad/s}
    alpha: {value: 1.3, unit: "1"}
    Fv: {value: 3e-5, unit: s/rad}
    offset: {value: 4, sigma: 2, unit: Nm}
)";

TEST(ParameterSet, OfARobot) {
  const auto model = *mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/irb6620.xml");
  for (const bool correlated : {false, true}) {
    const TemporaryFile file(
        std::string(robot) +
        (correlated ? "friction_correlation: {joint2: [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]]}\n" : ""));
    EXPECT_TRUE(is_of_dynamics(file.path));
    const auto sets = robot_parameters(file.path, *model);
    ASSERT_TRUE(sets) << sets.error().message;
    ASSERT_EQ(sets->size(), 1u);
    const ParameterSet& set = sets->front();
    EXPECT_EQ(set.keys.back(), "drives.joint2.offset_nm");
    EXPECT_EQ(set.mean(2), 4);
    const MatrixXd correlation = set.root * set.root.transpose();
    EXPECT_NEAR(correlation(0, 1), correlated ? 0.5 : 0, 1e-12);
    EXPECT_EQ(set.notes.size(), correlated ? 1u : 2u) << "independent draws are said";
  }
}

TEST(ParameterSet, OfARobotWithATorqueByPosition) {
  const auto model = *mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/irb6620.xml");
  const TemporaryFile file(std::string(robot) + "    " + std::string(identification::cosine_name) +
                           ": {value: 5, sigma: 1, unit: Nm}\n    " + std::string(identification::sine_name) +
                           ": {value: 6, sigma: 1, unit: Nm}\n");
  const auto sets = robot_parameters(file.path, *model);
  ASSERT_TRUE(sets) << sets.error().message;
  EXPECT_EQ(sets->front().size(), 3u);
  EXPECT_THAT(sets->front().notes, testing::Contains(testing::HasSubstr("the torque of joint2 by position")));
}

TEST(ParameterSet, OfARobotWithoutALawOfDrives) {
  const auto model = *mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/irb6620.xml");
  std::string text = robot;
  text.replace(text.find("friction_law: load"), 18, "friction_law: coulomb_viscous");
  const TemporaryFile file(text);
  const auto sets = robot_parameters(file.path, *model);
  ASSERT_FALSE(sets);
  EXPECT_THAT(sets.error().message, testing::HasSubstr("'coulomb_viscous' is not a law of drives; run tribotwin "));
}

}  // namespace
}  // namespace tribotwin::twin::sweep
