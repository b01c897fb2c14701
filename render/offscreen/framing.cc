#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <tribotwin/render/offscreen/framing.hpp>

namespace tribotwin::render {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double filled = 0.86;  // share of the picture, each way

/// Whether a geom of the first `groups` is drawn, and belongs to a tree of bodies that moves somewhere.
bool counts(const mjModel* m, int geom, int groups) {
  const int type = m->geom_type[geom], body = m->geom_bodyid[geom], root = m->body_rootid[body];
  if (type == mjGEOM_PLANE || type == mjGEOM_HFIELD || body == 0 || m->geom_group[geom] >= groups) return false;
  if (m->geom_matid[geom] < 0 && m->geom_rgba[4 * geom + 3] == 0) return false;
  for (int b = root; b < m->nbody; ++b)
    if (m->body_rootid[b] == root && m->body_jntnum[b] > 0) return true;
  return false;
}

/// The axes of a free camera: right, up, and where it looks.
std::array<Point, 3> axes_of(const mjvCamera& camera) {
  const double to_rad = std::numbers::pi / 180, a = camera.azimuth * to_rad, e = camera.elevation * to_rad;
  return {{{std::sin(a), -std::cos(a), 0},
           {-std::cos(a) * std::sin(e), -std::sin(a) * std::sin(e), std::cos(e)},
           {std::cos(a) * std::cos(e), std::sin(a) * std::cos(e), std::sin(e)}}};
}

}  // namespace

Box box_around(const mjModel* m, int type, const Point& s, int mesh) {
  const auto centred = [](double x, double y, double z) { return Box{{-x, -y, -z}, {x, y, z}}; };
  switch (type) {
    case mjGEOM_SPHERE:
      return centred(s[0], s[0], s[0]);
    case mjGEOM_CAPSULE:
      return centred(s[0], s[0], s[0] + s[1]);
    case mjGEOM_CYLINDER:
      return centred(s[0], s[0], s[1]);
    case mjGEOM_MESH: {
      Box box{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
      for (int v = m->mesh_vertadr[mesh]; v < m->mesh_vertadr[mesh] + m->mesh_vertnum[mesh]; ++v)
        for (std::size_t k = 0; k < 3; ++k) {
          const double x = m->mesh_vert[3 * static_cast<std::size_t>(v) + k];
          box.low[k] = std::min(box.low[k], x), box.high[k] = std::max(box.high[k], x);
        }
      return box;
    }
    default:  // boxes and ellipsoids
      return centred(s[0], s[1], s[2]);
  }
}

int groups_shown(const mjModel* m) {
  constexpr int visual = 3;  // MuJoCo draws groups 0 to 2 by default; by custom the others hold collision geometry
  for (int g = 0; g < m->ngeom; ++g)
    if (counts(m, g, visual)) return visual;
  return mjNGROUP;
}

std::vector<Point> outline(const mjModel* m, const mjData* d) {
  std::vector<Point> points;
  const int groups = groups_shown(m);
  for (int g = 0; g < m->ngeom; ++g) {
    if (!counts(m, g, groups)) continue;
    const mjtNum* size = m->geom_size + 3 * g;
    const Box box = box_around(m, m->geom_type[g], {size[0], size[1], size[2]}, m->geom_dataid[g]);
    std::ranges::copy(corners(box, d->geom_xpos + 3 * g, d->geom_xmat + 9 * g), std::back_inserter(points));
  }
  return points;
}

void frame(mjvCamera& camera, double fovy_deg, double aspect, std::span<const Point> points, Fixed fixed) {
  if (points.empty() || (fixed.look_at && fixed.distance)) return;
  const auto axes = axes_of(camera);
  const double tangent = filled * std::tan(fovy_deg * std::numbers::pi / 360), slopes[] = {tangent * aspect, tangent};
  // In the camera's axes a point is seen where |x - cx| <= slope (z - cz); the eye c moves back until all are.
  Point eye{0, 0, infinity};
  double nearest = infinity, farthest = -infinity;
  for (std::size_t k = 0; k < 2; ++k) {
    double high = -infinity, low = infinity;
    for (const Point& p : points) {
      const double x = dot(axes[k], p), z = dot(axes[2], p);
      high = std::max(high, x - slopes[k] * z), low = std::min(low, x + slopes[k] * z);
      nearest = std::min(nearest, z), farthest = std::max(farthest, z);
    }
    eye[k] = (high + low) / 2;
    eye[2] = std::min(eye[2], (low - high) / (2 * slopes[k]));
  }
  const Point given{camera.lookat[0], camera.lookat[1], camera.lookat[2]};
  if (fixed.look_at) {
    camera.distance = 0;
    for (const Point& p : points)
      for (std::size_t k = 0; k < 2; ++k)
        camera.distance = std::max(camera.distance, std::abs(dot(axes[k], p) - dot(axes[k], given)) / slopes[k] -
                                                        dot(axes[2], p) + dot(axes[2], given));
    return;
  }
  const double middle = (nearest + farthest) / 2;
  if (!fixed.distance) camera.distance = middle - eye[2];
  for (std::size_t k = 0; k < 3; ++k)
    camera.lookat[k] = eye[0] * axes[0][k] + eye[1] * axes[1][k] + middle * axes[2][k];
}

}  // namespace tribotwin::render
