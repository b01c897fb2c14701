// Parts as files: what was finished is not repeated, what fails is recorded, whatever a kill has left.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <set>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <tribotwin/twin/experiments/resumable_jobs.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre, testing::HasSubstr, testing::IsEmpty;

constexpr const char* campaign = "# MuJoCo, model\nname: test\n";

std::string read(const fs::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

class Parts : public testing::Test {
 protected:
  Parts() : folder_(fs::path(testing::TempDir()) / fmt::format("parts_{}", ::getpid())) { fs::remove_all(folder_); }
  ~Parts() override { fs::remove_all(folder_), fs::remove(log_); }

  Result<Completed> run(unsigned threads = 1) {
    fs::remove(log_);
    ResumableJobs jobs{.folder = "parts",
                       .files = {},
                       .whole = [](std::size_t, const std::string& text) { return text.ends_with('\n'); },
                       .make = [this](std::size_t i) -> Result<std::string> {
                         std::ofstream(log_, std::ios::app) << i << '\n';  // parts have processes of their own
                         if (crashing_.contains(i)) std::abort();
                         if (failing_.contains(i)) return work_failed("diverged, \"quickly\"");
                         return fmt::format("part {}\n", i);
                       }};
    for (std::size_t i = 0; i < 12; ++i) jobs.files.push_back(fmt::format("{:02}.txt", i));
    jobs.in_place_of = in_place_of_;
    return complete(campaign, jobs, {.directory = folder_, .threads = threads});
  }
  /// The parts that the last run made, in their order.
  std::multiset<std::size_t> made() const {
    std::ifstream log(log_);
    return {std::istream_iterator<std::size_t>(log), {}};
  }
  std::string sums() const { return read(folder_ / "checksums"); }

  const fs::path folder_;
  const fs::path log_ = folder_.string() + ".log";
  std::set<std::size_t> failing_, crashing_;
  std::function<std::string(std::size_t, const Error&)> in_place_of_;
};

TEST_F(Parts, AreTheSameOnAnyNumberOfThreads) {
  const auto on_threads = [&](unsigned threads) {
    fs::remove_all(folder_);
    EXPECT_TRUE(run(threads));
    return sums() + read(folder_ / "parts/07.txt");
  };
  const std::string one = on_threads(1);
  EXPECT_EQ(std::ranges::count(one, '\n'), 13);
  EXPECT_EQ(on_threads(8), one);
}

TEST_F(Parts, AreForOneProcessAtATime) {
  const auto first = run();
  ASSERT_TRUE(first);
  const auto second = run();
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, HasSubstr("another run is writing"));
}

TEST_F(Parts, ThatAreThereStay) {
  ASSERT_TRUE(run(8));
  const std::string before = sums();
  const auto again = run(8);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->present, 12u);
  EXPECT_THAT(made(), IsEmpty());
  EXPECT_EQ(sums(), before);
}

TEST_F(Parts, ThatFailAreRecordedAndTheOthersComplete) {
  failing_ = {3, 8};
  const auto outcome = run(4);
  ASSERT_FALSE(outcome);
  EXPECT_EQ(outcome.error().kind, ErrorKind::work);
  EXPECT_THAT(outcome.error().message, HasSubstr("2 of 12 parts failed"));
  EXPECT_THAT(outcome.error().message, HasSubstr("parts/03.txt: diverged, \"quickly\" (2 attempts); parts/08.txt"));
  EXPECT_EQ(read(folder_ / "failures.csv"),
            "part,attempts,message,input\nparts/03.txt,2,\"diverged, \"\"quickly\"\"\",\"part 3 of campaign.yaml\"\n"
            "parts/08.txt,2,\"diverged, \"\"quickly\"\"\",\"part 8 of campaign.yaml\"\n");
  EXPECT_EQ(std::ranges::count(sums(), '\n'), 10);

  failing_ = {};
  const auto again = run(4);
  ASSERT_TRUE(again);
  EXPECT_THAT(made(), ElementsAre(3, 8));
  EXPECT_FALSE(fs::exists(folder_ / "failures.csv"));
}

TEST_F(Parts, ThatCrashFailAlone) {
  crashing_ = {3};
  const auto outcome = run(4);
  ASSERT_FALSE(outcome);
  EXPECT_THAT(outcome.error().message, HasSubstr("1 of 12 parts failed"));
  EXPECT_THAT(read(folder_ / "failures.csv"),
              HasSubstr("parts/03.txt,2,\"its process was ended by signal 6 (Aborted)"));
  EXPECT_EQ(std::ranges::count(sums(), '\n'), 11);

  // Where something can stand for it, it does, and is tried again the next time.
  in_place_of_ = [](std::size_t i, const Error& error) { return fmt::format("no part {}: {}", i, error.message); };
  {
    const auto completed = run(4);
    ASSERT_TRUE(completed);
    EXPECT_THAT(completed->texts[3], HasSubstr("no part 3: its process was ended by signal 6"));
  }
  EXPECT_THAT(made(), ElementsAre(3, 3));
  EXPECT_EQ(std::ranges::count(sums(), '\n'), 11);

  crashing_ = {};
  const auto again = run(4);
  ASSERT_TRUE(again);
  EXPECT_THAT(made(), ElementsAre(3));
  EXPECT_FALSE(fs::exists(folder_ / "failures.csv"));
}

TEST_F(Parts, WhoseChecksumWasCutAreMadeAgain) {
  ASSERT_TRUE(run());
  const std::string whole = sums();
  for (const std::size_t cut : {whole.size() - 1, whole.size() - 9, std::size_t{5}}) {
    std::ofstream(folder_ / "checksums") << whole.substr(0, cut);
    const auto lines = std::ranges::count(whole.substr(0, cut), '\n');
    const auto again = run();
    ASSERT_TRUE(again) << cut;
    EXPECT_EQ(std::ssize(made()), 12 - lines) << cut;
    EXPECT_EQ(sums(), whole) << cut;
  }
}

TEST_F(Parts, ALineOfChecksumsThatIsNoneCostsItsPartAlone) {
  ASSERT_TRUE(run());
  std::string sums_now = sums();
  const auto name = sums_now.find(" 02.txt");
  ASSERT_NE(name, std::string::npos);
  std::ofstream(folder_ / "checksums") << sums_now.erase(name, 7);
  ASSERT_TRUE(run());
  EXPECT_THAT(made(), ElementsAre(2));
}

TEST_F(Parts, ThatWereChangedAreMadeAgain) {
  ASSERT_TRUE(run());
  std::ofstream(folder_ / "parts/05.txt") << "part 6\n";
  fs::remove(folder_ / "parts/09.txt");
  ASSERT_TRUE(run());
  EXPECT_THAT(made(), ElementsAre(5, 9));
}

TEST_F(Parts, CostTheSameHoweverManyThereAre) {
  // Lines are appended: in the order of one thread `checksums` is never written anew, so it stays one file.
  failing_ = {11};
  ASSERT_FALSE(run());
  const auto inode = [&] {
    struct stat found {};
    return ::stat((folder_ / "checksums").c_str(), &found) == 0 ? found.st_ino : 0;
  };
  const auto before = inode();
  failing_ = {};
  ASSERT_TRUE(run());
  EXPECT_EQ(inode(), before);
}

}  // namespace
}  // namespace tribotwin::twin
