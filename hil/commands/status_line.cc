#include <algorithm>
#include <cstdlib>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <tribotwin/hil/commands/status_line.hpp>
#include <tribotwin/plugins/friction/number.hpp>

namespace tribotwin::hil::program {
namespace {

/// A part of the line, from its longest form to its shortest; the last may be empty.
struct Part {
  struct Form {
    std::string text;
    int keep = last;  ///< of all parts, the form with the lowest number gives way to its next one
  };
  static constexpr int last = 100;
  std::vector<Form> forms;
};

std::string joined(const std::vector<Part>& parts) {
  std::vector<std::string> shown;
  for (const Part& part : parts)
    if (!part.forms.front().text.empty()) shown.push_back(part.forms.front().text);
  return fmt::format("{}", fmt::join(shown, ", "));
}

Part drives_of(const Bench& bench) {
  std::string letters;
  int enabled = 0, failed = 0;
  for (const auto& drive : bench.drives()) {
    letters += drive->enabled() ? 'E' : drive->failed() ? 'F' : drive->brake_engaged() ? '-' : '+';
    enabled += drive->enabled();
    failed += drive->failed();
  }
  return {{{"drives " + letters + " (E enabled, F fault)", 1},
           {"drives " + letters, 5},
           {fmt::format("{} of {} E, {} F", enabled, letters.size(), failed)}}};
}

std::string hottest(const Bench& bench, const char* form) {
  double hottest_degC = -1e9;
  for (std::size_t i = 0; i < bench.drives().size(); ++i)
    hottest_degC = std::max(hottest_degC, bench.plant().twin().temperature_degC(i));
  return fmt::format(fmt::runtime(form), hottest_degC);
}

std::vector<Part> parts_of(const SessionStatus& s) {
  std::uint64_t lost = 0;
  std::vector<std::string> loads, syncs;
  for (std::size_t i = 0; i < s.buses.size(); ++i) {
    const SessionStatus::Bus& bus = s.buses[i];
    lost += bus.transport->counters().lost();
    loads.push_back(bus.bit_rate ? fmt::format("{:.0f} %", 100 * bus.bits_per_s / *bus.bit_rate)
                                 : fmt::format("{:.0f} kbit/s", 1e-3 * bus.bits_per_s));
    syncs.push_back(fmt::format("{}", s.bench->counters(i).syncs));
  }
  const std::string load = fmt::format("bus {}", fmt::join(loads, " + "));
  std::vector<Part> parts{{{{fmt::format("{:.1f} s", s.simulated_s)}}},
                          {{{fmt::format("{} syncs", fmt::join(syncs, " + ")), 4}, {}}},
                          {{{load, 3}, {}}},
                          drives_of(*s.bench),
                          {{{hottest(*s.bench, "hottest {:.1f} degC"), 2}, {hottest(*s.bench, "{:.0f} degC"), 2}, {}}},
                          {{{fmt::format("lost {}", lost), lost > 0 ? 6 : 0}, {}}}};
  if (s.overruns > 0) parts.push_back({{{fmt::format("late {}", s.overruns), 6}, {}}});
  for (const auto& bus : s.buses) {
    const bool up = bus.transport->up();
    parts.push_back(
        {{{bus.transport->state(), up ? 0 : 7}, {bus.transport->name() + (up ? "" : " down"), up ? 0 : 8}, {}}});
  }
  return parts;
}

}  // namespace

std::string status_line(const SessionStatus& status, int columns) {
  const auto room = static_cast<std::size_t>(std::max(1, columns - 1));
  std::vector<Part> parts = parts_of(status);
  for (std::string line = joined(parts);; line = joined(parts)) {
    const auto next = std::ranges::min_element(parts, {}, [](const Part& part) { return part.forms.front().keep; });
    if (line.size() <= room || next->forms.front().keep == Part::last) return line.substr(0, room);
    next->forms.erase(next->forms.begin());
  }
}

int terminal_columns() {
  winsize size{};
  if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  const char* columns = std::getenv("COLUMNS");
  const auto stated = columns ? to_integer<int>(columns) : std::nullopt;
  return stated && *stated > 0 ? *stated : 80;
}

}  // namespace tribotwin::hil::program
