// Tasks in processes of their own: what crashes fails alone, whatever way it goes.
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <set>
#include <thread>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <tribotwin/twin/numerics/executor/executor.hpp>

namespace tribotwin::twin {
namespace {

using testing::AllOf, testing::ElementsAre, testing::HasSubstr, testing::IsEmpty, testing::SizeIs, testing::StartsWith;

std::string square(std::size_t i) { return fmt::format("{} squared is {}", i, i * i); }

Tasks in_processes(std::size_t count, Crew::Work work) {
  return {.count = count, .work = std::move(work), .own_processes = true};
}

/// Whether a child of this process is left.
bool has_children() { return ::waitpid(-1, nullptr, WNOHANG) >= 0 || errno != ECHILD; }

TEST(ProcessCrew, GivesTheResultsOfThreads) {
  // Short ones, which lie ready, with a long one among them, and results that do not fit into a socket.
  const auto work = [](std::size_t i, const std::string&) {
    if (i == 40) std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return i % 50 ? square(i) : std::string(3'000'000 + i, 'x');
  };
  const auto threads = carry_out({.count = 400, .work = work}, {.threads = 3});
  for (const unsigned processes : {1u, 3u}) {
    const auto outcome = carry_out(in_processes(400, work), {.threads = processes});
    ASSERT_TRUE(outcome);
    EXPECT_THAT(outcome->failures, IsEmpty());
    EXPECT_TRUE(outcome->results == threads->results);
    EXPECT_FALSE(has_children());
  }
}

TEST(ProcessCrew, ATaskThatEndsItsProcessFailsAlone) {
  const auto work = [](std::size_t i, const std::string&) -> Result<std::string> {
    if (i == 3) std::cerr << "engine: \x1b[31mstack overflow\nin step 7\n", std::abort();
    if (i == 5) ::kill(::getpid(), SIGKILL);
    if (i == 7) std::exit(4);
    if (i == 9) throw std::runtime_error("no memory");
    if (i == 11) return tl::unexpected(Error("wrong key"));
    if (i == 13) ::raise(SIGTERM);
    return square(i);
  };
  const auto outcome = carry_out(in_processes(100, work), {.threads = 2, .retries = 2});
  ASSERT_TRUE(outcome);
  ASSERT_THAT(outcome->failures, SizeIs(6));
  const auto message = [&](std::size_t k) { return outcome->failures[k].error.message; };
  EXPECT_THAT(message(0), AllOf(StartsWith("its process was ended by signal 6 (Aborted); its last words: "),
                                HasSubstr("engine: [31mstack overflow in step 7")));
  EXPECT_EQ(message(1), "its process was ended by signal 9 (Killed), by somebody or for want of memory");
  EXPECT_EQ(message(2), "its process ended with exit code 4");
  EXPECT_EQ(message(3), "no memory");
  EXPECT_EQ(message(4), "wrong key");
  EXPECT_EQ(message(5), "its process was ended by signal 15 (Terminated)");
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_EQ(outcome->failures[k].attempts, k != 4 ? 3 : 1) << k;
    EXPECT_EQ(outcome->failures[k].error.kind, k != 4 ? ErrorKind::work : ErrorKind::input) << k;
  }
  for (const std::size_t i : {0u, 4u, 6u, 12u, 99u}) EXPECT_EQ(outcome->results[i], square(i));
  EXPECT_FALSE(has_children());
}

TEST(ProcessCrew, ATaskThatCrashesOnceIsDoneTheNextTime) {
  const std::string marker = fmt::format("{}/crashed_{}", testing::TempDir(), ::getpid());
  const auto work = [&](std::size_t i, const std::string&) {
    if (i == 2 && ::access(marker.c_str(), F_OK) != 0) {
      std::fclose(std::fopen(marker.c_str(), "w"));
      ::raise(SIGSEGV);
    }
    return square(i);
  };
  const auto outcome = carry_out(in_processes(5, work), {.threads = 2, .retries = 1});
  ::unlink(marker.c_str());
  ASSERT_TRUE(outcome);
  EXPECT_THAT(outcome->failures, IsEmpty());
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(outcome->results[i], square(i));
}

TEST(ProcessCrew, MemoryOfATaskIsItsOwn) {
  int changed = 0;
  const auto outcome =
      carry_out(in_processes(1, [&](std::size_t, const std::string&) { return square(++changed); }), {});
  EXPECT_THAT(outcome->results, ElementsAre(square(1)));
  EXPECT_EQ(changed, 0);
}

TEST(ProcessCrew, WhatTasksSayOnStderrIsPassedOn) {
  testing::internal::CaptureStderr();
  const auto outcome = carry_out(in_processes(3,
                                              [](std::size_t i, const std::string&) {
                                                std::cerr << "note: task " << i << '\n';
                                                return square(i);
                                              }),
                                 {.threads = 1});
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "note: task 0\nnote: task 1\nnote: task 2\n");
}

TEST(ProcessCrew, NothingBeginsAfterAStop) {
  std::atomic<bool> stop = false;
  Tasks tasks = in_processes(1000, [](std::size_t i, const std::string&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return square(i);
  });
  tasks.keep = [&](std::size_t, const std::string&) -> Result<void> {
    stop = true;
    return {};
  };
  const auto outcome = carry_out(tasks, {.threads = 2, .stop = &stop});
  ASSERT_TRUE(outcome);
  EXPECT_TRUE(outcome->stopped);
  EXPECT_THAT(outcome->failures, IsEmpty());
  EXPECT_LT(std::ranges::count_if(outcome->results, [](const auto& r) { return !r.empty(); }), 50);
  EXPECT_FALSE(has_children());
}

TEST(ProcessCrew, EndsWhereItsResultsAreNotWanted) {
  // Results that fill the socket, which nobody reads any more.
  Tasks tasks = in_processes(10, [](std::size_t i, const std::string&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10 * i));
    return std::string(3'000'000, 'x');
  });
  tasks.keep = [](std::size_t, const std::string&) -> Result<void> { throw std::runtime_error("no memory"); };
  EXPECT_THROW((void)carry_out(tasks, {.threads = 3}), std::runtime_error);
  EXPECT_FALSE(has_children());
}

TEST(ProcessCrew, EndsWithItsParent) {
  // A process that is killed while its tasks wait; the tasks hold the other end of a pipe, so it ends with the last.
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const pid_t parent = ::fork();
  if (parent == 0) {
    (void)::close(ends[0]);
    const auto work = [&](std::size_t i, const std::string&) {
      (void)!::write(ends[1], "x", 1);
      std::this_thread::sleep_for(std::chrono::hours(1));
      return square(i);
    };
    (void)carry_out(in_processes(2, work), {.threads = 2});
    ::_exit(0);
  }
  (void)::close(ends[1]);
  char byte = 0;
  for (int i = 0; i < 2; ++i) ASSERT_EQ(::read(ends[0], &byte, 1), 1);
  ::kill(parent, SIGKILL);
  EXPECT_EQ(::read(ends[0], &byte, 1), 0);
  ::waitpid(parent, nullptr, 0);
  (void)::close(ends[0]);
}

}  // namespace
}  // namespace tribotwin::twin
