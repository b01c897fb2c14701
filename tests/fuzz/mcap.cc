// Recordings in MCAP with damaged bytes, lengths and checksums: each ends in numbers or in a printable message, and
// takes no more memory than the file justifies. Arguments: count, seed.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <new>
#include <random>
#include <string>

#include <unistd.h>

#include <tribotwin/tests/fuzz/require.hpp>
#include <tribotwin/tests/twin/io/mcap/mcap_bytes.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>

namespace {

using namespace tribotwin::mcap_bytes;

std::size_t largest = 0;  // allocation, since it was set to 0

}  // namespace

void* operator new(std::size_t size) {
  largest = std::max(largest, size);
  if (void* p = std::malloc(size ? size : 1)) return p;
  throw std::bad_alloc();
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  largest = std::max(largest, size);
  return std::malloc(size ? size : 1);
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace {

class Generator {
 public:
  explicit Generator(std::uint64_t seed) : random_(seed) {}

  /// A recording with up to three damages, each at a layer of its own: below it everything is whole again.
  std::string recording() {
    std::string messages;
    const bool json = one_of(8) == 0;
    for (std::uint64_t i = 0; i < 1 + one_of(6); ++i) {
      const std::string data =
          json ? R"({"header":{"stamp":{"sec":1,"nanosec":2}},"name":["a"],"position":[1]})"
               : joint_state(1 + 0.1 * static_cast<double>(i), {"a", "b"}, {1, 2}, {3, 4}, {5, 6}, one_of(4) == 0);
      messages += message(1, i, damaged(data, 16));
      if (one_of(20) == 0) messages += message(2, i, damaged(data, 2));
    }
    const std::string parts = schema(1, "sensor_msgs/msg/JointState") +
                              schema(2, "control_msgs/msg/DynamicJointState") +
                              channel(1, 1, "/joint_states", json ? "json" : "cdr") +
                              channel(2, 2, "/dynamic_joint_states", json ? "json" : "cdr");
    const std::string records = damaged(parts + messages, 5);
    const char* const formats[] = {"", "zstd", "lz4"};
    const std::int64_t size = one_of(8) ? -1 : static_cast<std::int64_t>(random_() >> one_of(64) >> 1);
    std::string data = one_of(4) ? chunk(formats[one_of(3)], records, size) : records;
    std::string whole = file(damaged(std::move(data), 5));
    if (one_of(6) == 0) whole = damaged(std::move(whole), 1);
    if (one_of(6) == 0) whole.resize(one_of(whole.size()));
    return whole;
  }

 private:
  std::uint64_t one_of(std::uint64_t count) { return random_() % count; }
  /// One time in `rarely`: a changed byte, number, length or order.
  std::string damaged(std::string bytes, std::uint64_t rarely) {
    if (bytes.size() < 16 || one_of(rarely)) return bytes;
    const std::size_t at = one_of(bytes.size() - 8), from = one_of(bytes.size() - 8);
    switch (one_of(5)) {
      case 0:
        bytes[at] = static_cast<char>(random_());
        break;
      case 1:
        bytes.replace(at, 4, le(static_cast<std::uint32_t>(random_() >> one_of(64))));
        break;
      case 2:
        bytes.replace(at, 8, le(static_cast<std::uint64_t>(random_() >> one_of(64))));
        break;
      case 3:
        bytes.erase(at, 1 + one_of(8));
        break;
      default:
        bytes.insert(at, bytes.substr(from, one_of(64)));
    }
    return bytes;
  }

  std::mt19937_64 random_;
};

}  // namespace

int main(int argc, char** argv) {
  const long count = argc > 1 ? std::atol(argv[1]) : 20000;
  Generator generator(argc > 2 ? static_cast<std::uint64_t>(std::atoll(argv[2])) : 1);
  const auto path = std::filesystem::temp_directory_path() / ("tribotwin_fuzz_" + std::to_string(::getpid()) + ".mcap");
  long read = 0;
  for (long i = 0; i < count; ++i) {
    const std::string bytes = generator.recording();
    std::filesystem::remove(path);  // a file system may flush a file that is truncated and written again
    std::ofstream(path, std::ios::binary) << bytes;
    largest = 0;
    const auto table = tribotwin::twin::read_numbers(path, {"time_s", "position_a_rad", "torque_b_nm"});
    // The best ratio of zstd is 43,700; a stream has a buffer, a dictionary of JSON some more.
    require(largest < 43700 * bytes.size() + 100'000, "allocates more than the file justifies");
    if (table) {
      ++read;
      for (const auto& column : table->columns)
        require(column.empty() || column.size() == table->lines.size(), "columns have different lengths");
      continue;
    }
    const auto& why = table.error().message;
    require(why.size() < 2000 && why.starts_with(path.string()), "the message is long, or without the file");
    require(std::ranges::all_of(why, [](char c) { return c >= 0x20 && c <= 0x7E; }), "the message is not printable");
  }
  std::filesystem::remove(path);
  require(read > count / 4 && read < count * 3 / 4, "too many files were read, or too few");
  std::printf("%ld files, %ld of them read\n", count, read);
}
