#pragma once

#include <map>
#include <string>
#include <vector>

#include <tribotwin/twin/io/output.hpp>

/// What a program's command line is, as plain data. Help, man pages and completions are written from it, so that they
/// cannot differ from what the program accepts.
namespace tribotwin::CLI {

struct OptionDescription {
  std::vector<std::string> names;  ///< "-o", "--output"; empty for an argument. Without former names
  std::string value;               ///< "FILE", the name of an argument; empty for a flag
  std::string help, default_value;
  std::string range;                 ///< "0 to 1"
  std::vector<std::string> choices;  ///< all values that are allowed
  std::vector<std::string> needs, excludes;
  bool required = false;
  bool repeated = false;  ///< more than one value, or the option again
  bool hidden = false;    ///< accepted, not shown

  bool positional() const { return names.empty(); }
  /// Its value is a file or a folder.
  bool is_path() const;
};

struct Description {
  std::string name;  ///< "tribotwin run"
  std::string summary, footer;
  std::vector<OptionDescription> options;
  std::vector<Description> commands;
  bool needs_command = false;
  bool hidden = false;

  /// The last word of the name.
  std::string word() const { return name.substr(name.rfind(' ') + 1); }
};

/// Values that a completion offers beside files: those of an option ("--law") or of an argument ("SCENARIO").
using CompletionValues = std::map<std::string, std::vector<std::string>>;

/// What stands for the value of an option in help and man pages: a row of a table where it has one, so that an option
/// has the same value in all commands, or `type`.
std::string placeholder(const std::string& option, const std::string& type);

/// "-o, --output PATH", "DATA...".
std::string label(const OptionDescription& option);
/// The help of an option with its values, default and relations.
std::string explained(const OptionDescription& option);

/// At most 80 columns. Headings are bold where `stream` is coloured.
std::string help_text(const Description& command, twin::Stream stream);

/// A page of section 1 with all commands of a program, for man(7). `version` "0.1.0"; `date` "2026-11-22".
std::string man_page(const Description& program, const std::string& version, const std::string& date);

/// The completion script of a program for "bash", "zsh" or "fish".
std::string completion_script(const Description& program, const std::string& shell, const CompletionValues& values);

}  // namespace tribotwin::CLI
