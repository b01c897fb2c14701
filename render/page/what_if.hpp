#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/uncertainty.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/live/page.hpp>

namespace tribotwin::render {

/// What the build embeds: kernel.wasm, our own functions for browsers; nothing where it was built without clang's
/// packages for them.
std::span<const twin::live::PageFile> kernel_files();

/// What a reader may choose; where `high` is not above `low` there is nothing to choose.
struct Choice {
  double low, high;
};

/// What a slider chooses; where `to` is not above `from` there is none.
struct Slider {
  std::string name, unit;
  double from, to, value;
  int decimals;
};

/// Puts sliders before a figure of series, the last child of `grid`; what_if.js moves its curves by what `kind` says
/// ("law", "warm-up"), with `numbers`, each the bytes that the kernel takes, and `more` for the script alone.
void add_sliders(IllustratedPage& page, pugi::xml_node grid, const char* kind, std::span<const Slider> sliders,
                 std::span<const std::string_view> numbers, const nlohmann::json& more = nullptr);

/// A section with the law over speed. Sliders move its curve to another temperature [degC] and load [-], with its band
/// of 95 % where `uncertainty` is not null; the values come from the kernel. Without scripts the curve stays at the
/// middle of both. Shows nothing where there is nothing to choose, or no kernel. `speed_max_rad_s`: joint side.
Result<void> show_what_if(IllustratedPage& page, const drive::Drive& drive, double speed_max_rad_s, Choice temperature,
                          Choice load, const friction::Uncertainty* uncertainty = nullptr);

}  // namespace tribotwin::render
