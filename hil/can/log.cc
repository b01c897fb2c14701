#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/can/words.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

using twin::Descriptor;

using Problem = tl::unexpected<Error>;

constexpr std::size_t read_size = 64 * 1024;
constexpr int ask_stop_ms = 100;
constexpr std::uint32_t error_flag = 0x20000000;

/// Part of a file for a message, short and printable for any content of the file.
std::string shown(std::string_view part) {
  constexpr std::size_t max_shown = 40;
  const std::string out = twin::printable(part.substr(0, max_shown));
  return part.size() > max_shown ? out + "..." : out;
}

template <typename... Arguments>
Problem problem(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  return Problem(fmt::format(format, std::forward<Arguments>(arguments)...));
}

Result<std::int64_t> parse_time(std::string_view word) {
  const auto bad = [&] {
    return problem("the time is '{}', not '(seconds.decimals)' with up to 9 decimals", shown(word));
  };
  if (word.size() < 3 || word.front() != '(' || word.back() != ')') return bad();
  const auto digits = word.substr(1, word.size() - 2);
  const auto dot = digits.find('.');
  const auto seconds = to_integer<std::uint64_t>(digits.substr(0, dot));
  if (!seconds) return bad();
  std::uint64_t ns = 0;
  if (dot != digits.npos) {
    const auto decimals = digits.substr(dot + 1);
    const auto value = to_integer<std::uint64_t>(decimals);
    if (!value || decimals.size() > 9) return bad();
    ns = *value;
    for (auto i = decimals.size(); i < 9; ++i) ns *= 10;
  }
  constexpr std::uint64_t last_second = std::numeric_limits<std::int64_t>::max() / 1'000'000'000 - 1;
  if (*seconds > last_second) return problem("the time {} s is after the year 2262", *seconds);
  return static_cast<std::int64_t>(*seconds * 1'000'000'000 + ns);
}

Result<void> parse_identifier(std::string_view digits, Frame& frame) {
  const auto id = to_integer<std::uint32_t>(digits, 16);
  if (!id || (digits.size() != 3 && digits.size() != 8))
    return problem("the identifier is '{}', not 3 or 8 hexadecimal digits", shown(digits));
  if (digits.size() == 3 && *id > 0x7FF)
    return problem("the identifier {} is above 7FF, the largest of 11 bits", digits);
  if (*id >= 2 * error_flag) return problem("the identifier {} has more than 29 bits", digits);
  frame.error = (*id & error_flag) != 0;
  frame.extended = digits.size() == 8 && !frame.error;
  frame.id = *id & ~error_flag;
  return {};
}

Result<void> parse_data(std::string_view digits, Frame& frame) {
  const std::size_t size = digits.size() / 2;
  if (digits.size() % 2 != 0) return problem("the data '{}' has an odd number of digits", shown(digits));
  if (size > frame.data.size() || !valid_size(frame.fd, static_cast<std::uint8_t>(size)))
    return problem("{} data bytes; {}", size,
                   frame.fd ? "an FD frame has 0..8, 12, 16, 20, 24, 32, 48 or 64" : "a classic frame has 0..8");
  for (std::size_t i = 0; i < size; ++i) {
    const auto byte = to_integer<std::uint8_t>(digits.substr(2 * i, 2), 16);
    if (!byte) return problem("the data '{}' is not hexadecimal", shown(digits));
    frame.data[i] = *byte;
  }
  frame.size = static_cast<std::uint8_t>(size);
  return {};
}

Result<void> parse_remote(std::string_view digits, Frame& frame) {
  const auto size = to_integer<std::uint8_t>(digits.empty() ? "0" : digits, 16);
  if (!size || digits.size() > 1 || *size > 8)
    return problem("a remote frame ends in R or R0..R8, not 'R{}'", shown(digits));
  if (frame.error) return problem("an error frame cannot be a remote frame");
  frame.remote = true;
  frame.size = *size;
  return {};
}

Result<void> parse_frame(std::string_view word, Frame& frame) {
  const auto mark = word.find('#');
  if (mark == word.npos) return problem("the frame '{}' has no '#' between identifier and data", shown(word));
  if (auto good = parse_identifier(word.substr(0, mark), frame); !good) return good;
  std::string_view rest = word.substr(mark + 1);
  if (rest.starts_with('R') || rest.starts_with('r')) return parse_remote(rest.substr(1), frame);
  if (rest.starts_with('#')) {
    // Bit 0 BRS, bit 1 ESI; bit 2 (FDF) repeats that it is an FD frame, in logs of newer programs.
    const auto flags = to_integer<std::uint8_t>(rest.substr(1, 1), 16);
    if (!flags || *flags > 7) return problem("the FD flags are '{}', not a digit 0..7", shown(rest.substr(1, 1)));
    if (frame.error) return problem("an error frame cannot be an FD frame");
    frame.fd = true;
    frame.bit_rate_switch = (*flags & 1) != 0;
    frame.error_passive = (*flags & 2) != 0;
    rest.remove_prefix(2);
  }
  return parse_data(rest, frame);
}

std::string why(int error) { return error ? fmt::format(" ({})", std::strerror(error)) : ""; }

}  // namespace

Result<Frame> parse_log_line(std::string_view line, std::string& bus) {
  const auto parts = words(line);
  if (parts.size() < 3 || parts.size() > 4) return problem("'{}' is not '(time) bus frame'", shown(line));
  const bool marked = parts.size() == 4;
  if (marked && parts[3] != "T" && parts[3] != "R")
    return problem("'{}' after the frame; only a direction T or R may follow", shown(parts[3]));
  const auto time_ns = parse_time(parts[0]);
  if (!time_ns) return tl::unexpected(time_ns.error());
  if (std::ranges::any_of(parts[1], [](unsigned char c) { return c < 0x20 || c == 0x7F; }))
    return problem("the bus name '{}' has control characters", shown(parts[1]));
  Frame frame;
  if (auto good = parse_frame(parts[2], frame); !good) return tl::unexpected(good.error());
  frame.time_ns = *time_ns;
  bus = parts[1];
  return frame;
}

Result<LogReader> LogReader::open(const std::filesystem::path& file, std::function<bool()> stop) {
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) return problem("{}: is a folder, not a candump log", file.string());
  LogReader reader;
  reader.fd_ =
      Descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));  // O_NONBLOCK: a pipe may have no writer yet
  if (reader.fd_.get() < 0) return problem("{}: cannot be read{}", file.string(), why(errno));
  reader.file_ = file;
  reader.stop_ = std::move(stop);
  return reader;
}

Result<bool> LogReader::fill() {
  buffer_.erase(0, std::exchange(begin_, 0));
  const std::size_t before = buffer_.size();
  while (!(stop_ && stop_())) {
    pollfd input{fd_.get(), POLLIN, 0};
    if (::poll(&input, 1, ask_stop_ms) <= 0) continue;
    buffer_.resize(before + read_size);
    const ssize_t n = ::read(fd_.get(), buffer_.data() + before, read_size);
    const int error = errno;
    buffer_.resize(before + static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
    if (n >= 0) return n > 0;
    if (error != EAGAIN && error != EINTR)
      return work_failed(fmt::format("{}: cannot be read after line {}{}", file_.string(), line_, why(error)));
  }
  return false;
}

Result<bool> LogReader::skip_line() {
  for (;;) {
    const auto end = buffer_.find('\n', begin_);
    skipping_ = end == buffer_.npos;
    begin_ = skipping_ ? buffer_.size() : end + 1;
    if (!skipping_) return true;
    if (auto more = fill(); !more || !*more) return more;
  }
}

Result<bool> LogReader::next_line(std::string_view& line) {
  if (skipping_)
    if (auto more = skip_line(); !more || !*more) return more;
  std::size_t searched = 0;  // from begin_
  for (;;) {
    auto end = buffer_.find('\n', begin_ + searched);
    const std::size_t length = std::min(end, buffer_.size()) - begin_;
    if (length >= limits::log_line_bytes) {
      ++line_;
      skipping_ = true;  // the next call continues after it
      return problem("{}:{}: longer than {} characters; a line of a candump log is '(time) bus frame'", file_.string(),
                     line_, limits::log_line_bytes - 1);
    }
    if (end == buffer_.npos) {
      searched = length;
      const auto more = fill();
      if (!more) return more;
      if (*more) continue;
      if (length == 0 || (stop_ && stop_())) return false;
      end = buffer_.size();
      cut_ = true;
    }
    line = std::string_view(buffer_).substr(begin_, length);
    begin_ = std::min(end + 1, buffer_.size());
    ++line_;
    return true;
  }
}

Result<bool> LogReader::next(Frame& frame) {
  for (;;) {
    std::string_view line;
    if (auto more = next_line(line); !more || !*more) return more;
    if (words(line).empty()) continue;
    const auto parsed = parse_log_line(line, bus_);
    if (!parsed)
      return problem("{}:{}: {}{}", file_.string(), line_, parsed.error().message,
                     cut_ ? "; this last line has no end, the log was cut: remove the line to use the rest" : "");
    frame = *parsed;
    return true;
  }
}

Result<LogWriter> LogWriter::create(const std::filesystem::path& file, std::string bus, RecordOptions options) {
  if (words(bus) != std::vector<std::string_view>{bus})
    return problem("{}: a log needs the name of a bus, one word; '{}' is none", file.string(), shown(bus));
  auto out = RecordFile::create(file, std::move(options));
  if (!out) return tl::unexpected(out.error());
  return LogWriter(file, std::move(bus), std::move(*out));
}

Result<void> LogWriter::write(const Frame& frame, std::string_view bus) {
  if (frame.time_ns < 0 || !valid_size(frame.fd, frame.size))
    return problem("{}: a frame of {} bytes at {} ns has no line in a candump log", file_.string(), frame.size,
                   frame.time_ns);
  return out_.append(fmt::format("({:010}.{:06}) {} {}\n", frame.time_ns / 1'000'000'000,
                                 frame.time_ns % 1'000'000'000 / 1000, bus, text(frame)));
}

}  // namespace tribotwin::hil
