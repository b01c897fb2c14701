#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <span>

#include <tribotwin/render/offscreen/changes.hpp>

namespace tribotwin::render {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

template <class T>
bool same(std::span<const T> a, std::span<const T> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

Point point(const float* p) { return {p[0], p[1], p[2]}; }
Point along(const Point& from, const Point& way, double times) {
  return {from[0] + times * way[0], from[1] + times * way[1], from[2] + times * way[2]};
}
Point to(const Point& from, const Point& there) { return along(there, from, -1); }

bool bounded(int type) {
  return type == mjGEOM_SPHERE || type == mjGEOM_CAPSULE || type == mjGEOM_ELLIPSOID || type == mjGEOM_CYLINDER ||
         type == mjGEOM_BOX || type == mjGEOM_MESH;
}

/// The corners of the box around a bounded geom, world axes [m].
std::array<Point, 8> corners(const mjModel* m, const mjvGeom& geom) {
  Point size = point(geom.size);
  // What is drawn has its half length as third size, what the model has as second.
  if (geom.type == mjGEOM_CAPSULE || geom.type == mjGEOM_CYLINDER) size[1] = size[2];
  // A drawn mesh has twice its number, or one more for its convex hull.
  const Box box = box_around(m, geom.type, size, geom.type == mjGEOM_MESH ? geom.dataid / 2 : -1);
  return corners(box, geom.pos, geom.mat);
}

struct Plane {
  Point at, normal;
  bool hides;  ///< what lies behind it: it has no ends, and the eye is in front

  double height_of(const Point& p) const { return dot(to(at, p), normal); }
};

/// What a shadow can fall on: planes, and a ball around everything else.
struct Receivers {
  std::vector<Plane> planes;
  Point middle{};
  double radius_m = 0;
};

Receivers receivers(const mjModel* m, const Shown& shown) {
  Receivers all;
  std::vector<Point> points;
  for (const mjvGeom& geom : shown.geoms)
    if (geom.type == mjGEOM_PLANE) {
      Plane plane{point(geom.pos), {geom.mat[2], geom.mat[5], geom.mat[8]}, false};
      plane.hides = geom.size[0] == 0 && geom.size[1] == 0 && geom.rgba[3] == 1 &&
                    std::ranges::all_of(shown.eyes, [&](auto& eye) { return plane.height_of(point(eye.pos)) > 0; });
      all.planes.push_back(plane);
    } else if (bounded(geom.type)) {
      std::ranges::copy(corners(m, geom), std::back_inserter(points));
    }
  for (const Point& p : points) all.middle = along(all.middle, p, 1.0 / static_cast<double>(points.size()));
  for (const Point& p : points)
    all.radius_m = std::max(all.radius_m, std::sqrt(dot(to(all.middle, p), to(all.middle, p))));
  return all;
}

bool is_directional(const auto& light) {
  if constexpr (requires { light.directional; })
    return light.directional;
  else
    return light.type == 1;  // mjLIGHT_DIRECTIONAL, of which 2.2.2 has no name
}

/// Which way the light goes on from p.
Point way_of(const mjvLight& light, const Point& p) {
  return is_directional(light) ? point(light.dir) : to(point(light.pos), p);
}

/// How steeply the light falls on a plane from each of these points; nothing where it falls on it from some alone.
std::optional<std::array<double, 8>> down(const mjvLight& light, const Plane& plane,
                                          const std::array<Point, 8>& points) {
  std::array<double, 8> all;
  std::ranges::transform(points, all.begin(), [&](const Point& p) { return -dot(way_of(light, p), plane.normal); });
  const bool one_side = std::ranges::all_of(all, [&](double d) { return d != 0 && (d > 0) == (all[0] > 0); });
  return one_side ? std::optional(all) : std::nullopt;
}

/// Where the shadow of a box with these corners ends, behind all that it can fall on; nothing where it has no end.
std::optional<std::array<Point, 8>> ends(const std::array<Point, 8>& points, const mjvLight& light,
                                         const Receivers& receivers) {
  std::array<double, 8> times{};
  const auto reach = [&](const Plane& plane, const std::array<double, 8>& steep) {
    for (int i = 0; i < 8; ++i) times[i] = std::max(times[i], plane.height_of(points[i]) / steep[i]);
  };
  const auto ended = [&] {
    std::array<Point, 8> all;
    for (int i = 0; i < 8; ++i) all[i] = along(points[i], way_of(light, points[i]), times[i]);
    return all;
  };
  for (const Plane& plane : receivers.planes)
    if (const auto steep = down(light, plane, points); plane.hides && steep && steep->front() > 0) {
      reach(plane, *steep);
      return ended();
    }
  // Else up to a plane across the light's way that leaves the ball behind it, and to all planes.
  const Point middle = along(points[0], to(points[0], points[7]), 0.5), axis = way_of(light, middle);
  const double length = std::sqrt(dot(axis, axis));
  const Plane last{along(receivers.middle, axis, receivers.radius_m / length), along({}, axis, -1 / length), false};
  const auto ahead = down(light, last, points);
  if (!(length > 0) || !ahead || ahead->front() < 0) return std::nullopt;
  reach(last, *ahead);
  for (const Plane& plane : receivers.planes) {
    const auto steep = down(light, plane, points);
    if (!steep) return std::nullopt;
    reach(plane, *steep);
  }
  return ended();
}

/// A pixel of the shadow map where it falls on p [m].
double shadow_pixel_m(const mjModel* m, const mjvLight& light, const Point& p) {
  const Point way = way_of(light, p);
  constexpr double to_rad = std::numbers::pi / 180;
  const double half = is_directional(light)
                          ? m->vis.map.shadowclip * m->stat.extent
                          : std::sqrt(dot(way, way)) * std::tan(std::min<double>(light.cutoff, 80) * to_rad);
  return 2 * half / m->vis.quality.shadowsize;
}

/// The rectangle around points that one eye sees; all of the picture once a point is not in front of it.
class Seen {
 public:
  Seen(const mjvGLCamera& eye, double aspect) : eye_(eye), aspect_(aspect) {}

  void add(const Point& p) {
    const Point ahead = point(eye_.forward), up = point(eye_.up), from_eye = to(point(eye_.pos), p);
    const Point right{ahead[1] * up[2] - ahead[2] * up[1], ahead[2] * up[0] - ahead[0] * up[2],
                      ahead[0] * up[1] - ahead[1] * up[0]};
    const double depth = dot(from_eye, ahead), near = eye_.frustum_near;
    if (!(depth > near)) {
      part_ = whole_picture;
      return;
    }
    const double height = eye_.frustum_top - eye_.frustum_bottom, width = height * aspect_;
    const double x = (dot(from_eye, right) / depth * near - eye_.frustum_center) / width + 0.5;
    const double y = (dot(from_eye, up) / depth * near - eye_.frustum_bottom) / height;
    part_ = {std::min(part_.left, x), std::max(part_.right, x), std::min(part_.bottom, y), std::max(part_.top, y)};
  }

  Part within_picture() const {
    const auto inside = [](double share) { return std::clamp(share, 0.0, 1.0); };
    return {inside(part_.left), inside(part_.right), inside(part_.bottom), inside(part_.top)};
  }

 private:
  mjvGLCamera eye_;
  double aspect_;
  Part part_{infinity, -infinity, infinity, -infinity};
};

/// Adds a geom and the shadows that it throws; false where they have no end.
bool add(const mjModel* m, const mjvGeom& geom, const Shown& shown, const Receivers& receivers, Seen& seen) {
  const auto points = corners(m, geom);
  for (const Point& p : points) seen.add(p);
  for (const mjvLight& light : shown.lights) {
    if (!light.castshadow) continue;
    const auto shadow = ends(points, light, receivers);
    if (!shadow) return false;
    for (const Point& p : *shadow) {
      const double more_m = 2 * shadow_pixel_m(m, light, p);
      for (int axis = 0; axis < 3; ++axis)
        for (const double shift_m : {-more_m, more_m}) {
          Point beside = p;
          beside[axis] += shift_m;
          seen.add(beside);
        }
    }
  }
  return true;
}

bool mirrors(const Shown& shown) {
  return std::ranges::any_of(shown.geoms, [](const mjvGeom& geom) { return geom.reflectance > 0; });
}

/// An eye of MuJoCo 3.x that sees in parallel, or as a sensor does.
bool special(const auto& eye) {
  if constexpr (requires { eye.orthographic; })
    return eye.orthographic || eye.frustum_width != 0;
  else
    return false;
}

/// A height field, or what else has a surface but no bounds here, that a shadow can fall on.
bool shaded_without_bounds(const Shown& shown) {
  return std::ranges::any_of(shown.lights, [](const mjvLight& light) { return light.castshadow; }) &&
         std::ranges::any_of(shown.geoms, [](const mjvGeom& geom) {
           return geom.type < mjNGEOMTYPES && geom.type != mjGEOM_PLANE && !bounded(geom.type);
         });
}

bool soft(const mjModel* m) {
#if mjVERSION_HEADER >= 300
  if (m->nflex > 0) return true;
#endif
  return m->nskin > 0;
}

}  // namespace

Shown::Shown(const mjvScene& scene)
    : geoms(scene.geoms, scene.geoms + scene.ngeom),
      lights(scene.lights, scene.lights + scene.nlight),
      eyes{scene.camera[0], scene.camera[1]} {}

std::optional<Part> changed(const mjModel* m, const Shown& before, const Shown& now, double aspect) {
  if (!same<mjvGLCamera>(before.eyes, now.eyes) || !same<mjvLight>(before.lights, now.lights) ||
      before.geoms.size() != now.geoms.size() || mirrors(before) || mirrors(now) || special(now.eyes[0]) || soft(m) ||
      shaded_without_bounds(before) || shaded_without_bounds(now))
    return whole_picture;
  const Receivers before_all = receivers(m, before), now_all = receivers(m, now);
  Seen seen(mjv_averageCamera(&now.eyes[0], &now.eyes[1]), aspect);
  bool differs = false;
  for (std::size_t i = 0; i < now.geoms.size(); ++i) {
    const mjvGeom &old = before.geoms[i], &geom = now.geoms[i];
    if (same<mjvGeom>({&old, 1}, {&geom, 1})) continue;
    if (!bounded(old.type) || !bounded(geom.type)) return whole_picture;
    if (!add(m, old, before, before_all, seen) || !add(m, geom, now, now_all, seen)) return whole_picture;
    differs = true;
  }
  return differs ? std::optional(seen.within_picture()) : std::nullopt;
}

}  // namespace tribotwin::render
