#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/shadow/dbc_file.hpp>
#include <tribotwin/hil/shadow/eds_file.hpp>
#include <tribotwin/hil/shadow/foreign_drives.hpp>
#include <tribotwin/plugins/friction/number.hpp>

namespace tribotwin::hil {
namespace {

enum class Quantity { position, torque, statusword, enabled };
constexpr std::pair<std::string_view, Quantity> quantities[] = {{"position", Quantity::position},
                                                                {"torque", Quantity::torque},
                                                                {"statusword", Quantity::statusword},
                                                                {"enabled", Quantity::enabled}};

struct Unit {
  std::string_view name;
  Quantity of;
  double size;  // [rad] or [Nm]
};
constexpr double degree = std::numbers::pi / 180;
constexpr Unit units[] = {{"rad", Quantity::position, 1},
                          {"mrad", Quantity::position, 1e-3},
                          {"urad", Quantity::position, 1e-6},
                          {"deg", Quantity::position, degree},
                          {"degree", Quantity::position, degree},
                          {"degrees", Quantity::position, degree},
                          {"\xC2\xB0", Quantity::position, degree},  // the degree sign in UTF-8
                          {"\xB0", Quantity::position, degree},      // and in Latin-1
                          {"rev", Quantity::position, 2 * std::numbers::pi},
                          {"Nm", Quantity::torque, 1},
                          {"N*m", Quantity::torque, 1},
                          {"N.m", Quantity::torque, 1},
                          {"N m", Quantity::torque, 1},
                          {"mNm", Quantity::torque, 1e-3},
                          {"cNm", Quantity::torque, 1e-2},
                          {"Ncm", Quantity::torque, 1e-2},
                          {"kNm", Quantity::torque, 1e3}};

/// One --signal, for one joint.
struct Wanted {
  std::string option, message, signal;
  Quantity quantity = Quantity::position;
  double factor = 1;
  bool scaled = false, always = false;
  std::vector<std::uint64_t> values;  // of `enabled`; empty: all but 0
};

std::string replaced(std::string text, const DriveParameters& p, int number) {
  for (const auto& [name, value] : {std::pair<std::string, std::string>{"{joint}", p.name},
                                    {"{node}", fmt::to_string(p.node)},
                                    {"{number}", fmt::to_string(number)}})
    for (auto at = text.find(name); at != std::string::npos; at = text.find(name, at + value.size()))
      text.replace(at, name.size(), value);
  return text;
}

/// "*0.001*gear", "/gear": their product.
Result<double> factor_of(const std::string& option, std::string_view text, const DriveParameters& p) {
  double factor = 1;
  while (!text.empty()) {
    const auto end = std::min(text.find_first_of("*/", 1), text.size());
    const auto word = text.substr(1, end - 1);
    const auto value = word == "gear" ? p.gear_ratio : to_number(word).value_or(0);
    if (!std::isfinite(value) || value == 0)
      return tl::unexpected(
          fmt::format("--signal {}: the factor '{}' is neither a number other than 0 nor 'gear'", option, word));
    factor = text[0] == '*' ? factor * value : factor / value;
    text.remove_prefix(end);
  }
  return factor;
}

/// The part of --signal behind the first '='.
Result<Wanted> parse_place(const std::string& option, Quantity quantity, std::string place, const DriveParameters& p) {
  Wanted w{.option = option, .quantity = quantity};
  const bool enabled = quantity == Quantity::enabled;
  if (enabled && place == "always") {
    w.always = true;
    return w;
  }
  if (const auto equal = place.find("=="); enabled && equal != std::string::npos) {
    std::string_view list = std::string_view(place).substr(equal + 2);
    while (!list.empty()) {
      const auto comma = std::min(list.find(','), list.size());
      const auto value = to_integer<std::uint64_t>(list.substr(0, comma));
      if (!value)
        return tl::unexpected(fmt::format("--signal {}: '{}' is no whole number", option, list.substr(0, comma)));
      w.values.push_back(*value);
      list.remove_prefix(std::min(comma + 1, list.size()));
    }
    place.resize(equal);
  }
  const auto scale = place.find_first_of("*/");
  if (scale != std::string::npos) {
    if (quantity != Quantity::position && quantity != Quantity::torque)
      return tl::unexpected(fmt::format("--signal {}: a state has no factor", option));
    auto factor = factor_of(option, std::string_view(place).substr(scale), p);
    if (!factor) return tl::unexpected(factor.error());
    w.factor = *factor;
    w.scaled = true;
    place.resize(scale);
  }
  const auto dot = place.find('.');
  if (dot == std::string::npos || dot == 0 || dot + 1 == place.size())
    return tl::unexpected(fmt::format("--signal {}: '{}' is not MESSAGE.SIGNAL", option, place));
  w.message = place.substr(0, dot);
  w.signal = place.substr(dot + 1);
  return w;
}

/// A --signal for this joint; none if it names another one.
Result<std::optional<Wanted>> parse(const std::string& option, std::span<const DriveParameters> drives, std::size_t i) {
  const auto equals = option.find('=');
  std::string what = option.substr(0, equals);
  if (equals == std::string::npos) return tl::unexpected(fmt::format("--signal {}: must be {}", option, signal_syntax));
  if (const auto dot = what.rfind('.'); dot != std::string::npos) {
    const std::string joint = what.substr(0, dot);
    if (std::ranges::find(drives, joint, &DriveParameters::name) == drives.end())
      return tl::unexpected(fmt::format("--signal {}: there is no joint '{}'", option, joint));
    if (joint != drives[i].name) return std::nullopt;
    what = what.substr(dot + 1);
  }
  const auto quantity = std::ranges::find(quantities, what, [](const auto& row) { return row.first; });
  if (quantity == std::end(quantities))
    return tl::unexpected(
        fmt::format("--signal {}: '{}' is none of position, torque, statusword, enabled", option, what));
  auto wanted = parse_place(option, quantity->second,
                            replaced(option.substr(equals + 1), drives[i], static_cast<int>(i) + 1), drives[i]);
  if (!wanted) return tl::unexpected(wanted.error());
  return *wanted;
}

/// A signal of a DBC file and the frame that it is in.
struct Place {
  std::uint32_t id = 0;
  bool extended = false;
  Signal signal;
  std::optional<Signal> multiplexor;
  std::uint64_t selection = 0;

  std::optional<std::uint64_t> raw(const Frame& frame) const { return here(frame) ? signal.raw(frame) : std::nullopt; }
  std::optional<double> value(const Frame& frame) const { return here(frame) ? signal.value(frame) : std::nullopt; }

 private:
  bool here(const Frame& frame) const {
    if (frame.id != id || frame.extended != extended || frame.remote || frame.error) return false;
    return !multiplexor || multiplexor->raw(frame) == selection;
  }
};

/// The unit's size in rad or Nm times the factor of the option.
Result<double> scale_of(const Wanted& w, const DbcSignal& s, const std::filesystem::path& file) {
  const auto unit = std::ranges::find_if(units, [&](const Unit& u) { return u.name == s.unit; });
  if (unit != std::end(units) && unit->of == w.quantity) return w.factor * unit->size;
  const char* base = w.quantity == Quantity::position ? "rad" : "Nm";
  if (unit != std::end(units))
    return tl::unexpected(fmt::format("{}:{}: signal {} is in {}; --signal {} takes {}", file.string(), s.line, s.name,
                                      s.unit, w.option, base));
  if (w.scaled) return w.factor;
  return tl::unexpected(
      fmt::format("{}:{}: the unit '{}' of signal {} is not known; give the size of one in {} of the "
                  "joint: --signal {}*SIZE",
                  file.string(), s.line, s.unit, s.name, base, w.option));
}

Result<Place> find(const Wanted& w, std::span<const DbcFile> files) {
  const DbcMessage* message = nullptr;
  const DbcFile* file = nullptr;
  for (const DbcFile& f : files)
    for (const DbcMessage& m : f.messages) {
      if (m.name != w.message) continue;
      if (message)
        return tl::unexpected(
            fmt::format("--signal {}: {} is in {} and in {}", w.option, m.name, file->file.string(), f.file.string()));
      message = &m;
      file = &f;
    }
  if (!message) return tl::unexpected(fmt::format("--signal {}: no DBC file has a message '{}'", w.option, w.message));
  if (const auto& reason = message->unreadable)
    return tl::unexpected(fmt::format("{}:{}: {}; --signal {} needs message {}", file->file.string(), reason->line,
                                      reason->why, w.option, message->name));
  const auto s = std::ranges::find(message->signals, w.signal, &DbcSignal::name);
  if (s == message->signals.end()) {
    std::vector<std::string> names;
    for (const DbcSignal& other : message->signals) names.push_back(other.name);
    return tl::unexpected(fmt::format("--signal {}: message {} ({}:{}) has no signal '{}'; it has {}", w.option,
                                      message->name, file->file.string(), message->line, w.signal,
                                      fmt::join(names, ", ")));
  }
  Place place{.id = message->id, .extended = message->extended, .signal = s->signal};
  if (s->selection) {
    if (!message->multiplexor())
      return tl::unexpected(fmt::format("{}:{}: signal {} is multiplexed, but message {} has no multiplexor (M)",
                                        file->file.string(), s->line, s->name, message->name));
    place.multiplexor = message->multiplexor()->signal;
    place.selection = *s->selection;
  }
  if (w.quantity == Quantity::position || w.quantity == Quantity::torque) {
    const auto scale = scale_of(w, *s, file->file);
    if (!scale) return tl::unexpected(scale.error());
    place.signal.factor *= *scale;
    place.signal.offset *= *scale;
  }
  return place;
}

class SignalListener final : public Listener {
 public:
  std::optional<Place> position, torque, statusword, enabled;
  std::vector<std::uint64_t> enabled_values;
  bool always = false, mean_torque = false;

  Heard hear(const Frame& frame) override {
    Heard heard;
    if (position) heard.position_rad = position->value(frame);
    if (torque) heard.torque_nm = torque->value(frame);
    heard.mean_torque = mean_torque;
    if (statusword)
      if (const auto word = statusword->raw(frame))
        heard.enabled = is_operation_enabled(static_cast<std::uint16_t>(*word));
    if (enabled)
      if (const auto value = enabled->raw(frame))
        heard.enabled = enabled_values.empty() ? *value != 0 : std::ranges::count(enabled_values, *value) > 0;
    if (always && (heard.position_rad || heard.torque_nm)) heard.enabled = true;
    return heard;
  }
};

/// The signals of one joint; null where none is given for it.
Result<std::unique_ptr<Listener>> signals_of(const ForeignDrives& foreign, std::span<const DbcFile> files,
                                             std::span<const DriveParameters> drives, std::size_t i) {
  auto listener = std::make_unique<SignalListener>();
  listener->mean_torque = foreign.mean_torque;
  const auto set = [](std::optional<Place>& place, const Wanted& w, Place found) -> Result<void> {
    if (place) return tl::unexpected(fmt::format("--signal {}: the joint has another one for it", w.option));
    place = std::move(found);
    return {};
  };
  bool any = false;
  for (const std::string& option : foreign.signals) {
    const auto wanted = parse(option, drives, i);
    if (!wanted) return tl::unexpected(wanted.error());
    if (!*wanted) continue;
    const Wanted& w = **wanted;
    any = true;
    if (w.always) {
      listener->always = true;
      continue;
    }
    auto place = find(w, files);
    if (!place) return tl::unexpected(place.error());
    if (w.quantity == Quantity::enabled) listener->enabled_values = w.values;
    std::optional<Place>* const places[] = {&listener->position, &listener->torque, &listener->statusword,
                                            &listener->enabled};
    if (auto ok = set(*places[static_cast<std::size_t>(w.quantity)], w, std::move(*place)); !ok)
      return tl::unexpected(ok.error());
  }
  if (!any) return nullptr;
  if (!listener->position)
    return tl::unexpected(fmt::format("no signal for the position of {}: --signal {}.position=MESSAGE.SIGNAL",
                                      drives[i].name, drives[i].name));
  return listener;
}

/// One --map: the joint, or none for all, and the file.
std::pair<std::string, std::filesystem::path> parse_map(const std::string& map) {
  const auto equals = map.find('=');
  if (equals == std::string::npos) return {"", map};
  return {map.substr(0, equals), map.substr(equals + 1)};
}

std::string extension(const std::filesystem::path& file) {
  std::string e = file.extension().string();
  for (char& c : e) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return e;
}

/// The EDS or DCF of one joint; null where none is given for it.
Result<std::unique_ptr<Listener>> eds_of(const ForeignDrives& foreign, const DriveParameters& drive) {
  std::optional<std::filesystem::path> chosen;
  for (const bool own : {false, true})  // the joint's own file counts before that of all
    for (const std::string& map : foreign.maps) {
      const auto [joint, file] = parse_map(map);
      if (extension(file) == ".dbc" || joint != (own ? drive.name : "")) continue;
      chosen = file;
    }
  if (!chosen) return nullptr;
  auto described = read_eds(*chosen, drive, foreign.increments);
  if (!described) return tl::unexpected(described.error());
  described->mean_torque = foreign.mean_torque;
  return canopen_listener(std::move(*described));
}

/// One line for all messages of a file that are left out.
void note_unreadable(const ForeignDrives& foreign, const DbcFile& file) {
  const auto out = [](const DbcMessage& m) { return m.unreadable.has_value(); };
  const auto count = std::ranges::count_if(file.messages, out);
  if (count == 0 || !foreign.note) return;
  const DbcMessage& first = *std::ranges::find_if(file.messages, out);
  foreign.note(fmt::format("{}: {} of {} messages are left out, the first is {}, line {}: {}", file.file.string(),
                           count, file.messages.size(), first.name, first.unreadable->line, first.unreadable->why));
}

Result<std::vector<DbcFile>> read_dbcs(const ForeignDrives& foreign, std::span<const DriveParameters> drives) {
  std::vector<DbcFile> files;
  for (const std::string& map : foreign.maps) {
    const auto [joint, file] = parse_map(map);
    const std::string kind = extension(file);
    if (kind != ".dbc" && kind != ".eds" && kind != ".dcf")
      return tl::unexpected(fmt::format("--map {}: the file's name ends in none of .dbc, .eds, .dcf", map));
    if (kind == ".dbc" && !joint.empty())
      return tl::unexpected(fmt::format("--map {}: a DBC is for all joints: --map {}", map, file.string()));
    if (!joint.empty() && std::ranges::find(drives, joint, &DriveParameters::name) == drives.end())
      return tl::unexpected(fmt::format("--map {}: there is no joint '{}'", map, joint));
    if (kind != ".dbc") continue;
    auto read = read_dbc(file);
    if (!read) return tl::unexpected(read.error());
    files.push_back(std::move(*read));
  }
  if (!files.empty() && foreign.signals.empty())
    return tl::unexpected(fmt::format("--map {}: which signals are positions and torques? --signal {}",
                                      files[0].file.string(), signal_syntax));
  return files;
}

}  // namespace

std::vector<std::filesystem::path> ForeignDrives::files() const {
  std::vector<std::filesystem::path> all;
  for (const std::string& map : maps) all.push_back(parse_map(map).second);
  return all;
}

Result<std::vector<std::unique_ptr<Listener>>> foreign_listeners(const ForeignDrives& foreign,
                                                                 std::span<const DriveParameters> drives) {
  const auto files = read_dbcs(foreign, drives);
  if (!files) return tl::unexpected(files.error());
  std::vector<std::unique_ptr<Listener>> listeners;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    auto by_signals = signals_of(foreign, *files, drives, i);
    if (!by_signals) return tl::unexpected(by_signals.error());
    auto by_eds = eds_of(foreign, drives[i]);
    if (!by_eds) return tl::unexpected(by_eds.error());
    if (*by_signals && *by_eds)
      return tl::unexpected(fmt::format("{} has both signals of a DBC and an EDS; give one of them", drives[i].name));
    listeners.push_back(*by_signals ? std::move(*by_signals) : std::move(*by_eds));
  }
  for (const DbcFile& file : *files) note_unreadable(foreign, file);
  return listeners;
}

}  // namespace tribotwin::hil
