#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <tribotwin/render/commands/program.hpp>
#include <tribotwin/render/page/illustrated.hpp>

/// Options and output that the commands for pages share.
namespace tribotwin::render::program {

struct PageOptions {
  twin::Destination output;
  bool png = false, pdf = false, quiet = false;
  std::string robot, serial_number;

  /// All but those of the robot, for pages of many robots.
  void add_output_to(CLI::App& command, const char* output_help);
  void add_to(CLI::App& command, const char* output_help);
};

/// Options of the commands that read one folder.
struct FolderOptions : PageOptions {
  std::string directory;

  void add_to(CLI::App& command, const char* directory_help);
};

/// A page and its figures as files. The names are checked before any work and the files are written at its end.
class PageFile {
 public:
  /// The page is `otherwise` where no -o names it. Throws InputError where a file cannot be written or is an input.
  PageFile(const PageOptions& options, const std::filesystem::path& otherwise,
           const std::vector<std::filesystem::path>& inputs);
  /// `file` is one of the folder whose day the page has.
  PageFile(const FolderOptions& options, const char* file)
      : PageFile(options, std::filesystem::path(options.directory) / "report.html",
                 {std::filesystem::path(options.directory) / file}) {}

  /// Makes the page, shows its progress and writes it. Returns the exit code.
  int make(const std::string& command_line, const std::function<Result<Report>(const ReportOptions&)>& report) const;

 private:
  void write_all(const Report& made) const;

  twin::Destination output_;
  std::string robot_, serial_number_, date_;
  bool quiet_;
  std::filesystem::path figures_;
  std::vector<Format> formats_;
};

}  // namespace tribotwin::render::program
