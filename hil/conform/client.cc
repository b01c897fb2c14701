#include <algorithm>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/conform/client.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::size_t most_frames = 100'000;
constexpr std::int64_t longest_wait_ns = 20'000'000;
constexpr std::size_t longest_upload = 1 << 20;  // bytes; a server that never ends is stopped here

constexpr std::uint8_t toggle_bit = 0x10, abort_command = 0x80;

SdoFailure wrong(std::string what) {
  return {.kind = SdoFailure::Kind::wrong_answer, .code = 0, .what = std::move(what)};
}

}  // namespace

std::string SdoFailure::text() const {
  switch (kind) {
    case Kind::aborted:
      return fmt::format("abort {:08X}h", code);
    case Kind::no_answer:
      return "no answer";
    case Kind::wrong_answer:
      break;
  }
  return "wrong answer: " + what;
}

SdoFrame sdo_frame(std::uint8_t command, std::uint16_t index, std::uint8_t sub, std::uint32_t value) {
  SdoFrame f{command, static_cast<std::uint8_t>(index), static_cast<std::uint8_t>(index >> 8), sub};
  encode(value, std::span(f).subspan(4));
  return f;
}

std::uint32_t sdo_value(const SdoFrame& frame) {
  return static_cast<std::uint32_t>(decode(Type::u32, std::span(frame).subspan(4)));
}

Client::Client(Transport& bus, std::uint8_t node, ClientOptions options)
    : bus_(bus), node_(node), options_(std::move(options)) {}

// ---- Time.

void Client::listen(std::int64_t duration_ns) {
  until([] { return false; }, duration_ns);
}

bool Client::until(const std::function<bool()>& condition, std::int64_t duration_ns) {
  const std::int64_t end_ns = now_ns() + duration_ns;
  while (!condition()) {
    if (now_ns() >= end_ns) return false;
    turn(end_ns);
  }
  return true;
}

void Client::turn(std::int64_t deadline_ns) {
  if (options_.stop()) throw Interrupted{};
  serve_cycle();
  deadline_ns = std::min(deadline_ns, now_ns() + longest_wait_ns);
  bus_.wait(cycle_ns_ ? std::min(deadline_ns, next_cycle_ns_) : deadline_ns);
  const std::int64_t now = now_ns();
  Frame frame;
  // Bounded, so that a flooded bus cannot keep the cycle from being served.
  for (int i = 0; i < 256 && bus_.receive(frame); ++i) {
    if (frame.extended || frame.remote || frame.error || frame.fd) continue;
    heard_.push_back({frame, now});
    if (heard_.size() > most_frames) heard_.pop_front();
    if (frame.id == cob::sdo_to_client + node_ && frame.size == 8) {
      answer_.emplace();
      std::ranges::copy(frame.bytes(), answer_->begin());
    }
  }
}

void Client::serve_cycle() {
  if (cycle_ns_ == 0 || now_ns() < next_cycle_ns_) return;
  // After a pause of the machine the cycle continues from now; it does not catch up.
  next_cycle_ns_ = now_ns() - next_cycle_ns_ > cycle_ns_ ? now_ns() + cycle_ns_ : next_cycle_ns_ + cycle_ns_;
  if (before_sync_) before_sync_();
  sync();
}

void Client::cycle(std::int64_t period_ns, std::function<void()> before) {
  cycle_ns_ = period_ns;
  before_sync_ = std::move(before);
  next_cycle_ns_ = now_ns();
}

// ---- Frames.

void Client::send(std::uint32_t id, std::span<const std::uint8_t> bytes) { bus_.send(classic(id, bytes)); }

void Client::nmt(NmtCommand command, std::uint8_t node) {
  const std::uint8_t bytes[] = {static_cast<std::uint8_t>(command), node};
  send(cob::nmt, bytes);
}

void Client::sync(std::uint32_t id) { send(id, {}); }

std::vector<HeardFrame> Client::heard(std::uint32_t id) const {
  std::vector<HeardFrame> found;
  std::ranges::copy_if(heard_, std::back_inserter(found), [&](const HeardFrame& h) { return h.frame.id == id; });
  return found;
}

// ---- SDO.

tl::expected<SdoFrame, SdoFailure> Client::request(const SdoFrame& bytes) {
  answer_.reset();
  send(cob::sdo_to_server + node_, bytes);
  if (!until([&] { return answer_.has_value(); }, options_.sdo_timeout_ns))
    return tl::unexpected(SdoFailure{.kind = SdoFailure::Kind::no_answer});
  return *answer_;
}

tl::expected<SdoFrame, SdoFailure> Client::transfer(const SdoFrame& bytes) {
  auto answer = request(bytes);
  if (answer && (*answer)[0] == abort_command)
    return tl::unexpected(SdoFailure{.kind = SdoFailure::Kind::aborted, .code = sdo_value(*answer)});
  return answer;
}

void Client::abort(std::uint16_t index, std::uint8_t sub, std::uint32_t code) {
  send(cob::sdo_to_server + node_, sdo_frame(abort_command, index, sub, code));
}

tl::expected<Bytes, SdoFailure> Client::upload(std::uint16_t index, std::uint8_t sub) {
  const auto answer = transfer(sdo_frame(0x40, index, sub));
  if (!answer) return tl::unexpected(answer.error());
  const SdoFrame& a = *answer;
  if ((a[0] & 0xE0) != 0x40) return tl::unexpected(wrong(fmt::format("command {:02X}h to an upload", a[0])));
  if (sdo_frame(a[0], index, sub, sdo_value(a)) != a)
    return tl::unexpected(
        wrong(fmt::format("{:02X}{:02X}h:{:02X} instead of {:04X}h:{:02X}", a[2], a[1], a[3], index, sub)));
  const bool expedited = a[0] & 2, sized = a[0] & 1;
  if (!expedited) return upload_segments(sized ? sdo_value(a) : 0);
  const std::ptrdiff_t size = 4 - (sized ? a[0] >> 2 & 3 : 0);
  return Bytes(a.begin() + 4, a.begin() + 4 + size);
}

tl::expected<Bytes, SdoFailure> Client::upload_segments(std::size_t announced) {
  Bytes bytes;
  std::uint8_t toggle = 0;
  while (bytes.size() < longest_upload) {
    const auto answer = transfer({static_cast<std::uint8_t>(0x60 | toggle)});
    if (!answer) return tl::unexpected(answer.error());
    const std::uint8_t command = (*answer)[0];
    if (command & 0xE0) return tl::unexpected(wrong(fmt::format("command {:02X}h to an upload segment", command)));
    if ((command & toggle_bit) != toggle) return tl::unexpected(wrong("the toggle bit does not alternate"));
    bytes.insert(bytes.end(), answer->begin() + 1, answer->begin() + 8 - (command >> 1 & 7));
    toggle ^= toggle_bit;
    if (!(command & 1)) continue;
    if (announced && bytes.size() != announced)
      return tl::unexpected(wrong(fmt::format("{} bytes announced, {} sent", announced, bytes.size())));
    return bytes;
  }
  return tl::unexpected(wrong(fmt::format("more than {} bytes", longest_upload)));
}

tl::expected<void, SdoFailure> Client::download(std::uint16_t index, std::uint8_t sub,
                                                std::span<const std::uint8_t> bytes) {
  if (bytes.empty() || bytes.size() > 4) return download_segmented(index, sub, bytes);
  SdoFrame f = sdo_frame(static_cast<std::uint8_t>(0x23 | (4 - bytes.size()) << 2), index, sub);
  std::ranges::copy(bytes, f.begin() + 4);
  const auto answer = transfer(f);
  if (!answer) return tl::unexpected(answer.error());
  if (sdo_frame(0x60, index, sub, sdo_value(*answer)) != *answer)
    return tl::unexpected(wrong(fmt::format("command {:02X}h to a download, or another object", (*answer)[0])));
  return {};
}

tl::expected<void, SdoFailure> Client::download_segmented(std::uint16_t index, std::uint8_t sub,
                                                          std::span<const std::uint8_t> bytes) {
  if (auto begun = transfer(sdo_frame(0x21, index, sub, static_cast<std::uint32_t>(bytes.size()))); !begun)
    return tl::unexpected(begun.error());
  std::uint8_t toggle = 0;
  for (std::size_t at = 0, size = 0;; at += size, toggle ^= toggle_bit) {
    size = std::min<std::size_t>(7, bytes.size() - at);
    const bool last = at + size == bytes.size();
    SdoFrame f{static_cast<std::uint8_t>(toggle | (7 - size) << 1 | (last ? 1 : 0))};
    std::ranges::copy(bytes.subspan(at, size), f.begin() + 1);
    const auto answer = transfer(f);
    if (!answer) return tl::unexpected(answer.error());
    if ((*answer)[0] != (0x20 | toggle))
      return tl::unexpected(wrong(fmt::format("command {:02X}h to a download segment", (*answer)[0])));
    if (last) return {};
  }
}

}  // namespace tribotwin::hil
