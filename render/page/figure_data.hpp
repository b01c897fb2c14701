#pragma once

#include <string>

#include <tribotwin/render/figure/figure.hpp>

namespace tribotwin::render {

/// The values of a figure of series, to seven digits, as the page's script reads them (JSON without characters that
/// markup knows); empty for surfaces, matrices, heat maps, rankings and equal scales, which stay as they are drawn.
std::string figure_data(const Figure& figure);

}  // namespace tribotwin::render
