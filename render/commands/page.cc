#include <chrono>
#include <ctime>
#include <optional>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/twin/io/command_line/version.hpp>

namespace tribotwin::render::program {

namespace fs = std::filesystem;

void PageOptions::add_output_to(CLI::App& command, const char* output_help) {
  output.add_to(command, output_help);
  output.add_json_to(command);
  command.add_flag("--png", png, "Also every figure as PNG, in a folder beside the page");
  command.add_flag("--pdf", pdf, "Also every figure as PDF, in a folder beside the page");
  command.add_flag("--quiet", quiet, "No progress");
}

void PageOptions::add_to(CLI::App& command, const char* output_help) {
  add_output_to(command, output_help);
  command.add_option("--robot", robot,
                     "What the page calls the robot (of a run: default is key robot of its scenario)");
  command.add_option("--serial-number", serial_number, "Its serial number, shown on the page");
}

namespace {
/// The day of the newest of the files, by their own time; empty where none is there.
std::string newest_day(const std::vector<fs::path>& files) {
  std::optional<std::time_t> newest;
  for (const auto& file : files) {
    std::error_code error;
    const auto time = fs::last_write_time(file, error);
    if (!error)
      newest = std::max<std::time_t>(newest.value_or(0),
                                     std::chrono::system_clock::to_time_t(std::chrono::file_clock::to_sys(time)));
  }
  return newest ? fmt::format("{:%Y-%m-%d}", fmt::gmtime(*newest)) : "";
}
}  // namespace

void FolderOptions::add_to(CLI::App& command, const char* directory_help) {
  command.add_option("DIR", directory, directory_help)->required();
  PageOptions::add_to(command, "The page (default: DIR/report.html)");
}

PageFile::PageFile(const PageOptions& options, const fs::path& otherwise, const std::vector<fs::path>& inputs)
    : output_(options.output),
      robot_(options.robot),
      serial_number_(options.serial_number),
      date_(newest_day(inputs)),
      quiet_(options.quiet) {
  if (!output_.named()) output_.file = otherwise.string();
  if (const auto ending = fs::path(output_.file).extension(); !ending.empty() && ending != ".html" && ending != ".htm")
    throw twin::InputError(fmt::format("-o {}: a page is HTML, and its name must end in .html; {}", output_.file,
                                       ending == ".pdf"
                                           ? "--pdf writes its figures as PDF, and a browser prints the page to PDF"
                                       : ending == ".png" ? "--png writes its figures as PNG"
                                                          : "--png and --pdf write its figures"));
  twin::or_wrong_input(output_.check(inputs));
  if (options.png) formats_.push_back(Format::png);
  if (options.pdf) formats_.push_back(Format::pdf);
  figures_ = output_.file;
  figures_.replace_extension();
  figures_ += "_figures";
  if (!formats_.empty() && !output_.force && fs::exists(figures_))
    throw twin::InputError(fmt::format("{}: exists; choose another name with -o, or replace what is in it with --force",
                                       figures_.string()));
  if (!formats_.empty()) twin::or_wrong_input(twin::check_output_folder(figures_, twin::Existing::replace));
}

int PageFile::make(const std::string& command_line,
                   const std::function<Result<Report>(const ReportOptions&)>& report) const {
  const Report made = [&] {
    twin::Progress progress(quiet_, "report");
    return twin::or_throw(report({.figure_files = formats_,
                                  .command = command_line,
                                  .progress = [&](double share) { progress(share); },
                                  .software = "tribotwin " + twin::program::version_number(),
                                  .robot = robot_,
                                  .serial_number = serial_number_,
                                  .date = date_}));
  }();
  write_all(made);
  return twin::done;
}

void PageFile::write_all(const Report& made) const {
  for (const auto& text : made.notes) twin::note("{}", text);
  std::vector<std::string> files;
  if (!made.figures.empty()) {
    for (const auto& file : made.figures) files.push_back(figures_ / file.name);
    twin::or_fail(twin::write_folder(figures_, made.figures, output_.existing()));
    if (!output_.json) twin::print("{}/ ({} figures)\n", figures_.string(), made.figures.size());
  }
  if (!output_.json) return write(output_, made.html);
  twin::or_fail(twin::write_file(output_.file, made.html, output_.existing()));
  files.push_back(output_.file);
  print_files(output_, files);
}

}  // namespace tribotwin::render::program
