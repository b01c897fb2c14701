#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/io/command_line/description.hpp>

namespace tribotwin::CLI {
namespace {

constexpr std::size_t width = 80, column = 28;

/// Words of `text` in lines of at most `width`; the first begins at `at`, the others at `indent`. Lines of `text` that
/// begin with a blank stay as they are.
std::string wrapped(std::string_view text, std::size_t at, std::size_t indent) {
  std::string lines;
  bool first = true;
  while (!text.empty()) {
    const auto end = text.find(' ');
    const std::string_view word = text.substr(0, end);
    text.remove_prefix(end == text.npos ? text.size() : end + 1);
    if (word.empty()) continue;
    if (!first && at + 1 + word.size() > width) {
      lines += "\n" + std::string(indent, ' ');
      at = indent;
    } else if (!first) {
      lines += ' ';
      ++at;
    }
    lines += word;
    at += word.size();
    first = false;
  }
  return lines + "\n";
}

/// The words of a line; an option and its value are one.
std::vector<std::string> units(std::string_view line) {
  std::vector<std::string> found;
  bool value_follows = false;
  while (!line.empty()) {
    const auto end = line.find(' ');
    const std::string_view word = line.substr(0, end);
    line.remove_prefix(end == line.npos ? line.size() : end + 1);
    if (word.empty()) continue;
    const bool option = word.starts_with('-');
    if (value_follows && !option)
      found.back() += " " + std::string(word);
    else
      found.emplace_back(word);
    value_follows = option && word.find('=') == word.npos;
  }
  return found;
}

/// A line to be pasted: one that is too long is continued behind a backslash.
std::string example(std::string_view line) {
  const std::string indent(line.substr(0, line.find_first_not_of(' ')));
  const auto words = units(line);
  std::string lines = indent;
  std::size_t at = indent.size();
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::size_t continued = i + 1 < words.size() ? 2 : 0;  // columns of " \\"
    if (i > 0 && at + 1 + words[i].size() + continued > width) {
      lines += " \\\n" + indent + "  ";
      at = indent.size() + 2;
    } else if (i > 0) {
      lines += ' ';
      ++at;
    }
    lines += words[i];
    at += words[i].size();
  }
  return lines + "\n";
}

std::string heading(std::string_view text, twin::Stream stream) { return twin::bold(text, stream) + '\n'; }

std::string row(const std::string& label, const std::string& text) {
  std::string line = "  " + label;
  if (line.size() + 2 > column)
    line += "\n" + std::string(column, ' ');
  else
    line.resize(column, ' ');
  return line + wrapped(text, column, column);
}

std::string rows(const Description& command, bool positional, std::string_view title, twin::Stream stream) {
  std::string text;
  for (const auto& o : command.options)
    if (o.positional() == positional && !o.hidden) text += row(label(o), explained(o));
  return text.empty() ? text : "\n" + heading(title, stream) + text;
}

std::string usage(const Description& command) {
  std::string text = "Usage: " + command.name + " [OPTIONS]";
  for (const auto& o : command.options)
    if (o.positional()) text += o.required ? " " + label(o) : fmt::format(" [{}]", label(o));
  if (std::ranges::any_of(command.commands, [](const auto& c) { return !c.hidden; }))
    text += command.needs_command ? " COMMAND" : " [COMMAND]";
  return wrapped(text, 0, 7);
}

/// Paragraphs are wrapped; what is indented stays a line to be pasted; what ends with ":" is a heading.
std::string footer(std::string_view text, twin::Stream stream) {
  std::string out, paragraph;
  const auto flush = [&] {
    if (!paragraph.empty()) out += wrapped(paragraph, 0, 0);
    paragraph.clear();
  };
  while (!text.empty()) {
    const auto end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(end == text.npos ? text.size() : end + 1);
    if (line.empty() || line.front() == ' ' || line.ends_with(':')) flush();
    if (line.empty())
      out += '\n';
    else if (line.front() == ' ')
      out += example(line);
    else if (line.ends_with(':'))
      out += heading(line, stream);
    else
      paragraph += (paragraph.empty() ? "" : " ") + std::string(line);
  }
  flush();
  return out;
}

}  // namespace

std::string help_text(const Description& command, twin::Stream stream) {
  std::string text = wrapped(command.summary, 0, 0) + "\n" + usage(command) +
                     rows(command, true, "Arguments:", stream) + rows(command, false, "Options:", stream);
  std::string commands;
  for (const auto& c : command.commands)
    if (!c.hidden) commands += row(c.word(), c.summary);
  if (!commands.empty()) text += "\n" + heading("Commands:", stream) + commands;
  if (!command.footer.empty()) text += "\n" + footer(command.footer, stream);
  return text;
}

}  // namespace tribotwin::CLI
