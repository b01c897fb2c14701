#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

/// File systems allow 255; the rest is for endings such as ".telemetry.h5.partial".
constexpr std::size_t max_bytes = 200;

bool is_control(char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }

/// The name on one line, shortened.
std::string shown(std::string_view name) {
  std::string out;
  for (const char c : name.substr(0, 60))
    out += is_control(c) ? fmt::format("\\x{:02x}", static_cast<unsigned char>(c)) : std::string(1, c);
  return name.size() > 60 ? out + "..." : out;
}

}  // namespace

Result<std::ifstream> open_text(const std::filesystem::path& file, std::string_view kind) {
  if (auto ok = check_input_file(file, kind, limits::any_length, Pipes::accept); !ok) return tl::unexpected(ok.error());
  if (is_named_pipe(file)) return open_from_writer(file);
  std::ifstream stream(file, std::ios::binary);
  const int why = errno;
  if (!stream)
    return tl::make_unexpected(
        Error(fmt::format("{}: cannot be read ({})", file.string(), std::strerror(why)),
              why == EMFILE || why == ENFILE || why == ENOMEM || why == EIO ? ErrorKind::work : ErrorKind::input));
  return stream;
}

Result<std::string> read_text(const std::filesystem::path& file, std::string_view kind) {
  if (auto ok = check_input_file(file, kind, limits::text_bytes, Pipes::accept); !ok) return tl::unexpected(ok.error());
  auto stream = open_text(file, kind);
  if (!stream) return tl::unexpected(stream.error());
  auto bytes = read_at_most(*stream, file.string(), limits::text_bytes);
  if (!bytes) return bytes;
  auto text = to_utf8(std::move(*bytes));
  if (!text) return tl::unexpected(fmt::format("{}:{}", file.string(), text.error().message));
  return text;
}

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r"), last = text.find_last_not_of(" \t\r");
  return first == text.npos ? std::string_view{} : text.substr(first, last - first + 1);
}

std::string printable(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7E) c = '?';
  return out;
}

std::string joined(std::span<const std::string> texts, std::string_view separator) {
  return fmt::format("{}", fmt::join(texts, separator));
}

std::string joined(std::span<const std::string_view> texts, std::string_view separator) {
  return fmt::format("{}", fmt::join(texts, separator));
}

std::string joined(std::span<const double> numbers, std::string_view separator) {
  return fmt::format("{}", fmt::join(numbers, separator));
}

std::optional<std::int64_t> to_time(std::string_view text) {
  const auto digits = [&](std::size_t at, std::size_t count) -> std::optional<unsigned> {
    return at + count <= text.size() ? to_integer<unsigned>(text.substr(at, count)) : std::nullopt;
  };
  const auto is = [&](std::size_t at, std::string_view any) {
    return at < text.size() && any.find(text[at]) != any.npos;
  };
  const auto year = digits(0, 4), month = digits(5, 2), day = digits(8, 2);
  if (!year || !month || !day || !is(4, "-") || !is(7, "-")) return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year(static_cast<int>(*year)), std::chrono::month(*month),
                                         std::chrono::day(*day)};
  if (!date.ok()) return std::nullopt;
  std::int64_t seconds = std::chrono::sys_days(date).time_since_epoch().count() * std::int64_t{86400};
  if (text.size() == 10) return seconds;
  if (text.back() == 'Z') text.remove_suffix(1);
  const auto hour = digits(11, 2), minute = digits(14, 2);
  // In the names of files a colon is often a dash.
  if (!hour || !minute || *hour > 23 || *minute > 59 || !is(10, "T _") || !is(13, ":-")) return std::nullopt;
  seconds += *hour * 3600 + *minute * 60;
  if (text.size() == 16) return seconds;
  const auto second = digits(17, 2);
  if (!second || *second > 59 || !is(16, ":-") || text.size() != 19) return std::nullopt;
  return seconds + *second;
}

std::string date_of(std::int64_t time_s) {
  const std::chrono::sys_seconds time{std::chrono::seconds(time_s)};
  const auto days = std::chrono::floor<std::chrono::days>(time);
  const std::chrono::year_month_day date(days);
  const auto rest = (time - days).count();
  std::string s = fmt::format("{:04}-{:02}-{:02}", static_cast<int>(date.year()), static_cast<unsigned>(date.month()),
                              static_cast<unsigned>(date.day()));
  if (rest) s += fmt::format("T{:02}:{:02}:{:02}", rest / 3600, rest / 60 % 60, rest % 60);
  return s;
}

std::optional<std::string> unfit_file_name(std::string_view name) {
  std::string wrong;
  if (name.empty())
    wrong = "is empty";
  else if (name == "." || name == "..")
    wrong = "is a folder of the file system";
  else if (name.find('/') != name.npos)
    wrong = "contains '/'";
  else if (std::ranges::any_of(name, is_control))
    wrong = "contains a control character";
  else if (name.size() > max_bytes)
    wrong = fmt::format("has {} bytes", name.size());
  else
    return std::nullopt;
  return fmt::format(
      "'{}' {} but must be a file name: 1 to {} bytes without '/' and control characters, not '.' or '..'", shown(name),
      wrong, max_bytes);
}

std::string did_you_mean(std::string_view given, std::span<const std::string> names) {
  std::string_view best;
  std::size_t fewest = 3;  // one more than the errors allowed
  for (const std::string& name : names) {
    const std::size_t dashes = std::min(name.find_first_not_of('-'), name.size());
    const std::size_t errors = typing_errors(given, name);
    if (errors < fewest && 2 * errors < name.size() - dashes) best = name, fewest = errors;
  }
  return best.empty() ? std::string() : fmt::format("; did you mean '{}'?", best);
}

}  // namespace tribotwin::twin
