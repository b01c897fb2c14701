#include <algorithm>
#include <cctype>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/io/command_line/description.hpp>

namespace tribotwin::CLI {
namespace {

/// Text of a line of man(7), in which a hyphen is one that can be copied.
std::string escaped(std::string_view text) {
  std::string out = text.starts_with('.') || text.starts_with('\'') ? "\\&" : "";
  for (const char c : text)
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else
      out += c;
  return out;
}

std::string in_font(char font, std::string_view text) { return fmt::format("\\f{}{}\\fR", font, escaped(text)); }

std::string label_of(const OptionDescription& o) {
  if (o.positional()) return in_font('I', label(o));
  std::vector<std::string> names;
  for (const auto& name : o.names) names.push_back(in_font('B', name));
  return fmt::format("{}{}{}", fmt::join(names, ", "), o.value.empty() ? "" : " ",
                     o.value.empty() ? "" : in_font('I', o.value));
}

std::string synopsis(const Description& command) {
  std::string text = in_font('B', command.name) + " [" + in_font('I', "OPTIONS") + "]";
  for (const auto& o : command.options)
    if (o.positional()) text += o.required ? " " + label_of(o) : fmt::format(" [{}]", label_of(o));
  if (std::ranges::any_of(command.commands, [](const auto& c) { return !c.hidden; }))
    text += command.needs_command ? " " + in_font('I', "COMMAND") : " [" + in_font('I', "COMMAND") + "]";
  return text + "\n";
}

std::string options(const Description& command) {
  std::string text;
  for (const bool positional : {true, false})
    for (const auto& o : command.options)
      if (o.positional() == positional && !o.hidden && o.names != std::vector<std::string>{"-h", "--help"})
        text += ".TP\n" + label_of(o) + "\n" + escaped(explained(o)) + "\n";
  return text;
}

/// Indented lines are examples, lines that end with ":" begin a paragraph of their own.
std::string footer(std::string_view text) {
  std::string out;
  bool example = false, paragraph = false;
  while (!text.empty()) {
    const auto end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(end == text.npos ? text.size() : end + 1);
    const bool indented = line.starts_with(' ');
    if (example && !indented) out += ".EE\n.RE\n";
    if (indented && !example) out += ".RS 4\n.EX\n";
    example = indented;
    if (line.empty()) {
      paragraph = false;
      continue;
    }
    if (!indented && (!paragraph || line.ends_with(':'))) out += ".PP\n";
    paragraph = !indented;
    out += escaped(line.substr(std::min(line.find_first_not_of(' '), line.size()))) + "\n";
  }
  return out + (example ? ".EE\n.RE\n" : "");
}

/// A command and those inside it.
std::string section(const Description& command) {
  std::string text = ".SS " + escaped(command.name.substr(command.name.find(' ') + 1)) + "\n" + synopsis(command) +
                     ".PP\n" + escaped(command.summary) + ".\n" + options(command) + footer(command.footer);
  for (const auto& c : command.commands)
    if (!c.hidden) text += section(c);
  return text;
}

constexpr std::pair<const char*, const char*> exit_codes[] = {
    {"0", "The work is done."},
    {"1", "The work failed, or was interrupted."},
    {"2", "Wrong usage or wrong input; the message says what would be right."},
    {"3", "A limit is exceeded, a check failed, or a joint is not healthy."},
};

}  // namespace

std::string man_page(const Description& program, const std::string& version, const std::string& date) {
  std::string upper = program.name;
  std::ranges::transform(upper, upper.begin(), [](unsigned char c) { return std::toupper(c); });
  std::string text = fmt::format(".TH {} 1 \"{}\" \"tribotwin {}\" \"User Commands\"\n", escaped(upper), date, version);
  text += ".SH NAME\n" + escaped(program.name) + " \\- " + escaped(program.summary) + "\n";
  text += ".SH SYNOPSIS\n" + synopsis(program);
  text += ".SH OPTIONS\n" + options(program) + footer(program.footer);
  text += ".SH COMMANDS\n";
  for (const auto& c : program.commands)
    if (!c.hidden) text += section(c);
  text += ".SH EXIT STATUS\n";
  for (const auto& [code, meaning] : exit_codes) text += fmt::format(".TP\n.B {}\n{}\n", code, meaning);
  text +=
      ".SH ENVIRONMENT\n.TP\n.B NO_COLOR\nWhere it is set, nothing is coloured unless \\fB\\-\\-color always\\fR "
      "asks for it.\n";
  text += ".SH SEE ALSO\n";
  std::vector<std::string> others;
  for (const char* name : {"tribotwin", "tribotwin-hil", "tribotwin-report"})
    if (name != program.name) others.push_back(fmt::format(".BR {} (1)", escaped(name)));
  return text + fmt::format("{}\n", fmt::join(others, " ,\n"));
}

}  // namespace tribotwin::CLI
