// Block transfers (CiA 301, 7.2.4.3.9 to 7.2.4.3.16). A segment that is lost, doubled or out of order is not taken; the
// answer to the block names the last one that was, and the rest is sent again in the next block.
#include <algorithm>

#include <tribotwin/hil/canopen/sdo.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint8_t largest_block = 127, segment_bytes = 7, last_segment = 0x80, crc_bit = 0x04, size_bit = 0x02;

/// Bits 0 and 1 of the command byte of a block upload.
enum UploadStep : int { initiate = 0, end = 1, acknowledge = 2, start = 3 };

constexpr std::uint8_t unused_bytes(std::size_t size) {
  return size == 0 ? segment_bytes : static_cast<std::uint8_t>((segment_bytes - size % segment_bytes) % segment_bytes);
}

}  // namespace

std::uint16_t sdo_crc(std::span<const std::uint8_t> bytes) {
  std::uint16_t crc = 0;
  for (const std::uint8_t byte : bytes) {
    crc = static_cast<std::uint16_t>(crc ^ byte << 8);
    for (int bit = 0; bit < 8; ++bit) crc = static_cast<std::uint16_t>(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
  }
  return crc;
}

// ---- Download.

void SdoServer::block_download(Request bytes, std::int64_t now_ns) {
  const bool ends = bytes[0] & 1;
  if (ends)
    end_block_download(bytes);
  else
    initiate_block_download(bytes, now_ns);
}

void SdoServer::initiate_block_download(Request bytes, std::int64_t now_ns) {
  transfer_ = {};
  auto begun = begin_download(Way::block_download, bytes[0] & size_bit, bytes, now_ns);
  if (!begun) return abort(begun.error());
  transfer_ = std::move(*begun);
  transfer_.crc = bytes[0] & crc_bit;
  transfer_.block_size = largest_block;
  Answer a = answer(0xA0 | crc_bit);
  a[4] = largest_block;
  send_(a);
}

void SdoServer::block_segment(Request bytes, std::int64_t now_ns) {
  index_ = transfer_.index;
  sub_ = transfer_.sub;
  const auto number = static_cast<std::uint8_t>(bytes[0] & ~last_segment);
  if (number == 0 || number > transfer_.block_size) return abort(Abort::sequence_number);
  transfer_.last_ns = now_ns;
  transfer_.incomplete = true;
  const bool last = bytes[0] & last_segment;
  if (number == transfer_.sequence + 1) {
    transfer_.sequence = number;
    transfer_.last = last;
    transfer_.bytes.insert(transfer_.bytes.end(), bytes.begin() + 1, bytes.end());
    // How much of the last segment is data, its end says.
    if (transfer_.bytes.size() >= transfer_.longest + segment_bytes + (transfer_.longest == 0 ? 1 : 0))
      return abort(Abort::too_long);
  }
  if (last || number == transfer_.block_size) acknowledge_block();
}

void SdoServer::acknowledge_block() {
  if (transfer_.last) transfer_.way = Way::block_download_end;
  send_({0xA2, transfer_.sequence, transfer_.block_size});
  transfer_.sequence = 0;
  transfer_.incomplete = false;
}

void SdoServer::end_block_download(Request bytes) {
  if (transfer_.way != Way::block_download_end) return abort(Abort::unknown_command);
  index_ = transfer_.index;
  sub_ = transfer_.sub;
  transfer_.bytes.erase(transfer_.bytes.end() - (bytes[0] >> 2 & 7), transfer_.bytes.end());
  if (transfer_.crc && sdo_crc(transfer_.bytes) != decode(Type::u16, bytes.subspan(1, 2))) return abort(Abort::crc);
  if (finish_download()) send_({0xA1});
}

// ---- Upload.

void SdoServer::block_upload(Request bytes, std::int64_t now_ns) {
  const auto in = [&](Way way) {
    if (transfer_.way != way) abort(Abort::unknown_command);
    return transfer_.way == way;
  };
  transfer_.last_ns = now_ns;
  switch (bytes[0] & 3) {
    case UploadStep::initiate:
      return initiate_block_upload(bytes, now_ns);
    case UploadStep::start:
      if (!in(Way::block_upload_start)) return;
      transfer_.way = Way::block_upload;
      return send_block();
    case UploadStep::acknowledge:
      if (in(Way::block_upload)) block_acknowledged(bytes);
      return;
    default:
      if (in(Way::block_upload_end)) reset();
  }
}

void SdoServer::initiate_block_upload(Request bytes, std::int64_t now_ns) {
  transfer_ = {};
  const std::uint8_t block_size = bytes[4], switch_threshold = bytes[5];
  if (block_size == 0 || block_size > largest_block) return abort(Abort::block_size);
  auto value = dictionary_.read(index_, sub_);
  if (!value) return abort(value.error());
  if (switch_threshold != 0 && value->size() <= switch_threshold) return upload(std::move(*value), now_ns);
  Answer a = answer(0xC0 | crc_bit | size_bit);
  encode(static_cast<std::int64_t>(value->size()), std::span(a).subspan(4));
  transfer_ = {.way = Way::block_upload_start,
               .index = index_,
               .sub = sub_,
               .bytes = std::move(*value),
               .crc = (bytes[0] & crc_bit) != 0,
               .block_size = block_size,
               .last_ns = now_ns};
  send_(a);
}

/// Sends segments from `sequence` on, until the block or the value ends or the bus takes no more.
void SdoServer::send_block() {
  while (transfer_.sequence < transfer_.block_size && !transfer_.last) {
    const std::size_t from = transfer_.at + std::size_t{segment_bytes} * transfer_.sequence;
    const std::size_t size = std::min<std::size_t>(segment_bytes, transfer_.bytes.size() - from);
    const bool last = from + size == transfer_.bytes.size();
    Answer a{static_cast<std::uint8_t>((transfer_.sequence + 1) | (last ? last_segment : 0))};
    std::copy_n(transfer_.bytes.begin() + static_cast<std::ptrdiff_t>(from), size, a.begin() + 1);
    if (!send_(a)) return;
    ++transfer_.sequence;
    transfer_.last = last;
  }
}

void SdoServer::block_acknowledged(Request bytes) {
  index_ = transfer_.index;
  sub_ = transfer_.sub;
  const std::uint8_t taken = bytes[1], next_size = bytes[2];
  if (taken > transfer_.sequence) return abort(Abort::sequence_number);
  if (next_size == 0 || next_size > largest_block) return abort(Abort::block_size);
  if (transfer_.last && taken == transfer_.sequence) return end_block_upload();
  transfer_.at += std::size_t{segment_bytes} * taken;
  transfer_.block_size = next_size;
  transfer_.sequence = 0;
  transfer_.last = false;
  send_block();
}

void SdoServer::end_block_upload() {
  transfer_.way = Way::block_upload_end;
  const std::uint16_t crc = transfer_.crc ? sdo_crc(transfer_.bytes) : std::uint16_t{0};
  send_({static_cast<std::uint8_t>(0xC1 | unused_bytes(transfer_.bytes.size()) << 2), static_cast<std::uint8_t>(crc),
         static_cast<std::uint8_t>(crc >> 8)});
}

}  // namespace tribotwin::hil
