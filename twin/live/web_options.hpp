#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/live/server.hpp>

namespace tribotwin::twin::live {

/// --web and --web-readonly of the commands that have a live bench.
struct WebOptions {
  std::string address;
  bool readonly = false;
  std::string origin, folder;

  void add_to(CLI::App& command) {
    given_ = command
                 .add_option("--web", address,
                             "Show the joints in a browser: where the page is served, 127.0.0.1:8080 without a value; "
                             "port 0 chooses; the line 'web: http://...' says where. An address that others reach "
                             "needs the token of that line")
                 ->expected(0, 1);
    auto* only = command.add_flag("--web-readonly", readonly, "The page shows and changes nothing")->needs(given_);
    command
        .add_option(
            "--web-folder", folder,
            "Folder of the files that a page records or exports (default: that of the results, else the current "
            "one)")
        ->needs(given_)
        ->excludes(only);
    command
        .add_option("--web-origin", origin,
                    "A site that may connect by Foxglove's protocol, as a browser names it: http://localhost:8081, "
                    "file:// for Lichtblick's desktop. It can only listen")
        ->needs(given_);
  }
  bool given() const { return given_ && given_->count() > 0; }
  /// Serves the page and says where. nullptr where the option is not given; throws InputError where its address is
  /// wrong or cannot be had. `results`: the folder of what the program writes; empty: the current one.
  std::unique_ptr<Server> start(Hello hello, const std::filesystem::path& results) const;

 private:
  CLI::Option* given_ = nullptr;
};

}  // namespace tribotwin::twin::live
