#pragma once

#include <tribotwin/render/page/page.hpp>
#include <tribotwin/render/pose/moment.hpp>

namespace tribotwin::render {

/// At most so many bytes of shapes and poses, compressed: a page stays small enough for a mail.
inline constexpr std::size_t robot_bytes_max = 300'000;

/// Adds the robot in 3-D with a slider over the moments of a record, housings in the colours of `scale`. Meshes are
/// simplified. A robot larger than robot_bytes_max has no such figure, and one without visible shapes neither; the page
/// then says why.
void show_robot(Page& page, pugi::xml_node to, const mujoco::Model& model, const Moments& moments, Scale scale);

}  // namespace tribotwin::render
