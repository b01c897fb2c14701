#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <tribotwin/twin/experiments/unfinished_runs.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

long peak_kib() {
  struct rusage usage {};
  ::getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

TEST(Identity, KnowsEveryByteOfALongFileWithoutItsMemory) {
  const fs::path file = fs::path(testing::TempDir()) / "identity_of_a_long_file";
  constexpr std::uintmax_t size = (std::uintmax_t{128} << 20) + 5;
  std::ofstream(file) << "time_s";
  fs::resize_file(file, size);
  std::vector<Scenario> one{load_scenario(TRIBOTWIN_SOURCE_DIR "/twin/scenarios/irb6620_hold.yaml").value()};
  const std::string without = identity_of(one);
  one[0].resolved_yaml += "\nrecording: " + file.string() + "\n";
  const long before = peak_kib();
  const std::string zeros = identity_of(one);
  EXPECT_LT(peak_kib() - before, 64 * 1024) << "KiB";
  std::fstream(file).seekp(static_cast<std::streamoff>(size - 1)) << 'x';
  EXPECT_NE(identity_of(one), zeros);
  fs::resize_file(file, size - 1);
  EXPECT_NE(identity_of(one), zeros);
  EXPECT_NE(zeros, without);
  fs::remove(file);
}

}  // namespace
}  // namespace tribotwin::twin
