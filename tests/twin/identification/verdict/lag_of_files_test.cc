#include <cmath>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/verdict/lag_of_files.hpp>

// Torques that are a sine, recorded late by a known time.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;

class Pendulum {
 public:
  const Regressor& regressor() const { return regressor_; }

  /// Files of 10 s at 100 Hz, late by these times; the prediction is on time.
  JointMotion motion(const std::vector<double>& late_s) {
    constexpr Index samples = 1000;
    JointMotion out;
    out.period_s = 0.01, out.cutoff_hz = 10;
    const auto all = samples * std::ssize(late_s);
    for (auto* m : {&out.q, &out.qd, &out.qdd, &out.torque}) m->setZero(1, all);
    out.direction.setOnes(1, all), out.moving.setConstant(1, all, true);
    predicted_.resize(1, all);
    for (std::size_t f = 0; f < late_s.size(); ++f) {
      const Index first = static_cast<Index>(f) * samples;
      out.segments.emplace_back(first, first + samples), out.file.push_back(f);
      for (Index i = 0; i < samples; ++i) {
        const double t = 0.01 * static_cast<double>(i);
        out.time_s.push_back(t);
        predicted_(0, first + i) = at(t);
        out.torque(0, first + i) = at(t - late_s[f]) + 0.05 * std::sin(7000 * t * t);
      }
    }
    return out;
  }
  const MatrixXd& predicted() const { return predicted_; }

 private:
  static double at(double time_s) { return 5 * std::sin(6 * time_s) + 2 * std::sin(10 * time_s); }

  std::shared_ptr<const mujoco::Model> model_ = *mujoco::load_string(R"(<mujoco><worldbody>
    <body name="rod"><joint name="hip" axis="0 1 0"/><geom type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="6"/>
    </body></worldbody></mujoco>)");
  Regressor regressor_ = *Regressor::create(model_->get());
  MatrixXd predicted_;
};

const std::vector<std::string> files{"a.csv", "b.csv", "c.csv"};

TEST(LagOfFiles, IsThatOfEachAndNamedWhereTheyDiffer) {
  Pendulum pendulum;
  const double late_s[] = {0.01, -0.005, 0};
  const JointMotion motion = pendulum.motion({late_s[0], late_s[1], late_s[2]});
  const auto lags = lag_of_files(pendulum.regressor(), motion, pendulum.predicted());
  ASSERT_THAT(lags, testing::SizeIs(3));
  for (const FileLag& lag : lags) EXPECT_NEAR(lag.value_s, late_s[lag.file], 3 * lag.sigma_s) << files[lag.file];
  EXPECT_LT(lags[2].sigma_s, 0.001);
  EXPECT_THAT(files_that_differ(pendulum.regressor(), files, lags),
              testing::ElementsAre(testing::AllOf(testing::HasSubstr("torque_hip_nm"), testing::HasSubstr("a.csv"))));
  EXPECT_THAT(late_torques(pendulum.regressor(), files, lags, motion),
              testing::ElementsAre(testing::HasSubstr("a.csv"), testing::HasSubstr("b.csv")));
}

TEST(LagOfFiles, ThatIsOneOrWasRemovedIsNotNamed) {
  Pendulum pendulum;
  JointMotion motion = pendulum.motion({0, 0, 0});
  motion.lag_s = {0.02};
  const auto lags = lag_of_files(pendulum.regressor(), motion, pendulum.predicted());
  ASSERT_THAT(lags, testing::SizeIs(3));
  for (const FileLag& lag : lags) EXPECT_NEAR(lag.value_s, 0.02, 3 * lag.sigma_s);
  EXPECT_THAT(files_that_differ(pendulum.regressor(), files, lags), testing::IsEmpty());
  EXPECT_THAT(late_torques(pendulum.regressor(), files, lags, motion), testing::IsEmpty());
}

TEST(LagOfFiles, IsUnknownOfAShortRecord) {
  Pendulum pendulum;
  JointMotion motion = pendulum.motion({0.01});
  motion.moving.rightCols(700).setConstant(false);
  EXPECT_THAT(lag_of_files(pendulum.regressor(), motion, pendulum.predicted()), testing::IsEmpty());
}

}  // namespace
}  // namespace tribotwin::twin::identification
