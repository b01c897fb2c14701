#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/render/offscreen/changes.hpp>
#include <tribotwin/render/offscreen/renderer.hpp>

namespace tribotwin::render {
namespace {

// Larger pictures are drawn in tiles of this side: memory stays bounded, and no framebuffer limit matters.
constexpr int tile_side = 4096;

// Of a painted geom's colour, the part that glows and the part that is lit: its shape is seen and, under the light of a
// usual scene, the colour is that of the legend.
constexpr float glowing = 0.7F, lit = 0.35F;

Result<mjvCamera> camera_of(const mjModel* m, const mjData* d, const View& view, double aspect) {
  mjvCamera camera;
  mjv_defaultFreeCamera(m, &camera);
  const bool free = view.azimuth_deg || view.elevation_deg || view.distance_m || view.look_at_m;
  if (!view.camera.empty() && free)
    return tl::unexpected(fmt::format(
        "camera '{}' has its own place: azimuth, elevation, distance and look-at are for a free camera", view.camera));
  const int id = mj_name2id(m, mjOBJ_CAMERA, free ? "" : view.camera.empty() ? "overview" : view.camera.c_str());
  if (id >= 0) {
    camera.type = mjCAMERA_FIXED;
    camera.fixedcamid = id;
  } else if (!view.camera.empty()) {
    std::string names;
    for (int i = 0; i < m->ncam; ++i)
      if (const char* name = mj_id2name(m, mjOBJ_CAMERA, i)) names += (names.empty() ? "" : ", ") + std::string(name);
    return tl::unexpected(
        fmt::format("camera '{}': the model has {}", view.camera, names.empty() ? "no named camera" : names));
  }
  if (view.azimuth_deg) camera.azimuth = *view.azimuth_deg;
  if (view.elevation_deg) camera.elevation = *view.elevation_deg;
  if (view.distance_m) camera.distance = *view.distance_m;
  if (view.look_at_m) std::ranges::copy(*view.look_at_m, camera.lookat);
  if (id < 0)
    frame(camera, static_cast<double>(m->vis.global.fovy), aspect, view.whole.empty() ? outline(m, d) : view.whole,
          {.look_at = view.look_at_m.has_value(), .distance = view.distance_m.has_value()});
  return camera;
}

void remove_texture(auto& geom) {
  if constexpr (requires { geom.matid; })
    geom.matid = -1;
  else
    geom.texid = -1;
}

void scale_sensor(auto& camera, float& width, int tile_width, int whole_width) {
  if (camera.frustum_width == 0) return;
  width = 2 * camera.frustum_width;
  camera.frustum_width *= static_cast<float>(tile_width) / static_cast<float>(whole_width);
}

/// The part of the camera's picture that lies in the tile; all in pixels from the bottom left.
auto tile_of(auto camera, Size whole, mjrRect tile) {
  const auto full = camera;
  const float height = full.frustum_top - full.frustum_bottom;
  float width = height * static_cast<float>(whole.width) / static_cast<float>(whole.height);
  // Half the width of a camera with a sensor in MuJoCo 3.x, which then comes before the shape of the picture.
  if constexpr (requires { camera.frustum_width; }) scale_sensor(camera, width, tile.width, whole.width);
  const auto at = [](float from, float span, double share) { return static_cast<float>(from + span * share); };
  camera.frustum_bottom = at(full.frustum_bottom, height, static_cast<double>(tile.bottom) / whole.height);
  camera.frustum_top = at(full.frustum_bottom, height, static_cast<double>(tile.bottom + tile.height) / whole.height);
  camera.frustum_center = at(full.frustum_center - width / 2, width, (tile.left + tile.width / 2.0) / whole.width);
  return camera;
}

/// A light at the eye for models that have none: MuJoCo's own is too dim to be the only one, and may be off.
void light_up(mjModel& m) {
  auto& light = m.vis.headlight;
  light.active = 1;
  std::ranges::fill(light.ambient, 0.35F);
  std::ranges::fill(light.diffuse, 0.6F);
  std::ranges::fill(light.specular, 0.2F);
}

/// Whether a sphere, an ellipsoid or the end of a capsule is so large that few stacks are seen as corners of its
/// outline.
bool has_large_rounds(const mjModel* m) {
  const auto any = [limit_m = 0.02 * m->stat.extent](const int* type, const mjtNum* size_m, int count) {
    for (int i = 0; i < count; ++i) {
      const mjtNum* s = size_m + 3 * i;
      if ((type[i] == mjGEOM_SPHERE || type[i] == mjGEOM_CAPSULE) && s[0] > limit_m) return true;
      if (type[i] == mjGEOM_ELLIPSOID && *std::max_element(s, s + 3) > limit_m) return true;
    }
    return false;
  };
  return any(m->geom_type, m->geom_size, m->ngeom) || any(m->site_type, m->site_size, m->nsite);
}

mjrRect whole(Size size) { return {0, 0, size.width, size.height}; }

bool has_sky(const mjModel* m) {
  return std::any_of(m->tex_type, m->tex_type + m->ntex, [](int type) { return type == mjTEXTURE_SKYBOX; });
}

/// A light background where nothing was drawn, darker upwards; rows start at the bottom.
void paint_sky(std::vector<std::uint8_t>& rgb, const std::vector<float>& depth, mjrRect tile, int height) {
  constexpr Colour low{0xee, 0xf2, 0xf7}, high{0xb9, 0xc8, 0xda};
  for (int y = 0; y < tile.height; ++y) {
    const double share = static_cast<double>(tile.bottom + y) / height;
    const auto mix = [share](int a, int b) { return static_cast<std::uint8_t>(std::lround(a + share * (b - a))); };
    const Colour c{mix(low.r, high.r), mix(low.g, high.g), mix(low.b, high.b)};
    for (int x = 0; x < tile.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.width) + x;
      if (depth[at] < 1) continue;
      rgb[3 * at] = c.r, rgb[3 * at + 1] = c.g, rgb[3 * at + 2] = c.b;
    }
  }
}

/// The mean of each square of n x n pixels, from rows that start at the bottom.
void shrink(const std::vector<std::uint8_t>& rgb, int width, int height, int n, Image& out, int left, int top) {
  const std::size_t row = 3 * static_cast<std::size_t>(width);
  const int area = n * n;
  for (int y = 0; y < height / n; ++y) {
    const std::uint8_t* from = rgb.data() + row * static_cast<std::size_t>(height - (y + 1) * n);
    std::uint8_t* to = out.at(left, top + y);
    if (n == 1) {
      std::copy_n(from, row, to);
      continue;
    }
    for (int x = 0; x < width / n; ++x)
      for (int c = 0; c < 3; ++c, ++to) {
        int sum = area / 2;
        for (int i = 0; i < n; ++i)
          for (int j = 0; j < n; ++j) sum += from[row * i + 3 * (x * n + j) + c];
        *to = static_cast<std::uint8_t>(sum / area);
      }
  }
}

}  // namespace

struct Renderer::Impl {
  Context gl;
  mujoco::ModelPtr model;
  Size size;
  int supersampling;
  mjvScene scene{};
  mjrContext context{};
  mjvOption option{};
  std::vector<std::uint8_t> pixels;
  std::vector<float> depth;  // where the model has no sky
  bool sky = true;
  bool only_changes;
  std::optional<Shown> shown;  // of the picture before
  Image image;

  explicit Impl(Context c) : gl(std::move(c)) {}
  ~Impl() {
    mjr_freeContext(&context);
    mjv_freeScene(&scene);
  }

  mjrRect part_to_draw(const Shown& now) const;
  void draw_part(mjrRect part);
};

/// What of the picture must be drawn, in its pixels from the bottom left.
mjrRect Renderer::Impl::part_to_draw(const Shown& now) const {
  if (!shown || image.width != size.width || image.height != size.height) return whole(size);
  const auto part = changed(model.get(), *shown, now, static_cast<double>(size.width) / size.height);
  if (!part) return {};
  // Edges of shadows and of what is smoothed reach a little farther.
  constexpr int margin = 4;
  const auto low = [](double share, int side) { return std::max(0, static_cast<int>(share * side) - margin); };
  const auto high = [](double share, int side) { return std::min(side, static_cast<int>(share * side) + 1 + margin); };
  const int left = low(part->left, size.width), bottom = low(part->bottom, size.height);
  return {left, bottom, high(part->right, size.width) - left, high(part->top, size.height) - bottom};
}

/// Draws the scene into this part of the picture, given in its pixels from the bottom left; the rest stays.
void Renderer::Impl::draw_part(mjrRect part) {
  if (image.width != size.width || image.height != size.height) image = Image(size.width, size.height);
  const int s = supersampling;
  const Size drawn{size.width * s, size.height * s};
  const mjvGLCamera eyes[2] = {scene.camera[0], scene.camera[1]};
  const int step = tile_side / s * s;  // whole pixels of the picture
  const int right = (part.left + part.width) * s, top = (part.bottom + part.height) * s;
  for (int bottom = part.bottom * s; bottom < top; bottom += step)
    for (int left = part.left * s; left < right; left += step) {
      const mjrRect tile{left, bottom, std::min(step, right - left), std::min(step, top - bottom)};
      for (int eye = 0; eye < 2; ++eye) scene.camera[eye] = tile_of(eyes[eye], drawn, tile);
      const mjrRect viewport{0, 0, tile.width, tile.height};
      mjr_render(viewport, &scene, &context);
      pixels.resize(3 * static_cast<std::size_t>(tile.width) * tile.height);
      if (!sky) depth.resize(static_cast<std::size_t>(tile.width) * tile.height);
      mjr_readPixels(pixels.data(), sky ? nullptr : depth.data(), viewport, &context);
      if (!sky) paint_sky(pixels, depth, tile, drawn.height);
      shrink(pixels, tile.width, tile.height, s, image, left / s, (drawn.height - bottom - tile.height) / s);
    }
}

Renderer::Renderer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer::~Renderer() = default;

Result<Renderer> Renderer::create(const mjModel* model, Size size, Quality quality) {
  for (const int side : {size.width, size.height})
    if (side < side_min || side > side_max)
      return tl::unexpected(fmt::format("a picture of {} x {} pixels: each side must be {} to {}", size.width,
                                        size.height, side_min, side_max));
  if (quality.supersampling < 1 || quality.supersampling > 4)
    return tl::unexpected(fmt::format("supersampling {}: must be 1 to 4", quality.supersampling));
  auto gl = Context::create();
  if (!gl) return tl::unexpected(gl.error());
  auto impl = std::make_unique<Impl>(std::move(*gl));
  impl->size = size;
  impl->supersampling = quality.supersampling;
  impl->only_changes = quality.only_changes;
  impl->model.reset(mj_copyModel(nullptr, model));
  mjModel* m = impl->model.get();
  const int width = std::min(tile_side, size.width * quality.supersampling),
            height = std::min(tile_side, size.height * quality.supersampling);
  if (std::max(width, height) > impl->gl.side_max())
    return tl::unexpected(
        fmt::format("a picture of {} x {} pixels needs a framebuffer of {} x {}; this OpenGL gives at most {} a side",
                    size.width, size.height, width, height, impl->gl.side_max()));
  m->vis.global.offwidth = width;
  m->vis.global.offheight = height;
  m->vis.quality.offsamples = quality.samples;
  m->vis.quality.numslices = std::min(m->vis.quality.numslices, quality.slices_max);
  m->vis.quality.numstacks = std::min(m->vis.quality.numstacks, quality.stacks_max);
  if (!has_large_rounds(m)) m->vis.quality.numstacks = std::min(m->vis.quality.numstacks, quality.straight_stacks_max);
  m->vis.quality.shadowsize = std::min(m->vis.quality.shadowsize, quality.shadow_map_max);
  if (m->nlight == 0) light_up(*m);
  mjv_defaultScene(&impl->scene);
  mjv_makeScene(m, &impl->scene, std::max<int>(1000, 2 * static_cast<int>(m->ngeom) + 500));
  mjr_defaultContext(&impl->context);
  mjr_makeContext(m, &impl->context, mjFONTSCALE_100);
  mjr_setBuffer(mjFB_OFFSCREEN, &impl->context);
  if (impl->context.currentBuffer != mjFB_OFFSCREEN || impl->context.offWidth < width ||
      impl->context.offHeight < height)
    return work_failed(
        fmt::format("no offscreen framebuffer of {} x {} pixels with {} samples", width, height, quality.samples));
  mjv_defaultOption(&impl->option);
  for (int group = 0; group < groups_shown(model); ++group) impl->option.geomgroup[group] = 1;
  impl->sky = has_sky(model);
  return Renderer(std::move(impl));
}

void Renderer::resize(Size size) { impl_->size = size; }

Result<Image> Renderer::draw(mjData* d, const View& view, std::span<const Paint> paints) {
  Impl& r = *impl_;
  auto camera = camera_of(r.model.get(), d, view, static_cast<double>(r.size.width) / r.size.height);
  if (!camera) return tl::unexpected(camera.error());
  mjv_updateScene(r.model.get(), d, &r.option, nullptr, &*camera, mjCAT_ALL, &r.scene);
  for (int i = 0; i < r.scene.ngeom; ++i) {
    mjvGeom& geom = r.scene.geoms[i];
    if (geom.objtype != mjOBJ_GEOM) continue;
    const auto paint = std::ranges::find(paints, geom.objid, &Paint::geom);
    if (paint == paints.end()) continue;
    const Colour c = paint->colour;
    remove_texture(geom);
    for (int channel = 0; const auto part : {c.r, c.g, c.b})
      geom.rgba[channel++] = lit * static_cast<float>(part) / 255;
    geom.emission = glowing / lit;
    geom.specular = geom.reflectance = 0;
  }
  if (!r.only_changes) {
    r.draw_part(whole(r.size));
    return std::exchange(r.image, {});
  }
  Shown now(r.scene);
  const mjrRect part = r.part_to_draw(now);
  r.shown.reset();  // until its picture is complete
  r.draw_part(part);
  r.shown = std::move(now);
  return r.image;
}

void pose_kinematics(const mjModel* m, mjData* d) {
  mj_kinematics(m, d);
  mj_comPos(m, d);
  mj_camlight(m, d);
#if mjVERSION_HEADER >= 300
  mj_flex(m, d);
#endif
  mj_tendon(m, d);
}

}  // namespace tribotwin::render
