#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {

/// {"files": [...]}: what --json prints where the result of a command is files.
std::string files_json(std::span<const std::string> files);

/// Where a command's result goes: the file named with -o, or stdout without one.
struct Destination {
  std::string file;
  bool force = false;  ///< the file may replace one that exists
  bool json = false;   ///< the names of the files written are printed as JSON

  /// Adds the options -o and --force to a CLI::App; returns the first. `former`: an older name of -o, as ",--csv".
  template <class Command>
  auto* add_to(Command& command, const std::string& help, const std::string& former = "") {
    auto* option = command.add_option("-o,--output" + former, file, help);
    command.add_flag("--force", force, "Replace files that exist");
    return option;
  }
  /// Adds --json to a command whose result is files.
  template <class Command>
  void add_json_to(Command& command) {
    command.add_flag("--json", json, "Print the names of the files written as JSON");
  }
  bool named() const { return !file.empty(); }
  Existing existing() const { return replace_if(force); }

  /// Before any work: whether the file can become an output of a command that reads `inputs`.
  Result<void> check(const std::vector<std::filesystem::path>& inputs) const {
    if (json && !named()) return tl::unexpected(Error("--json names the file that is written; give -o FILE with it"));
    return named() ? check_output(file, existing(), inputs) : Result<void>{};
  }
  /// Writes the result. What fails now is failed work: check() has refused wrong input.
  Result<void> deliver(std::string_view text) const {
    if (!named()) return print_text(text), Result<void>{};
    const auto written = write_file(file, text, existing());
    if (!written) return work_failed(written.error().message);
    if (json) print_text(files_json(std::array{file}));
    return {};
  }
};

}  // namespace tribotwin::twin
