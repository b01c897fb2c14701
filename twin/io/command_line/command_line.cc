#include <cmath>
#include <cstdint>
#include <optional>
#include <type_traits>
#include <utility>

#include <CLI/CLI.hpp>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/command_line/command_line.hpp>

namespace tribotwin::CLI {

struct Validator::Made {
  ::CLI::Validator validator;
};

struct Option::Made {
  ::CLI::Option& option;
};

struct ParseError::Made {
  ::CLI::ParseError error;
};

struct App::Made {
  std::unique_ptr<::CLI::App> program;  ///< null for a command
  ::CLI::App& app;
};

namespace {

Validator made(::CLI::Validator validator) {
  return {std::make_shared<const Validator::Made>(Validator::Made{std::move(validator)})};
}

}  // namespace

Range::Range(double min, double max) : Validator(CLI::made(::CLI::Range(min, max))) {}
Range::Range(int min, int max) : Validator(CLI::made(::CLI::Range(min, max))) {}
Range::Range(unsigned min, unsigned max) : Validator(CLI::made(::CLI::Range(min, max))) {}
IsMember::IsMember(std::initializer_list<const char*> values) : Validator(CLI::made(::CLI::IsMember(values))) {}
IsMember::IsMember(std::initializer_list<int> values) : Validator(CLI::made(::CLI::IsMember(values))) {}

const Validator PositiveNumber = made(::CLI::PositiveNumber), NonNegativeNumber = made(::CLI::NonNegativeNumber);

Option::Option(std::unique_ptr<Made> made) : made_(std::move(made)) {}
Option::~Option() = default;

Option* Option::required() {
  made_->option.required();
  return this;
}
Option* Option::check(const Validator& validator) {
  made_->option.check(validator.made->validator);
  return this;
}
Option* Option::capture_default_str() {
  made_->option.capture_default_str();
  return this;
}
Option* Option::excludes(Option* other) {
  made_->option.excludes(&other->made_->option);
  return this;
}
Option* Option::needs(Option* other) {
  made_->option.needs(&other->made_->option);
  return this;
}
Option* Option::allow_extra_args(bool value) {
  made_->option.allow_extra_args(value);
  return this;
}
Option* Option::delimiter(char value) {
  made_->option.delimiter(value);
  return this;
}
Option* Option::expected(int values) {
  made_->option.expected(values);
  return this;
}
Option* Option::expected(int min, int max) {
  made_->option.expected(min, max);
  return this;
}
std::size_t Option::count() const { return made_->option.count(); }

const char* ParseError::what() const noexcept { return made_->error.what(); }

App::App(std::string description) {
  auto program = std::make_unique<::CLI::App>(std::move(description));
  ::CLI::App& app = *program;
  made_ = std::make_unique<Made>(Made{std::move(program), app});
}
App::App(std::unique_ptr<Made> made) : made_(std::move(made)) {}
App::~App() = default;

namespace {

template <class T>
constexpr bool is_real =
    std::is_same_v<T, double> || std::is_same_v<T, std::optional<double>> || std::is_same_v<T, std::vector<double>>;

/// Ranges let NaN pass, and a limit that is infinite limits nothing.
std::string finite(const std::string& text) {
  const auto value = to_number(text);
  return !value || std::isfinite(*value) ? "" : "must be a finite number, not " + text;
}

}  // namespace

template <class T>
Option* App::add_option(const std::string& name, T& variable, const std::string& help) {
  ::CLI::Option& option = *made_->app.add_option(name, variable, help);
  if constexpr (is_real<T>) option.check(finite, "");
  auto made = std::make_unique<Option::Made>(Option::Made{option});
  return options_.emplace_back(std::make_unique<Option>(std::move(made))).get();
}
// A new type of variable needs a line here.
template Option* App::add_option(const std::string&, bool&, const std::string&);
template Option* App::add_option(const std::string&, int&, const std::string&);
template Option* App::add_option(const std::string&, unsigned&, const std::string&);
template Option* App::add_option(const std::string&, std::uint8_t&, const std::string&);
template Option* App::add_option(const std::string&, std::size_t&, const std::string&);
template Option* App::add_option(const std::string&, double&, const std::string&);
template Option* App::add_option(const std::string&, std::string&, const std::string&);
template Option* App::add_option(const std::string&, std::optional<int>&, const std::string&);
template Option* App::add_option(const std::string&, std::optional<std::int64_t>&, const std::string&);
template Option* App::add_option(const std::string&, std::optional<std::uint64_t>&, const std::string&);
template Option* App::add_option(const std::string&, std::optional<double>&, const std::string&);
template Option* App::add_option(const std::string&, std::vector<double>&, const std::string&);
template Option* App::add_option(const std::string&, std::vector<std::string>&, const std::string&);

Option* App::add_flag(const std::string& name, bool& variable, const std::string& help) {
  auto made = std::make_unique<Option::Made>(Option::Made{*made_->app.add_flag(name, variable, help)});
  return options_.emplace_back(std::make_unique<Option>(std::move(made))).get();
}

App* App::add_subcommand(const std::string& name, const std::string& description) {
  auto made = std::make_unique<Made>(Made{nullptr, *made_->app.add_subcommand(name, description)});
  return commands_.emplace_back(std::make_unique<App>(std::move(made))).get();
}
App* App::footer(const std::string& text) {
  made_->app.footer(text);
  return this;
}
App* App::callback(std::function<void()> work) {
  made_->app.callback(std::move(work));
  return this;
}
App* App::require_subcommand(int count) {
  made_->app.require_subcommand(count);
  return this;
}
App* App::require_subcommand(int min, int max) {
  made_->app.require_subcommand(static_cast<std::size_t>(min), static_cast<std::size_t>(max));
  return this;
}
void App::set_version_flag(const std::string& flag, const std::string& version) {
  made_->app.set_version_flag(flag, version);
}

void App::parse(int argc, const char* const* argv) {
  try {
    made_->app.parse(argc, argv);
  } catch (const ::CLI::ParseError& error) {
    throw ParseError(std::make_shared<const ParseError::Made>(ParseError::Made{error}));
  }
}
int App::exit(const ParseError& error, std::ostream& out, std::ostream& err) const {
  return made_->app.exit(error.made().error, out, err);
}
std::vector<const App*> App::get_subcommands() const {
  std::vector<const App*> given;
  for (const auto& command : commands_)
    if (*command) given.push_back(command.get());
  return given;
}
App::operator bool() const { return made_->app.parsed(); }

}  // namespace tribotwin::CLI
