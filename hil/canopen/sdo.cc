#include <algorithm>
#include <utility>

#include <tribotwin/hil/canopen/sdo.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::int64_t timeout_ns = 1'000'000'000;
constexpr std::size_t longest = 1024;  // bytes of a segmented download

/// Bits 5 to 7 of the command byte of a client (CiA 301, 7.2.4.3).
enum ClientCommand : int {
  download_segment_request = 0,
  initiate_download_request = 1,
  initiate_upload_request = 2,
  upload_segment_request = 3,
  abort_transfer = 4
};
constexpr bool names_an_object(int command) { return command == 1 || command == 2 || command == 5 || command == 6; }

constexpr std::uint8_t toggle_bit = 0x10;

}  // namespace

std::optional<SdoServer::Answer> SdoServer::request(Request bytes, std::int64_t now_ns) {
  if (bytes.size() != 8) return std::nullopt;
  const int command = bytes[0] >> 5;
  if (names_an_object(command)) {
    index_ = static_cast<std::uint16_t>(bytes[1] | bytes[2] << 8);
    sub_ = bytes[3];
  }
  switch (command) {
    case initiate_download_request:
      return initiate_download(bytes, now_ns);
    case download_segment_request:
      return download_segment(bytes, now_ns);
    case initiate_upload_request:
      return initiate_upload(bytes, now_ns);
    case upload_segment_request:
      return upload_segment(bytes, now_ns);
    case abort_transfer:
      transfer_ = {};
      return std::nullopt;
    default:
      return abort(Abort::unknown_command);  // block transfers and commands that CiA 301 does not define
  }
}

std::optional<SdoServer::Answer> SdoServer::tick(std::int64_t now_ns) {
  if (transfer_.way == Transfer::Way::none || now_ns - transfer_.last_ns < timeout_ns) return std::nullopt;
  index_ = transfer_.index;
  sub_ = transfer_.sub;
  return abort(Abort::timed_out);
}

SdoServer::Answer SdoServer::abort(Abort code) {
  transfer_ = {};
  Answer a{abort_command, static_cast<std::uint8_t>(index_), static_cast<std::uint8_t>(index_ >> 8), sub_};
  encode(static_cast<std::int64_t>(code), std::span(a).subspan(4));
  return a;
}

SdoServer::Answer SdoServer::initiate_download(Request bytes, std::int64_t now_ns) {
  transfer_ = {};
  const bool expedited = bytes[0] & 2, sized = bytes[0] & 1;
  if (expedited) return expedited_download(bytes);
  const Object* o = dictionary_.find(index_, sub_);
  if (!o) return abort(dictionary_.has_index(index_) ? Abort::no_sub_index : Abort::no_object);
  if (o->access != Access::read_write) return abort(Abort::read_only);
  const auto announced = sized ? static_cast<std::size_t>(decode(Type::u32, bytes.subspan(4, 4))) : 0;
  if (announced > longest) return abort(Abort::too_long);
  transfer_ = {.way = Transfer::Way::download, .index = index_, .sub = sub_, .announced = announced, .last_ns = now_ns};
  return {0x60, bytes[1], bytes[2], bytes[3]};
}

SdoServer::Answer SdoServer::expedited_download(Request bytes) {
  const bool sized = bytes[0] & 1;
  std::size_t size = 4 - (sized ? (bytes[0] >> 2 & 3) : 0);
  if (!sized)  // the size is that of the object
    if (const Object* o = dictionary_.find(index_, sub_); o && o->type != Type::text)
      size = static_cast<std::size_t>(size_of(o->type));
  if (auto ok = dictionary_.write(index_, sub_, bytes.subspan(4, size)); !ok) return abort(ok.error());
  return {0x60, bytes[1], bytes[2], bytes[3]};
}

tl::expected<void, Abort> SdoServer::continues(Transfer::Way way, std::uint8_t command) {
  if (transfer_.way != way) return tl::unexpected(Abort::unknown_command);
  index_ = transfer_.index;
  sub_ = transfer_.sub;
  if (static_cast<bool>(command & toggle_bit) != transfer_.toggle) return tl::unexpected(Abort::toggle);
  return {};
}

SdoServer::Answer SdoServer::download_segment(Request bytes, std::int64_t now_ns) {
  if (auto ok = continues(Transfer::Way::download, bytes[0]); !ok) return abort(ok.error());
  const std::size_t size = 7 - (bytes[0] >> 1 & 7);
  const auto data = bytes.subspan(1, size);
  transfer_.bytes.insert(transfer_.bytes.end(), data.begin(), data.end());
  if (transfer_.bytes.size() > longest || (transfer_.announced && transfer_.bytes.size() > transfer_.announced))
    return abort(Abort::too_long);
  const Answer answer{static_cast<std::uint8_t>(0x20 | (transfer_.toggle ? toggle_bit : 0))};
  transfer_.toggle = !transfer_.toggle;
  transfer_.last_ns = now_ns;
  const bool last = bytes[0] & 1;
  if (!last) return answer;
  const Transfer done = std::exchange(transfer_, {});
  if (done.announced && done.bytes.size() != done.announced) return abort(Abort::too_short);
  if (auto ok = dictionary_.write(done.index, done.sub, done.bytes); !ok) return abort(ok.error());
  return answer;
}

SdoServer::Answer SdoServer::initiate_upload(Request bytes, std::int64_t now_ns) {
  transfer_ = {};
  auto value = dictionary_.read(index_, sub_);
  if (!value) return abort(value.error());
  Answer a{0x40, bytes[1], bytes[2], bytes[3]};
  if (!value->empty() && value->size() <= 4) {  // expedited
    a[0] = static_cast<std::uint8_t>(0x43 | (4 - value->size()) << 2);
    std::ranges::copy(*value, a.begin() + 4);
    return a;
  }
  a[0] = 0x41;
  encode(static_cast<std::int64_t>(value->size()), std::span(a).subspan(4));
  transfer_ = {
      .way = Transfer::Way::upload, .index = index_, .sub = sub_, .bytes = std::move(*value), .last_ns = now_ns};
  return a;
}

SdoServer::Answer SdoServer::upload_segment(Request bytes, std::int64_t now_ns) {
  if (auto ok = continues(Transfer::Way::upload, bytes[0]); !ok) return abort(ok.error());
  const std::size_t size = std::min<std::size_t>(7, transfer_.bytes.size() - transfer_.at);
  Answer a{};
  std::copy_n(transfer_.bytes.begin() + static_cast<std::ptrdiff_t>(transfer_.at), size, a.begin() + 1);
  transfer_.at += size;
  const bool last = transfer_.at == transfer_.bytes.size();
  a[0] = static_cast<std::uint8_t>((transfer_.toggle ? toggle_bit : 0) | (7 - size) << 1 | (last ? 1 : 0));
  transfer_.toggle = !transfer_.toggle;
  transfer_.last_ns = now_ns;
  if (last) transfer_ = {};
  return a;
}

}  // namespace tribotwin::hil
