// What is finished of unfinished work, whatever a kill, a disk or somebody else has left of its file.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/tests/small_disk.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/numerics/executor/bytes.hpp>
#include <tribotwin/twin/numerics/executor/journal.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::AllOf, testing::HasSubstr, testing::Pair, testing::ElementsAre, testing::SizeIs;

class JournalTest : public testing::Test {
 protected:
  JournalTest()
      : folder_([] {
          std::string name = (fs::temp_directory_path() / "tribotwin_XXXXXX").string();
          return fs::path(mkdtemp(name.data()));
        }()) {}
  ~JournalTest() override { fs::remove_all(folder_); }

  Result<Journal> open(const std::string& identity = "this plan", std::size_t spare = 1000) const {
    return Journal::open(file_, identity, spare);
  }
  std::string bytes() const {
    std::ifstream stream(file_, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  void write(std::string_view text) const { std::ofstream(file_, std::ios::binary) << text; }
  /// A result with every byte.
  static std::string result(int i) {
    std::string all(static_cast<std::size_t>(i) % 7 * 100, '\0');
    for (std::size_t k = 0; k < all.size(); ++k) all[k] = static_cast<char>(k + static_cast<std::size_t>(i));
    return all;
  }
  static std::string task(int i) { return std::string("a\0b", 3) + fmt::format("{:03}", i); }
  static void keep(Journal& journal, int from, int to) {
    for (int i = from; i < to; ++i) ASSERT_TRUE(journal.keep(task(i), result(i)));
  }
  static void expect(const Journal& journal, int count) {
    const auto all = journal.find("");
    ASSERT_THAT(all, SizeIs(count));
    for (int i = 0; i < count; ++i) {
      EXPECT_EQ(all[static_cast<std::size_t>(i)].first, task(i));
      EXPECT_EQ(all[static_cast<std::size_t>(i)].second, result(i));
    }
  }

  const fs::path folder_, file_ = folder_ / "work.unfinished";
};

TEST_F(JournalTest, WhatWasKeptIsThereAgain) {
  {
    auto journal = open().value();
    EXPECT_TRUE(journal.empty());
    EXPECT_FALSE(fs::exists(file_)) << "a file with nothing in it";
    keep(journal, 0, 20);
    expect(journal, 20);
  }
  auto again = open().value();
  expect(again, 20);
  EXPECT_THAT(again.find(task(7).substr(0, 5)), SizeIs(10));
  EXPECT_THAT(again.find(task(7)), ElementsAre(Pair("", result(7))));
  EXPECT_THAT(again.find("a"), SizeIs(20));
  EXPECT_THAT(again.find("b"), SizeIs(0));
  again.remove();
  EXPECT_FALSE(fs::exists(file_));
  expect(open().value(), 0);
}

TEST_F(JournalTest, ACutRecordDoesNotCountWhereverItIsCut) {
  std::size_t before = 0;
  {
    auto journal = open().value();
    keep(journal, 0, 4);
    before = bytes().size();
    keep(journal, 4, 5);
  }
  const std::string whole = bytes();
  ASSERT_GT(whole.size(), before + result(4).size());
  for (std::size_t size = before; size < whole.size(); size += size < before + 20 ? 1 : 37) {
    write(whole.substr(0, size));
    auto journal = open();
    ASSERT_TRUE(journal) << size;
    expect(*journal, 4);
    keep(*journal, 4, 6);
    expect(open().value(), 6);
  }
}

TEST_F(JournalTest, ADamagedRecordDoesNotCount) {
  {
    auto journal = open().value();
    keep(journal, 0, 6);
  }
  const std::string whole = bytes();
  for (std::size_t at = 0; at < whole.size(); at += 29) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x40);
    write(damaged);
    const auto journal = open();
    if (!journal) {
      EXPECT_THAT(journal.error().message, HasSubstr(file_.string()));
      EXPECT_EQ(bytes(), damaged) << "not ours, so not touched";
    } else {
      expect(*journal, static_cast<int>(journal->find("").size()));
      EXPECT_LT(journal->find("").size(), 6u);
    }
  }
}

// As above with a checksum that is right: only somebody else can have written it.
TEST_F(JournalTest, ARecordWhoseSizesAreWrongDoesNotCount) {
  {
    auto journal = open().value();
    keep(journal, 0, 4);
  }
  const std::string whole = bytes();
  const auto record = [](const std::string& body) {
    return BytesOut().put<std::uint64_t>(body.size()).put<std::uint32_t>(crc32(body)).take() + body;
  };
  const std::string task = BytesOut().put(std::string_view("a")).take();
  for (const std::string& body : {std::string(), std::string(7, '\0'), std::string(16, '\xFF'), task,
                                  task + BytesOut().put<std::uint64_t>(1).take()}) {
    write(whole + record(body) + record(task + task));
    auto journal = open();
    ASSERT_TRUE(journal);
    expect(*journal, 4);
    keep(*journal, 4, 6);
    expect(open().value(), 6);
  }
  write(whole.substr(0, whole.find('\n') + 1) + record(std::string(16, '\xFF')));
  const auto journal = open();
  ASSERT_FALSE(journal);
  EXPECT_THAT(journal.error().message, AllOf(HasSubstr(file_.string()), HasSubstr("is damaged")));
}

TEST_F(JournalTest, IsNotThatOfOtherWork) {
  {
    auto journal = open().value();
    keep(journal, 0, 3);
  }
  const std::string before = bytes();
  const auto other = open("another plan");
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().kind, ErrorKind::input);
  EXPECT_THAT(other.error().message, AllOf(HasSubstr(file_.string()), HasSubstr("another command")));
  EXPECT_EQ(bytes(), before);
  for (const std::string_view text : {"", "notes of somebody"}) {
    write(text);
    ASSERT_FALSE(open());
    EXPECT_EQ(bytes(), text);
  }
  fs::remove(file_);
  fs::create_directory(file_);
  EXPECT_FALSE(open());
}

TEST_F(JournalTest, WhatIsNoLongerNeededDoesNotFillTheDisk) {
  auto journal = open("this plan", 5000).value();
  std::size_t largest = 0;
  keep(journal, 0, 5);
  for (int round = 0; round < 200; ++round) {
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(journal.keep(fmt::format("z{}", i), std::string(100, 'x')));
    ASSERT_TRUE(journal.forget("z"));
    largest = std::max<std::size_t>(largest, fs::file_size(file_));
    expect(journal, 5);
  }
  EXPECT_LT(largest, 5000u + 2 * 3000);
  expect(open().value(), 5);
  keep(journal, 5, 6);
  expect(open().value(), 6);
}

TEST_F(JournalTest, AFullDiskLosesNothingThatWasKept) {
  auto journal = open().value();
  keep(journal, 0, 5);
  {
    const SmallDisk full(bytes().size() + 50);
    const auto failed = journal.keep(task(5), std::string(1000, 'x'));
    ASSERT_FALSE(failed);
    EXPECT_EQ(failed.error().kind, ErrorKind::work);
    EXPECT_THAT(failed.error().message, HasSubstr(file_.string()));
  }
  // What followed a torn record would be lost.
  EXPECT_FALSE(journal.keep(task(5), result(5)));
  auto again = open().value();
  expect(again, 5);
  keep(again, 5, 7);
  expect(open().value(), 7);
}

TEST_F(JournalTest, OneThatCannotBeReadIsNotTakenForAnother) {
  const auto journal = Journal::open("/proc/self/mem", "this plan", 1000);  // address 0: reading fails
  ASSERT_FALSE(journal);
  EXPECT_EQ(journal.error().message, "/proc/self/mem: cannot be read to its end (Input/output error)");
}

}  // namespace
}  // namespace tribotwin::twin
