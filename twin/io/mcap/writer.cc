#include <algorithm>
#include <map>

#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/mcap/bytes.hpp>
#include <tribotwin/twin/io/mcap/compression.hpp>
#include <tribotwin/twin/io/mcap/writer.hpp>

namespace tribotwin::twin::mcap {
namespace {

constexpr std::size_t chunk_bytes = 768 << 10;  // uncompressed, as rosbag2 and the reference libraries write

std::string record(Op op, std::string_view content) {
  std::string out(1, static_cast<char>(op));
  put(out, std::uint64_t{content.size()});
  return out += content;
}

std::string of_texts(const Texts& texts) {
  std::string entries, out;
  for (const auto& [key, value] : texts) put_text(entries, key), put_text(entries, value);
  put_text(out, entries);
  return out;
}

/// Messages that are not yet written, and where each is.
struct Chunk {
  std::string records;
  std::uint64_t first_ns = 0, last_ns = 0;
  std::map<std::uint16_t, std::string> index;  ///< per channel: time and place of each message

  void add(std::uint16_t channel, std::uint64_t time_ns, std::string_view message) {
    first_ns = records.empty() ? time_ns : std::min(first_ns, time_ns);
    last_ns = records.empty() ? time_ns : std::max(last_ns, time_ns);
    auto& entries = index[channel];
    put(entries, time_ns), put(entries, std::uint64_t{records.size()});
    records += record(Op::message, message);
  }
};

struct Statistics {
  std::uint64_t first_ns = 0, last_ns = 0;
  std::map<std::uint16_t, std::uint64_t> messages;  ///< per channel

  void add(std::uint16_t channel, std::uint64_t time_ns) {
    first_ns = messages.empty() ? time_ns : std::min(first_ns, time_ns);
    last_ns = messages.empty() ? time_ns : std::max(last_ns, time_ns);
    ++messages[channel];
  }
};

}  // namespace

struct Writer::Impl {
  Sink sink;
  Result<void> status;
  std::uint64_t place = 0;
  std::uint32_t checksum = 0;
  /// Of the summary: records by operation code, in the order of the summary.
  std::map<Op, std::vector<std::string>> summary;
  std::map<std::string, std::uint16_t> schemas;  ///< by all but their number
  Chunk chunk;
  Statistics statistics;

  void write(std::string_view bytes) {
    if (status) status = sink(bytes);
    checksum = crc32(bytes, checksum);
    place += bytes.size();
  }
  std::size_t count(Op op) const {
    const auto found = summary.find(op);
    return found == summary.end() ? 0 : found->second.size();
  }
  /// A record that the summary repeats.
  void write_repeated(Op op, std::string_view content) {
    summary[op].push_back(record(op, content));
    write(summary[op].back());
  }
  void write_chunk();
  void add_statistics();
  void write_summary();
};

void Writer::Impl::write_chunk() {
  if (chunk.records.empty()) return;
  const std::string packed = compressed(chunk.records);
  std::string content, index_entry, offsets;
  put(content, chunk.first_ns), put(content, chunk.last_ns);
  put(content, std::uint64_t{chunk.records.size()}), put(content, crc32(chunk.records));
  put_text(content, "zstd");
  put(content, std::uint64_t{packed.size()});
  content += packed;
  const std::string whole = record(Op::chunk, content);
  put(index_entry, chunk.first_ns), put(index_entry, chunk.last_ns);
  put(index_entry, place), put(index_entry, std::uint64_t{whole.size()});
  write(whole);
  const std::uint64_t indexes_begin = place;
  for (const auto& [channel, entries] : chunk.index) {
    put(offsets, channel), put(offsets, place);
    std::string index;
    put(index, channel), put_text(index, entries);
    write(record(Op::message_index, index));
  }
  put_text(index_entry, offsets);
  put(index_entry, place - indexes_begin);
  put_text(index_entry, "zstd");
  put(index_entry, std::uint64_t{packed.size()}), put(index_entry, std::uint64_t{chunk.records.size()});
  summary[Op::chunk_index].push_back(record(Op::chunk_index, index_entry));
  chunk = {};
}

void Writer::Impl::add_statistics() {
  std::uint64_t all = 0;
  std::string counts, content;
  for (const auto& [channel, messages] : statistics.messages) {
    put(counts, channel), put(counts, messages);
    all += messages;
  }
  put(content, all);
  put(content, static_cast<std::uint16_t>(count(Op::schema)));
  put(content, static_cast<std::uint32_t>(count(Op::channel)));
  put(content, std::uint32_t{0});  // attachments
  put(content, static_cast<std::uint32_t>(count(Op::metadata_index)));
  put(content, static_cast<std::uint32_t>(count(Op::chunk_index)));
  put(content, statistics.first_ns), put(content, statistics.last_ns);
  put_text(content, counts);
  summary[Op::statistics].push_back(record(Op::statistics, content));
}

void Writer::Impl::write_summary() {
  checksum = 0;
  const std::uint64_t begin = place;
  std::string offsets;
  for (const auto& [op, records] : summary) {
    std::string group;
    group += static_cast<char>(op);
    put(group, place);
    const std::uint64_t group_begin = place;
    for (const auto& one : records) write(one);
    put(group, place - group_begin);
    offsets += record(Op::summary_offset, group);
  }
  const std::uint64_t offsets_begin = place;
  write(offsets);
  std::string footer;
  put(footer, begin), put(footer, offsets_begin);
  const std::string head = record(Op::footer, footer + std::string(sizeof checksum, '\0'));
  put(footer, crc32(std::string_view(head).substr(0, record_head + 2 * sizeof begin), checksum));
  write(record(Op::footer, footer));
  write(magic);
}

Writer::Writer(Sink sink, std::string_view profile, std::string_view library) : impl_(std::make_unique<Impl>()) {
  impl_->sink = std::move(sink);
  impl_->write(magic);
  std::string header;
  put_text(header, profile), put_text(header, library);
  impl_->write(record(Op::header, header));
}
Writer::Writer(Writer&&) noexcept = default;
Writer::~Writer() = default;

std::uint16_t Writer::add_schema(std::string_view name, std::string_view encoding, std::string_view data) {
  std::string fields, content;
  put_text(fields, name), put_text(fields, encoding), put_text(fields, data);
  const auto id = static_cast<std::uint16_t>(impl_->count(Op::schema) + 1);
  const auto [known, added] = impl_->schemas.emplace(fields, id);
  if (!added) return known->second;
  put(content, id);
  impl_->write_repeated(Op::schema, content + fields);
  return id;
}

std::uint16_t Writer::add_channel(std::string_view topic, std::string_view encoding, std::uint16_t schema,
                                  const Texts& metadata) {
  const auto id = static_cast<std::uint16_t>(impl_->count(Op::channel) + 1);
  std::string content;
  put(content, id), put(content, schema), put_text(content, topic), put_text(content, encoding);
  content += of_texts(metadata);
  impl_->write_repeated(Op::channel, content);
  return id;
}

void Writer::add_metadata(std::string_view name, const Texts& metadata) {
  std::string content, index;
  put_text(content, name);
  content += of_texts(metadata);
  const std::string whole = record(Op::metadata, content);
  put(index, impl_->place), put(index, std::uint64_t{whole.size()}), put_text(index, name);
  impl_->summary[Op::metadata_index].push_back(record(Op::metadata_index, index));
  impl_->write(whole);
}

Result<void> Writer::add_message(std::uint16_t channel, std::uint64_t time_ns, std::string_view data) {
  impl_->statistics.add(channel, time_ns);
  std::string content;
  put(content, channel);
  put(content, static_cast<std::uint32_t>(impl_->statistics.messages[channel] - 1));  // sequence
  put(content, time_ns), put(content, time_ns);                                       // recorded and published
  content += data;
  impl_->chunk.add(channel, time_ns, content);
  if (impl_->chunk.records.size() >= chunk_bytes) impl_->write_chunk();
  return impl_->status;
}

Result<void> Writer::finish() {
  impl_->write_chunk();
  std::string checksum;
  put(checksum, impl_->checksum);
  impl_->write(record(Op::data_end, checksum));
  impl_->add_statistics();
  impl_->write_summary();
  return impl_->status;
}

}  // namespace tribotwin::twin::mcap
