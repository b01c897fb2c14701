#pragma once

#include <array>
#include <span>
#include <vector>

#include <mujoco/mujoco.h>

/// Where a free camera must be so that a robot is seen whole.
namespace tribotwin::render {

using Point = std::array<double, 3>;  ///< world axes [m]

/// In the frame of a geom.
struct Box {
  Point low, high;
};

inline double dot(const Point& a, const Point& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// Its corners, world axes [m], in a frame at `place` that is turned by the 3 x 3 matrix `turn`, rows first.
template <class Number>
std::array<Point, 8> corners(const Box& box, const Number* place, const Number* turn) {
  std::array<Point, 8> all;
  for (std::size_t i = 0; i < 8; ++i) {
    const Point p{i & 1 ? box.high[0] : box.low[0], i & 2 ? box.high[1] : box.low[1], i & 4 ? box.high[2] : box.low[2]};
    for (std::size_t k = 0; k < 3; ++k)
      all[i][k] = place[k] + turn[3 * k] * p[0] + turn[3 * k + 1] * p[1] + turn[3 * k + 2] * p[2];
  }
  return all;
}

/// Of a geom with bounds: sphere, capsule, ellipsoid, cylinder, box (`size` as mjModel.geom_size has it) or mesh (by
/// its number; -1 for the others).
Box box_around(const mjModel* m, int type, const Point& size, int mesh);

/// How many groups of geoms are drawn: the usual three, or all where nothing that moves would be visible.
int groups_shown(const mjModel* model);

/// Corners of the boxes around the geoms that are drawn by default, of bodies that move and of what carries them, at
/// d's pose: no ground, no scenery. Empty where a model has none.
std::vector<Point> outline(const mjModel* m, const mjData* d);

/// What of a free camera is chosen already.
struct Fixed {
  bool look_at = false, distance = false;
};

/// Moves `camera`, a free one whose angles are set, so that all points lie in the picture with some space around them.
/// `aspect`: width over height. What is fixed is kept.
void frame(mjvCamera& camera, double fovy_deg, double aspect, std::span<const Point> points, Fixed fixed = {});

}  // namespace tribotwin::render
