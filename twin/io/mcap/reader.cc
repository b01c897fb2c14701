#include <algorithm>
#include <fstream>
#include <map>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/mcap/bytes.hpp>
#include <tribotwin/twin/io/mcap/compression.hpp>
#include <tribotwin/twin/io/mcap/reader.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::mcap {
namespace {

using Status = Result<void>;

tl::unexpected<Error> wrong(std::string what) { return tl::unexpected(Error(std::move(what))); }

/// Schemas and channels so far, and what becomes of a record of the data section.
class Messages {
 public:
  explicit Messages(const Visit& visit) : visit_(visit) {}

  Status take(Op op, std::string_view content) {
    Cursor cursor(content);
    switch (op) {
      case Op::schema:
        return add_schema(cursor);
      case Op::channel:
        return add_channel(cursor);
      case Op::message:
        return pass_on(cursor);
      case Op::chunk:
        return open_chunk(cursor);
      default:
        return {};
    }
  }
  const std::vector<Channel>& channels() const { return channels_; }

 private:
  Status add_schema(Cursor& in) {
    const auto id = in.number<std::uint16_t>();
    const std::string name(in.text());
    if (!in.whole()) return wrong("a schema is shorter than its fields");
    if (id == 0) return {};  // "should be ignored by readers"
    const auto [known, added] = schemas_.emplace(id, name);
    return added || known->second == name ? Status{} : wrong(fmt::format("two schemas have the number {}", id));
  }

  Status add_channel(Cursor& in) {
    const auto id = in.number<std::uint16_t>(), schema = in.number<std::uint16_t>();
    Channel channel{.topic = std::string(in.text()), .encoding = std::string(in.text()), .schema = {}};
    if (!in.whole()) return wrong("a channel is shorter than its fields");
    if (schema != 0) {
      const auto found = schemas_.find(schema);
      if (found == schemas_.end())
        return wrong(fmt::format("channel {} has schema {}, which is not there", id, schema));
      channel.schema = found->second;
    }
    const auto [known, added] = by_id_.emplace(id, channels_.size());
    if (!added)
      return channels_[known->second] == channel ? Status{} : wrong(fmt::format("two channels have the number {}", id));
    channels_.push_back(std::move(channel));
    return {};
  }

  Status pass_on(Cursor& in) {
    const auto id = in.number<std::uint16_t>();
    (void)in.number<std::uint32_t>();  // sequence
    const auto log_time_ns = in.number<std::uint64_t>();
    (void)in.number<std::uint64_t>();  // publish_time
    if (!in.whole()) return wrong("a message is shorter than its fields");
    const auto channel = by_id_.find(id);
    if (channel == by_id_.end()) return wrong(fmt::format("a message is of channel {}, which is not there", id));
    return visit_(channels_[channel->second], log_time_ns, in.rest());
  }

  Status open_chunk(Cursor& in) {
    (void)in.number<std::uint64_t>(), (void)in.number<std::uint64_t>();  // earliest and latest time
    const auto size = in.number<std::uint64_t>();
    const auto crc = in.number<std::uint32_t>();
    const auto format = in.text();
    const auto packed = in.bytes(in.number<std::uint64_t>());
    if (!in.whole()) return wrong("a chunk is shorter than its fields");
    const auto records = decompress(format, packed, size, buffer_);
    if (!records) return wrong("a chunk is damaged: " + records.error().message);
    if (crc != 0 && crc32(*records) != crc) return wrong("a chunk is damaged: its checksum (CRC-32) is another");
    return take_all(*records);
  }

  Status take_all(std::string_view records) {
    Cursor cursor(records);
    while (!cursor.rest().empty()) {
      const auto op = static_cast<Op>(cursor.number<std::uint8_t>());
      const auto content = cursor.bytes(cursor.number<std::uint64_t>());
      if (!cursor.whole()) return wrong("a chunk is damaged: it ends within a record");
      if (op == Op::chunk) return wrong("a chunk is damaged: it holds a chunk");
      if (auto ok = take(op, content); !ok) return ok;
    }
    return {};
  }

  const Visit& visit_;
  std::map<std::uint16_t, std::string> schemas_;
  std::map<std::uint16_t, std::size_t> by_id_;
  std::vector<Channel> channels_;
  Buffer buffer_;
};

/// The records of the file, one after another, with the checksum of the bytes so far.
class Records {
 public:
  Records(std::ifstream stream, std::uint64_t size) : stream_(std::move(stream)), size_(size) {}

  struct Head {
    Op op;
    std::uint64_t length;
  };
  /// Nothing where no whole record follows.
  std::optional<Head> head() {
    if (left() < record_head) return std::nullopt;
    checksum_before_ = checksum_;
    Cursor cursor(read(record_head));
    const Head out{static_cast<Op>(cursor.number<std::uint8_t>()), cursor.number<std::uint64_t>()};
    if (out.length > left() || out.op == Op{0}) return std::nullopt;
    return out;
  }
  /// The next bytes, at most as many as are left.
  std::string_view read(std::uint64_t count) {
    content_.resize(count);
    stream_.read(content_.data(), static_cast<std::streamsize>(count));
    content_.resize(static_cast<std::size_t>(stream_.gcount()));
    checksum_ = crc32(content_, checksum_);
    place_ += content_.size();
    return content_;
  }
  void skip(std::uint64_t count) {
    constexpr std::uint64_t step = std::uint64_t{1} << 20;
    for (; count > 0; count -= std::min(count, step))
      if (read(std::min(count, step)).empty()) return;
  }
  std::uint64_t place() const { return place_; }
  /// Whether the machine could not read the file; then it may go on where it seems to end.
  bool failed() const { return stream_.bad(); }
  std::uint64_t left() const { return size_ - place_; }
  std::uint32_t checksum() const { return checksum_; }
  std::uint32_t checksum_before_record() const { return checksum_before_; }
  void restart_checksum() { checksum_ = 0; }
  /// Whether the file ends as a whole one does.
  bool ends_whole() {
    std::string end(magic.size(), '\0');
    if (size_ < 2 * magic.size()) return false;
    stream_.seekg(static_cast<std::streamoff>(size_ - magic.size()));
    stream_.read(end.data(), static_cast<std::streamsize>(end.size()));
    stream_.seekg(static_cast<std::streamoff>(place_));
    return end == magic;
  }

 private:
  std::ifstream stream_;
  std::uint64_t size_, place_ = 0;
  std::uint32_t checksum_ = 0, checksum_before_ = 0;
  std::string content_;
};

/// Records whose content matters; all others may be long and are passed over.
bool is_read(Op op) {
  switch (op) {
    case Op::schema:
    case Op::channel:
    case Op::message:
    case Op::chunk:
    case Op::data_end:
    case Op::footer:
      return true;
    default:
      return false;
  }
}

class Reader {
 public:
  Reader(Records records, const Visit& visit) : records_(std::move(records)), messages_(visit) {}

  bool failed() const { return records_.failed(); }
  Result<Contents> read() {
    const bool ends_whole = records_.ends_whole();
    if (records_.read(std::min<std::uint64_t>(magic.size(), records_.left())) != magic)
      return wrong("does not begin as MCAP files do");
    std::string cut_off;
    while (!at_end_) {
      place_ = records_.place();
      const auto head = records_.head();
      if (!head && ends_whole) return wrong(fmt::format("damaged at byte {}: no record of MCAP", place_));
      if (!head) {
        cut_off = fmt::format("ends at byte {} without the end of an MCAP file", place_);
        break;
      }
      if (auto ok = take(*head); !ok) return tl::unexpected(located(std::move(ok.error())));
    }
    return Contents{.channels = messages_.channels(), .cut_off = std::move(cut_off)};
  }

 private:
  Error located(Error error) const {
    error.message = fmt::format("byte {}: {}", place_, error.message);
    return error;
  }

  Status take(const Records::Head& head) {
    if (!is_read(head.op) || (in_summary_ && head.op != Op::footer)) return records_.skip(head.length), Status{};
    if (head.length > limits::mcap_chunk_bytes)
      return wrong(fmt::format("a record has {} bytes; at most {} are read", head.length, limits::mcap_chunk_bytes));
    const std::string_view content = records_.read(head.length);
    if (content.size() != head.length) return wrong("cannot be read");
    Cursor cursor(content);
    if (head.op == Op::footer) return take_footer(cursor, content);
    if (head.op != Op::data_end) return messages_.take(head.op, content);
    const auto crc = cursor.number<std::uint32_t>();
    if (crc != 0 && crc != records_.checksum_before_record())
      return wrong("the data are damaged: their checksum (CRC-32) is another");
    in_summary_ = true;
    records_.restart_checksum();
    return {};
  }

  Status take_footer(Cursor& footer, std::string_view content) {
    at_end_ = true;
    (void)footer.number<std::uint64_t>(), (void)footer.number<std::uint64_t>();  // starts of summary and its offsets
    const auto crc = footer.number<std::uint32_t>();
    if (!footer.whole()) return wrong("the footer is shorter than its fields");
    std::string head(1, static_cast<char>(Op::footer));
    put(head, std::uint64_t{content.size()});
    const auto found = crc32(content.substr(0, 16), crc32(head, records_.checksum_before_record()));
    if (crc != 0 && in_summary_ && crc != found)
      return wrong("the summary is damaged: its checksum (CRC-32) is another");
    const auto left = records_.left();
    if (left != magic.size() || records_.read(left) != magic)
      return wrong(
          fmt::format("{} bytes follow the end, where {} are expected: the file is damaged, or several were "
                      "put together",
                      left, magic.size()));
    return {};
  }

  Records records_;
  Messages messages_;
  std::uint64_t place_ = 0;  // of the record that is read
  bool in_summary_ = false, at_end_ = false;
};

}  // namespace

Result<Contents> read(const std::filesystem::path& file, const Visit& visit) {
  auto stream = open_text(file, "an MCAP file");
  if (!stream) return tl::unexpected(stream.error());
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  if (error) return wrong(fmt::format("{}: cannot be read ({})", file.string(), error.message()));
  Reader reader(Records(std::move(*stream), size), visit);
  auto contents = reader.read();
  if (reader.failed()) return not_read(file.string());
  if (!contents) contents.error().message = fmt::format("{}: {}", file.string(), contents.error().message);
  return contents;
}

bool begins_as_mcap(std::string_view first_bytes) { return first_bytes.starts_with(magic); }

}  // namespace tribotwin::twin::mcap
