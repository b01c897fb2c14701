#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/hil/can/words.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view first_line = "tribotwin-hil session 2", old_first_line = "tribotwin-hil session 1",
                           begin_turns = "turns", last_line = "end";
constexpr std::int64_t most_steps = 1'000'000;   ///< of one turn; a session makes a few hundred at most
constexpr std::int64_t most_cycles = 1'000'000;  ///< of one command `step`
constexpr std::string_view off = "off", on = "on", end_of_turn = "end", back = "recovered", foreign = "misleading",
                           moved = "steps", lost = "not_kept", no_numbers = "unconfigured", absent = "absent",
                           of_bus = "bus", happened = "event", stand = "pause", go_on = "resume";

/// The faults of a drive, as the list of faults calls them.
struct Named {
  FaultKind kind;
  std::string_view word;
};
constexpr Named drive_faults[] = {{FaultKind::encoder_freeze, "encoder_freeze"},
                                  {FaultKind::over_temperature, "over_temperature"},
                                  {FaultKind::safe_torque_off, "safe_torque_off"}};

constexpr std::pair<StartFile::Kind, std::string_view> start_files[] = {
    {StartFile::Kind::eds, "eds"}, {StartFile::Kind::dcf, "dcf"}, {StartFile::Kind::store, "store"}};

/// KEY=VALUE; both empty where the word is none.
std::pair<std::string_view, std::string_view> split(std::string_view word, char at) {
  const auto mark = word.find(at);
  if (mark == word.npos) return {};
  return {word.substr(0, mark), word.substr(mark + 1)};
}

/// Any text as one word.
std::string as_word(std::string_view text) {
  std::string word;
  for (const char c : text) {
    const bool plain = static_cast<unsigned char>(c) > ' ' && c != '%' && c != 0x7f;
    word += plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return word;
}

std::optional<std::string> from_word(std::string_view word) {
  std::string text;
  for (std::size_t i = 0; i < word.size(); ++i) {
    if (word[i] != '%') {
      text += word[i];
      continue;
    }
    const auto code = to_integer<unsigned char>(word.substr(i + 1, 2), 16);
    if (!code || i + 2 >= word.size()) return std::nullopt;
    text += static_cast<char>(*code);
    i += 2;
  }
  return text;
}

/// AFTER:DRIVE:STATE of a fault.
std::optional<Turn::Imposed> parse_fault(FaultKind kind, std::string_view value) {
  const auto [after, rest] = split(value, ':');
  const auto [drive, state] = split(rest, ':');
  const auto frames = after == end_of_turn ? Turn::at_end : to_integer<std::size_t>(after);
  const auto number = to_integer<std::size_t>(drive);
  if (!frames || !number || *number == 0) return std::nullopt;
  Turn::Imposed imposed{*frames, {.kind = kind, .drive = *number - 1, .on = state != off}};
  if (state == off) return imposed;
  if (kind != FaultKind::over_temperature) return state == on ? std::optional(imposed) : std::nullopt;
  const auto value_degC = to_number(state);
  if (!value_degC || !std::isfinite(*value_degC)) return std::nullopt;
  imposed.fault.temperature_degC = *value_degC;
  return imposed;
}

bool parse_word(std::string_view word, Turn& turn) {
  if (word == back) return turn.recovered.push_back(0), true;
  if (word == go_on) return turn.hold = Turn::goes_on, true;
  const auto [key, value] = split(word, '=');
  if (key == stand) {
    turn.hold = to_integer<std::int64_t>(value);
    return turn.hold && *turn.hold >= 0 && *turn.hold <= most_cycles;
  }
  if (key == back) {
    const auto bus = to_integer<std::size_t>(value);
    if (bus) turn.recovered.push_back(*bus);
    return bus.has_value();
  }
  if (key == moved) {
    const auto steps = to_integer<std::int64_t>(value);
    turn.steps = steps.value_or(0);
    return turn.steps > 0 && turn.steps <= most_steps;
  }
  if (key == foreign || key == lost) {
    const auto number = to_integer<std::size_t>(value);
    if (number) (key == foreign ? turn.misleading : turn.not_kept).push_back(*number);
    return number.has_value();
  }
  if (key == happened) {
    auto text = from_word(value);
    if (text) turn.events.push_back(std::move(*text));
    return text.has_value();
  }
  const auto named = std::ranges::find(drive_faults, key, &Named::word);
  if (named == std::end(drive_faults)) return false;
  const auto fault = parse_fault(named->kind, value);
  if (fault) turn.faults.push_back(*fault);
  return fault.has_value();
}

std::string word_of(const Turn::Imposed& imposed) {
  const DriveFault& fault = imposed.fault;
  const bool hot = fault.kind == FaultKind::over_temperature;
  return fmt::format(" {}={}:{}:{}", std::ranges::find(drive_faults, fault.kind, &Named::kind)->word,
                     imposed.after == Turn::at_end ? std::string(end_of_turn) : std::to_string(imposed.after),
                     fault.drive + 1,
                     !fault.on ? std::string(off)
                     : hot     ? fmt::format("{}", fault.temperature_degC)
                               : std::string(on));
}

/// The drives of one bus, counted from 1.
std::string bus_line(const std::vector<std::size_t>& drives) {
  std::string line(of_bus);
  for (const std::size_t drive : drives) line += fmt::format(" {}", drive + 1);
  return line + "\n";
}

std::string text_of(const SessionHead& head) {
  std::string text =
      fmt::format("{}\nclock {}\ncycle_us {}\nstart_us {}\nscenario {:08X}\n", first_line,
                  head.realtime ? "realtime" : "lockstep", head.cycle_us, head.start_ns / 1000, head.scenario);
  if (head.conditions.unconfigured) text += fmt::format("{}\n", no_numbers);
  for (const auto& drives : head.wiring) text += bus_line(drives);
  for (const StartFile& file : head.conditions.files) {
    const std::string name = twin::printable(file.name.string());
    text += fmt::format("{} {} {}\n", word_of(file.kind),
                        file.content ? std::to_string(file.content->size()) : std::string(absent), name);
    if (file.content) text += *file.content + "\n";
  }
  return text + fmt::format("{}\n", begin_turns);
}

}  // namespace

std::string_view word_of(StartFile::Kind kind) {
  return std::ranges::find(start_files, kind, &std::pair<StartFile::Kind, std::string_view>::first)->second;
}

std::uint32_t scenario_checksum(const twin::Scenario& scenario) { return twin::crc32(scenario.resolved_yaml); }

fs::path session_file_of(const fs::path& log) {
  std::error_code none;
  if (log.empty() || (fs::exists(log, none) && !fs::is_regular_file(log, none))) return {};
  return log.string() + ".session";
}

Result<SessionWriter> SessionWriter::create(const fs::path& file, const SessionHead& head, RecordOptions options) {
  auto out = RecordFile::create(file, std::move(options));
  if (!out) return tl::unexpected(out.error());
  SessionWriter writer(std::move(*out), head.start_ns);
  const auto wrote = writer.out_.append(text_of(head));
  if (!wrote) return tl::unexpected(wrote.error());
  return writer;
}

Result<void> SessionWriter::write(const Turn& turn) {
  std::string line = std::to_string((turn.time_ns - std::exchange(last_ns_, turn.time_ns)) / 1000);
  for (const std::string& event : turn.events) line += fmt::format(" {}={}", happened, as_word(event));
  if (turn.hold)
    line += *turn.hold == Turn::goes_on ? fmt::format(" {}", go_on) : fmt::format(" {}={}", stand, *turn.hold);
  if (turn.steps > 0) line += fmt::format(" {}={}", moved, turn.steps);
  for (const std::size_t frame : turn.misleading) line += fmt::format(" {}={}", foreign, frame);
  for (const Turn::Imposed& imposed : turn.faults) line += word_of(imposed);
  for (const std::size_t number : turn.not_kept) line += fmt::format(" {}={}", lost, number);
  for (const std::size_t bus : turn.recovered)
    line += bus == 0 ? fmt::format(" {}", back) : fmt::format(" {}={}", back, bus);
  return out_.append(line + "\n");
}

Result<void> SessionWriter::finish() {
  if (auto ok = out_.append(fmt::format("{}\n", last_line)); !ok) return ok;
  return out_.finish();
}

Result<SessionReader> SessionReader::open(const fs::path& file) {
  SessionReader reader;
  reader.file_ = file;
  auto stream = twin::open_text(file, "a session file");
  if (!stream) return tl::unexpected(stream.error());
  reader.in_ = std::move(*stream);
  if (auto ok = reader.read_head(); !ok) {
    if (reader.in_.bad()) return not_read(file.string());
    return tl::unexpected(ok.error());
  }
  return reader;
}

Result<void> SessionReader::read_head() {
  std::string line;
  if (!read_line(in_, line, limits::session_line_bytes))
    return tl::unexpected(fmt::format("{}: is empty", file_.string()));
  const auto wrong = [&](std::string_view expected) {
    return tl::unexpected(fmt::format("{}:{}: is not '{}'; no session file, or of another version of tribotwin-hil",
                                      file_.string(), line_, expected));
  };
  ++line_;
  const bool old = line == old_first_line;
  if (!old && line != first_line) return wrong(first_line);
  const auto value_of = [&](std::string_view key) -> std::string {
    ++line_;
    read_line(in_, line, limits::session_line_bytes);
    const auto [found, value] = split(line, ' ');
    return std::string(found == key ? value : "");
  };
  const std::string clock = value_of("clock");
  if (clock != "realtime" && clock != "lockstep") return wrong("clock realtime|lockstep");
  const auto cycle_us = to_integer<std::uint32_t>(value_of("cycle_us"));
  if (!cycle_us || *cycle_us == 0) return wrong("cycle_us NUMBER");
  constexpr std::int64_t longest_us = std::numeric_limits<std::int64_t>::max() / 1000;
  const auto start_us = to_integer<std::int64_t>(value_of("start_us"));
  if (!start_us || *start_us < 0 || *start_us > longest_us) return wrong("start_us NUMBER");
  head_ = {clock == "realtime", *cycle_us, *start_us * 1000};
  last_ns_ = head_.start_ns;
  head_.complete = !old;
  if (old) return {};
  const std::string checksum = value_of("scenario");
  const auto scenario = to_integer<std::uint32_t>(checksum, 16);
  if (!scenario || checksum.size() != 8) return wrong("scenario CHECKSUM");
  head_.scenario = *scenario;
  return read_conditions();
}

Result<void> SessionReader::read_conditions() {
  std::string line;
  while (++line_, read_line(in_, line, limits::session_line_bytes)) {
    if (line == begin_turns) return {};
    const auto [key, value] = split(line, ' ');
    const auto kind = std::ranges::find(start_files, key, &std::pair<StartFile::Kind, std::string_view>::second);
    if (line == no_numbers) {
      head_.conditions.unconfigured = true;
    } else if (key == of_bus && read_bus(line)) {
      continue;
    } else if (kind != std::end(start_files)) {
      auto file = read_start_file(kind->first, value);
      if (!file) return tl::unexpected(file.error());
      head_.conditions.files.push_back(std::move(*file));
    } else {
      break;
    }
  }
  return tl::unexpected(fmt::format("{}:{}: is not '{}', '{}' or 'eds|dcf|store BYTES NAME' or 'bus DRIVE...'",
                                    file_.string(), line_, no_numbers, begin_turns));
}

Result<StartFile> SessionReader::read_start_file(StartFile::Kind kind, std::string_view size_and_name) {
  const auto [size, name] = split(size_and_name, ' ');
  StartFile file{.kind = kind, .name = std::string(name), .content = std::nullopt};
  if (size == absent && kind == StartFile::Kind::store) return file;
  const auto bytes = to_integer<std::size_t>(size);
  if (!bytes || *bytes > limits::text_bytes)
    return tl::unexpected(fmt::format("{}:{}: is not '{} BYTES NAME' with at most {} bytes", file_.string(), line_,
                                      word_of(kind), limits::text_bytes));
  file.content = std::string(*bytes, '\0');
  if (!in_.read(file.content->data(), static_cast<std::streamsize>(*bytes)) || in_.get() != '\n')
    return tl::unexpected(
        fmt::format("{}:{}: {} bytes of a file and the end of a line must follow", file_.string(), line_, *bytes));
  line_ += static_cast<std::size_t>(std::ranges::count(*file.content, '\n')) + 1;
  return file;
}

bool SessionReader::read_bus(const std::string& line) {
  const auto parts = words(line);
  auto& drives = head_.wiring.emplace_back();
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const auto number = to_integer<std::size_t>(parts[i]);
    if (!number || *number == 0) return false;
    drives.push_back(*number - 1);
  }
  return parts[0] == of_bus;
}

Result<Wiring> recorded_wiring(const fs::path& log) {
  const fs::path file = session_file_of(log);
  if (file.empty() || !fs::exists(file)) return Wiring{};
  auto session = SessionReader::open(file);
  if (!session) return tl::unexpected(session.error());
  return session->head().wiring;
}

Result<bool> SessionReader::next(Turn& turn) {
  std::string line;
  if (complete_) return false;
  if (!read_line(in_, line, limits::session_line_bytes)) {
    if (in_.bad()) return not_read(file_.string());
    return false;
  }
  ++line_;
  if (line == last_line) return complete_ = true, false;
  if (in_.eof()) return false;  // the last line of a session that was killed
  const auto parts = words(line);
  const auto us = parts.empty() ? std::nullopt : to_integer<std::int64_t>(parts[0]);
  turn = {};
  bool good = us && *us >= 0 && *us <= (std::numeric_limits<std::int64_t>::max() - last_ns_) / 1000;
  good = good && line.size() <= limits::session_line_bytes;
  for (std::size_t i = 1; good && i < parts.size(); ++i) good = parse_word(parts[i], turn);
  if (!good)
    return tl::unexpected(
        fmt::format("{}:{}: '{}' is not 'MICROSECONDS WORD...'", file_.string(), line_, line.substr(0, 40)));
  turn.time_ns = last_ns_ += *us * 1000;
  return true;
}

}  // namespace tribotwin::hil
