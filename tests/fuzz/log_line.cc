// parse_log_line on hostile input: whatever parses prints, and what is printed parses back equal.
// For libFuzzer: clang++ -fsanitize=fuzzer,address,undefined. Without it, main() below: log_line [COUNT [SEED]].
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include <tribotwin/hil/can/log.hpp>

namespace {

using namespace tribotwin::hil;

long parsed_lines = 0;

void require(bool condition, std::string_view what, std::string_view line) {
  if (condition) return;
  std::fprintf(stderr, "%.*s: '%.*s'\n", static_cast<int>(what.size()), what.data(), static_cast<int>(line.size()),
               line.data());
  std::abort();
}

void check(std::string_view line) {
  std::string bus;
  const auto frame = parse_log_line(line, bus);
  if (!frame) {
    require(!frame.error().message.empty() && frame.error().message.size() < 300, "the message is empty or long", line);
    for (const char c : frame.error().message) require(c >= 0x20 && c <= 0x7E, "the message is not printable", line);
    return;
  }
  ++parsed_lines;
  require(valid_size(frame->fd, frame->size), "parsed a length that no frame has", line);
  const auto printed = fmt::format("({}.{:09}) {} {}", frame->time_ns / 1'000'000'000, frame->time_ns % 1'000'000'000,
                                   bus, text(*frame));
  std::string bus_again;
  const auto again = parse_log_line(printed, bus_again);
  require(again && *again == *frame && again->time_ns == frame->time_ns && bus_again == bus,
          "is not what it prints, " + printed, line);
}

constexpr std::string_view seeds[] = {"(1700000000.123456) vcan0 601#4041600000000000",
                                      "(0000000000.000001) can0 123#",
                                      "(1.5) can1 12345678#0011223344556677 T",
                                      "(1700000000.123456789) vcan0 123##1AABB R",
                                      "(2.25) vcan0 123##50011223344",
                                      "(3) can0 123#R8",
                                      "(1700000000.1) can0 1FFFFFFF#R",
                                      "(4.0) can0 20000088#0000000000000000\r\n",
                                      "(5.0) can0 "
                                      "123##"
                                      "0000102030405060708090A0B0C0D0E0F101112131415161718191A1B1C1D1E1F202122232425262"
                                      "728292A2B2C2D2E2F303132333435363738393A3B3C3D3E3F"};

class Generator {
 public:
  explicit Generator(std::uint64_t seed) : random_(seed) {}

  /// A seed line with a few changes; sometimes nothing but noise.
  std::string line() {
    std::string out;
    if (below(10) == 0) {
      for (auto n = below(60); n > 0; --n) out += below(2) ? character() : static_cast<char>(below(256));
      return out;
    }
    out = seeds[below(std::size(seeds))];
    for (auto n = below(4); n > 0; --n) mutate(out);
    return out;
  }

 private:
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(random_() % n); }
  char character() {
    constexpr std::string_view likely = "0123456789ABCDEFabcdefRT#(). \t_-x";
    return likely[below(likely.size())];
  }
  void mutate(std::string& line) {
    const auto at = below(line.size() + 1), length = below(line.size() - at + 1);
    switch (below(7)) {
      case 0:
        line.insert(at, 1, character());
        break;
      case 1:
        line.erase(at, 1);
        break;
      case 2:
        line.erase(at, length);
        break;
      case 3:
        line.insert(at, line.substr(at, length));
        break;
      case 4:
        line += seeds[below(std::size(seeds))].substr(below(15));
        break;
      case 5:
        if (at < line.size()) line[at] = static_cast<char>(below(256));
        break;
      default:
        if (at < line.size()) line[at] = character();
    }
  }
  std::mt19937_64 random_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  check({reinterpret_cast<const char*>(data), size});
  return 0;
}

/// Weak, so that libFuzzer's own main wins where it is linked.
[[gnu::weak]] int main(int argc, char** argv) {
  const long count = argc > 1 ? std::strtol(argv[1], nullptr, 10) : 1'000'000;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  Generator generator(seed);
  for (long i = 0; i < count; ++i) {
    const auto line = generator.line();
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(line.data()), line.size());
  }
  std::printf("%ld inputs with seed %llu, %ld of them frames\n", count, static_cast<unsigned long long>(seed),
              parsed_lines);
  return parsed_lines > 0 || count == 0 ? 0 : 1;
}
