#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace tribotwin::render {

/// A picture in memory: sRGB, 8 bit, three bytes a pixel, rows from the top.
struct Image {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;

  Image() = default;
  Image(int w, int h) : width(w), height(h), rgb(3 * static_cast<std::size_t>(w) * static_cast<std::size_t>(h)) {}
  std::uint8_t* at(int x, int y) { return rgb.data() + 3 * (static_cast<std::size_t>(y) * width + x); }
  const std::uint8_t* at(int x, int y) const { return rgb.data() + 3 * (static_cast<std::size_t>(y) * width + x); }
  bool operator==(const Image&) const = default;
};

/// A picture of at least one pixel as a PNG file's bytes. The same picture gives the same bytes.
std::string png(const Image& image);

/// Copies `part` into `whole` with its top left corner at (x, y); what lies outside is cut.
void paste(Image& whole, const Image& part, int x, int y);

}  // namespace tribotwin::render
