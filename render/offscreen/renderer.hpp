#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/render/offscreen/context.hpp>
#include <tribotwin/render/offscreen/framing.hpp>
#include <tribotwin/render/offscreen/image.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {

struct Size {
  int width = 1280, height = 960;
  bool operator==(const Size&) const = default;
};
/// 16..8192 a side.
inline constexpr int side_min = 16, side_max = 8192;

struct Quality {
  int samples = 4;                           ///< multisampling
  int supersampling = 2;                     ///< pixels drawn per pixel of the picture, each way: 1..4
  int slices_max = 1000, stacks_max = 1000;  ///< of cylinders, spheres and the like, which are drawn with facets
  int straight_stacks_max = 1000;            ///< the same where nothing round is thicker than 4 % of the model's extent
  int shadow_map_max = 16384;                ///< side of the map of each light's shadows [pixels]
  bool only_changes = false;                 ///< draws only what can differ from the picture before, for films
};
/// Of pictures that a page or a film shows smaller, or for a moment: less than a quarter of the time.
inline constexpr Quality plain_quality{
    .samples = 4, .supersampling = 1, .slices_max = 40, .stacks_max = 12, .shadow_map_max = 2048};
inline constexpr Quality film_quality = [] {
  Quality quality = plain_quality;
  quality.straight_stacks_max = 6;  // of cylinders, whose stacks are not seen but are most of the triangles
  quality.only_changes = true;
  return quality;
}();

/// Where the eye is: a camera of the model by name, or free. Without a name: the camera "overview" if there is one and
/// no value of a free view is given; else free, with the model's angles and, where neither distance nor point is given,
/// so that the robot is seen whole.
struct View {
  std::string camera;
  std::optional<double> azimuth_deg, elevation_deg, distance_m;
  std::optional<Point> look_at_m;
  std::vector<Point> whole;  ///< what must be seen, for several pictures of one view; empty: the robot at its pose
};

/// A geom of the model drawn in another colour, with little shading, so that the colour matches that of a legend.
struct Paint {
  int geom;
  Colour colour;
};

/// Draws one model in pictures of one size at a time, in the thread that made it. The same pose gives the same pixels;
/// with only_changes rounding may place an edge between other samples of a pixel: in less than one of 1,000 pixels.
class Renderer {
 public:
  /// Fails on sizes out of range and where the context gives no such framebuffer; the message has the figures.
  static Result<Renderer> create(const mjModel* model, Size size, Quality quality = {});
  Renderer(Renderer&&) noexcept;
  ~Renderer();

  /// Of the next pictures: no side longer than at first.
  void resize(Size size);

  /// d belongs to the model and has kinematics, cameras and lights of its pose (mj_forward or pose_kinematics).
  /// Fails on a camera the model does not have.
  Result<Image> draw(mjData* d, const View& view, std::span<const Paint> paints = {});

 private:
  struct Impl;
  explicit Renderer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// What a picture of d's qpos needs, without forces, plugins or a change of its time.
void pose_kinematics(const mjModel* m, mjData* d);

}  // namespace tribotwin::render
