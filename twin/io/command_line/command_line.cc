#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <type_traits>
#include <utility>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::CLI {

struct Validator::Made {
  ::CLI::Validator validator;
  std::string range;
  std::vector<std::string> choices;
};

struct Option::Made {
  ::CLI::Option& option;
  std::string type;  ///< CLI11's name of the variable's type; empty for a flag
  bool hidden = false;
  std::string range;
  std::vector<std::string> choices;
};

struct ParseError::Made {
  ::CLI::ParseError error;
};

struct App::Made {
  std::unique_ptr<::CLI::App> program;  ///< null for a command
  ::CLI::App& app;
  std::string name;  ///< "tribotwin run"
  bool hidden = false;
  std::string colour;  ///< of --color, which output.cc has read already
};

namespace {

Validator made(::CLI::Validator validator, std::string range, std::vector<std::string> choices = {}) {
  return {std::make_shared<const Validator::Made>(
      Validator::Made{std::move(validator), std::move(range), std::move(choices)})};
}

template <class T>
Validator member(std::initializer_list<T> values) {
  std::vector<std::string> choices;
  for (const T& value : values) choices.push_back(fmt::format("{}", value));
  return made(::CLI::IsMember(values), "", std::move(choices));
}

/// A check of CLI11 with our message and text in the help: `what` is "a number above 0", `range` "above 0".
template <class Number, class Accepts>
Validator numbers(::CLI::Validator validator, std::string what, std::string range, Accepts accepts) {
  return made(validator.operation([what = std::move(what), accepts](std::string& text) {
    Number value{};
    const bool good = ::CLI::detail::lexical_cast(text, value) && accepts(value);
    return good ? std::string() : fmt::format("must be {}, not '{}'", what, text);
  }),
              std::move(range));
}

template <class Number>
Validator range(Number min, Number max) {
  constexpr const char* kind = std::is_integral_v<Number> ? "a whole number" : "a number";
  return numbers<Number>(::CLI::Range(min, max), fmt::format("{} from {} to {}", kind, min, max),
                         fmt::format("{} to {}", min, max),
                         [min, max](Number value) { return value >= min && value <= max; });
}

}  // namespace

Range::Range(double min, double max) : Validator(range(min, max)) {}
Range::Range(int min, int max) : Validator(range(min, max)) {}
Range::Range(unsigned min, unsigned max) : Validator(range(min, max)) {}
IsMember::IsMember(std::initializer_list<const char*> values) : Validator(member(values)) {}
IsMember::IsMember(std::initializer_list<int> values) : Validator(member(values)) {}

const Validator PositiveNumber = numbers<double>(::CLI::PositiveNumber, "a number above 0", "above 0",
                                                 [](double value) { return value > 0; }),
                NonNegativeNumber = numbers<double>(::CLI::NonNegativeNumber, "a number of at least 0", "0 or more",
                                                    [](double value) { return value >= 0; });

Option::Option(std::unique_ptr<Made> made) : made_(std::move(made)) {}
Option::~Option() = default;

Option* Option::required() {
  made_->option.required();
  return this;
}
Option* Option::check(const Validator& validator) {
  made_->option.check(validator.made->validator);
  made_->range = validator.made->range;
  made_->choices = validator.made->choices;
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
Option* Option::hide() {
  made_->hidden = true;
  return this;
}
std::size_t Option::count() const { return made_->option.count(); }

namespace {

/// The letter and the first long name; the other long names are former ones.
std::vector<std::string> shown_names(const ::CLI::Option& option) {
  std::vector<std::string> names;
  if (!option.get_snames().empty()) names.push_back("-" + option.get_snames().front());
  if (!option.get_lnames().empty()) names.push_back("--" + option.get_lnames().front());
  return names;
}

std::vector<std::string> long_names(const std::set<::CLI::Option*>& options) {
  std::vector<std::string> names;
  for (const auto* option : options) names.push_back(shown_names(*option).back());
  std::ranges::sort(names);
  return names;
}

}  // namespace

OptionDescription Option::describe() const {
  const ::CLI::Option& o = made_->option;
  OptionDescription d{.names = shown_names(o),
                      .help = o.get_description(),
                      .default_value = o.get_default_str(),
                      .range = made_->range,
                      .choices = made_->choices,
                      .needs = long_names(o.get_needs()),
                      .excludes = long_names(o.get_excludes()),
                      .required = o.get_required(),
                      .repeated = o.get_items_expected_max() > 1,
                      .hidden = made_->hidden};
  if (d.positional())
    d.value = o.get_name(true);
  else if (!made_->type.empty())
    d.value = placeholder(d.names.back(), made_->type);
  return d;
}

const char* ParseError::what() const noexcept { return made_->error.what(); }

App::App(const std::string& name, const std::string& description) {
  auto program = std::make_unique<::CLI::App>(description, name);
  ::CLI::App& app = *program;
  made_ = std::make_unique<Made>(Made{std::move(program), app, name});
  prepare();
}
App::App(std::unique_ptr<Made> made) : made_(std::move(made)) { prepare(); }
App::~App() = default;

namespace {

template <class T>
constexpr bool is_real =
    std::is_same_v<T, double> || std::is_same_v<T, std::optional<double>> || std::is_same_v<T, std::vector<double>>;

template <class T>
constexpr bool is_text = std::is_same_v<T, std::string> || std::is_same_v<T, std::vector<std::string>>;

/// A limit that is NaN limits nothing, nor does one that is infinite.
std::string finite(const std::string& text) {
  const auto value = to_number(text);
  return !value || std::isfinite(*value) ? "" : "must be a finite number, not " + text;
}

/// Where an empty name meant "none", a variable of a script that is not set would change what a command does.
std::string not_empty(const std::string& text) { return text.empty() ? "must not be empty" : ""; }

/// The commands of a program that its list of arguments names, the last of them.
::CLI::App& named_command(::CLI::App& program) {
  ::CLI::App* command = &program;
  while (!command->get_subcommands().empty()) command = command->get_subcommands().front();
  return *command;
}

std::vector<std::string> options_of(::CLI::App& command) {
  std::vector<std::string> names;
  for (const ::CLI::Option* option : command.get_options()) {
    const auto shown = shown_names(*option);
    names.insert(names.end(), shown.begin(), shown.end());
  }
  return names;
}

std::vector<std::string> commands_of(::CLI::App& program) {
  std::vector<std::string> names;
  for (const ::CLI::App* command : program.get_subcommands([](::CLI::App*) { return true; }))
    if (!command->get_group().empty()) names.push_back(command->get_name());  // else it is hidden
  return names;
}

std::string unknown_option(const std::string& given, ::CLI::App& program, ::CLI::App& command) {
  const std::string option = given.substr(0, given.find('='));
  const auto known = options_of(command);
  if (std::ranges::find(known, option) != known.end())
    return fmt::format("option {} belongs behind the command: {} ... {}", option, command.get_name(), option);
  const std::string of = &program == &command ? "" : " of " + command.get_name();
  return fmt::format("unknown option '{}'{}{}", option, of, twin::did_you_mean(option, known));
}

/// What is wrong with the arguments that nothing took; empty where `error` says it better.
std::string of_remaining(::CLI::App& program, const ::CLI::ParseError& error) {
  const int code = error.get_exit_code();
  if (code != int(::CLI::ExitCodes::RequiredError) && code != int(::CLI::ExitCodes::ExtrasError)) return {};
  ::CLI::App& command = named_command(program);
  const auto commands = commands_of(command);
  const bool wants_command = command.get_require_subcommand_min() > 0;
  const std::vector<std::string> remaining = program.remaining(true);
  const auto option =
      std::ranges::find_if(remaining, [](const auto& word) { return word.size() > 1 && word[0] == '-'; });
  if (option != remaining.end()) return unknown_option(*option, program, command);
  const std::string list = fmt::format("{}", fmt::join(commands, ", "));
  if (remaining.empty()) return wants_command ? fmt::format("a command is missing; one of {}", list) : std::string();
  const std::string& word = remaining.front();
  if (!wants_command) return fmt::format("unexpected argument '{}'", word);
  const std::string meant = twin::did_you_mean(word, commands);
  return fmt::format("unknown command '{}'{}", word, meant.empty() ? "; one of " + list : meant);
}

}  // namespace

template <class T>
Option* App::add_option(const std::string& name, T& variable, const std::string& help) {
  ::CLI::Option& option = *made_->app.add_option(name, variable, help);
  if constexpr (is_real<T>) option.check(finite, "");
  if constexpr (is_text<T>) option.check(not_empty, "");
  const std::string type = option.get_type_name();
  auto made = std::make_unique<Option::Made>(Option::Made{option, type.substr(0, type.find(':'))});
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
  auto made =
      std::make_unique<Made>(Made{nullptr, *made_->app.add_subcommand(name, description), made_->name + " " + name});
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
App* App::hide() {
  made_->app.group("");
  made_->hidden = true;
  return this;
}

void App::set_version_flag(const std::string& version, const std::string& json) {
  const ::CLI::App& app = made_->app;
  made_->app.set_version_flag("--version", [&app, version, json] {
    const auto* own = app.get_option_no_throw("--json");
    const auto others = app.remaining();  // --json where the program itself has no such option
    return (own && own->count() > 0) || std::ranges::find(others, "--json") != others.end() ? json : version;
  });
}

/// What every program and command has: its help and --color.
void App::prepare() {
  made_->app.set_help_flag("-h,--help", "Print this help");
  made_->app.formatter_fn([this](const ::CLI::App*, const std::string&, ::CLI::AppFormatMode) {
    return help_text(describe(), twin::Stream::output);
  });
  add_option("--color,--colour", made_->colour, "Whether to colour messages and headings")
      ->check(IsMember({"auto", "always", "never"}));
  if (!made_->program) options_.back()->hide();
}

void App::parse(int argc, const char* const* argv) {
  try {
    made_->app.parse(argc, argv);
  } catch (const ::CLI::ParseError& error) {
    if (const std::string better = of_remaining(made_->app, error); !better.empty())
      throw ParseError(
          std::make_shared<const ParseError::Made>(ParseError::Made{::CLI::ParseError(better, error.get_exit_code())}));
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

Description App::describe() const {
  Description d{.name = made_->name,
                .summary = made_->app.get_description(),
                .footer = made_->app.get_footer(),
                .needs_command = made_->app.get_require_subcommand_min() > 0,
                .hidden = made_->hidden};
  for (const auto& option : options_)
    if (option != options_.front()) d.options.push_back(option->describe());
  const auto flag = [&](std::vector<std::string> names, std::string help) {
    d.options.push_back({.names = std::move(names), .help = std::move(help)});
  };
  d.options.push_back(options_.front()->describe());  // --color, behind those of the command
  if (made_->program) flag({"--version"}, "Print version, engine, commit and compiler; with --json also the libraries");
  flag({"-h", "--help"}, "Print this help");
  for (const auto& command : commands_) d.commands.push_back(command->describe());
  return d;
}

const App& App::given() const {
  for (const auto& command : commands_)
    if (*command) return command->given();
  return *this;
}

}  // namespace tribotwin::CLI
