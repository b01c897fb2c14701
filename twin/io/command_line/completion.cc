#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/io/command_line/description.hpp>

namespace tribotwin::CLI {
namespace {

/// What a value may be: the words to choose from, and whether files are offered.
struct Offer {
  std::vector<std::string> words;
  bool files = false;
};

Offer offer_of(const OptionDescription& o, const CompletionValues& values) {
  if (!o.choices.empty()) return {.words = o.choices};
  const auto found = values.find(o.positional() ? o.value : o.names.back());
  return {.words = found == values.end() ? std::vector<std::string>{} : found->second, .files = o.is_path()};
}

std::string function_name(std::string_view program) {
  std::string name = "_" + std::string(program);
  std::ranges::replace(name, '-', '_');
  return name;
}

/// Calls `visit` for the program and all commands that are shown, with the words that lead there: "", "diagnose check".
template <class Visit>
void for_each_command(const Description& command, const std::string& path, const Visit& visit) {
  visit(command, path);
  for (const auto& c : command.commands)
    if (!c.hidden) for_each_command(c, path.empty() ? c.word() : path + " " + c.word(), visit);
}

std::vector<std::string> words_of(const Description& command) {
  std::vector<std::string> words;
  for (const auto& c : command.commands)
    if (!c.hidden) words.push_back(c.word());
  return words;
}

/// --color is offered for every command, although only the program's help shows it.
bool offered(const OptionDescription& o) { return !o.hidden || o.names.back() == "--color"; }

// ---- bash

std::string bash_values(const Description& command, const std::string& path, const CompletionValues& values) {
  std::string text;
  for (const auto& o : command.options) {
    if (o.positional() || o.value.empty() || !offered(o)) continue;
    const Offer offer = offer_of(o, values);
    std::vector<std::string> patterns;
    for (const auto& name : o.names) patterns.push_back(fmt::format("'{}:{}'", path, name));
    text += fmt::format("    {}) words='{}' files={} ;;\n", fmt::join(patterns, "|"), fmt::join(offer.words, " "),
                        offer.files ? 1 : 0);
  }
  return text;
}

std::string bash_words(const Description& command, const std::string& path, const CompletionValues& values) {
  std::vector<std::string> options, arguments;
  bool files = false;
  for (const auto& o : command.options) {
    if (o.positional()) {
      const Offer offer = offer_of(o, values);
      arguments.insert(arguments.end(), offer.words.begin(), offer.words.end());
      files |= offer.files;
    } else if (offered(o)) {
      options.insert(options.end(), o.names.begin(), o.names.end());
    }
  }
  const auto commands = words_of(command);
  arguments.insert(arguments.end(), commands.begin(), commands.end());
  return fmt::format("    '{}') options='{}' words='{}' files={} ;;\n", path, fmt::join(options, " "),
                     fmt::join(arguments, " "), files ? 1 : 0);
}

std::string bash(const Description& program, const CompletionValues& values) {
  std::string of_options, of_commands, paths;
  for_each_command(program, "", [&](const Description& command, const std::string& path) {
    of_options += bash_values(command, path, values);
    of_commands += bash_words(command, path, values);
    paths += fmt::format("{}'{}'", path.empty() ? "" : "|", path);
  });
  return fmt::format(R"(# bash completion for {0}; written by '{0} completion bash'
{1}() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} path= options= words= files=0 i
  for ((i = 1; i < COMP_CWORD; i++)); do
    case "${{path:+$path }}${{COMP_WORDS[i]}}" in
      {2}) path="${{path:+$path }}${{COMP_WORDS[i]}}" ;;
    esac
  done
  # --option=value arrives as three words.
  if [[ $word == = ]]; then word=; elif [[ $before == = ]]; then before=${{COMP_WORDS[COMP_CWORD-2]}}; fi
  COMPREPLY=()
  case "$path:$before" in
{3}    *) case "$path" in
{4}    esac ;;
  esac
  if [[ $word == -* ]]; then words=$options files=0; fi
  local IFS=$' \t\n'
  COMPREPLY=($(compgen -W "$words" -- "$word"))
  if ((files)); then
    compopt -o filenames 2>/dev/null
    local IFS=$'\n'
    COMPREPLY+=($(compgen -f -- "$word"))
  fi
}}
complete -F {1} {0}
)",
                     program.name, function_name(program.name), paths, of_options, of_commands);
}

// ---- zsh

/// Text inside '...' of a specification of _arguments.
std::string zsh_text(std::string_view text) {
  std::string out;
  for (const char c : text)
    if (c == '\'')
      out += "'\\''";
    else if (c == '[' || c == ']' || c == ':' || c == '\\')
      out += std::string("\\") + c;
    else
      out += c;
  return out;
}

std::string zsh_action(const Offer& offer) {
  if (offer.words.empty()) return offer.files ? "_files" : " ";
  const std::string words = fmt::format("({})", fmt::join(offer.words, " "));
  return offer.files ? fmt::format("_alternative \"values:value:{}\" \"files:file:_files\"", words) : words;
}

std::string zsh_arguments(const Description& command, const CompletionValues& values) {
  std::string text;
  int position = 0;
  for (const auto& o : command.options) {
    const std::string action = zsh_action(offer_of(o, values));
    if (o.positional()) {
      text += fmt::format(" \\\n        '{}:{}:{}'", o.repeated ? "*" : std::to_string(++position), zsh_text(o.value),
                          action);
      continue;
    }
    if (!offered(o)) continue;
    for (const auto& name : o.names)
      text += fmt::format(" \\\n        '{}{}{}[{}]{}'", o.repeated ? "*" : "", name,
                          o.value.empty() || !name.starts_with("--") ? "" : "=", zsh_text(o.help),
                          o.value.empty() ? "" : fmt::format(":{}:{}", zsh_text(o.value), action));
  }
  return text;
}

std::string zsh_commands(const Description& command) {
  std::string text;
  for (const auto& c : command.commands)
    if (!c.hidden) text += fmt::format(" '{}:{}'", c.word(), zsh_text(c.summary));
  return text;
}

/// A function for a command, after those of the commands inside it.
std::string zsh_function(const Description& command, const CompletionValues& values) {
  std::string name = function_name(command.name), inner, cases;
  std::ranges::replace(name, ' ', '_');
  if (words_of(command).empty())
    return fmt::format("{}() {{\n    _arguments -s{}\n}}\n", name, zsh_arguments(command, values));
  for (const auto& c : command.commands) {
    if (c.hidden) continue;
    inner += zsh_function(c, values);
    std::string function = function_name(c.name);
    std::ranges::replace(function, ' ', '_');
    cases += fmt::format("      {}) {} ;;\n", c.word(), function);
  }
  Description own = command;
  const bool takes_files =
      std::ranges::any_of(own.options, [](const auto& o) { return o.positional() && o.is_path(); });
  std::erase_if(own.options, [](const auto& o) { return o.positional(); });
  return inner + fmt::format(R"({0}() {{
    local -a commands=({1})
    local context state state_descr line
    typeset -A opt_args
    _arguments -C -s{2} \
        '1: :->command' '*:: :->rest' && return
    case $state in
    command) _describe -t commands command commands{3} ;;
    rest) case $words[1] in
{4}      *) _files ;;
      esac ;;
    esac
}}
)",
                             name, zsh_commands(command), zsh_arguments(own, values), takes_files ? "; _files" : "",
                             cases);
}

std::string zsh(const Description& program, const CompletionValues& values) {
  return fmt::format("#compdef {0}\n# written by '{0} completion zsh'\n{1}{2} \"$@\"\n", program.name,
                     zsh_function(program, values), function_name(program.name));
}

// ---- fish

std::string fish_text(std::string_view text) {
  std::string out;
  for (const char c : text)
    if (c == '\'' || c == '\\')
      out += std::string("\\") + c;
    else
      out += c;
  return out;
}

/// When a line of fish holds: the words of `path` were given, and none of `others` behind them.
std::string fish_condition(const std::string& path, const std::vector<std::string>& others) {
  std::vector<std::string> all;
  std::string_view rest = path;
  while (!rest.empty()) {
    const auto end = rest.find(' ');
    all.push_back(fmt::format("__fish_seen_subcommand_from {}", rest.substr(0, end)));
    rest.remove_prefix(end == rest.npos ? rest.size() : end + 1);
  }
  if (!others.empty()) all.push_back(fmt::format("not __fish_seen_subcommand_from {}", fmt::join(others, " ")));
  return fmt::format(" -n '{}'", fmt::join(all, "; and "));
}

std::string fish_value(const Offer& offer) {
  std::string text = offer.files ? " -r -F" : " -x";
  if (!offer.words.empty()) text += fmt::format(" -a '{}'", fmt::join(offer.words, " "));
  return text;
}

std::string fish_option(const std::string& start, const OptionDescription& o, const CompletionValues& values) {
  std::string text = start;
  for (const auto& name : o.names) text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
  if (!o.value.empty()) text += fish_value(offer_of(o, values));
  return text + fmt::format(" -d '{}'\n", fish_text(o.help));
}

std::string fish(const Description& program, const CompletionValues& values) {
  std::string text = fmt::format("# fish completion for {0}; written by '{0} completion fish'\n", program.name);
  for_each_command(program, "", [&](const Description& command, const std::string& path) {
    const auto commands = words_of(command);
    const std::string condition = path.empty() && commands.empty() ? "" : fish_condition(path, commands);
    const std::string start = fmt::format("complete -c {}{}", program.name, condition);
    bool files = false;
    for (const auto& o : command.options) {
      if (!o.positional()) {
        if (offered(o)) text += fish_option(start, o, values);
        continue;
      }
      const Offer offer = offer_of(o, values);
      files |= offer.files;
      if (!offer.words.empty()) text += fmt::format("{} -a '{}'\n", start, fmt::join(offer.words, " "));
    }
    if (!files) text += start + " -f\n";
    for (const auto& c : command.commands)
      if (!c.hidden) text += fmt::format("{} -a {} -d '{}'\n", start, c.word(), fish_text(c.summary));
  });
  return text;
}

}  // namespace

std::string completion_script(const Description& program, const std::string& shell, const CompletionValues& values) {
  return shell == "bash" ? bash(program, values) : shell == "zsh" ? zsh(program, values) : fish(program, values);
}

}  // namespace tribotwin::CLI
