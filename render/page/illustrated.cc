#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

FigureSize size_of(const Figure& figure) {
  if (figure.surface) return {640, 430};
  if (figure.heat_map) {
    const int columns = static_cast<int>(figure.heat_map->columns.size()),
              rows = static_cast<int>(figure.heat_map->rows.size());
    return {std::clamp(290 + 52 * columns, 520, 960), std::clamp(150 + 26 * rows, 320, 1400)};
  }
  if (figure.ranking) {
    const auto bars = static_cast<int>(figure.ranking->names.size() * figure.ranking->bars.size());
    return {520, std::clamp(110 + 26 * bars, 190, 900)};
  }
  if (!figure.matrix) return {520, 370};
  const int n = static_cast<int>(figure.matrix->names.size());
  return {std::max(520, 170 + 52 * n), std::max(370, 90 + 32 * n)};
}

}  // namespace

Result<void> IllustratedPage::keep(const std::string& name, std::string bytes, const char* ending) {
  std::string file = fmt::format("{:02}_{}.{}", shown_, name, ending);
  if (const auto why = twin::unfit_file_name(file))
    return work_failed(fmt::format("the file of figure {}: {}; give the joint another name", shown_, *why));
  files_.push_back({std::move(file), std::move(bytes)});
  return {};
}

Result<void> IllustratedPage::show(pugi::xml_node to, const Figure& figure, const std::string& name,
                                   const std::string& caption, bool wide) {
  const FigureSize size = size_of(figure);
  auto svg = draw(figure, Format::svg, size);
  if (!svg) return tl::unexpected(svg.error());
  ++shown_;
  for (const Format format : formats_) {
    auto file = draw(figure, format, size);
    if (!file) return tl::unexpected(file.error());
    const char* ending = format == Format::pdf ? "pdf" : format == Format::png ? "png" : "svg";
    if (auto kept = keep(name, std::move(*file), ending); !kept) return kept;
  }
  add_svg(to, *svg, caption, figure.title + ". " + caption, wide);
  return {};
}

Result<void> IllustratedPage::show(pugi::xml_node to, const Image& image, const std::string& name,
                                   const std::string& caption, bool wide) {
  std::string bytes = png(image);
  add_png(to, bytes, caption, caption, wide);
  ++shown_;
  return formats_.empty() ? Result<void>() : keep(name, std::move(bytes), "png");
}

void IllustratedPage::tile(pugi::xml_node tiles, const std::string& name, const std::string& value,
                           const std::string& more, const char* kind) {
  auto node = add(tiles, "div", {}, "tile");
  add(node, "div", name, "name");
  add(node, "div", value, kind ? (std::string("value ") + kind).c_str() : "value");
  if (!more.empty()) add(node, "div", more, "more");
}

void IllustratedPage::add_origin(const std::string& command) {
  add(body(), "h2", "Origin");
  add(body(), "p", "To make this page again:");
  add(body(), "pre", command);
}

}  // namespace tribotwin::render
