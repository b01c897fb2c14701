#pragma once

#include <cstddef>
#include <exception>
#include <functional>
#include <initializer_list>
#include <iosfwd>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/twin/io/command_line/description.hpp>

/// The part of CLI11 that the programs use, under the same names and with the same meaning. CLI11 is a header that
/// takes seconds to compile; here it is compiled once, in command_line.cc.
namespace tribotwin::CLI {

/// What the value of an option must be.
struct Validator {
  struct Made;
  std::shared_ptr<const Made> made;
};

/// Minimum and maximum are allowed.
struct Range : Validator {
  Range(double min, double max);
  Range(int min, int max);
  Range(unsigned min, unsigned max);
};

struct IsMember : Validator {
  IsMember(std::initializer_list<const char*> values);
  IsMember(std::initializer_list<int> values);
};

extern const Validator PositiveNumber, NonNegativeNumber;

class Option {
 public:
  struct Made;
  explicit Option(std::unique_ptr<Made> made);
  ~Option();

  Option* required();
  Option* check(const Validator& validator);
  Option* capture_default_str();  ///< the help shows the value that the variable has now
  Option* excludes(Option* other);
  Option* needs(Option* other);
  Option* allow_extra_args(bool value);
  Option* delimiter(char value);
  Option* expected(int values);
  Option* expected(int min, int max);
  Option* hide();  ///< accepted, but not shown in help
  std::size_t count() const;
  OptionDescription describe() const;

 private:
  std::unique_ptr<Made> made_;
};

/// Why the command line could not be parsed, or that only help or version was asked for.
class ParseError : public std::exception {
 public:
  struct Made;
  explicit ParseError(std::shared_ptr<const Made> made) : made_(std::move(made)) {}
  const char* what() const noexcept override;
  const Made& made() const { return *made_; }

 private:
  std::shared_ptr<const Made> made_;
};

/// A program or one of its commands.
class App {
 public:
  struct Made;
  App(const std::string& name, const std::string& description);
  explicit App(std::unique_ptr<Made> made);
  ~App();

  /// Options and commands live as long as the App. The types of variables are listed in command_line.cc. `name` is
  /// "-o,--output": a letter, a long name, then former long names, which are accepted and not shown.
  template <class T>
  Option* add_option(const std::string& name, T& variable, const std::string& help);
  Option* add_flag(const std::string& name, bool& variable, const std::string& help);
  App* add_subcommand(const std::string& name, const std::string& description);
  App* footer(const std::string& text);
  App* callback(std::function<void()> work);
  App* require_subcommand(int count);
  App* require_subcommand(int min, int max);
  App* hide();  ///< accepted, but not shown in help
  /// `json` is what --version prints with --json.
  void set_version_flag(const std::string& version, const std::string& json);

  /// Throws ParseError, and what callbacks throw.
  void parse(int argc, const char* const* argv);
  /// Writes the help or the error. Returns the exit code by CLI11, 0 after help.
  int exit(const ParseError& error, std::ostream& out, std::ostream& err) const;
  /// The commands that were given.
  std::vector<const App*> get_subcommands() const;
  /// Whether this command was given.
  explicit operator bool() const;

  Description describe() const;
  /// The innermost command that was given, or the program.
  const App& given() const;

 private:
  void prepare();

  std::unique_ptr<Made> made_;
  std::vector<std::unique_ptr<Option>> options_;
  std::vector<std::unique_ptr<App>> commands_;
};

}  // namespace tribotwin::CLI
