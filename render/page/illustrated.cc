#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/render/page/figure_data.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::render {
namespace {

/// As much higher as a key of more than three lines needs.
FigureSize with_room_for_key(const Figure& figure) {
  int count = 0, longest = 0;
  for (const Series& s : figure.series)
    if (!s.label.empty()) ++count, longest = std::max(longest, static_cast<int>(s.label.size()));
  const int columns = std::max(1, 440 / (8 * longest + 50)), lines = (count + columns - 1) / columns;
  return {520, 370 + 19 * std::clamp(lines - 3, 0, 30)};
}

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
  if (!figure.matrix) return with_room_for_key(figure);
  const int n = static_cast<int>(figure.matrix->names.size());
  return {std::max(520, 170 + 52 * n), std::max(370, 90 + 32 * n)};
}

}  // namespace

std::vector<std::string> identity_of(const ReportOptions& o, const std::string& otherwise, const std::string& measured,
                                     const std::string& simulated_by) {
  return {o.robot.empty() ? otherwise : o.robot, serial_number_in_words(o.serial_number),
          !measured.empty() ? "data of " + measured
          : !o.date.empty() ? "newest file written " + o.date
                            : "",
          "page made with " + o.software, simulated_by.empty() ? "" : "simulated by " + simulated_by};
}

std::string source_of(const std::string& kind, const std::vector<std::string>& files) {
  if (files.empty()) return {};
  std::vector<std::string> names;
  for (const auto& file : files) names.push_back(without_folder(file));
  if (names.size() > 3) names = {fmt::format("{} and {} more", names.front(), names.size() - 1)};
  return fmt::format("{}{}: {}", kind, files.size() > 1 ? "s" : "", fmt::join(names, ", "));
}

Result<void> IllustratedPage::keep(const std::string& name, std::string bytes, const char* ending) {
  std::string file = fmt::format("{:02}_{}.{}", shown_, name, ending);
  if (const auto why = twin::unfit_file_name(file))
    return work_failed(fmt::format("the file of figure {}: {}; give the joint another name", shown_, *why));
  files_.push_back({std::move(file), std::move(bytes)});
  return {};
}

Result<void> IllustratedPage::show(pugi::xml_node to, const Figure& figure, const std::string& name,
                                   const std::string& caption, Width width) {
  const FigureSize size = width == Width::small ? FigureSize{300, 220} : size_of(figure);
  auto svg = draw(figure, Format::svg, size);
  if (!svg) return tl::unexpected(svg.error());
  ++shown_;
  for (const Format format : formats_) {
    auto file = draw(figure, format, size);
    if (!file) return tl::unexpected(file.error());
    const char* ending = format == Format::pdf ? "pdf" : format == Format::png ? "png" : "svg";
    if (auto kept = keep(name, std::move(*file), ending); !kept) return kept;
  }
  const std::string data = figure_data(figure);
  add_svg(to, {.markup = *svg, .data = data, .inverts = figure.matrix || figure.heat_map}, caption,
          figure.title.empty() ? caption : figure.title + ". " + caption, width);
  return {};
}

Result<void> IllustratedPage::show(pugi::xml_node to, const Image& image, const std::string& name,
                                   const std::string& caption, Width width) {
  std::string bytes = png(image);
  add_png(to, bytes, caption, caption, width);
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

void IllustratedPage::open(const Opening& o) {
  struct Lamp {
    const char *kind, *name;
  };
  static constexpr Lamp lamps[] = {{"good", "Green"}, {"warn", "Amber"}, {"bad", "Red"}};
  const Lamp lamp = lamps[static_cast<int>(o.light)];
  std::string identity;
  for (const auto& part : o.identity)
    if (!part.empty()) identity += (identity.empty() ? "" : " · ") + part;
  if (!identity.empty()) add(body(), "p", identity, "identity soft");
  add(body(), "p", o.verdict, (std::string("verdict ") + lamp.kind).c_str()).append_attribute("id") = "verdict";
  add_named(body(), lamp.name, ": " + o.rule, (std::string("lamp ") + lamp.kind).c_str());
  if (!o.tiles.empty()) {
    auto grid = add(body(), "div", {}, "tiles");
    for (const Tile& t : o.tiles) tile(grid, t.name, t.value, t.more, t.kind);
  }
  auto action = add(body(), "p");
  add(action, "strong", "What to do: ");
  add(action, "span", o.action);
}

void IllustratedPage::add_origin(const std::string& command) {
  add(body(), "h2", "Origin");
  add(body(), "p", "To make this page again:");
  add(body(), "pre", command);
}

}  // namespace tribotwin::render
