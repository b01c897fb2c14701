// A film that draws only what can have changed shows what one shows that draws every picture whole.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include <gtest/gtest.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/render/offscreen/changes.hpp>
#include <tribotwin/render/offscreen/renderer.hpp>

namespace tribotwin::render {
namespace {

std::shared_ptr<const mujoco::Model> loaded(const std::string& name) {
  auto model = mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/" + name + ".xml");
  if (!model) throw std::runtime_error(model.error().message);
  return *model;
}

std::shared_ptr<const mujoco::Model> scene(const std::string& world) {
  auto model = mujoco::load_string("<mujoco><worldbody>" + world + "</worldbody></mujoco>");
  if (!model) throw std::runtime_error(model.error().message);
  return *model;
}

Renderer renderer(const mjModel* m, bool only_changes) {
  auto made = Renderer::create(m, {320, 240}, {.samples = 4, .supersampling = 1, .only_changes = only_changes});
  if (!made) throw std::runtime_error(made.error().message);
  return std::move(*made);
}

Image drawn(Renderer& renderer, mjData* d, const View& view, std::span<const Paint> paints) {
  auto image = renderer.draw(d, view, paints);
  if (!image) throw std::runtime_error(image.error().message);
  return *image;
}

/// Pixels of which a channel differs by more than 2, per thousand.
double different(const Image& a, const Image& b) {
  int count = 0;
  for (std::size_t i = 0; i < a.rgb.size(); i += 3)
    count +=
        std::ranges::any_of(std::array{i, i + 1, i + 2}, [&](auto k) { return std::abs(a.rgb[k] - b.rgb[k]) > 2; });
  return 1000.0 * count / (static_cast<double>(a.rgb.size()) / 3);
}

/// Of all pictures of a film in which every joint swings by `swing` and a geom changes its colour.
double worst_of_film(const mujoco::Model& model, double swing, const View& view = {}) {
  const mjModel* m = model.get();
  const mujoco::DataPtr d(mj_makeData(m));
  if (m->nkey > 0) mj_resetDataKeyframe(m, d.get(), 0);
  const std::vector<double> start(d->qpos, d->qpos + m->nq);
  Renderer whole = renderer(m, false), part = renderer(m, true);
  double worst = 0;
  for (int i = 0; i < 6; ++i) {
    for (std::size_t j = 0; j < start.size(); ++j) d->qpos[j] = start[j] + swing * std::sin(0.7 * i + j);
    pose_kinematics(m, d.get());
    const Paint paint{static_cast<int>(m->ngeom) - 1, {static_cast<std::uint8_t>(40 * i), 100, 200}};
    const auto expected = drawn(whole, d.get(), view, {&paint, 1}), image = drawn(part, d.get(), view, {&paint, 1});
    worst = std::max(worst, different(expected, image));
  }
  return worst;
}

// Rounding moves an edge past one of a pixel's samples now and then. A shadow left behind is ten times as much.
constexpr double rounding = 1;

class ShippedModels : public testing::TestWithParam<const char*> {};
TEST_P(ShippedModels, FilmIsTheSame) {
  const auto model = loaded(GetParam());
  EXPECT_LE(worst_of_film(*model, 0.3, {.whole = {{-1.5, -1.5, 0}, {1.5, 1.5, 2}}}), rounding);
}
INSTANTIATE_TEST_SUITE_P(All, ShippedModels,
                         testing::Values("irb6620", "br609", "er3a_c60", "rh380n_bench", "xl330_pendulum"));

constexpr const char* ball = R"(<body pos="0 0 1"><joint type="slide" axis="1 0.5 0.3"/><geom size=".2"/></body>)";
const View from_aside{.azimuth_deg = 60, .elevation_deg = -25, .distance_m = 6.0, .look_at_m = Point{0, 0, 0.5}};

TEST(Films, ShadowOfASpotFallsOnAWallAndAFloorWithEnds) {
  const auto model = scene(R"(<light pos="-3 -2 3" dir="3 2 -2" castshadow="true"/>
    <geom type="plane" size="1.5 1.5 .1"/><geom type="box" pos="2 1 1" size=".1 2 1"/><geom pos="0 0 -1" size=".5"/>)" +
                           std::string(ball));
  EXPECT_LE(worst_of_film(*model, 0.5, from_aside), rounding);
}

TEST(Films, ShadowsOfTwoLightsOnSlopes) {
  const auto model = scene(R"(<light directional="true" dir="1 0 -1" castshadow="true"/>
    <light directional="true" dir="0 -1 -.2" castshadow="true"/><geom type="plane" size="0 0 1"/>
    <geom type="box" pos="1 0 .5" euler="0 30 20" size=".5 .5 .5"/><geom type="plane" pos="0 -2 0" zaxis="0 1 0"
    size="2 2 1"/>)" + std::string(ball));
  EXPECT_LE(worst_of_film(*model, 0.5, from_aside), rounding);
}

const std::string lamp = R"(<light pos="0 0 4" dir="0 0 -1" castshadow="true"/><geom type="plane" size="0 0 1"/>)";

TEST(Films, LoneRods) {
  const std::string joint = R"(<body pos="0 0 1.2"><joint type="hinge" axis="0 1 0"/>)";
  for (const char* rod : {R"(<geom type="capsule" fromto="0 0 0 0 0 -1" size=".02"/></body>)",
                          R"(<geom type="cylinder" fromto="0 0 0 .8 0 .3" size=".02"/></body>)"}) {
    const auto model = scene(lamp + joint + rod);
    EXPECT_LE(worst_of_film(*model, 0.5, from_aside), rounding) << rod;
  }
}

TEST(Films, Tendon) {
  const auto model = mujoco::load_string("<mujoco><worldbody>" + lamp + R"(<site name="a" pos="1 0 1.5"/>
    <body pos="-1 0 1"><joint type="slide" axis="0 1 0"/><geom size=".02"/><site name="b"/></body></worldbody>
    <tendon><spatial width=".03"><site site="a"/><site site="b"/></spatial></tendon></mujoco>)");
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_LE(worst_of_film(**model, 0.6, from_aside), rounding);
}

TEST(Films, LampBesideARodThatReachesAboveIt) {
  const auto model = scene(R"(<light pos="-1 -.5 1" dir="1 .5 -.3" cutoff="80" castshadow="true"/>
    <geom type="plane" size="0 0 1"/><geom type="box" pos="3 0 1" size=".1 3 1"/>
    <body pos="0 0 .6"><joint type="slide" axis="0 1 0"/><geom type="box" size=".05 .05 .9"/></body>)");
  EXPECT_LE(worst_of_film(*model, 0.3, from_aside), rounding);
}

TEST(Films, CreaseOfFloorAndWall) {
  const auto model = scene(R"(<light directional="true" dir="1 .2 -1" castshadow="true"/><geom type="plane"
    size="0 0 1"/><geom type="plane" pos="1 0 0" zaxis="-1 0 0" size="0 0 1"/><body pos="0 0 1"><joint type="slide"
    axis="0 1 0"/><geom type="box" size=".05 .3 .7"/></body>)");
  EXPECT_LE(worst_of_film(*model, 0.3, from_aside), rounding);
}

TEST(Films, ShadowOnTerrain) {
  const auto model = mujoco::load_string(
      R"(<mujoco><asset><hfield name="hill" nrow="3" ncol="3" size="3 3 .5 .1"/></asset><worldbody>
      <light directional="true" dir=".5 0 -1" castshadow="true"/><geom type="hfield" hfield="hill" pos="0 0 -1"/>)" +
      std::string(ball) + "</worldbody></mujoco>");
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_LE(worst_of_film(**model, 0.5, from_aside), rounding);
}

TEST(Films, MirrorShowsWhatMoves) {
  const auto model = mujoco::load_string(
      R"(<mujoco><asset><material name="mirror" reflectance=".8"/></asset><worldbody>
      <light directional="true" dir="0 0 -1"/><geom type="plane" size="2 2 1" material="mirror"/>)" +
      std::string(ball) + "</worldbody></mujoco>");
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_LE(worst_of_film(**model, 0.5, from_aside), rounding);
}

TEST(Films, EyeAndLightThatMoveAlong) {
  const auto model = scene(R"(<geom type="plane" size="0 0 1"/><body pos="0 0 1"><joint type="slide" axis="1 0 0"/>
    <geom size=".2"/><camera name="on" pos="0 -3 1" zaxis="0 -1 .3"/><light pos="0 0 2" castshadow="true"/></body>)");
  EXPECT_LE(worst_of_film(*model, 0.5, {.camera = "on"}), rounding);
  EXPECT_LE(worst_of_film(*model, 0.5, from_aside), rounding);
}

TEST(Films, WhatComesBehindTheEye) {
  const auto model = scene(R"(<light directional="true" dir="0 1 -1" castshadow="true"/>
    <geom type="plane" size="0 0 1"/><body pos="0 0 .5"><joint type="slide" axis="0 1 0"/>
    <geom type="box" size=".1 4 .1"/></body><camera name="near" pos="0 -2 1" xyaxes="1 0 0 0 .4 1"/>)");
  EXPECT_LE(worst_of_film(*model, 3, {.camera = "near"}), rounding);
}

/// What the scene of this model shows from aside, the ball moved by q [m].
Shown shown(const mjModel* m, double q) {
  const mujoco::DataPtr d(mj_makeData(m));
  d->qpos[0] = q;
  pose_kinematics(m, d.get());
  mjvOption option;
  mjvCamera camera;
  mjvScene scene;
  mjv_defaultOption(&option);
  mjv_defaultFreeCamera(m, &camera);
  mjv_defaultScene(&scene);
  mjv_makeScene(m, &scene, 100);
  // A renderer has one scene: what the engine leaves unwritten, padding and the rest of labels, stays as it is.
  std::memset(scene.geoms, 0, 100 * sizeof *scene.geoms);
  std::memset(scene.lights, 0, sizeof scene.lights);
  mjv_updateScene(m, d.get(), &option, nullptr, &camera, mjCAT_ALL, &scene);
  Shown all(scene);
  mjv_freeScene(&scene);
  return all;
}

TEST(Changes, AreNoneInTheSamePictureAndAroundTheBallAndItsShadowElse) {
  const auto model = scene(R"(<light directional="true" dir="0 0 -1" castshadow="true"/>
    <geom type="plane" size="0 0 1"/><geom pos="5 0 0" size=".1"/>)" +
                           std::string(ball));
  const mjModel* m = model->get();
  EXPECT_FALSE(changed(m, shown(m, 0.1), shown(m, 0.1), 4.0 / 3));
  const auto part = changed(m, shown(m, 0), shown(m, 0.01), 4.0 / 3);
  ASSERT_TRUE(part);
  EXPECT_GT(part->left, 0);
  EXPECT_LT(part->right - part->left, 0.3);
  EXPECT_LT(part->top - part->bottom, 0.5);
  EXPECT_GT(part->top - part->bottom, part->right - part->left);  // the shadow lies below the ball
}

/// The home pose of a model as a page draws it and as the first frame of a film shows it: pixels that differ, per
/// thousand.
double film_against_page(const mujoco::Model& model) {
  const mujoco::DataPtr d(mj_makeData(model.get()));
  if (model.get()->nkey > 0) mj_resetDataKeyframe(model.get(), d.get(), 0);
  pose_kinematics(model.get(), d.get());
  const auto picture = [&](const Quality& quality) {
    auto made = Renderer::create(model.get(), {1280, 960}, quality);
    if (!made) throw std::runtime_error(made.error().message);
    return drawn(*made, d.get(), {}, {});
  };
  return different(picture(film_quality), picture(plain_quality));
}

TEST(Films, FewerStacksAreNotSeen) {
  for (const char* name : {"irb6620", "er3a_c60"}) EXPECT_LT(film_against_page(*loaded(name)), 1) << name;
}

TEST(Films, LargeRoundPartsKeepTheirStacks) {
  for (const char* part :
       {"<geom size='.3'/>", "<geom type='capsule' size='.3 .5'/>", "<geom type='ellipsoid' size='.1 .1 .5'/>",
        "<site size='.3'/><geom type='box' size='1 1 .1'/>"})
    EXPECT_EQ(film_against_page(*scene(part)), 0) << part;
}

}  // namespace
}  // namespace tribotwin::render
