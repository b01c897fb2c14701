#pragma once

#include <array>
#include <optional>
#include <vector>

#include <mujoco/mujoco.h>

#include <tribotwin/render/offscreen/framing.hpp>

/// Which part of a picture can differ from the one before.
namespace tribotwin::render {

/// What a picture shows, as the engine's scene holds it: geoms as they are painted, lights, both eyes.
struct Shown {
  std::vector<mjvGeom> geoms;
  std::vector<mjvLight> lights;
  std::array<mjvGLCamera, 2> eyes;

  explicit Shown(const mjvScene& scene);
};

/// Left, right, bottom and top as shares of the picture, 0 to 1.
struct Part {
  double left, right, bottom, top;
};
inline constexpr Part whole_picture{0, 1, 0, 1};

/// An upright rectangle around all that differs: the boxes of the geoms that are not where or as they were, and their
/// shadows, in both pictures; nothing if the pictures are the same. The whole picture where that is not known: another
/// eye or light, mirrors, skins, shadows without an end or on a height field, an eye that sees in parallel or has a
/// sensor, something that differs and has no bounds, or reaches behind the eye.
/// `aspect`: width over height.
std::optional<Part> changed(const mjModel* m, const Shown& before, const Shown& now, double aspect);

}  // namespace tribotwin::render
