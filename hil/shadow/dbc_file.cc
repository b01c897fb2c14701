#include <algorithm>
#include <cmath>
#include <optional>
#include <regex>
#include <string>
#include <unordered_map>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/shadow/dbc_file.hpp>
#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint32_t extended_id = 0x80000000;             // bit 31 of a message's number
constexpr int longest_frame = 64, longest_message = 1 << 20;  // bytes; of a message of many frames: a plain limit

/// A DBC may write a '+' before a number.
std::string_view unsigned_part(std::string_view text) { return text.substr(text.starts_with('+') ? 1 : 0); }
template <class Integer>
std::optional<Integer> number(const std::string& text) {
  return to_integer<Integer>(unsigned_part(text));
}
std::optional<double> real(std::string_view text) { return to_number(unsigned_part(twin::trimmed(text))); }

/// Lines of one file, in order. Every function fails with what is wrong in the line.
class Reader {
 public:
  Result<void> take(const std::string& text, std::size_t line) {
    static const std::regex keyword(R"(\s*(BO_|SG_|SIG_VALTYPE_|SG_MUL_VAL_)\s)");
    std::smatch found;
    if (!begins(text, found, keyword)) return {};
    if (found[1] == "BO_") return message(text, line);
    if (found[1] == "SG_") return signal(text, line);
    return found[1] == "SG_MUL_VAL_" ? multiplexed(text, line) : value_type(text);
  }
  std::vector<DbcMessage> messages;

 private:
  Result<void> message(const std::string& text, std::size_t line) {
    static const std::regex form(R"(\s*BO_\s+(\S{1,40})\s+([A-Za-z_]\w*)\s*:\s*(\S{1,40}))");
    std::smatch found;
    if (!begins(text, found, form)) return tl::unexpected(std::string("is no message: BO_ ID NAME: BYTES SENDER"));
    const auto id = number<std::uint32_t>(found[1]);
    const auto size = number<int>(found[3]);
    DbcMessage m{.name = found[2], .line = line};
    // A pseudo message holds signals of no frame.
    const bool independent = m.name == "VECTOR__INDEPENDENT_SIG_MSG";
    if (!id)
      return tl::unexpected(fmt::format("the identifier '{}' is no number from 0 to 4294967295", found[1].str()));
    m.extended = (*id & extended_id) != 0;
    m.id = *id & ~extended_id;
    if (!independent && m.id > (m.extended ? cob::id_29_bit : cob::id_11_bit))
      return tl::unexpected(fmt::format("the identifier {} has more than {} bits{}", *id, m.extended ? 29 : 11,
                                        m.extended ? "" : "; bit 31 marks one of 29 bits"));
    if (!size || *size < 0 || *size > longest_message)
      return tl::unexpected(
          fmt::format("the length '{}' is no number of bytes from 0 to {}", found[3].str(), longest_message));
    m.size = independent ? longest_frame : *size;
    if (m.size > longest_frame)
      leave_out(m, line, fmt::format("{} bytes are more than a frame of at most {}", m.size, longest_frame));
    const auto named = by_name_.try_emplace(m.name, messages.size()).first;
    const auto numbered = by_id_.try_emplace(key(m.id, m.extended), messages.size()).first;
    if (const std::size_t first = std::min(named->second, numbered->second); first < messages.size())
      return tl::unexpected(fmt::format("message {} has the name or the identifier of {} in line {}", m.name,
                                        messages[first].name, messages[first].line));
    messages.push_back(std::move(m));
    signals_.emplace_back();
    return {};
  }

  Result<void> signal(const std::string& text, std::size_t line) {
    static const std::regex form(
        R"(\s*SG_\s+([A-Za-z_]\w*)\s*(M|m\d+M?)?\s*:\s*(\d+)\|(\d+)@([01])([+-])\s*\(([^,()]+),([^,()]+)\)\s*)"
        R"re(\[[^\]]*\]\s*"([^"]*)")re");
    std::smatch found;
    if (messages.empty()) return tl::unexpected(std::string("a signal before the first message"));
    if (!begins(text, found, form))
      return tl::unexpected(
          std::string("is no signal: SG_ NAME : START|BITS@ORDER SIGN (FACTOR,OFFSET) [MIN|MAX] \"UNIT\" RECEIVER"));
    DbcMessage& m = messages.back();
    if (found[2].matched && found[2].length() > 1 && found[2].str().ends_with('M'))
      leave_out(m, line, fmt::format("signal {} has extended multiplexing ({})", found[1].str(), found[2].str()));
    DbcSignal s{.name = found[1], .unit = found[9], .line = line};
    const auto start = number<int>(found[3]), bits = number<int>(found[4]);
    const auto factor = real(found[7].str()), offset = real(found[8].str());
    if (!factor || !std::isfinite(*factor) || *factor == 0)
      return tl::unexpected(
          fmt::format("signal {}: the factor '{}' is no number other than 0", s.name, found[7].str()));
    if (!offset || !std::isfinite(*offset))
      return tl::unexpected(fmt::format("signal {}: the offset '{}' is no number", s.name, found[8].str()));
    if (bits && *bits > 64 && *bits <= 8 * longest_message)
      return leave_out(m, line, fmt::format("signal {} has {} bits; one of 1 to 64 can be read", s.name, *bits)),
             Result<void>{};
    if (!bits || *bits < 1 || *bits > 64)
      return tl::unexpected(fmt::format("signal {} has {} bits; a signal has 1 to 64", s.name, found[4].str()));
    if (!start || *start >= 8 * (m.unreadable ? longest_message : longest_frame))
      return tl::unexpected(fmt::format("signal {} begins at bit {}; a frame has at most 512", s.name, found[3].str()));
    s.signal = {.start = *start,
                .bits = *bits,
                .big_endian = found[5] == "0",
                .kind = found[6] == "-" ? Signal::Kind::is_signed : Signal::Kind::is_unsigned,
                .factor = *factor,
                .offset = *offset};
    if (s.signal.bytes() > m.size)
      return tl::unexpected(fmt::format("signal {} ends in byte {}, but message {} has {} bytes", s.name,
                                        s.signal.bytes(), m.name, m.size));
    s.selects = found[2] == "M";
    if (found[2].matched && !s.selects && !m.unreadable) s.selection = number<std::uint64_t>(found[2].str().substr(1));
    Signals& known = signals_.back();
    if (const auto [other, fresh] = known.by_name.try_emplace(s.name, m.signals.size()); !fresh)
      return tl::unexpected(
          fmt::format("signal {} is in message {} already, in line {}", s.name, m.name, m.signals[other->second].line));
    if (s.selects && !known.multiplexor) known.multiplexor = m.signals.size();
    m.signals.push_back(std::move(s));
    return {};
  }

  /// Values of the multiplexor for a signal: SG_MUL_VAL_ ID SIGNAL MULTIPLEXOR 0-0, 2-3; Those that say what the SG_
  /// line says already are simple.
  Result<void> multiplexed(const std::string& text, std::size_t line) {
    static const std::regex form(R"(\s*SG_MUL_VAL_\s+(\d+)\s+(\w+)\s+(\w+)\s+(\d+)-(\d+)\s*(,|;))");
    std::smatch found;
    if (!begins(text, found, form))
      return tl::unexpected(std::string("is no range: SG_MUL_VAL_ ID SIGNAL MULTIPLEXOR 0-0, 2-3;"));
    const auto at = message_of(found[1]);
    if (!at) return tl::unexpected(fmt::format("there is no message {}", found[1].str()));
    const auto& multiplexor = signals_[*at].multiplexor;
    const DbcSignal* s = signal_of(*at, found[2]);
    const bool simple = s && multiplexor && messages[*at].signals[*multiplexor].name == found[3] && found[6] == ";" &&
                        found[4] == found[5] && s->selection == number<std::uint64_t>(found[4]);
    if (!simple)
      leave_out(messages[*at], line, fmt::format("signal {} has extended multiplexing (SG_MUL_VAL_)", found[2].str()));
    return {};
  }

  static void leave_out(DbcMessage& m, std::size_t line, const std::string& why) {
    if (!m.unreadable) m.unreadable = {line, why};
  }

  /// A signal whose bits are a floating-point number: SIG_VALTYPE_ ID NAME : 1 (or 2);
  Result<void> value_type(const std::string& text) {
    static const std::regex form(R"(\s*SIG_VALTYPE_\s+(\d+)\s+(\w+)\s*:?\s*([0-3])\s*;)");
    std::smatch found;
    if (!begins(text, found, form)) return tl::unexpected(std::string("is no type: SIG_VALTYPE_ ID SIGNAL : 0..3;"));
    const auto at = message_of(found[1]);
    DbcSignal* s = at ? signal_of(*at, found[2]) : nullptr;
    if (!s) return tl::unexpected(fmt::format("there is no signal {} in a message {}", found[2].str(), found[1].str()));
    if (found[3] == "0") return {};
    if (s->signal.bits != (found[3] == "1" ? 32 : 64))
      return tl::unexpected(fmt::format("signal {} has {} bits; as a floating-point number it has {}", s->name,
                                        s->signal.bits, found[3] == "1" ? 32 : 64));
    s->signal.kind = Signal::Kind::is_float;
    return {};
  }

  static std::uint64_t key(std::uint32_t id, bool extended) { return id | (std::uint64_t{extended} << 32); }
  /// Its place by the ID of a line, bit 31 of which marks one of 29 bits.
  std::optional<std::size_t> message_of(const std::string& text) const {
    const auto id = number<std::uint32_t>(text);
    if (!id) return std::nullopt;
    const auto found = by_id_.find(key(*id & ~extended_id, (*id & extended_id) != 0));
    return found == by_id_.end() ? std::nullopt : std::optional(found->second);
  }
  DbcSignal* signal_of(std::size_t message, const std::string& name) {
    const auto& names = signals_[message].by_name;
    const auto found = names.find(name);
    return found == names.end() ? nullptr : &messages[message].signals[found->second];
  }

  /// Without regex_match and a ".*" at the end, whose recursion grows with the line.
  static bool begins(const std::string& text, std::smatch& found, const std::regex& form) {
    return std::regex_search(text, found, form, std::regex_constants::match_continuous);
  }

  /// Of one message: places by name, and that of the first multiplexor.
  struct Signals {
    std::unordered_map<std::string, std::size_t> by_name;
    std::optional<std::size_t> multiplexor;
  };
  std::unordered_map<std::string, std::size_t> by_name_;
  std::unordered_map<std::uint64_t, std::size_t> by_id_;
  std::vector<Signals> signals_;  // in the order of `messages`
};

}  // namespace

const DbcSignal* DbcMessage::multiplexor() const {
  const auto found = std::ranges::find_if(signals, &DbcSignal::selects);
  return found == signals.end() ? nullptr : &*found;
}

Result<DbcFile> read_dbc(const std::filesystem::path& file) {
  auto stream = twin::open_text(file, "a DBC file");
  if (!stream) return tl::unexpected(stream.error());
  Reader reader;
  std::string text;
  for (std::size_t line = 1; read_line(*stream, text, limits::dbc_file_line_bytes + 1); ++line) {
    if (text.ends_with('\r')) text.pop_back();
    if (text.size() > limits::dbc_file_line_bytes)
      return tl::unexpected(fmt::format("{}:{}: is longer than {} bytes, the most that a line of a DBC file has",
                                        file.string(), line, limits::dbc_file_line_bytes));
    text.resize(std::min(text.size(), limits::dbc_line_bytes));  // regular expressions recurse
    if (auto ok = reader.take(text, line); !ok)
      return tl::unexpected(fmt::format("{}:{}: {}", file.string(), line, ok.error().message));
  }
  if (stream->bad()) return not_read(file.string());
  if (reader.messages.empty())
    return tl::unexpected(fmt::format("{}: no message (BO_): is it a DBC file?", file.string()));
  return DbcFile{file, std::move(reader.messages)};
}

}  // namespace tribotwin::hil
