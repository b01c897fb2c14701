// The SDO server and its dictionary with random input; block transfers: sdo_block.cc. For libFuzzer, and as a program:
// fuzz_sdo RUNS SEED.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include <tribotwin/hil/cia402/node.hpp>

using namespace tribotwin::hil;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const DriveParameters parameters{.node = 1, .name = "joint1", .gear_ratio = 100, .rated_torque_nm = 2};
  int answers = 0, requests = 0;
  Node node(parameters, [&](const Frame& frame) {
    if (frame.size > 8) std::abort();
    answers += frame.id == 0x581;
    return Sent::done;
  });
  node.start(0);
  for (std::size_t at = 0; at + 8 <= size; at += 8) {
    if (const int command = data[at] >> 5; command == 5 || command == 6) continue;
    const auto before = answers;
    node.receive(classic(0x601, std::span(data + at, 8)), 0);
    ++requests;
    if (answers > before + 1) std::abort();                           // one answer at most
    if ((data[at] >> 5) != 4 && answers != before + 1) std::abort();  // and one for all but a client's abort
  }
  // Written values are within the object's limits, for any input.
  for (const Object& o : node.dictionary().objects())
    if (is_number(o.type) && o.access == Access::read_write && (o.value < o.low || o.value > o.high)) std::abort();
  return 0;
}

__attribute__((weak)) int main(int argc, char** argv) {
  const long runs = argc > 1 ? std::atol(argv[1]) : 1000;
  std::mt19937 random(static_cast<unsigned>(argc > 2 ? std::atol(argv[2]) : 1));
  const std::uint8_t commands[] = {0x40, 0x60, 0x70, 0x23, 0x27, 0x2B, 0x2F, 0x21, 0x20, 0x00, 0x10, 0x01, 0x80, 0xE0};
  const std::uint16_t indices[] = {0x1003, 0x1008, 0x1016, 0x1017, 0x1402, 0x1602, 0x1802,
                                   0x1A02, 0x6040, 0x6060, 0x607A, 0x605A, 0x2110, 0x6085};
  std::vector<std::uint8_t> bytes;
  for (long i = 0; i < runs; ++i) {
    bytes.resize(8 * (1 + random() % 16));
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random() % 3 ? random() : 0);
    for (std::size_t at = 0; at < bytes.size(); at += 8) {
      if (random() % 8) bytes[at] = commands[random() % std::size(commands)];
      if (random() % 8) {
        const auto index = indices[random() % std::size(indices)];
        bytes[at + 1] = static_cast<std::uint8_t>(index);
        bytes[at + 2] = static_cast<std::uint8_t>(index >> 8);
        bytes[at + 3] = static_cast<std::uint8_t>(random() % 10);
      }
    }
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  std::printf("%ld runs\n", runs);
}
