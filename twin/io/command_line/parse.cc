#include <exception>
#include <memory>
#include <new>
#include <sstream>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/io/command_line/parse.hpp>
#include <tribotwin/twin/io/command_line/version.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/shipped.hpp>

namespace tribotwin::twin::program {
namespace {

std::vector<std::string> stems(const std::vector<std::filesystem::path>& files) {
  std::vector<std::string> names;
  for (const auto& file : files) names.push_back(file.stem().string());
  return names;
}

/// What ships, and the laws.
CLI::CompletionValues completion_values(const CLI::CompletionValues& beside) {
  std::vector<std::string> laws;
  for (const auto& law : friction::laws()) laws.emplace_back(law.name);
  const auto models = stems(shipped_models());
  CLI::CompletionValues values{{"SCENARIO", stems(shipped_scenarios(Purpose::scenario))},
                               {"CAMPAIGN", stems(shipped_scenarios(Purpose::campaign))},
                               {"FIT", stems(shipped_scenarios(Purpose::fit))},
                               {"PLAN", stems(shipped_scenarios(Purpose::plan))},
                               {"MODEL", models},
                               {"--law", laws},
                               {"--friction", laws}};
  for (const auto& [option, words] : beside) values[option].insert(values[option].end(), words.begin(), words.end());
  return values;
}

/// The commands that packages use: they are not shown in help.
void add_hidden_commands(CLI::App& app, int& code, const CLI::CompletionValues& values) {
  const auto shell = std::make_shared<std::string>();
  auto* completion = app.add_subcommand("completion", "Print the completion script of a shell")->hide();
  completion->add_option("SHELL", *shell, "The shell")->required()->check(CLI::IsMember({"bash", "zsh", "fish"}));
  completion->callback([&app, &code, shell, &values] {
    print_text(CLI::completion_script(app.describe(), *shell, completion_values(values)));
    code = done;
  });
  app.add_subcommand("man-page", "Print the manual page")->hide()->callback([&app, &code] {
    print_text(CLI::man_page(app.describe(), version_number(), version_date()));
    code = done;
  });
}

/// Whether the arguments end where a command is missing.
bool command_missing(const CLI::App& app, int argc, const char* const* argv) {
  const auto innermost = app.given().describe();
  return innermost.needs_command && innermost.word() == argv[argc - 1];
}

}  // namespace

int parse(const std::string& program, const std::string& engine, CLI::App& app, int argc, const char* const* argv,
          int& code, const CLI::CompletionValues& values) {
  choose_colour(argc, argv);
  app.set_version_flag(version_text(program, engine), version_json(program, engine));
  add_hidden_commands(app, code, values);
  if (argc == 1) {
    report_text(CLI::help_text(app.describe(), Stream::messages));
    return finish(program, wrong_input);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    std::ostringstream out, error;
    code = app.exit(e, out, error) == 0 ? done : wrong_input;
    print_text(out.str());
    if (code == done)
      report_text(error.str());
    else if (command_missing(app, argc, argv))
      report_text(CLI::help_text(app.given().describe(), Stream::messages));
    else
      report_text(error.str());
  } catch (const std::bad_alloc&) {
    code = report_error(program, failed, "out of memory");
  } catch (const InputError& e) {
    code = report_error(program, wrong_input, e.what());
  } catch (const std::exception& e) {
    code = report_error(program, failed, e.what());
  }
  return finish(program, code);
}

}  // namespace tribotwin::twin::program
