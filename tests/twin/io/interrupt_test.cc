// What a program leaves that a signal or std::quick_exit ends.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <set>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
namespace fs = std::filesystem;

constexpr int went_on = 42;  // exit code of a program that nothing ended

class Interrupt : public testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(folder_);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) ::signal(signal, SIG_DFL);  // whatever started the tests
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// The wait status of a program that does `work` in the folder.
  int status_of(const std::function<void()>& work) const {
    const pid_t program = ::fork();
    if (program == 0) {
      ::setenv("TMPDIR", folder_.c_str(), 1);
      prepare_streams();
      work();
      ::_exit(went_on);
    }
    int status = 0;
    EXPECT_EQ(::waitpid(program, &status, 0), program);
    return status;
  }
  std::set<std::string> left() const {
    std::set<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(folder_))
      names.insert(fs::relative(entry.path(), folder_).string());
    return names;
  }
  fs::path folder_ = fs::temp_directory_path() / fmt::format("tribotwin_interrupt_{}", ::getpid());
};

/// Something temporary of every kind, while `ending` happens.
void work_until(const fs::path& folder, const std::function<void()>& ending) {
  auto fresh = NewFile::create(folder / "result", Existing::replace);
  FolderLock lock;
  const TemporaryFolder temporary("of_a_test");
  fs::create_directories(temporary.path() / "a" / "b");
  for (int i = 0; i < 200; ++i) std::ofstream(temporary.path() / "a" / fmt::format("{}", i)) << i;
  if (fresh && fresh->write("half") && lock.take(folder)) ending();
}

TEST_F(Interrupt, SignalLeavesNothingTemporaryAndEndsTheProgram) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    const int status = status_of([&] { work_until(folder_, [&] { ::raise(signal); }); });
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == signal) << signal << " " << status;
    EXPECT_THAT(left(), IsEmpty()) << signal;
  }
}

TEST_F(Interrupt, QuickExitLeavesNothingTemporary) {
  const int status = status_of([&] { work_until(folder_, [] { std::quick_exit(failed); }); });
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == failed) << status;
  EXPECT_THAT(left(), IsEmpty());
}

TEST_F(Interrupt, WhatIsPublishedStays) {
  std::ofstream(folder_ / "old") << "old";
  const int status = status_of([&] {
    auto replaced = NewFile::create(folder_ / "old", Existing::replace);
    (void)replaced->write("new");
    (void)write_file(folder_ / "result", "whole", Existing::refuse);
    ::raise(SIGTERM);
  });
  EXPECT_TRUE(WIFSIGNALED(status)) << status;
  EXPECT_THAT(left(), ElementsAre("old", "result"));
  EXPECT_EQ(read_bytes(folder_ / "old").value(), "old");
  EXPECT_EQ(read_bytes(folder_ / "result").value(), "whole");
}

TEST_F(Interrupt, SecondSignalOfAnyKindLeavesNothingTemporary) {
  for (const int first : {SIGINT, SIGTERM, SIGHUP})
    for (const int second : {SIGINT, SIGTERM, SIGHUP}) {
      const int status = status_of([&] {
        catch_interrupts();
        work_until(folder_, [&] {
          ::raise(first);
          if (!interrupted()) ::_exit(went_on);
          ::raise(second);
        });
      });
      EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == second) << first << " " << second << " " << status;
      EXPECT_THAT(left(), IsEmpty()) << first << " " << second;
    }
}

TEST_F(Interrupt, ChildOfTheProgramRemovesNothing) {
  const int status = status_of([&] {
    work_until(folder_, [&] {
      const std::set<std::string> before = left();
      const pid_t child = ::fork();
      if (child == 0) ::raise(SIGTERM);
      ::waitpid(child, nullptr, 0);
      ::_exit(before.size() > 200 && left() == before ? done : failed);
    });
  });
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == done) << status;
}

TEST_F(Interrupt, IgnoredSignalStaysIgnored) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    ::signal(signal, SIG_IGN);  // as nohup does
    const int not_caught = status_of([&] { ::raise(signal); });
    const int caught = status_of([&] {
      catch_interrupts();
      ::raise(signal);
      if (interrupted()) ::_exit(failed);
    });
    ::signal(signal, SIG_DFL);
    for (const int status : {not_caught, caught})
      EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == went_on) << signal << " " << status;
  }
}

}  // namespace
}  // namespace tribotwin::twin
