#pragma once

#include <span>

#include <tribotwin/plugins/drive/drive.hpp>
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

/// A section with the law over speed. Sliders move its curve to another temperature [degC] and load [-]; the values
/// come from the kernel. Without scripts the curve stays at the middle of both. Shows nothing where there is nothing to
/// choose, or no kernel. `speed_max_rad_s`: joint side.
Result<void> show_what_if(IllustratedPage& page, const drive::Drive& drive, double speed_max_rad_s, Choice temperature,
                          Choice load);

}  // namespace tribotwin::render
