#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <pango/pangocairo.h>

#include <tribotwin/render/pose/overlay.hpp>

namespace tribotwin::render {
namespace {

/// The picture as a Cairo surface; what was drawn is taken back at the end of its life.
class Canvas {
 public:
  explicit Canvas(Image& image)
      : image_(image),
        surface_(cairo_image_surface_create(CAIRO_FORMAT_RGB24, image.width, image.height), cairo_surface_destroy) {
    for (int y = 0; y < image.height; ++y) {
      const std::uint8_t* p = image.at(0, y);
      std::uint32_t* to = row(y);
      for (int x = 0; x < image.width; ++x, p += 3) to[x] = static_cast<std::uint32_t>(p[0] << 16 | p[1] << 8 | p[2]);
    }
    cairo_surface_mark_dirty(surface_.get());
    cairo_.reset(cairo_create(surface_.get()));
  }
  Canvas(const Canvas&) = delete;
  ~Canvas() {
    cairo_surface_flush(surface_.get());
    for (int y = 0; y < image_.height; ++y) {
      const std::uint32_t* p = row(y);
      std::uint8_t* to = image_.at(0, y);
      for (int x = 0; x < image_.width; ++x, to += 3) {
        to[0] = static_cast<std::uint8_t>(p[x] >> 16);
        to[1] = static_cast<std::uint8_t>(p[x] >> 8);
        to[2] = static_cast<std::uint8_t>(p[x]);
      }
    }
  }

  void colour(Colour c, double opacity = 1) {
    cairo_set_source_rgba(cairo_.get(), c.r / 255.0, c.g / 255.0, c.b / 255.0, opacity);
  }
  void card(double x, double y, double w, double h, double radius) {
    cairo_t* c = cairo_.get();
    cairo_new_sub_path(c);
    cairo_arc(c, x + w - radius, y + radius, radius, -M_PI / 2, 0);
    cairo_arc(c, x + w - radius, y + h - radius, radius, 0, M_PI / 2);
    cairo_arc(c, x + radius, y + h - radius, radius, M_PI / 2, M_PI);
    cairo_arc(c, x + radius, y + radius, radius, M_PI, 1.5 * M_PI);
    cairo_close_path(c);
    cairo_fill(c);
  }
  void box(double x, double y, double w, double h) {
    cairo_rectangle(cairo_.get(), x, y, w, h);
    cairo_fill(cairo_.get());
  }
  cairo_t* operator*() { return cairo_.get(); }

 private:
  std::uint32_t* row(int y) {
    return reinterpret_cast<std::uint32_t*>(cairo_image_surface_get_data(surface_.get()) +
                                            static_cast<std::ptrdiff_t>(y) *
                                                cairo_image_surface_get_stride(surface_.get()));
  }
  Image& image_;
  std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)> surface_;
  std::unique_ptr<cairo_t, decltype(&cairo_destroy)> cairo_{nullptr, cairo_destroy};
};

/// One line of text, set but not yet drawn.
class Text {
 public:
  Text(Canvas& canvas, const std::string& text, double pixels, bool bold = false, double width_max = 0)
      : layout_(pango_cairo_create_layout(*canvas), g_object_unref) {
    const std::unique_ptr<PangoFontDescription, decltype(&pango_font_description_free)> font(
        pango_font_description_from_string(std::string(theme::picture_font).c_str()), pango_font_description_free);
    pango_font_description_set_absolute_size(font.get(), pixels * PANGO_SCALE);
    if (bold) pango_font_description_set_weight(font.get(), PANGO_WEIGHT_BOLD);
    pango_layout_set_font_description(layout_.get(), font.get());
    const std::string shown = printable(text);
    pango_layout_set_single_paragraph_mode(layout_.get(), TRUE);
    pango_layout_set_text(layout_.get(), shown.c_str(), static_cast<int>(shown.size()));
    pango_layout_get_pixel_size(layout_.get(), &width_, &height_);
    if (width_max > 0 && width_ > width_max) {
      pango_layout_set_width(layout_.get(), static_cast<int>(width_max * PANGO_SCALE));
      pango_layout_set_ellipsize(layout_.get(), PANGO_ELLIPSIZE_MIDDLE);
      pango_layout_get_pixel_size(layout_.get(), &width_, &height_);
    }
  }
  int width() const { return width_; }
  int height() const { return height_; }
  void draw(Canvas& canvas, double x, double y) const {
    cairo_move_to(*canvas, x, y);
    pango_cairo_show_layout(*canvas, layout_.get());
  }

 private:
  std::unique_ptr<PangoLayout, decltype(&g_object_unref)> layout_;
  int width_ = 0, height_ = 0;
};

constexpr double text_size = 18;

}  // namespace

void draw_panel(Image& image, const std::string& title, std::span<const PanelRow> rows, double unit) {
  Canvas canvas(image);
  constexpr double pads = 14, margins = 20, lines = 1.5 * text_size, heads = 1.75 * text_size;  // in units
  const double inside_units =
      (title.empty() ? 0 : heads) + lines * static_cast<double>(rows.size()) + 2 * pads - 0.4 * text_size;
  unit = std::min(unit, image.height / (inside_units + 2 * margins));
  const double size = text_size * unit, pad = pads * unit, margin = margins * unit, gap = 18 * unit, chip = 16 * unit;
  const double line = lines * unit, name_max = std::max(0.25 * image.width, 4 * size);
  const bool chips = std::ranges::any_of(rows, &PanelRow::has_chip);
  const Text heading(canvas, title, 1.1 * size, true, image.width - 2 * margin - 2 * pad);
  struct Set {
    Text name, first, second;
  };
  std::vector<Set> set;
  double widest[3] = {};
  for (const auto& row : rows) {
    set.push_back(
        {Text(canvas, row.name, size, false, name_max), Text(canvas, row.first, size), Text(canvas, row.second, size)});
    const double widths[] = {static_cast<double>(set.back().name.width()),
                             static_cast<double>(set.back().first.width()),
                             static_cast<double>(set.back().second.width())};
    for (int i = 0; i < 3; ++i) widest[i] = std::max(widest[i], widths[i]);
  }
  double inside = chips ? chip + 0.6 * gap : 0;
  const double name_at = inside, first_at = name_at + widest[0] + (widest[1] > 0 ? gap + widest[1] : 0);
  const double second_at = first_at + (widest[2] > 0 ? gap + widest[2] : 0);
  inside = rows.empty() ? heading.width() : std::max<double>(second_at, heading.width());
  const double head = title.empty() ? 0 : heads * unit;
  canvas.colour(theme::paper, 0.88);
  canvas.card(margin, margin, inside + 2 * pad, inside_units * unit, 10 * unit);
  canvas.colour(theme::ink);
  heading.draw(canvas, margin + pad, margin + pad);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double y = margin + pad + head + line * static_cast<double>(i), x = margin + pad;
    if (rows[i].has_chip) {
      canvas.colour(rows[i].chip);
      canvas.card(x, y + (set[i].name.height() - chip) / 2, chip, chip, 3 * unit);
    }
    canvas.colour(theme::ink);
    set[i].name.draw(canvas, x + name_at, y);
    set[i].first.draw(canvas, x + first_at - set[i].first.width(), y);
    set[i].second.draw(canvas, x + second_at - set[i].second.width(), y);
  }
}

void draw_colour_bar(Image& image, const ColourBar& bar, double unit) {
  Canvas canvas(image);
  const double size = text_size * unit, pad = 14 * unit, margin = 20 * unit, width = 22 * unit;
  const double height = std::min(0.55 * image.height, 520 * unit);
  const Text label(canvas, bar.label, size);
  std::vector<std::pair<double, Text>> marks;
  double widest = 0;
  for (const double value : ticks(bar.from, bar.to, 6)) {
    marks.emplace_back(value, Text(canvas, fmt::format("{:g}", value), size));
    widest = std::max<double>(widest, marks.back().second.width());
  }
  const double inside = width + 10 * unit + widest + 10 * unit + label.height();
  const double left = image.width - margin - inside - 2 * pad, top = (image.height - height) / 2 - pad - size / 2;
  canvas.colour(theme::paper, 0.88);
  canvas.card(left, top, inside + 2 * pad, height + 2 * pad + size, 10 * unit);
  const double x = left + pad, y = top + pad + size / 2;
  const int steps = std::max(2, static_cast<int>(height));
  for (int i = 0; i < steps; ++i) {
    canvas.colour(viridis(1 - (i + 0.5) / steps));
    canvas.box(x, y + height * i / steps, width, height / steps + 0.5);
  }
  for (const auto& [value, text] : marks) {
    const double at = y + height * (1 - (value - bar.from) / (bar.to - bar.from));
    canvas.colour(theme::ink);
    canvas.box(x + width, at - 0.6 * unit, 5 * unit, 1.2 * unit);
    text.draw(canvas, x + width + 10 * unit + widest - text.width(), at - text.height() / 2.0);
  }
  cairo_save(*canvas);
  cairo_translate(*canvas, left + pad + inside - label.height(), y + height / 2 + label.width() / 2.0);
  cairo_rotate(*canvas, -M_PI / 2);
  label.draw(canvas, 0, 0);
  cairo_restore(*canvas);
}

void draw_text(Image& image, const std::string& text, double x, double y, double unit) {
  Canvas canvas(image);
  canvas.colour(theme::ink);
  Text(canvas, text, text_size * unit, false, image.width - x).draw(canvas, x, y);
}

}  // namespace tribotwin::render
