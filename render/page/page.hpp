#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <pugixml.hpp>

/// A self-contained page: style and script inside, pictures as data; the script only adds to what is there without it.
/// Text is inserted as text and never becomes markup.
namespace tribotwin::render {

/// As attributes carry bytes.
std::string base64(std::string_view bytes);

/// Compressed, as browsers unpack it: zlib's format (RFC 1950).
std::string deflated(std::string_view bytes);

/// The text with absolute paths shortened to "mjcf/NAME" of what ships, and to names of files else: a page says nothing
/// about the machine that made it.
std::string without_folders(const std::string& text);

/// How much of a page's width a figure takes: half of a screen's; all of it; as little as is readable, for many alike.
enum class Width { normal, wide, small };

class Page {
 public:
  explicit Page(std::string_view title);

  /// The column everything goes into.
  pugi::xml_node body() { return main_; }
  /// <tag class="kind">text</tag>
  static pugi::xml_node add(pugi::xml_node to, const char* tag, std::string_view text = {}, const char* kind = nullptr);
  /// A paragraph that begins with a name in bold, of class `kind`.
  static pugi::xml_node add_named(pugi::xml_node to, std::string_view name, std::string_view text,
                                  const char* kind = nullptr);
  /// A drawing for add_svg. `data`: figure_data() of what it shows, for the script; may be empty. `inverts`: where the
  /// page is dark its colours are turned around; else only those of the theme are exchanged.
  struct Svg {
    std::string_view markup, data{};
    bool inverts = false;
  };
  /// A card with a caption below.
  void add_svg(pugi::xml_node to, const Svg& svg, const std::string& caption, const std::string& alternative,
               Width width = Width::normal);
  void add_png(pugi::xml_node to, std::string_view png, const std::string& caption, const std::string& alternative,
               Width width = Width::normal);
  /// A part of the page that is closed until the reader opens it, and is not printed while closed.
  static pugi::xml_node add_details(pugi::xml_node to, const std::string& summary);
  /// The first column names the rows; columns with numbers are set right.
  static void add_table(pugi::xml_node to, const std::vector<std::string>& head,
                        const std::vector<std::vector<std::string>>& rows);

  /// Lets the script compile the kernel that the page carries (what_if.hpp).
  void allow_kernel();

  /// A robot in 3-D for robot_figure.js: `packed` is deflated() JSON {geometry, joints, scale, moments}, of which
  /// geometry is that of twin/live/protocol, scale [degC, degC] and a moment {time, degC of each joint, pose: position
  /// [m] and quaternion w x y z of each body}. Nothing is shown without scripts or WebGL, nor on paper. The page then
  /// carries three.js, and its policy lets it run.
  void add_robot(pugi::xml_node to, const std::string& packed, const std::string& caption);

  std::string html() const;

 private:
  /// Of scripts, as content security policies name it.
  void allow(const std::string& source);

  pugi::xml_document document_;
  pugi::xml_node main_, policy_;
  std::vector<std::string> allowed_;
  int figures_ = 0;
};

}  // namespace tribotwin::render
