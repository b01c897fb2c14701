#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/hil/conform/report.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil {
namespace {

const char* label(Verdict verdict) {
  constexpr const char* labels[] = {"pass", "FAIL", "n/a ", "----"};
  return labels[static_cast<int>(verdict)];
}

const char* name_of(Needs needs) {
  constexpr const char* names[] = {"", "--motion", "--motion --homing"};
  return names[static_cast<int>(needs)];
}

}  // namespace

const char* name_of(Verdict verdict) {
  constexpr const char* names[] = {"pass", "fail", "not applicable", "not run"};
  return names[static_cast<int>(verdict)];
}

int ConformReport::count(Verdict verdict) const {
  return static_cast<int>(std::ranges::count(findings, verdict, &Finding::verdict));
}

std::string summary(const ConformReport& r) {
  return fmt::format("{} checks: {} passed, {} failed, {} not applicable, {} not run", r.findings.size(),
                     r.count(Verdict::pass), r.count(Verdict::fail), r.count(Verdict::not_applicable),
                     r.count(Verdict::not_run));
}

std::string to_text(const ConformReport& r) {
  std::string s = fmt::format("node {} on {}: \"{}\", device type {:08X}h\n\n", r.node, r.bus,
                              twin::printable(r.device_name), r.device_type);
  for (const Finding& f : r.findings) {
    s += fmt::format("{}  {}  ({})\n", label(f.verdict), f.check.id, f.check.clause);
    const bool made = f.verdict == Verdict::pass || f.verdict == Verdict::fail;
    s += fmt::format("      expected: {}\n      {}: {}\n", f.expected, made ? "seen" : "reason",
                     twin::printable(f.seen));
  }
  s += "\n";
  for (const auto& note : r.notes) s += fmt::format("note: {}\n", note);
  if (r.interrupted) s += "interrupted: the checks are not complete\n";
  return s + summary(r) + "\n";
}

std::string to_json(const ConformReport& r) {
  nlohmann::ordered_json checks = nlohmann::ordered_json::array();
  for (const Finding& f : r.findings)
    checks.push_back({{"id", f.check.id},
                      {"clause", f.check.clause},
                      {"verdict", name_of(f.verdict)},
                      {"expected", f.expected},
                      {"seen", twin::printable(f.seen)}});
  const nlohmann::ordered_json json{{"node", r.node},
                                    {"bus", r.bus},
                                    {"device_name", twin::printable(r.device_name)},
                                    {"device_type", r.device_type},
                                    {"complete", !r.interrupted},
                                    {"passed", r.count(Verdict::pass)},
                                    {"failed", r.count(Verdict::fail)},
                                    {"not_applicable", r.count(Verdict::not_applicable)},
                                    {"not_run", r.count(Verdict::not_run)},
                                    {"notes", r.notes},
                                    {"checks", checks}};
  return twin::dump_json(json, 2) + "\n";
}

std::string checks_markdown() {
  std::string s = "| check | clause | expected | needs |\n|---|---|---|---|\n";
  for (const Check& c : all_checks())
    s += fmt::format("| {} | {} | {} | {} |\n", c.id, c.clause, c.expected, name_of(c.needs));
  return s;
}

}  // namespace tribotwin::hil
