#pragma once

#include <functional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/figure/figure.hpp>
#include <tribotwin/render/offscreen/image.hpp>
#include <tribotwin/render/page/page.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::render {

struct ReportOptions {
  std::vector<Format> figure_files;  ///< also every figure as a file of each of these formats (poses are PNG always)
  std::string command;               ///< the command line that makes this report; shown in it
  std::function<void(double)> progress;
  std::string software{};                ///< "tribotwin 0.1.0", which makes the page
  std::string robot{}, serial_number{};  ///< of what the page is about, as the user calls it; may be empty
  std::string date{};                    ///< when the newest file that is read was written: "2026-11-25"
};

struct Report {
  std::string html;
  std::vector<twin::OutputFile> figures;
  std::vector<std::string> notes;  ///< what could not be shown, for stderr; the page says so too
};

/// What identifies a page of results. `otherwise`, where the user names no robot: the one that a model names, or
/// source_of the data; may be empty. `measured`: the date of the newest data, where they have one. `simulated_by`: the
/// engine that simulated the data, as these say; empty where they do not, and of measured data.
std::vector<std::string> identity_of(const ReportOptions& options, const std::string& otherwise,
                                     const std::string& measured = "", const std::string& simulated_by = "");
/// "recording: a.csv", "recordings: a.csv, b.csv"; of more than three "recordings: a.csv and 4 more"; nothing of none.
std::string source_of(const std::string& kind, const std::vector<std::string>& files);

/// A page with figures, each of which may also become a file.
/// Green: nothing to do. Amber: read what is said before figures are used. Red: act first.
enum class Light { green, amber, red };

/// A number in a page's head, with its name and a remark. `kind` is "good", "warn" or "bad".
struct Tile {
  std::string name, value, more{};
  const char* kind = nullptr;
};

/// What a reader who reads nothing else needs.
struct Opening {
  std::string verdict;  ///< one sentence
  Light light;
  std::string rule;  ///< why the light has this colour
  std::vector<Tile> tiles;
  std::string action;                   ///< what to do
  std::vector<std::string> identity{};  ///< robot, serial number, date, software; empty ones are left out
};

class IllustratedPage : public Page {
 public:
  /// `figure_files`: also every figure as a file of each of these formats (pictures are PNG always).
  IllustratedPage(std::string_view title, std::vector<Format> figure_files)
      : Page(title), formats_(std::move(figure_files)) {}

  /// Draws a figure; `name` is that of its files. Fails where it cannot be drawn.
  Result<void> show(pugi::xml_node to, const Figure& figure, const std::string& name, const std::string& caption,
                    Width width = Width::normal);
  Result<void> show(pugi::xml_node to, const Image& image, const std::string& name, const std::string& caption,
                    Width width = Width::normal);
  /// A number in the page's head, with its name and a remark. `kind` is "good" or "bad".
  static void tile(pugi::xml_node tiles, const std::string& name, const std::string& value, const std::string& more,
                   const char* kind = nullptr);

  /// How every page begins; before the opening only its title.
  void open(const Opening& opening);
  /// The last section: how the page was made, which `command` makes it again.
  void add_origin(const std::string& command);
  Report report(std::vector<std::string> notes) { return {html(), std::move(files_), std::move(notes)}; }

 private:
  Result<void> keep(const std::string& name, std::string bytes, const char* ending);

  std::vector<Format> formats_;
  std::vector<twin::OutputFile> files_;
  int shown_ = 0;
};

}  // namespace tribotwin::render
