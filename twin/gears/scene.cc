#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/gears/drive_elements.hpp>
#include <tribotwin/twin/gears/effort.hpp>
#include <tribotwin/twin/gears/scene.hpp>

namespace tribotwin::twin {
namespace {

/// Lowest point of a geom above the origin of the world [m].
double bottom(const mjModel* m, const mjData* d, int geom) {
  const mjtNum *size = m->geom_size + 3 * geom, *z = d->geom_xmat + 9 * geom + 6;  // the world's z in the geom's frame
  const double centre = d->geom_xpos[3 * geom + 2];
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
      return centre - size[0];
    case mjGEOM_CAPSULE:
      return centre - size[0] - size[1] * std::abs(z[2]);
    case mjGEOM_CYLINDER:
      return centre - size[0] * std::hypot(z[0], z[1]) - size[1] * std::abs(z[2]);
    case mjGEOM_BOX:
      return centre - size[0] * std::abs(z[0]) - size[1] * std::abs(z[1]) - size[2] * std::abs(z[2]);
    case mjGEOM_ELLIPSOID:
      return centre - std::hypot(size[0] * z[0], size[1] * z[1], size[2] * z[2]);
    case mjGEOM_MESH: {
      const int mesh = m->geom_dataid[geom];
      double low = centre;
      for (int v = m->mesh_vertadr[mesh]; v < m->mesh_vertadr[mesh] + m->mesh_vertnum[mesh]; ++v) {
        const float* p = m->mesh_vert + 3 * v;
        low = std::min(low, centre + z[0] * p[0] + z[1] * p[1] + z[2] * p[2]);
      }
      return low;
    }
    default:
      return centre;
  }
}

double lowest(const mjModel* m) {
  const mujoco::DataPtr d(mj_makeData(m));
  mj_forward(m, d.get());
  double low = 0;
  for (int g = 0; g < m->ngeom; ++g)
    if (m->geom_type[g] != mjGEOM_PLANE && m->geom_type[g] != mjGEOM_HFIELD) low = std::min(low, bottom(m, d.get(), g));
  return low;
}

pugi::xml_node world(pugi::xml_document& document) {
  pugi::xml_node root = document.document_element(), found = root.child("worldbody");
  return found ? found : root.append_child("worldbody");
}

using Pair = std::pair<std::string, std::string>;

/// Neighbours in a chain whose geoms touch at d's pose; a base that is part of the world counts, a floor does not.
std::set<Pair> touching_neighbours(const mjModel* m, const mjData* d) {
  const auto above = [m](int body) { return m->body_weldid[m->body_parentid[m->body_weldid[body]]]; };
  const auto is_ground = [m](int geom) {
    return m->geom_bodyid[geom] == 0 && (m->geom_type[geom] == mjGEOM_PLANE || m->geom_type[geom] == mjGEOM_HFIELD);
  };
  std::set<Pair> pairs;
  for (int c = 0; c < d->ncon; ++c) {
    const int one = m->geom_bodyid[d->contact[c].geom1], two = m->geom_bodyid[d->contact[c].geom2];
    const bool neighbours = above(one) == m->body_weldid[two] || above(two) == m->body_weldid[one];
    const char *first = mj_id2name(m, mjOBJ_BODY, one), *second = mj_id2name(m, mjOBJ_BODY, two);
    if (neighbours && first && second && !is_ground(d->contact[c].geom1) && !is_ground(d->contact[c].geom2))
      pairs.insert(std::minmax<std::string>(first, second));
  }
  return pairs;
}

}  // namespace

void add_scene(pugi::xml_document& document, const mjModel* m, bool fixed_base, std::vector<std::string>& notes) {
  if (m->nlight == 0) {
    pugi::xml_node light = world(document).prepend_child("light");
    set_attribute(light, "directional", "true");
    set_attribute(light, "pos", "-2 -2 5");
    set_attribute(light, "dir", ".4 .4 -1");
    notes.emplace_back("a light was added");
  }
  bool ground = false, floating = false;
  for (int g = 0; g < m->ngeom; ++g)
    ground =
        ground || (m->geom_bodyid[g] == 0 && (m->geom_type[g] == mjGEOM_PLANE || m->geom_type[g] == mjGEOM_HFIELD));
  for (int j = 0; j < m->njnt; ++j) floating = floating || (m->jnt_type[j] == mjJNT_FREE && !fixed_base);
  if (ground) return;
  pugi::xml_node floor = world(document).prepend_child("geom");
  set_attribute(floor, "name", mj_name2id(m, mjOBJ_GEOM, "floor") < 0 ? "floor" : "tribotwin_floor");
  set_attribute(floor, "type", "plane");
  set_attribute(floor, "size", "0 0 .05");
  set_attribute(floor, "group", "0");
  set_attribute(floor, "rgba", ".73 .75 .78 1");
  if (!floating) {
    set_attribute(floor, "pos", fmt::format("0 0 {:.4g}", lowest(m)));
    set_attribute(floor, "contype", "0");
    set_attribute(floor, "conaffinity", "0");
  }
  notes.emplace_back(floating ? "a floor was added at height 0" : "a floor without contacts was added below the robot");
}

bool exclude_neighbours(pugi::xml_document& document, const mjModel* m, std::vector<std::string>& notes) {
  const mujoco::DataPtr d(mj_makeData(m));
  if (m->nkey > 0) mju_copy(d->qpos, m->key_qpos, static_cast<int>(m->nq));
  mj_fwdPosition(m, d.get());
  std::set<Pair> pairs = touching_neighbours(m, d.get());
  constexpr int poses = 50;
  std::map<Pair, int> count;
  std::mt19937 random(1);
  for (int i = 0; i < poses; ++i) {
    random_pose(m, d.get(), random);
    mj_fwdPosition(m, d.get());
    for (const Pair& pair : touching_neighbours(m, d.get())) ++count[pair];
  }
  for (const auto& [pair, times] : count)
    if (2 * times > poses) pairs.insert(pair);
  for (const auto& [first, second] : pairs) {
    pugi::xml_node root = document.document_element(), contact = root.child("contact");
    if (!contact) contact = root.append_child("contact");
    pugi::xml_node exclude = contact.append_child("exclude");
    set_attribute(exclude, "body1", first);
    set_attribute(exclude, "body2", second);
    notes.push_back(
        fmt::format("'{}' and '{}' overlap where they are joined; contacts between them are excluded", first, second));
  }
  return !pairs.empty();
}

}  // namespace tribotwin::twin
