#include <algorithm>
#include <new>

#include <lodepng.h>

#include <tribotwin/render/offscreen/image.hpp>

namespace tribotwin::render {

std::string png(const Image& image) {
  std::vector<unsigned char> bytes;
  if (lodepng::encode(bytes, image.rgb, image.width, image.height, LCT_RGB)) throw std::bad_alloc();
  return {bytes.begin(), bytes.end()};
}

void paste(Image& whole, const Image& part, int x, int y) {
  const int from_x = std::max(0, -x), to_x = std::min(part.width, whole.width - x);
  for (int row = std::max(0, -y); row < std::min(part.height, whole.height - y); ++row)
    if (from_x < to_x)
      std::copy(part.at(from_x, row), part.at(from_x, row) + 3 * (to_x - from_x), whole.at(x + from_x, y + row));
}

}  // namespace tribotwin::render
