// The container: what a file holds arrives, what is wrong with it is said; what is written is read.
#include <filesystem>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/tests/twin/io/mcap/mcap_bytes.hpp>
#include <tribotwin/tests/twin/io/tables/table_files.hpp>
#include <tribotwin/twin/io/mcap/reader.hpp>
#include <tribotwin/twin/io/mcap/writer.hpp>

namespace tribotwin::twin {
namespace {

using namespace mcap_bytes;
using testing::ElementsAre, testing::HasSubstr;

TEST(Checksum, OfPartsIsThatOfTheWhole) {
  EXPECT_EQ(crc32("123456789"), 0xCBF43926u);
  EXPECT_EQ(crc32("56789", crc32("1234")), 0xCBF43926u);
  EXPECT_EQ(crc32("", 0xCBF43926u), 0xCBF43926u);
}

class Mcap : public TableFiles {
 protected:
  /// "topic encoding schema time data" per message, or the error.
  std::string read(const std::string& bytes) {
    std::string out;
    const auto contents = mcap::read(
        write("a.mcap", bytes), [&](const mcap::Channel& c, std::uint64_t time_ns, std::string_view d) -> Result<void> {
          out += fmt::format("{} {} {} {} {};", c.topic, c.encoding, c.schema, time_ns, d);
          return {};
        });
    if (!contents) return "error: " + contents.error().message;
    return out + contents->cut_off;
  }
};

const std::string parts = schema(1, "a/msg/A") + channel(7, 1, "/a") + channel(8, 0, "/b", "json");
const std::string messages = message(7, 5, "one") + message(8, 4, "two");
const std::string both = "/a cdr a/msg/A 5 one;/b json  4 two;";

TEST_F(Mcap, EveryLayoutIsRead) {
  const std::string metadata = record(12, text("m") + text("")), index = record(7, le(std::uint16_t{7}) + text("")),
                    attachment = record(9, std::string(3 << 20, 'x')), priv = record(0x80, "private");
  const struct {
    const char* name;
    std::string data;
  } cases[] = {
      {"without chunks", parts + messages},
      {"plain chunk", chunk("", parts + messages)},
      {"zstd", chunk("zstd", parts + messages)},
      {"lz4", chunk("lz4", parts + messages)},
      {"channels before the chunk", parts + chunk("zstd", messages) + index},
      {"two chunks", chunk("lz4", parts + message(7, 5, "one")) + index + chunk("zstd", message(8, 4, "two"))},
      {"channels twice", chunk("zstd", parts + message(7, 5, "one")) + chunk("", parts + message(8, 4, "two"))},
      {"no checksum", chunk("zstd", parts + messages, -1, 0)},
      {"an empty chunk", chunk("zstd", "") + parts + messages},
      {"other records", metadata + parts + attachment + priv + messages},
      {"other records in a chunk", chunk("", parts + priv + messages)},
      {"schema 0 is ignored", schema(0, "x") + parts + messages},
      {"longer records of a later version",
       record(3, le(std::uint16_t{1}) + text("a/msg/A") + text("ros2msg") + text("") + "later") +
           record(4, le(std::uint16_t{7}) + le(std::uint16_t{1}) + text("/a") + text("cdr") + text("") + "later") +
           channel(8, 0, "/b", "json") + messages},
  };
  for (const auto& c : cases) EXPECT_EQ(read(file(c.data)), both) << c.name;
  EXPECT_EQ(read(file("")), "");
  // The smallest files have no DataEnd.
  EXPECT_EQ(read(magic + header + parts + messages + record(2, std::string(20, '\0')) + magic), both);
}

TEST_F(Mcap, DamageIsSaid) {
  const std::string whole = file(parts + messages);
  std::string changed = whole;
  changed[whole.find("one")] = 'O';
  const struct {
    const char* name;
    std::string bytes, says;
  } cases[] = {
      {"no MCAP", "hello, here is a text", "does not begin"},
      {"nothing", "", "does not begin"},
      {"checksum of the data", changed, "the data are damaged: their checksum"},
      {"checksum of a chunk", file(chunk("zstd", parts, -1, 1)), "byte 35: a chunk is damaged: its checksum"},
      {"unknown compression", file(chunk("gz\x1b", parts)), "compression 'gz?' is not known; accepted are zstd, lz4"},
      {"a size beyond the chunk's bytes", file(chunk("zstd", parts, 1LL << 40)), "cannot be the 1099511627776"},
      {"a size beyond the ratio of lz4", file(chunk("lz4", parts, 1000000)), "cannot be the 1000000"},
      {"more than promised", file(chunk("zstd", parts, 3)), "zstd: "},
      {"more than promised, lz4", file(chunk("lz4", parts, 3)), "lz4: "},
      {"less than promised", file(chunk("zstd", parts, 1000)), "uncompressed, where the chunk promises 1000"},
      {"less than promised, lz4", file(chunk("lz4", parts, 1000)), "uncompressed, where the chunk promises 1000"},
      {"not compressed", file(chunk("", parts, 1000)), "where the chunk promises 1000"},
      {"no zstd", file(record(6, std::string(28, '\0') + text("zstd") + le(std::uint64_t{4}) + "abcd")), "damaged"},
      {"a cut record in a chunk", file(chunk("", parts.substr(0, 20))), "ends within a record"},
      {"a chunk in a chunk", file(chunk("", chunk("", parts))), "holds a chunk"},
      {"an unknown schema", file(channel(7, 1, "/a")), "channel 7 has schema 1, which is not there"},
      {"an unknown channel", file(messages), "of channel 7, which is not there"},
      {"two channels of a number", file(parts + channel(7, 1, "/c")), "two channels have the number 7"},
      {"two schemas of a number", file(parts + schema(1, "C")), "two schemas have the number 1"},
      {"a short message", file(parts + record(5, "abc")), "a message is shorter than its fields"},
      {"a long text", file(record(4, le(std::uint32_t{7}) + le(0xFFFFFFFFu))), "a channel is shorter"},
      {"a length beyond a file with an end", magic + record(12, "") + '\5' + le(std::uint64_t{1} << 63) + magic,
       "damaged at byte 17"},
      {"two files in one", whole + whole, "bytes follow the end"},
  };
  for (const auto& c : cases) {
    const std::string message = read(c.bytes);
    EXPECT_THAT(message, testing::StartsWith("error: ")) << c.name;
    EXPECT_THAT(message, HasSubstr(c.says)) << c.name;
    EXPECT_THAT(message, HasSubstr("a.mcap: ")) << c.name;
  }
}

TEST_F(Mcap, ARecordWithoutEndTakesNoMemory) {
  const auto sparse = write("a.mcap", magic + header + '\5' + le(std::uint64_t{1} << 35));
  std::filesystem::resize_file(sparse, std::uintmax_t{1} << 36);
  const auto visit = [](const mcap::Channel&, std::uint64_t, std::string_view) -> Result<void> { return {}; };
  const auto contents = mcap::read(sparse, visit);
  ASSERT_FALSE(contents);
  EXPECT_THAT(contents.error().message, HasSubstr("a record has 34359738368 bytes; at most 1073741824 are read"));
}

/// A recorder that was killed leaves whole records and a part of one; they are read, and it is said.
TEST_F(Mcap, AKilledRecorderLosesItsLastChunkOnly) {
  const std::string begin = magic + header + chunk("zstd", parts + messages), second = chunk("lz4", messages);
  for (const std::size_t more : {std::size_t{0}, std::size_t{5}, std::size_t{30}, second.size() - 1})
    EXPECT_EQ(read(begin + second.substr(0, more)),
              both + fmt::format("ends at byte {} without the end of an MCAP file", begin.size()))
        << more;
  EXPECT_EQ(read(begin + std::string(4096, '\0')),  // of a file system after a power failure
            both + fmt::format("ends at byte {} without the end of an MCAP file", begin.size()));
  EXPECT_THAT(read(begin + second), HasSubstr(both + both + "ends at byte"));
}

TEST_F(Mcap, WhatIsWrittenIsRead) {
  std::string bytes, expected;
  {
    mcap::Writer writer(
        [&](std::string_view more) -> Result<void> {
          bytes += more;
          return {};
        },
        "ros2", "a test");
    const auto one = writer.add_schema("a/msg/A", "ros2msg", "float64 x");
    EXPECT_EQ(writer.add_schema("a/msg/A", "ros2msg", "float64 x"), one);
    const auto a = writer.add_channel("/a", "cdr", one, {{"key", "value"}}), b = writer.add_channel("/b", "json", 0);
    writer.add_metadata("m", {{"seed", "1"}});
    for (int i = 0; i < 12000; ++i) {  // more than one chunk
      const std::string data = fmt::format("{:050}", i);
      ASSERT_TRUE(writer.add_message(i % 2 ? a : b, 1000u + static_cast<unsigned>(i), data));
      expected += fmt::format("{} {} {};", i % 2 ? "/a cdr a/msg/A" : "/b json ", 1000 + i, data);
    }
    ASSERT_TRUE(writer.finish());
  }
  EXPECT_TRUE(read(bytes) == expected);
  EXPECT_LT(bytes.size(), expected.size() / 2);
  // Every byte is under a checksum, or the magic, or a length whose change is found.
  for (std::size_t at = 0; at < bytes.size(); at += 1 + bytes.size() / 40) {
    std::string changed = bytes;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    EXPECT_THAT(read(changed).substr(0, 200), HasSubstr("error: ")) << at;
  }
}

TEST_F(Mcap, AFullDiskIsAnError) {
  std::size_t written = 0;
  mcap::Writer writer(
      [&](std::string_view more) -> Result<void> {
        if ((written += more.size()) > 100) return work_failed("the disk is full");
        return {};
      },
      "ros2", "a test");
  const auto channel = writer.add_channel("/a", "cdr", writer.add_schema("a/msg/A", "ros2msg", std::string(100, 'x')));
  EXPECT_FALSE(writer.add_message(channel, 1, "x"));
  const auto done = writer.finish();
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message, "the disk is full");
}

}  // namespace
}  // namespace tribotwin::twin
