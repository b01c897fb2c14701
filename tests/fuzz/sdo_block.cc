// Block transfers of the SDO server with a client that does the right thing, mostly. What it transferred without an
// abort must have arrived. For libFuzzer, and as a program: fuzz_sdo_block ACTS SEED.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include <tribotwin/hil/canopen/sdo.hpp>

using namespace tribotwin::hil;

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint16_t memory = 0x2180, text = 0x1021, number = 0x1017;
constexpr std::int64_t longest = 2000;

/// Bytes that decide what the client does; zeros at the end.
class Choices {
 public:
  Choices(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  bool empty() const { return at_ >= size_; }
  std::uint8_t byte() { return empty() ? std::uint8_t{0} : data_[at_++]; }
  std::size_t word() { return static_cast<std::size_t>(byte() << 8 | byte()); }
  bool rarely() { return byte() < 8; }

 private:
  const std::uint8_t* data_;
  std::size_t size_, at_ = 0;
};

class Client {
 public:
  long transferred = 0, aborted = 0;

  void act(Choices& c) {
    switch (c.byte() % 8) {
      case 0:
        return begin_download(c);
      case 1:
        return begin_upload(c);
      case 2: {  // anything
        Bytes request(8);
        for (auto& b : request) b = c.byte();
        off_ = true;
        return send(request);
      }
      case 3:
        now_ += static_cast<std::int64_t>(c.word()) * 20'000;
        off_ = off_ || now_ - sent_ns_ >= 1'000'000'000;
        server_.tick(now_);
        return collect();
      default:
        return c.rarely() ? reset() : go_on(c);
    }
  }

 private:
  enum class Doing { nothing, download, download_end, upload, upload_end };

  void reset() {
    send({0x80, 0, 0, 0, 0, 0, 0, 8});
    doing_ = Doing::nothing;
  }
  void send(Bytes request) {
    request.resize(8);
    sent_ns_ = now_;
    server_.request(request, now_);
    collect();
  }
  void collect() {
    for (const auto& a : std::exchange(answers_, {})) {
      if ((doing_ != Doing::upload || off_) && SdoServer::is_abort(a)) {
        if (!off_ && doing_ != Doing::nothing) std::abort();  // the client did nothing wrong
        ++aborted;
        doing_ = Doing::nothing;
      }
      came_.push_back(a);
    }
  }

  void begin_download(Choices& c) {
    data_.resize(c.word() % longest);
    for (auto& b : data_) b = static_cast<std::uint8_t>(&b - data_.data() + now_);
    const bool sized = c.byte() & 1;
    const auto size = static_cast<std::uint8_t>(data_.size());
    doing_ = Doing::download;
    off_ = false;
    at_ = 0;
    reset_server();
    came_.clear();
    send({static_cast<std::uint8_t>(sized ? 0xC6 : 0xC4), memory & 0xFF, memory >> 8, 0, sized ? size : std::uint8_t{0},
          sized ? static_cast<std::uint8_t>(data_.size() >> 8) : std::uint8_t{0}});
    if (doing_ == Doing::download && (came_.size() != 1 || came_[0][0] != 0xA4)) std::abort();
  }
  void begin_upload(Choices& c) {
    const std::uint16_t index = c.byte() & 1 ? text : memory;
    auto& value = dictionary_.find(index, 0)->text;
    expected_.assign(value.begin(), value.end());
    data_.clear();
    came_.clear();
    reset_server();
    block_ = static_cast<std::uint8_t>(1 + c.byte() % 127);
    doing_ = Doing::upload;
    off_ = false;
    send({0xA4, static_cast<std::uint8_t>(index), static_cast<std::uint8_t>(index >> 8), 0, block_});
    if (came_.size() != 1 || came_[0][0] != 0xC6) std::abort();
    came_.clear();
    send({0xA3});
  }
  void reset_server() {
    server_.request(Bytes{0x80, 0, 0, 0, 0, 0, 0, 8}, now_);
    answers_.clear();
  }

  void go_on(Choices& c) {
    switch (doing_) {
      case Doing::nothing:
        return;
      case Doing::download:
        return download_block(c);
      case Doing::download_end:
        return end_download();
      case Doing::upload:
        return upload_block(c);
      case Doing::upload_end:
        return end_upload();
    }
  }

  /// The server's answer to a block, also to one that it missed for long.
  void take_answer() {
    for (const auto& a : std::exchange(came_, {})) {
      if (a[0] == 0xA4) block_ = a[4];
      if (a[0] != 0xA2) continue;
      at_ += std::size_t{7} * a[1];
      block_ = a[2];
      if (at_ >= data_.size() && a[1] > 0) doing_ = Doing::download_end;
    }
  }
  void download_block(Choices& c) {
    take_answer();
    if (doing_ != Doing::download) return;
    std::size_t at = at_;
    for (std::size_t number = 1; number <= block_; ++number, at += 7) {
      const bool last = at + 7 >= data_.size();
      Bytes frame{static_cast<std::uint8_t>(number | (last ? 0x80 : 0))};
      for (std::size_t i = at; i < std::min(at + 7, data_.size()); ++i) frame.push_back(data_[i]);
      if (!c.rarely() || c.empty()) send(frame);
      if (number < block_ && !last && c.rarely() && !c.empty()) send(frame);  // doubled
      if (last) break;
    }
    if (doing_ == Doing::download) take_answer();
  }
  void end_download() {
    came_.clear();
    const std::size_t unused = data_.empty() ? 7 : (7 - data_.size() % 7) % 7;
    const std::uint16_t crc = sdo_crc(data_);
    send({static_cast<std::uint8_t>(0xC1 | unused << 2), static_cast<std::uint8_t>(crc),
          static_cast<std::uint8_t>(crc >> 8)});
    if (!came_.empty() && came_.back()[0] == 0xA1) {
      const std::string& kept = dictionary_.find(memory, 0)->text;
      if (!std::ranges::equal(kept, data_, [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; }))
        std::abort();
      ++transferred;
    } else if (!off_ && doing_ == Doing::download_end) {
      std::abort();  // a client without fault ends with an answer
    }
    doing_ = Doing::nothing;
  }

  void upload_block(Choices& c) {
    std::uint8_t good = 0;
    bool last = false;
    if (!off_ && came_.size() > 127) std::abort();
    for (const auto& a : came_) {
      if (a[0] == 0x80) {
        doing_ = Doing::nothing;
        return;
      }
      const bool lost = c.rarely() && !c.empty();
      if (lost || (a[0] & 0x7F) != good + 1) continue;
      ++good;
      last = a[0] & 0x80;
      data_.insert(data_.end(), a.begin() + 1, a.end());
    }
    came_.clear();
    block_ = static_cast<std::uint8_t>(1 + c.byte() % 127);
    if (last) doing_ = Doing::upload_end;
    send({0xA2, good, block_});
  }
  void end_upload() {
    doing_ = Doing::nothing;
    if (came_.empty() || (came_.back()[0] & 0xE3) != 0xC1) {
      if (!off_) std::abort();
      return;
    }
    data_.resize(data_.size() - std::min<std::size_t>(data_.size(), came_.back()[0] >> 2 & 7));
    const bool right = sdo_crc(data_) == (came_.back()[1] | came_.back()[2] << 8);
    if (!off_ && (!right || data_ != expected_)) std::abort();
    send({0xA1});
    ++transferred;
  }

  Dictionary dictionary_{{{number, 0, "number", Type::u16, Access::read_write},
                          {text, 0, "text", Type::domain, Access::read_only},
                          {memory, 0, "memory", Type::domain, Access::read_write, false, 0, 0, longest}}};
  std::vector<SdoServer::Answer> answers_, came_;
  SdoServer server_{dictionary_, [this](const SdoServer::Answer& a) {
                      answers_.push_back(a);
                      return true;
                    }};
  std::int64_t now_ = 0, sent_ns_ = 0;
  Doing doing_ = Doing::nothing;
  bool off_ = false;  // the client did something wrong, or time passed: an abort is right
  Bytes data_, expected_ = Bytes(777, 'x');
  std::size_t at_ = 0;
  std::uint8_t block_ = 127;
};

long all_transferred = 0, all_aborted = 0;

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Client client;
  Choices choices(data, size);
  while (!choices.empty()) client.act(choices);
  all_transferred += client.transferred;
  all_aborted += client.aborted;
  return 0;
}

__attribute__((weak)) int main(int argc, char** argv) {
  const long acts = argc > 1 ? std::atol(argv[1]) : 1000;
  std::mt19937_64 random(static_cast<std::uint64_t>(argc > 2 ? std::atol(argv[2]) : 1));
  Client client;
  Bytes bytes(4096);
  for (long i = 0; i < acts;) {
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    Choices choices(bytes.data(), bytes.size());
    for (; !choices.empty() && i < acts; ++i) client.act(choices);
  }
  std::printf("%ld acts, %ld transfers ended well, %ld aborts\n", acts, client.transferred, client.aborted);
  return client.transferred > acts / 100 && client.aborted > 0 ? 0 : 1;
}
