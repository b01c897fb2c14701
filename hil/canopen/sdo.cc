#include <algorithm>
#include <limits>
#include <utility>

#include <tribotwin/hil/canopen/sdo.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::int64_t timeout_ns = 1'000'000'000, ask_again_ns = timeout_ns / 2;

/// Bits 5 to 7 of the command byte of a client (CiA 301, 7.2.4.3).
enum ClientCommand : int {
  download_segment_request = 0,
  initiate_download_request = 1,
  initiate_upload_request = 2,
  upload_segment_request = 3,
  abort_transfer = 4,
  block_upload_request = 5,
  block_download_request = 6
};

constexpr bool names_an_object(std::uint8_t command) {
  switch (command >> 5) {
    case initiate_download_request:
    case initiate_upload_request:
      return true;
    case block_upload_request:
      return (command & 3) == 0;
    case block_download_request:
      return (command & 1) == 0;
    default:
      return false;
  }
}

constexpr std::uint8_t toggle_bit = 0x10;

}  // namespace

void SdoServer::request(Request bytes, std::int64_t now_ns) {
  if (bytes.size() != 8) return;
  if (bytes[0] == abort_command) return reset();
  // In a block the command byte is the number of the segment.
  if (transfer_.way == Way::block_download) return block_segment(bytes, now_ns);
  if (names_an_object(bytes[0])) {
    index_ = static_cast<std::uint16_t>(bytes[1] | bytes[2] << 8);
    sub_ = bytes[3];
  }
  switch (bytes[0] >> 5) {
    case initiate_download_request:
      return initiate_download(bytes, now_ns);
    case download_segment_request:
      return download_segment(bytes, now_ns);
    case initiate_upload_request:
      return initiate_upload(now_ns);
    case upload_segment_request:
      return upload_segment(bytes, now_ns);
    case abort_transfer:
      return reset();
    case block_upload_request:
      return block_upload(bytes, now_ns);
    case block_download_request:
      return block_download(bytes, now_ns);
    default:
      return abort(Abort::unknown_command);
  }
}

void SdoServer::tick(std::int64_t now_ns) {
  if (transfer_.way == Way::none) return;
  if (now_ns - transfer_.last_ns >= timeout_ns) {
    index_ = transfer_.index;
    sub_ = transfer_.sub;
    return abort(Abort::timed_out);
  }
  if (transfer_.way == Way::block_upload) send_block();
  if (transfer_.incomplete && now_ns - transfer_.last_ns >= ask_again_ns) acknowledge_block();
}

std::int64_t SdoServer::next_ns() const {
  if (transfer_.way == Way::none) return std::numeric_limits<std::int64_t>::max();
  return transfer_.last_ns + (transfer_.incomplete ? ask_again_ns : timeout_ns);
}

SdoServer::Answer SdoServer::answer(std::uint8_t command) const {
  return {command, static_cast<std::uint8_t>(index_), static_cast<std::uint8_t>(index_ >> 8), sub_};
}

void SdoServer::abort(Abort code) {
  transfer_ = {};
  Answer a = answer(abort_command);
  encode(static_cast<std::int64_t>(code), std::span(a).subspan(4));
  send_(a);
}

// ---- Downloads.

tl::expected<SdoServer::Transfer, Abort> SdoServer::begin_download(Way way, bool announced, Request bytes,
                                                                   std::int64_t now_ns) {
  const auto object = dictionary_.writable(index_, sub_);
  if (!object) return tl::unexpected(object.error());
  Transfer transfer{.way = way, .index = index_, .sub = sub_, .announced = announced, .last_ns = now_ns};
  transfer.longest = hil::longest(**object);
  if (!announced) return transfer;
  transfer.longest = static_cast<std::size_t>(decode(Type::u32, bytes.subspan(4, 4)));
  if (auto right = fits(**object, transfer.longest); !right) return tl::unexpected(right.error());
  return transfer;
}

bool SdoServer::finish_download() {
  const Transfer done = std::exchange(transfer_, {});
  if (done.announced && done.bytes.size() != done.longest) {
    abort(done.bytes.size() > done.longest ? Abort::too_long : Abort::too_short);
    return false;
  }
  const auto written = dictionary_.write(done.index, done.sub, done.bytes);
  if (!written) abort(written.error());
  return written.has_value();
}

void SdoServer::initiate_download(Request bytes, std::int64_t now_ns) {
  transfer_ = {};
  const bool expedited = bytes[0] & 2, sized = bytes[0] & 1;
  if (expedited) return expedited_download(bytes);
  auto begun = begin_download(Way::download, sized, bytes, now_ns);
  if (!begun) return abort(begun.error());
  transfer_ = std::move(*begun);
  send_(answer(0x60));
}

void SdoServer::expedited_download(Request bytes) {
  const bool sized = bytes[0] & 1;
  std::size_t size = 4 - (sized ? (bytes[0] >> 2 & 3) : 0);
  if (!sized)  // the size is that of the object
    if (const Object* o = dictionary_.find(index_, sub_); o && is_number(o->type))
      size = std::min<std::size_t>(size, static_cast<std::size_t>(size_of(o->type)));
  if (auto ok = dictionary_.write(index_, sub_, bytes.subspan(4, size)); !ok) return abort(ok.error());
  send_(answer(0x60));
}

tl::expected<void, Abort> SdoServer::continues(Way way, std::uint8_t command) {
  if (transfer_.way != way) return tl::unexpected(Abort::unknown_command);
  index_ = transfer_.index;
  sub_ = transfer_.sub;
  if (static_cast<bool>(command & toggle_bit) != transfer_.toggle) return tl::unexpected(Abort::toggle);
  return {};
}

void SdoServer::download_segment(Request bytes, std::int64_t now_ns) {
  if (auto ok = continues(Way::download, bytes[0]); !ok) return abort(ok.error());
  const std::size_t size = 7 - (bytes[0] >> 1 & 7);
  const auto data = bytes.subspan(1, size);
  transfer_.bytes.insert(transfer_.bytes.end(), data.begin(), data.end());
  if (transfer_.bytes.size() > transfer_.longest) return abort(Abort::too_long);
  const Answer taken{static_cast<std::uint8_t>(0x20 | (transfer_.toggle ? toggle_bit : 0))};
  transfer_.toggle = !transfer_.toggle;
  transfer_.last_ns = now_ns;
  const bool last = bytes[0] & 1;
  if (!last || finish_download()) send_(taken);
}

// ---- Uploads.

void SdoServer::initiate_upload(std::int64_t now_ns) {
  transfer_ = {};
  auto value = dictionary_.read(index_, sub_);
  if (!value) return abort(value.error());
  upload(std::move(*value), now_ns);
}

void SdoServer::upload(std::vector<std::uint8_t> value, std::int64_t now_ns) {
  Answer a = answer(0x41);
  if (!value.empty() && value.size() <= 4) {  // expedited
    a[0] = static_cast<std::uint8_t>(0x43 | (4 - value.size()) << 2);
    std::ranges::copy(value, a.begin() + 4);
  } else {
    encode(static_cast<std::int64_t>(value.size()), std::span(a).subspan(4));
    transfer_ = {.way = Way::upload, .index = index_, .sub = sub_, .bytes = std::move(value), .last_ns = now_ns};
  }
  send_(a);
}

void SdoServer::upload_segment(Request bytes, std::int64_t now_ns) {
  if (auto ok = continues(Way::upload, bytes[0]); !ok) return abort(ok.error());
  const std::size_t size = std::min<std::size_t>(7, transfer_.bytes.size() - transfer_.at);
  Answer a{};
  std::copy_n(transfer_.bytes.begin() + static_cast<std::ptrdiff_t>(transfer_.at), size, a.begin() + 1);
  transfer_.at += size;
  const bool last = transfer_.at == transfer_.bytes.size();
  a[0] = static_cast<std::uint8_t>((transfer_.toggle ? toggle_bit : 0) | (7 - size) << 1 | (last ? 1 : 0));
  transfer_.toggle = !transfer_.toggle;
  transfer_.last_ns = now_ns;
  if (last) transfer_ = {};
  send_(a);
}

}  // namespace tribotwin::hil
