#include <algorithm>

#include <tribotwin/hil/canopen/sdo.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::int64_t timeout_ns = 1'000'000'000;
constexpr std::size_t longest = 1024;  // bytes of a segmented download

}  // namespace

SdoServer::Answer SdoServer::abort(Abort code) {
  transfer_ = {};
  Answer a{0x80, static_cast<std::uint8_t>(index_), static_cast<std::uint8_t>(index_ >> 8), sub_};
  encode(static_cast<std::int64_t>(code), std::span(a).subspan(4));
  return a;
}

std::optional<SdoServer::Answer> SdoServer::tick(std::int64_t now_ns) {
  if (transfer_.way == Transfer::Way::none || now_ns - transfer_.last_ns < timeout_ns) return std::nullopt;
  index_ = transfer_.index;
  sub_ = transfer_.sub;
  return abort(Abort::timed_out);
}

std::optional<SdoServer::Answer> SdoServer::request(std::span<const std::uint8_t> bytes, std::int64_t now_ns) {
  if (bytes.size() != 8) return std::nullopt;
  const std::uint8_t command = bytes[0];
  const int kind = command >> 5;
  if (kind == 1 || kind == 2 || kind == 5 || kind == 6) {
    index_ = static_cast<std::uint16_t>(bytes[1] | bytes[2] << 8);
    sub_ = bytes[3];
  }
  Answer a{};
  switch (kind) {
    case 1: {  // initiate download
      transfer_ = {};
      const bool expedited = command & 2, sized = command & 1;
      a = {0x60, bytes[1], bytes[2], bytes[3]};
      if (expedited) {
        std::size_t size = 4 - (sized ? (command >> 2 & 3) : 0);
        if (!sized)  // the size is what the object has
          if (const Object* o = dictionary_.find(index_, sub_); o && o->type != Type::text)
            size = static_cast<std::size_t>(size_of(o->type));
        if (auto ok = dictionary_.write(index_, sub_, bytes.subspan(4, size)); !ok) return abort(ok.error());
        return a;
      }
      const Object* o = dictionary_.find(index_, sub_);
      if (!o) return abort(dictionary_.has_index(index_) ? Abort::no_sub_index : Abort::no_object);
      if (o->access != Access::read_write) return abort(Abort::read_only);
      const auto announced = sized ? static_cast<std::size_t>(decode(Type::u32, bytes.subspan(4, 4))) : 0;
      if (announced > longest) return abort(Abort::too_long);
      transfer_ = {
          .way = Transfer::Way::download, .index = index_, .sub = sub_, .announced = announced, .last_ns = now_ns};
      return a;
    }
    case 0: {  // download segment
      if (transfer_.way != Transfer::Way::download) return abort(Abort::unknown_command);
      index_ = transfer_.index;
      sub_ = transfer_.sub;
      if (static_cast<bool>(command & 0x10) != transfer_.toggle) return abort(Abort::toggle);
      const std::size_t size = 7 - (command >> 1 & 7);
      transfer_.bytes.insert(transfer_.bytes.end(), bytes.begin() + 1,
                             bytes.begin() + 1 + static_cast<std::ptrdiff_t>(size));
      if (transfer_.bytes.size() > longest || (transfer_.announced && transfer_.bytes.size() > transfer_.announced))
        return abort(Abort::too_long);
      a[0] = static_cast<std::uint8_t>(0x20 | (transfer_.toggle ? 0x10 : 0));
      transfer_.toggle = !transfer_.toggle;
      transfer_.last_ns = now_ns;
      if (command & 1) {
        const Transfer done = std::exchange(transfer_, {});
        if (done.announced && done.bytes.size() != done.announced) return abort(Abort::too_short);
        if (auto ok = dictionary_.write(done.index, done.sub, done.bytes); !ok) return abort(ok.error());
      }
      return a;
    }
    case 2: {  // initiate upload
      transfer_ = {};
      auto value = dictionary_.read(index_, sub_);
      if (!value) return abort(value.error());
      a = {0x40, bytes[1], bytes[2], bytes[3]};
      if (!value->empty() && value->size() <= 4) {
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
    case 3: {  // upload segment
      if (transfer_.way != Transfer::Way::upload) return abort(Abort::unknown_command);
      index_ = transfer_.index;
      sub_ = transfer_.sub;
      if (static_cast<bool>(command & 0x10) != transfer_.toggle) return abort(Abort::toggle);
      const std::size_t size = std::min<std::size_t>(7, transfer_.bytes.size() - transfer_.at);
      std::copy_n(transfer_.bytes.begin() + static_cast<std::ptrdiff_t>(transfer_.at), size, a.begin() + 1);
      transfer_.at += size;
      const bool last = transfer_.at == transfer_.bytes.size();
      a[0] = static_cast<std::uint8_t>((transfer_.toggle ? 0x10 : 0) | (7 - size) << 1 | (last ? 1 : 0));
      transfer_.toggle = !transfer_.toggle;
      transfer_.last_ns = now_ns;
      if (last) transfer_ = {};
      return a;
    }
    case 4:  // the client aborts
      transfer_ = {};
      return std::nullopt;
    default:
      return abort(Abort::unknown_command);  // block transfers and what CiA 301 does not know
  }
}

}  // namespace tribotwin::hil
