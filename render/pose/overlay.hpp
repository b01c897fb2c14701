#pragma once

#include <span>
#include <string>

#include <tribotwin/render/offscreen/image.hpp>
#include <tribotwin/render/theme/theme.hpp>

/// Text and legends over a picture, drawn by Cairo and Pango: any language, any size.
namespace tribotwin::render {

struct PanelRow {
  Colour chip;
  bool has_chip;
  std::string name, first, second;  ///< columns; plain text
};

/// A panel at the top left: a title, then rows in columns. `unit` is the picture's measure: 1/960 of the height of a
/// single picture; text is 18 units high, or as much less as lets all rows fit into the picture.
void draw_panel(Image& image, const std::string& title, std::span<const PanelRow> rows, double unit);

struct ColourBar {
  std::string label;  ///< with its unit in brackets
  double from, to;
};
/// A colour bar at the right edge.
void draw_colour_bar(Image& image, const ColourBar& bar, double unit);

/// A line of text with its top left corner at (x, y), dark on what is there.
void draw_text(Image& image, const std::string& text, double x, double y, double unit);

}  // namespace tribotwin::render
