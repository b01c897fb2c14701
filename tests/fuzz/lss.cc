// LSS of three drives on one bus with random requests; after each run of them a fastscan finds every drive without a
// number. For libFuzzer, and as a program: fuzz_lss ACTS SEED.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <vector>

#include <tribotwin/hil/cia402/node.hpp>

using namespace tribotwin::hil;

namespace {

using Bytes = std::vector<std::uint8_t>;

void require(bool good) {
  if (!good) std::abort();
}

class Bus {
 public:
  Bus() {
    for (std::uint8_t i = 1; i <= 3; ++i) {
      nodes_.push_back(std::make_unique<Node>(
          DriveParameters{.node = i, .name = "joint"},
          [this](const Frame& frame) {
            require(frame.size <= 8);
            answers_.push_back(frame);
            return Sent::done;
          },
          NodeSetup{.unconfigured = i != 3}));
      nodes_.back()->start(0);
    }
  }

  void receive(std::uint32_t id, Bytes bytes) {
    answers_.clear();
    const bool lss = id == 0x7E5;
    for (const auto& node : nodes_) {
      const std::size_t before = answers_.size();
      const bool had_number = node->id() != 0xFF;
      node->receive(classic(id, bytes), 0);
      require(answers_.size() <= before + 1);
      require(node->id() == 0xFF || (node->id() >= 1 && node->id() <= 127));
      if (lss && had_number) require(node->id() != 0xFF);  // only a reset takes a number away
      if (answers_.size() == before) continue;
      require(lss || node->id() != 0xFF);
      require(!lss || answers_.back().id == 0x7E4 || (!had_number && answers_.back().id == 0x700U + node->id()));
    }
  }
  void ask(std::uint32_t id, int bit, int part, int next) {
    Bytes request{0x51,
                  0,
                  0,
                  0,
                  0,
                  static_cast<std::uint8_t>(bit),
                  static_cast<std::uint8_t>(part),
                  static_cast<std::uint8_t>(next)};
    encode(id, std::span(request).subspan(1, 4));
    receive(0x7E5, request);
  }

  /// Gives numbers to all drives that have none.
  int number_all() {
    receive(0x7E5, {0x04, 0, 0, 0, 0, 0, 0, 0});
    receive(0, {0x82, 0});
    int found = 0;
    for (; scan(); ++found) {
      require(found < 3);
      receive(0x7E5, {0x11, static_cast<std::uint8_t>(50 + found), 0, 0, 0, 0, 0, 0});
      require(answers_.size() == 1 && answers_[0].data[1] == 0);
      receive(0x7E5, {0x04, 0, 0, 0, 0, 0, 0, 0});
    }
    for (const auto& node : nodes_) require(node->id() != 0xFF);
    return found;
  }

 private:
  bool scan() {
    ask(0, 128, 0, 0);
    if (answers_.empty()) return false;
    std::uint32_t bits = 0;
    for (int part = 0; part < 4; ++part) {
      bits = 0;
      for (int bit = 31; bit >= 0; --bit) {
        ask(bits, bit, part, part);
        if (answers_.empty()) bits |= 1U << bit;
      }
      ask(bits, 0, part, (part + 1) % 4);
      require(!answers_.empty());
    }
    require(bits >= 1 && bits <= 3);  // a serial number
    return true;
  }

  std::vector<std::unique_ptr<Node>> nodes_;
  std::vector<Frame> answers_;
};

long found = 0;

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bus bus;
  for (std::size_t at = 0; at + 9 <= size; at += 9) {
    Bytes request(data + at + 1, data + at + 9);
    if (data[at] % 16 == 0) request.resize(data[at] / 32);
    if (data[at] % 16 == 1)
      bus.receive(0,
                  {static_cast<std::uint8_t>(data[at] & 0x20 ? 0x81 : 0x82), static_cast<std::uint8_t>(data[at + 1])});
    else
      bus.receive(data[at] % 16 == 2 ? 0x601 : 0x7E5, request);
  }
  found += bus.number_all();
  return 0;
}

__attribute__((weak)) int main(int argc, char** argv) {
  const long acts = argc > 1 ? std::atol(argv[1]) : 1000;
  std::mt19937 random(static_cast<unsigned>(argc > 2 ? std::atol(argv[2]) : 1));
  const std::uint8_t commands[] = {0x04, 0x11, 0x13, 0x15, 0x17, 0x40, 0x41, 0x42, 0x43, 0x46, 0x47,
                                   0x48, 0x49, 0x4A, 0x4B, 0x4C, 0x51, 0x5A, 0x5B, 0x5C, 0x5D, 0x5E};
  const std::uint32_t values[] = {0, 1, 2, 3, 0x7477, 0x10000, 0xFF, 0x7F, 0x80, 0xFFFFFFFF};
  constexpr long acts_per_run = 200;
  Bytes bytes(9 * acts_per_run);
  long done = 0;
  for (; done < acts; done += acts_per_run) {
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random() % 3 ? random() : 0);
    for (std::size_t at = 0; at < bytes.size(); at += 9) {
      if (random() % 16) bytes[at + 1] = commands[random() % std::size(commands)];
      if (random() % 4) encode(values[random() % std::size(values)], std::span(bytes).subspan(at + 2, 4));
      if (random() % 4) bytes[at + 6] = static_cast<std::uint8_t>(random() % 8 ? random() % 32 : 128);
      if (random() % 4) bytes[at + 7] = bytes[at + 8] = static_cast<std::uint8_t>(random() % 4);
    }
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  std::printf("%ld acts, %ld drives found\n", done, found);
  return found > 0 || acts == 0 ? 0 : 1;
}
