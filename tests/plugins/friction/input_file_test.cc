// Files that a user names: what is refused, and how much is read.
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <tribotwin/plugins/friction/input_file.hpp>

namespace tribotwin {
namespace {

using testing::HasSubstr;

class InputFile : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string refusal(const std::filesystem::path& file, Pipes pipes = Pipes::refuse) {
    const auto ok = check_input_file(file, "a table", 10, pipes);
    return ok ? "accepted" : ok.error().message;
  }
  std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("tribotwin_input_" + std::to_string(::getpid()));
};

TEST_F(InputFile, SpecialFilesAreRefused) {
  EXPECT_EQ(refusal(folder_), folder_.string() + ": is a folder, not a table");
  EXPECT_EQ(refusal("/dev/zero"), "/dev/zero: is a device, not a table");
  EXPECT_EQ(refusal("/dev/null", Pipes::accept), "/dev/null: is a device, not a table");
  EXPECT_THAT(refusal(folder_ / "none"), HasSubstr("none: cannot be read (No such file"));
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  EXPECT_THAT(refusal(folder_ / "pipe"), HasSubstr("pipe: is a pipe, not a table"));
  EXPECT_EQ(refusal(folder_ / "pipe", Pipes::accept), "accepted");
  sockaddr_un name{.sun_family = AF_UNIX, .sun_path = {}};
  const std::string socket = (folder_ / "s").string();
  ASSERT_LT(socket.size(), sizeof name.sun_path);
  socket.copy(name.sun_path, socket.size());
  const int bound = ::socket(AF_UNIX, SOCK_STREAM, 0);
  ASSERT_EQ(::bind(bound, reinterpret_cast<const sockaddr*>(&name), sizeof name), 0);
  EXPECT_THAT(refusal(socket), HasSubstr("is a socket, not a table"));
  ::close(bound);
}

TEST_F(InputFile, LongFilesAreRefusedByTheirLength) {
  std::ofstream(folder_ / "ten") << "0123456789";
  EXPECT_EQ(refusal(folder_ / "ten"), "accepted");
  EXPECT_EQ(*read_input_file(folder_ / "ten", "a table", 10), "0123456789");
  std::filesystem::resize_file(folder_ / "ten", std::uintmax_t{1} << 40);
  const auto refused = read_input_file(folder_ / "ten", "a table", 10);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("ten: is longer than 10 bytes"));
  EXPECT_THAT(refused.error().message, HasSubstr("it has 1099511627776"));
}

TEST(ReadAtMost, StopsAtTheLimit) {
  for (const std::size_t size : {0, 1, 9, 10, 11, 1000, 70000, 140000}) {
    std::istringstream stream(std::string(size, 'x'));
    const auto bytes = read_at_most(stream, "a", 10);
    EXPECT_EQ(bytes.has_value(), size <= 10) << size;
    std::istringstream again(std::string(size, 'x'));
    EXPECT_EQ(read_at_most(again, "a", size)->size(), size);
  }
}

TEST(ReadLine, SplitsAsGetline) {
  for (const std::string text : {"", "\n", "a", "a\n", "a\n\nb", "a\r\nb\n", "\n\n"}) {
    std::istringstream one(text), other(text);
    std::string expected, line;
    while (std::getline(one, expected)) {
      EXPECT_TRUE(read_line(other, line, 100)) << text;
      EXPECT_EQ(line, expected);
    }
    EXPECT_FALSE(read_line(other, line, 100)) << text;
  }
}

/// A disk that fails behind `text`.
class FailingDisk final : public std::streambuf {
 public:
  explicit FailingDisk(std::string text) : text_(std::move(text)) {
    setg(text_.data(), text_.data(), text_.data() + text_.size());
  }

 protected:
  int_type underflow() override { throw std::ios_base::failure("no more"); }

 private:
  std::string text_;
};

TEST(ReadLine, APartOfALineThatCannotBeReadOnIsNoLine) {
  FailingDisk disk("whole\nonly the begi");
  std::istream stream(&disk);
  std::string line;
  EXPECT_TRUE(read_line(stream, line, 100));
  EXPECT_EQ(line, "whole");
  EXPECT_FALSE(read_line(stream, line, 100));
  EXPECT_TRUE(stream.bad());
}

TEST(ReadLine, LongLinesAreCutAndKnown) {
  for (const std::size_t size : {4094, 4095, 4096, 8190, 8191, 20000}) {
    const std::string text(size, 'x');
    std::string line;
    std::istringstream stream(text + "\ny\n");
    EXPECT_TRUE(read_line(stream, line, 30000));
    EXPECT_EQ(line, text);
    EXPECT_TRUE(read_line(stream, line, 30000));
    EXPECT_EQ(line, "y");
    std::istringstream at_the_end(text);
    EXPECT_TRUE(read_line(at_the_end, line, 30000));
    EXPECT_EQ(line, text);
    EXPECT_FALSE(read_line(at_the_end, line, 30000));
    std::istringstream cut(text);
    EXPECT_TRUE(read_line(cut, line, 100));
    EXPECT_GT(line.size(), 100u);
    EXPECT_LE(line.size(), 100u + 4096);
  }
}

}  // namespace
}  // namespace tribotwin
