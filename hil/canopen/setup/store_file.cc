#include <algorithm>
#include <set>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/setup/lss.hpp>
#include <tribotwin/hil/canopen/setup/store_file.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

using Drives = std::map<std::uint32_t, KeptParameters>;

constexpr std::string_view first_line = "tribotwin-hil store 1";

template <class Number>
bool parse(std::string_view text, Number& number, int base) {
  const auto value = to_integer<Number>(text, base);
  number = value.value_or(0);
  return value.has_value();
}

std::string shown(std::string_view line) { return twin::printable(line.substr(0, 40)); }

/// Reads the lines of a store; the first problem ends it.
class Parser {
 public:
  Parser(const std::filesystem::path& file, std::string_view text) : file_(file), text_(text) {}

  Result<Drives> run() {
    if (next() != first_line) return problem("expected '{}': this is no store of tribotwin-hil", first_line);
    while (at_ < text_.size()) {
      const std::size_t begin = at_;
      const std::string_view line = next();
      if (at_ > text_.size()) return problem("expected the end of the line: the file is cut");
      if (line.starts_with("checksum = ")) return end(line.substr(11), text_.substr(0, begin));
      if (auto ok = take(line); !ok) return tl::unexpected(ok.error());
    }
    ++line_;
    return problem("expected 'checksum = ...' at the end: the file is cut");
  }

 private:
  template <class... Arguments>
  tl::unexpected<Error> problem(fmt::format_string<Arguments...> format, Arguments&&... arguments) const {
    return tl::unexpected<Error>(
        fmt::format("{}:{}: {}", file_.string(), line_, fmt::format(format, std::forward<Arguments>(arguments)...)));
  }
  std::string_view next() {
    const std::size_t end = std::min(text_.find('\n', at_), text_.size());
    const auto line = text_.substr(at_, end - at_);
    at_ = end + 1;
    ++line_;
    return line;
  }

  Result<Drives> end(std::string_view checksum, std::string_view content) {
    std::uint32_t expected = 0;
    if (checksum.size() != 8 || !parse(checksum, expected, 16)) return problem("a checksum has 8 hexadecimal digits");
    if (at_ != text_.size()) return problem("nothing may follow the checksum");
    if (expected != twin::crc32(content))
      return problem("the checksum of the lines above is {:08X}: they were changed or damaged", twin::crc32(content));
    return std::move(drives_);
  }

  Result<void> take(std::string_view line) {
    if (line.starts_with('[')) return take_drive(line);
    if (!drive_) return problem("expected '[drive N]', not '{}'", shown(line));
    const std::size_t equals = line.find(" = ");
    if (equals == line.npos) return expected(line);
    const std::string_view name = line.substr(0, equals), value = line.substr(equals + 3);
    return name == "number" ? take_number(value) : take_value(line, name, value);
  }
  tl::unexpected<Error> expected(std::string_view line) const {
    return problem("expected 'number = N' or '1017h:00 = 64 00', not '{}'", shown(line));
  }

  Result<void> take_drive(std::string_view line) {
    constexpr std::string_view begin = "[drive ";
    std::uint32_t serial = 0;
    if (!line.starts_with(begin) || !line.ends_with(']') || line.size() < begin.size() + 1 ||
        !parse(line.substr(begin.size(), line.size() - begin.size() - 1), serial, 10))
      return problem("expected '[drive N]' with a serial number, not '{}'", shown(line));
    if (drives_.contains(serial)) return problem("drive {} is here twice", serial);
    drive_ = &drives_[serial];
    seen_.clear();
    return {};
  }
  Result<void> take_number(std::string_view value) {
    std::uint8_t number = 0;
    if (!parse(value, number, 10) || (!is_node_number(number) && number != unconfigured_node))
      return problem("a node number is 1 to 127, or 255 for none, not '{}'", shown(value));
    if (drive_->node_number) return problem("the drive has two numbers");
    drive_->node_number = number;
    return {};
  }
  Result<void> take_value(std::string_view line, std::string_view name, std::string_view bytes) {
    ObjectValue value{.line = line_};
    if (name.size() != 8 || name.substr(4, 2) != "h:" || !parse(name.substr(0, 4), value.index, 16) ||
        !parse(name.substr(6), value.sub, 16))
      return expected(line);
    for (std::size_t at = 0; at < bytes.size(); at += 3) {
      std::uint8_t byte = 0;
      const bool separated = at + 2 == bytes.size() || (at + 3 < bytes.size() && bytes[at + 2] == ' ');
      if (!separated || !parse(bytes.substr(at, 2), byte, 16))
        return problem("bytes are two hexadecimal digits each with a blank between them, not '{}'", shown(bytes));
      value.bytes.push_back(byte);
    }
    if (!seen_.emplace(value.index, value.sub).second)
      return problem("{} is here twice", object_name(value.index, value.sub));
    drive_->values.push_back(std::move(value));
    return {};
  }

  const std::filesystem::path& file_;
  std::string_view text_;
  std::size_t at_ = 0;
  int line_ = 0;
  Drives drives_;
  KeptParameters* drive_ = nullptr;
  std::set<std::pair<std::uint16_t, std::uint8_t>> seen_;  // objects of this drive
};

std::string text_of(const Drives& drives) {
  std::string text = fmt::format("{}\n", first_line);
  for (const auto& [serial, kept] : drives) {
    text += fmt::format("[drive {}]\n", serial);
    if (kept.node_number) text += fmt::format("number = {}\n", *kept.node_number);
    for (const ObjectValue& v : kept.values) {
      text += object_name(v.index, v.sub) + " = ";
      for (std::size_t i = 0; i < v.bytes.size(); ++i) text += fmt::format("{}{:02X}", i ? " " : "", v.bytes[i]);
      text += '\n';
    }
  }
  return text + fmt::format("checksum = {:08X}\n", twin::crc32(text));
}

}  // namespace

Result<StoreFile> StoreFile::read(const std::filesystem::path& file) {
  std::error_code none;
  if (!std::filesystem::exists(file, none)) return parse(std::nullopt, file);
  const auto text = twin::read_text(file, "a store of drives");
  if (!text) return tl::unexpected(text.error());
  return parse(*text, file);
}

Result<StoreFile> StoreFile::parse(std::optional<std::string_view> content, const std::filesystem::path& file) {
  StoreFile store;
  store.file_ = file;
  if (!content) return store;
  auto drives = Parser(file, *content).run();
  if (!drives) return tl::unexpected(drives.error());
  store.drives_ = std::move(*drives);
  return store;
}

KeptParameters StoreFile::of(std::uint32_t serial_number) const {
  const auto found = drives_.find(serial_number);
  return found == drives_.end() ? KeptParameters{} : found->second;
}

Result<void> StoreFile::keep(std::uint32_t serial_number, const KeptParameters& parameters) {
  Drives next = drives_;
  next[serial_number] = parameters;
  if (auto ok = twin::write_file(file_, text_of(next), twin::Existing::replace); !ok) return ok;
  drives_ = std::move(next);
  return {};
}

}  // namespace tribotwin::hil
