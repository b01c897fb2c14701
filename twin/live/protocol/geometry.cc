#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <numbers>
#include <optional>
#include <unordered_map>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/live/protocol/geometry.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::live {
namespace {

using Json = nlohmann::ordered_json;
using Vertex = std::array<float, 3>;
using Face = std::array<int, 3>;

struct Mesh {
  std::vector<Vertex> vertices;
  std::vector<Face> faces;
};

Mesh mesh_of(const mjModel* m, int id) {
  Mesh mesh;
  const float* vertices = m->mesh_vert + 3 * static_cast<std::ptrdiff_t>(m->mesh_vertadr[id]);
  for (int v = 0; v < m->mesh_vertnum[id]; ++v, vertices += 3)
    mesh.vertices.push_back({vertices[0], vertices[1], vertices[2]});
  const int* faces = m->mesh_face + 3 * static_cast<std::ptrdiff_t>(m->mesh_faceadr[id]);
  for (int f = 0; f < m->mesh_facenum[id]; ++f, faces += 3) mesh.faces.push_back({faces[0], faces[1], faces[2]});
  return mesh;
}

/// All vertices in one cell of a grid become their mean; faces that shrink to a line are gone.
Mesh clustered(const Mesh& mesh, int cells) {
  Vertex low = mesh.vertices.front(), high = low;
  for (const Vertex& v : mesh.vertices)
    for (std::size_t k = 0; k < 3; ++k) low[k] = std::min(low[k], v[k]), high[k] = std::max(high[k], v[k]);
  float side = 0;
  for (std::size_t k = 0; k < 3; ++k) side = std::max(side, high[k] - low[k]);
  const float cell = std::max(side, 1e-9F) / static_cast<float>(cells);
  std::unordered_map<std::uint64_t, int> places;
  std::vector<int> place_of, counts;
  Mesh made;
  for (const Vertex& v : mesh.vertices) {
    std::uint64_t key = 0;
    for (std::size_t k = 0; k < 3; ++k)
      key = key << 21 | static_cast<std::uint64_t>(std::clamp((v[k] - low[k]) / cell, 0.0F, 1e6F));
    const auto [at, fresh] = places.try_emplace(key, static_cast<int>(made.vertices.size()));
    const auto place = static_cast<std::size_t>(at->second);
    place_of.push_back(at->second);
    if (fresh) made.vertices.push_back({}), counts.push_back(0);
    for (std::size_t k = 0; k < 3; ++k) made.vertices[place][k] += v[k];
    ++counts[place];
  }
  for (std::size_t i = 0; i < counts.size(); ++i)
    for (float& x : made.vertices[i]) x /= static_cast<float>(counts[i]);
  for (const Face& f : mesh.faces) {
    const Face moved{place_of[static_cast<std::size_t>(f[0])], place_of[static_cast<std::size_t>(f[1])],
                     place_of[static_cast<std::size_t>(f[2])]};
    if (moved[0] != moved[1] && moved[1] != moved[2] && moved[2] != moved[0]) made.faces.push_back(moved);
  }
  return made;
}

/// With at most so many triangles.
Mesh simplified(const Mesh& mesh, std::size_t triangles) {
  if (mesh.faces.size() <= triangles || mesh.vertices.empty()) return mesh;
  for (double cells = 1 + std::sqrt(static_cast<double>(triangles)); cells >= 1; cells *= 0.95) {
    Mesh made = clustered(mesh, static_cast<int>(cells));
    if (made.faces.size() <= triangles) return made;
  }
  return {};
}

/// How many triangles each mesh may have: small ones keep theirs, the large share what is left.
std::vector<std::size_t> shares(const std::vector<std::size_t>& wanted, std::size_t all) {
  std::vector<std::size_t> order(wanted.size()), given(wanted.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::ranges::sort(order, {}, [&](std::size_t i) { return wanted[i]; });
  for (std::size_t done = 0; done < order.size(); ++done) {
    given[order[done]] = std::min(wanted[order[done]], all / (order.size() - done));
    all -= given[order[done]];
  }
  return given;
}

/// Shortest digits that give the same float again.
template <class Numbers>
void append_numbers(std::string& text, const Numbers& rows) {
  text += '[';
  for (const auto& row : rows)
    for (const auto number : row) fmt::format_to(std::back_inserter(text), "{},", number);
  if (text.back() == ',') text.pop_back();
  text += ']';
}

std::string mesh_text(const mjModel* m, int id, std::size_t triangles) {
  const Mesh whole = mesh_of(m, id), shown = simplified(whole, triangles);
  const char* name = mj_id2name(m, mjOBJ_MESH, id);
  std::string text = fmt::format(R"({{"name":{},"faces_of_model":{},"vertices":)", dump_json(Json(name ? name : "")),
                                 whole.faces.size());
  append_numbers(text, shown.vertices);
  text += ",\"faces\":";
  append_numbers(text, shown.faces);
  return text + "}";
}

const char* type_name(int type) {
  switch (type) {
    case mjGEOM_PLANE:
      return "plane";
    case mjGEOM_SPHERE:
      return "sphere";
    case mjGEOM_CAPSULE:
      return "capsule";
    case mjGEOM_ELLIPSOID:
      return "ellipsoid";
    case mjGEOM_CYLINDER:
      return "cylinder";
    case mjGEOM_BOX:
      return "box";
    case mjGEOM_MESH:
      return "mesh";
    default:
      return nullptr;
  }
}

/// As MuJoCo's renderer: the geom's own colour if it is not the default grey, else that of its material.
std::array<float, 4> colour_of(const mjModel* m, int geom) {
  constexpr std::array default_grey{0.5F, 0.5F, 0.5F, 1.0F};
  const float* own = m->geom_rgba + 4 * static_cast<std::ptrdiff_t>(geom);
  const int material = m->geom_matid[geom];
  if (material >= 0 && std::equal(own, own + 4, default_grey.begin()))
    own = m->mat_rgba + 4 * static_cast<std::ptrdiff_t>(material);
  return {own[0], own[1], own[2], own[3]};
}

bool is_shown(const mjModel* m, int geom, int groups) {
  return m->geom_group[geom] >= 0 && m->geom_group[geom] < groups && colour_of(m, geom)[3] > 0;
}

Json numbers(const mjtNum* from, int count) { return std::vector<double>(from, from + count); }

/// Where the eye of the first picture is, from the robot: that of the camera "overview", else of a free one.
Json eye(const mjModel* m) {
  if (const int camera = mj_name2id(m, mjOBJ_CAMERA, "overview"); camera >= 0 && m->cam_bodyid[camera] == 0) {
    mjtNum axes[9];
    mju_quat2Mat(axes, m->cam_quat + 4 * static_cast<std::ptrdiff_t>(camera));
    return {axes[2], axes[5], axes[8]};
  }
  mjvCamera free;
  mjv_defaultFreeCamera(m, &free);
  const double to_rad = std::numbers::pi / 180, a = free.azimuth * to_rad, e = free.elevation * to_rad;
  return {-std::cos(e) * std::cos(a), -std::cos(e) * std::sin(a), -std::sin(e)};
}

class Writer {
 public:
  Writer(const mujoco::Model& model, const GeometryLimits& limits) : m_(model.get()), limits_(limits) {
    joint_of_body_.resize(static_cast<std::size_t>(m_->nbody));
    housing_of_geom_.resize(static_cast<std::size_t>(m_->ngeom));
    for (const auto& drive : model.drives()) {
      const std::string joint = joint_name(m_, drive);
      const int body = m_->jnt_bodyid[drive.joint];
      std::string& of_body = joint_of_body_[static_cast<std::size_t>(body)];
      if (of_body.empty()) of_body = joint;
      if (const int geom = mj_name2id(m_, mjOBJ_GEOM, ("housing_" + joint).c_str()); geom >= 0)
        housing_of_geom_[static_cast<std::size_t>(geom)] = joint;
      else
        bodies_as_housings_.emplace_back(body, joint);
    }
    for (const auto& [body, joint] : bodies_as_housings_)
      for (int geom = m_->body_geomadr[body]; geom < m_->body_geomadr[body] + m_->body_geomnum[body]; ++geom)
        if (auto& of_geom = housing_of_geom_[static_cast<std::size_t>(geom)]; of_geom.empty()) of_geom = joint;
  }

  std::string text() {
    Json bodies = Json::array();
    for (int body = 0; body < m_->nbody; ++body) bodies.push_back(body_json(body));
    const Json rest{{"left_out", left_out_}, {"eye", eye(m_)}};
    std::string all = "{\"bodies\":" + dumped(bodies) + ",\"meshes\":[";
    std::vector<std::size_t> wanted;
    for (const int mesh : meshes_) wanted.push_back(static_cast<std::size_t>(m_->mesh_facenum[mesh]));
    const std::vector<std::size_t> given = shares(wanted, limits_.triangles);
    for (std::size_t i = 0; i < meshes_.size(); ++i) all += (i ? "," : "") + mesh_text(m_, meshes_[i], given[i]);
    return all + "]," + dumped(rest).substr(1);
  }

 private:
  static std::string dumped(const Json& json) { return dump_json(json); }
  static Json or_null(const std::string& text) { return text.empty() ? Json(nullptr) : Json(text); }

  Json body_json(int body) {
    const char* name = mj_id2name(m_, mjOBJ_BODY, body);
    Json geoms = Json::array();
    for (int i = 0; i < m_->body_geomnum[body]; ++i) {
      const int geom = m_->body_geomadr[body] + i;
      if (!is_shown(m_, geom, limits_.groups)) continue;
      if (geoms_ >= limits_.geoms || !type_name(m_->geom_type[geom])) {
        ++left_out_;
        continue;
      }
      ++geoms_;
      geoms.push_back(geom_json(geom));
    }
    return {{"name", name ? name : ""},
            {"parent", m_->body_parentid[body]},
            {"joint", or_null(joint_of_body_[static_cast<std::size_t>(body)])},
            {"geoms", std::move(geoms)}};
  }

  Json geom_json(int geom) {
    const auto at = static_cast<std::ptrdiff_t>(geom);
    const char* name = mj_id2name(m_, mjOBJ_GEOM, geom);
    const bool is_mesh = m_->geom_type[geom] == mjGEOM_MESH;
    return {{"name", name ? name : ""},
            {"type", type_name(m_->geom_type[geom])},
            {"size", numbers(m_->geom_size + 3 * at, 3)},
            {"pos", numbers(m_->geom_pos + 3 * at, 3)},
            {"quat", numbers(m_->geom_quat + 4 * at, 4)},
            {"rgba", colour_of(m_, geom)},
            {"mesh", is_mesh ? Json(place_of(m_->geom_dataid[geom])) : Json(nullptr)},
            {"housing", or_null(housing_of_geom_[static_cast<std::size_t>(geom)])}};
  }

  /// Among the meshes that are sent.
  std::size_t place_of(int mesh) {
    const auto found = std::ranges::find(meshes_, mesh);
    if (found != meshes_.end()) return static_cast<std::size_t>(found - meshes_.begin());
    meshes_.push_back(mesh);
    return meshes_.size() - 1;
  }

  const mjModel* m_;
  const GeometryLimits limits_;
  std::vector<std::string> joint_of_body_, housing_of_geom_;
  std::vector<std::pair<int, std::string>> bodies_as_housings_;
  std::vector<int> meshes_;
  std::size_t geoms_ = 0, left_out_ = 0;
};

}  // namespace

std::string geometry_json(const mujoco::Model& model, const GeometryLimits& limits) {
  return Writer(model, limits).text();
}

void read_poses(const mjModel* m, const mjData* d, std::span<float> to) {
  auto at = to.begin();
  for (int body = 0; body < m->nbody; ++body) {
    const auto b = static_cast<std::ptrdiff_t>(body);
    for (int k = 0; k < 3; ++k) *at++ = static_cast<float>(d->xpos[3 * b + k]);
    for (int k = 0; k < 4; ++k) *at++ = static_cast<float>(d->xquat[4 * b + k]);
  }
}

}  // namespace tribotwin::twin::live
