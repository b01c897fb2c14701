#include <gmock/gmock.h>

#include <cmath>
#include <cstdlib>
#include <fstream>

#include <tribotwin/twin/telemetry/telemetry.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class TelemetryTest : public testing::Test {
 protected:
  fs::path folder = [] {
    std::string name = (fs::temp_directory_path() / "tribotwin_XXXXXX").string();
    return fs::path(mkdtemp(name.data()));
  }();
  void TearDown() override { fs::remove_all(folder); }
  double clock_s = 0;
  TelemetryOptions options(std::vector<std::string> joints) {
    return {.attributes = {{"engine", "test"}}, .joints = std::move(joints), .channels = {{"a", "rad", "an angle"}, {"b", "Nm", "a torque"}},
            .cycle_channels = {{"cycle_a", "degC", "per cycle"}}, .wall_clock_s = [this] { return clock_s; }};
  }
};

TEST_F(TelemetryTest, ReadsBackWhatWasWritten) {
  auto t = Telemetry::create(folder / "telemetry.h5", options({"one", "two"}));
  ASSERT_TRUE(t) << t.error();
  for (int i = 0; i < 5000; ++i) ASSERT_TRUE(t->append(i, std::vector<double>{i + .1, i + .2, i + .3, i + .4}));
  ASSERT_TRUE(t->append_cycle(7, std::vector<double>{1, 2}));
  ASSERT_TRUE(t->finish());
  const auto r = read_telemetry(folder / "telemetry.h5");
  ASSERT_TRUE(r) << r.error();
  EXPECT_TRUE(r->complete);
  EXPECT_THAT(r->attributes, testing::ElementsAre(testing::Pair("engine", "test")));
  ASSERT_EQ(r->time_s.size(), 5000u);
  EXPECT_EQ(r->channel("two", "a")[4321], 4321.3);
  EXPECT_EQ(r->channel("two", "cycle_a")[0], 2);
  EXPECT_EQ(r->channels[1].unit, "Nm");
}

TEST_F(TelemetryTest, OddJointNamesSurviveAndDoublesAreRefused) {
  const std::vector<std::string> names{"a/b", "", ".", "\u00fc \"x\",y"};
  auto t = Telemetry::create(folder / "telemetry.h5", options(names));
  ASSERT_TRUE(t) << t.error();
  ASSERT_TRUE(t->append(0, std::vector<double>(8, 1.5)));
  ASSERT_TRUE(t->finish());
  EXPECT_THAT(read_telemetry(folder / "telemetry.h5")->joints, testing::UnorderedElementsAreArray(names));
  ASSERT_TRUE(export_csv(folder));
  std::string header;
  std::ifstream csv(folder / "telemetry.csv");
  std::getline(csv, header);
  EXPECT_THAT(header, HasSubstr("\"\u00fc \"\"x\"\",y.a\""));
  EXPECT_THAT(Telemetry::create(folder / "d.h5", options({"x", "x"})).error(), HasSubstr("two joints are called 'x'"));
}

TEST_F(TelemetryTest, FlushesByTheClockAndStaysMarkedUntilFinished) {
  auto t = Telemetry::create(folder / "telemetry.h5", options({"one"}));
  ASSERT_TRUE(t);
  ASSERT_TRUE(t->append(0, std::vector<double>{1, 2}));
  EXPECT_EQ(read_telemetry(folder / "telemetry.h5")->time_s.size(), 0u);
  clock_s = 0.6;
  ASSERT_TRUE(t->append(1, std::vector<double>{1, 2}));
  const auto seen = read_telemetry(folder / "telemetry.h5");
  ASSERT_TRUE(seen) << seen.error();
  EXPECT_EQ(seen->time_s.size(), 2u);
  EXPECT_FALSE(seen->complete);
}

TEST_F(TelemetryTest, FailuresNameTheFile) {
  EXPECT_THAT(Telemetry::create("/nonexistent/x.h5", options({"a"})).error(), HasSubstr("/nonexistent/x.h5"));
  std::ofstream(folder / "telemetry.h5") << "junk";
  EXPECT_THAT(read_telemetry(folder / "telemetry.h5").error(), HasSubstr("no readable HDF5"));
  EXPECT_FALSE(recover(folder));
  EXPECT_FALSE(export_csv(folder));
  EXPECT_FALSE(fs::exists(folder / "telemetry.csv"));
}

}  // namespace
}  // namespace tribotwin::twin
