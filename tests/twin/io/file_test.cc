// What is in a folder, also where the disk fails while it is listed.
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include <dirent.h>
#include <dlfcn.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <tribotwin/twin/io/file.hpp>

namespace {

int reads_until_failure = -1;  // of a listing; below 0: none fails

}  // namespace

/// The program's own comes before that of the C library.
extern "C" dirent* readdir(DIR* folder) {
  static const auto real = reinterpret_cast<dirent* (*)(DIR*)>(::dlsym(RTLD_NEXT, "readdir"));
  if (reads_until_failure < 0 || reads_until_failure-- > 0) return real(folder);
  errno = EIO;
  return nullptr;
}

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

class EntriesOf : public testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(folder_ / "sub");
    for (const char* name : {"a", "b"}) std::ofstream(folder_ / name) << name;
  }
  void TearDown() override {
    reads_until_failure = -1;
    fs::remove_all(folder_);
  }
  fs::path folder_ = fs::temp_directory_path() / fmt::format("tribotwin_file_{}", ::getpid());
};

TEST_F(EntriesOf, AreAllFilesAndFolders) {
  std::set<std::string> names;
  const auto entries = entries_of(folder_);
  ASSERT_TRUE(entries) << entries.error().message;
  for (const fs::directory_entry& entry : *entries) names.insert(entry.path().filename().string());
  EXPECT_THAT(names, testing::ElementsAre("a", "b", "sub"));
}

TEST_F(EntriesOf, FolderThatDoesNotExistHasNone) { EXPECT_TRUE(entries_of(folder_ / "none").value().empty()); }

TEST_F(EntriesOf, FileIsRefused) {
  const auto entries = entries_of(folder_ / "a");
  ASSERT_FALSE(entries);
  EXPECT_EQ(entries.error().message, (folder_ / "a").string() + ": cannot be listed (Not a directory)");
  EXPECT_EQ(entries.error().kind, ErrorKind::input);
}

TEST_F(EntriesOf, FailureInTheMiddleNamesTheFolder) {
  for (const int reads : {0, 1, 2, 3}) {
    reads_until_failure = reads;
    const auto entries = entries_of(folder_);
    ASSERT_FALSE(entries) << reads;
    EXPECT_EQ(entries.error().message, folder_.string() + ": cannot be listed (Input/output error)");
    EXPECT_EQ(entries.error().kind, ErrorKind::work);
  }
}

}  // namespace
}  // namespace tribotwin::twin
