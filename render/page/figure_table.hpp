#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

#include <tribotwin/render/page/illustrated.hpp>

/// Figures of a page as rows of tables: a new figure is a new row.
namespace tribotwin::render {

/// A figure without its title, and the text below it.
struct Drawing {
  Figure figure;
  std::string caption;
};

/// `draw` makes the figure, or nothing where the input has nothing to show.
template <class... Input>
struct FigureRow {
  std::string_view name;  ///< of its files
  std::string_view title;
  std::optional<Drawing> (*draw)(const Input&...);
};

/// What comes before name and title where a table is drawn for several joints.
struct FigurePrefix {
  std::string name, title;
};

/// Shows the figures of a table in the order of its rows. Fails where one cannot be drawn.
template <class... Input>
Result<void> show_table(IllustratedPage& page, pugi::xml_node to,
                        std::type_identity_t<std::span<const FigureRow<Input...>>> rows, const FigurePrefix& prefix,
                        const Input&... input) {
  for (const auto& row : rows)
    if (std::optional<Drawing> drawing = row.draw(input...)) {
      drawing->figure.title = prefix.title + std::string(row.title);
      if (auto ok = page.show(to, drawing->figure, prefix.name + std::string(row.name), drawing->caption); !ok)
        return ok;
    }
  return {};
}

}  // namespace tribotwin::render
