#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/io/command_line/description.hpp>

namespace tribotwin::CLI {
namespace {

/// Options whose value is neither a number nor any text. One row each, for all commands of all programs.
constexpr std::pair<const char*, const char*> placeholders[] = {
    {"--gear", "CLASS"},       {"--scenario", "FILE"},
    {"--can", "BUS"},          {"--camera", "NAME"},
    {"--columns", "FILE"},     {"--dcf", "FILE"},
    {"--drive", "NAME"},       {"--eds", "FILE"},
    {"--evaluate", "FILE"},    {"--faults", "FILE"},
    {"--fix", "NAME=VALUE"},   {"--friction", "LAW"},
    {"--given", "FILE"},       {"--interval", "A,B"},
    {"--joint", "JOINT"},      {"--law", "LAW"},
    {"--loaded", "FILE"},      {"--look-at", "X Y Z"},
    {"--map", "FILE"},         {"--name", "NAME"},
    {"--output", "PATH"},      {"--params", "FILE"},
    {"--points", "FILE"},      {"--pose", "JOINT=RAD"},
    {"--record", "FILE"},      {"--set", "KEY=VALUE"},
    {"--shared", "NAME"},      {"--site", "NAME"},
    {"--size", "WxH"},         {"--speeds", "FROM:TO:COUNT"},
    {"--static", "FILE"},      {"--stats", "FILE"},
    {"--store", "FILE"},       {"--joint-temperature", "JOINT=DEGC"},
    {"--thermal", "FILE"},     {"--wrench", "FILE"},
    {"--color", "WHEN"},       {"--payload", "FILE=KNOWN"},
    {"--web", "ADDRESS:PORT"}, {"--web-folder", "DIR"},
    {"--c", "FILE"},
};

}  // namespace

bool OptionDescription::is_path() const {
  static constexpr std::array words{"FILE", "PATH", "DIR"};
  if (positional()) return choices.empty();
  return std::ranges::find(words, value) != words.end();
}

std::string placeholder(const std::string& option, const std::string& type) {
  for (const auto& [name, value] : placeholders)
    if (option == name) return value;
  return type == "FLOAT" ? "NUMBER" : type == "INT" || type == "UINT" ? "N" : type;
}

std::string label(const OptionDescription& o) {
  if (o.positional()) return o.value + (o.repeated ? "..." : "");
  return fmt::format("{}{}{}", fmt::join(o.names, ", "), o.value.empty() ? "" : " ", o.value);
}

std::string explained(const OptionDescription& o) {
  std::string text = o.help;
  std::vector<std::string> facts;
  if (!o.choices.empty()) facts.push_back(fmt::format("{}", fmt::join(o.choices, ", ")));
  if (!o.range.empty()) facts.push_back(o.range);
  if (!o.default_value.empty()) facts.push_back("default: " + o.default_value);
  if (!o.needs.empty()) facts.push_back(fmt::format("with {}", fmt::join(o.needs, ", ")));
  if (!o.excludes.empty()) facts.push_back(fmt::format("not with {}", fmt::join(o.excludes, ", ")));
  if (o.required && !o.positional()) facts.emplace_back("required");
  if (!facts.empty()) text += fmt::format(" ({})", fmt::join(facts, "; "));
  return text;
}

}  // namespace tribotwin::CLI
