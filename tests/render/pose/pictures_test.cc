// Pixels: the same every time, and those of the golden image.
#include <array>
#include <cmath>
#include <cstdlib>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <lodepng.h>

#include <tribotwin/render/pose/moment.hpp>
#include <tribotwin/render/pose/overlay.hpp>
#include <tribotwin/render/pose/pose.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {
namespace {

const std::string source = TRIBOTWIN_SOURCE_DIR;

std::shared_ptr<const mujoco::Model> robot(const std::string& name = "irb6620") {
  auto model = mujoco::load_file(source + "/mjcf/" + name + ".xml");
  if (!model) throw std::runtime_error(model.error().message);
  return *model;
}

Image drawn(const mjModel* m, const View& view = {}, std::span<const Paint> paints = {}, Size size = {320, 240},
            Quality quality = {}) {
  const mujoco::DataPtr d(mj_makeData(m));
  mj_resetDataKeyframe(m, d.get(), 0);
  pose_kinematics(m, d.get());
  auto renderer = Renderer::create(m, size, quality);
  if (!renderer) throw std::runtime_error(renderer.error().message);
  auto image = renderer->draw(d.get(), view, paints);
  if (!image) throw std::runtime_error(image.error().message);
  return *image;
}

mujoco::ModelPtr changed(const mujoco::Model& model, auto change) {
  mujoco::ModelPtr copy(mj_copyModel(nullptr, model.get()));
  change(copy.get());
  return copy;
}

/// Share of pixels of which a channel differs by more than 24: antialiasing of another Mesa stays below, a changed part
/// does not.
double difference(const Image& a, const Image& b) {
  if (a.width != b.width || a.height != b.height) return 1;
  std::size_t off = 0;
  for (std::size_t i = 0; i < a.rgb.size(); i += 3) {
    int max_difference = 0;
    for (std::size_t c = i; c < i + 3; ++c) max_difference = std::max(max_difference, std::abs(a.rgb[c] - b.rgb[c]));
    off += max_difference > 24;
  }
  return static_cast<double>(off) / (static_cast<double>(a.rgb.size()) / 3);
}

constexpr double tolerance = 0.002;

Image golden() {
  Image image;
  std::vector<unsigned char> rgb;
  unsigned width = 0, height = 0;
  const std::string file = source + "/tests/render/pose/golden/irb6620.png";
  if (const unsigned error = lodepng::decode(rgb, width, height, file, LCT_RGB))
    throw std::runtime_error(file + ": " + lodepng_error_text(error));
  image.width = static_cast<int>(width);
  image.height = static_cast<int>(height);
  image.rgb.assign(rgb.begin(), rgb.end());
  return image;
}

TEST(Pictures, SamePoseSamePixels) {
  const auto model = robot();
  const Image first = drawn(model->get()), second = drawn(model->get());
  EXPECT_EQ(first, second);
  EXPECT_EQ(png(first), png(second));
}

TEST(Pictures, PngHoldsThePixels) {
  Image image(5, 3);
  for (std::size_t i = 0; i < image.rgb.size(); ++i) image.rgb[i] = static_cast<std::uint8_t>(7 * i);
  std::vector<unsigned char> rgb;
  unsigned width = 0, height = 0;
  const std::string bytes = png(image);
  ASSERT_EQ(
      lodepng::decode(rgb, width, height, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), LCT_RGB),
      0U);
  EXPECT_EQ(width, 5U);
  EXPECT_EQ(height, 3U);
  EXPECT_TRUE(std::equal(rgb.begin(), rgb.end(), image.rgb.begin(), image.rgb.end()));
}

TEST(Pictures, LooksLikeTheGoldenImage) {
  const auto model = robot();
  const Image now = drawn(model->get());
  if (const char* file = std::getenv("TRIBOTWIN_NEW_GOLDEN")) {  // to accept a change that was looked at
    const std::string bytes = png(now);
    lodepng::save_file(std::vector<unsigned char>(bytes.begin(), bytes.end()), file);
  }
  EXPECT_LT(difference(now, golden()), tolerance);
}

// Each of these changes exceeds the tolerance.
TEST(Pictures, GoldenImageSeesASwappedColour) {
  const auto model = robot();
  const int geom = mj_name2id(model->get(), mjOBJ_GEOM, "housing_joint2");
  ASSERT_GE(geom, 0);
  EXPECT_GT(difference(drawn(model->get(), {}, std::vector<Paint>{{geom, {0, 0, 255}}}), golden()), tolerance);
  const auto swapped = changed(*model, [](mjModel* m) {
    for (int i = 0; i < m->nmat; ++i) std::swap(m->mat_rgba[4 * i], m->mat_rgba[4 * i + 2]);
    for (int i = 0; i < m->ngeom; ++i) std::swap(m->geom_rgba[4 * i], m->geom_rgba[4 * i + 2]);
  });
  EXPECT_GT(difference(drawn(swapped.get()), golden()), tolerance);
}

TEST(Pictures, GoldenImageSeesAMissingShadow) {
  const auto dark = changed(*robot(), [](mjModel* m) {
    for (int i = 0; i < m->nlight; ++i) m->light_castshadow[i] = 0;
  });
  EXPECT_GT(difference(drawn(dark.get()), golden()), tolerance);
}

TEST(Pictures, GoldenImageSeesAMirroredCamera) {
  Image mirrored = golden();
  for (int y = 0; y < mirrored.height; ++y)
    for (int x = 0; x < mirrored.width / 2; ++x)
      for (int c = 0; c < 3; ++c) std::swap(mirrored.at(x, y)[c], mirrored.at(mirrored.width - 1 - x, y)[c]);
  EXPECT_GT(difference(drawn(robot()->get()), mirrored), tolerance);
}

// Larger than a tile: the parts fit together. One tile at half the size has the same picture but for its pixels' edges.
TEST(Pictures, TilesHaveNoSeams) {
  const auto model = robot("xl330_pendulum");
  const mjModel* m = model->get();
  const auto plain = [&](Size size) {
    const mujoco::DataPtr d(mj_makeData(m));
    pose_kinematics(m, d.get());
    auto renderer = Renderer::create(m, size, {.samples = 0, .supersampling = 1});
    if (!renderer) throw std::runtime_error(renderer.error().message);
    auto image = renderer->draw(d.get(), {});
    if (!image) throw std::runtime_error(image.error().message);
    return *image;
  };
  const Image large = plain({4800, 600}), small = plain({2400, 300});
  Image half(2400, 300);
  for (int y = 0; y < 300; ++y)
    for (int x = 0; x < 2400; ++x)
      for (int c = 0; c < 3; ++c)
        half.at(x, y)[c] =
            static_cast<std::uint8_t>((large.at(2 * x, 2 * y)[c] + large.at(2 * x + 1, 2 * y)[c] +
                                       large.at(2 * x, 2 * y + 1)[c] + large.at(2 * x + 1, 2 * y + 1)[c]) /
                                      4);
  EXPECT_LT(difference(half, small), 0.02);
  Image shifted(2400, 300);  // what a tile in the wrong place would give
  paste(shifted, half, -40, 0);
  EXPECT_GT(difference(shifted, small), 0.02);
}

constexpr const char* lopsided = R"(<mujoco><compiler angle="radian"/>
  <statistic center="3 0 0" extent="0.5"/>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body name="wall" pos="9 0 0"><geom type="box" size="0.1 4 4"/></body>
    <body pos="1 2 0"><joint name="turn" range="-1 1" limited="true"/><geom type="cylinder" size="0.2 0.1"/>
      <body pos="0 0 0.1"><joint name="lift" type="slide" range="0 0.2" limited="true"/>
        <geom type="capsule" fromto="0 0 0 0 0 2" size="0.08"/>
        <body pos="0 0 2"><joint axis="0 1 0"/><geom type="box" pos="0.6 0 0" size="0.6 0.05 0.05"/></body>
      </body>
    </body>
  </worldbody></mujoco>)";

/// The box of the pixels in which two pictures differ, in shares of the sides: left, top, right, bottom.
std::array<double, 4> changed_box(const Image& a, const Image& b) {
  int left = a.width, top = a.height, right = -1, bottom = -1;
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x)
      if (!std::equal(a.at(x, y), a.at(x, y) + 3, b.at(x, y)))
        left = std::min(left, x), right = std::max(right, x), top = std::min(top, y), bottom = std::max(bottom, y);
  const double w = a.width - 1, h = a.height - 1;
  return {left / w, top / h, right / w, bottom / h};
}

// Whatever the model says of its centre and extent, a free camera shows the robot whole, and large.
TEST(Pictures, FreeCameraShowsTheWholeRobot) {
  const auto model = mujoco::load_string(lopsided);
  ASSERT_TRUE(model) << model.error().message;
  const mjModel* m = (*model)->get();
  const auto without_shadow = changed(**model, [](mjModel* copy) { copy->vis.headlight.active = 1; });
  std::vector<Paint> red, blue;
  for (int g = 2; g < m->ngeom; ++g) red.push_back({g, {255, 0, 0}}), blue.push_back({g, {0, 0, 255}});
  for (const Size size : {Size{240, 160}, Size{120, 240}})
    for (const auto& [azimuth, elevation] : {std::pair{90.0, -45.0}, {130.0, -20.0}, {0.0, 10.0}}) {
      const View view{.azimuth_deg = azimuth, .elevation_deg = elevation};
      const mujoco::DataPtr d(mj_makeData(m));
      d->qpos[2] = 0.7;
      pose_kinematics(m, d.get());
      auto renderer = Renderer::create(without_shadow.get(), size, {.samples = 0, .supersampling = 1});
      ASSERT_TRUE(renderer) << renderer.error().message;
      const auto box = changed_box(*renderer->draw(d.get(), view, red), *renderer->draw(d.get(), view, blue));
      for (int side = 0; side < 4; ++side) {
        EXPECT_GT(box[static_cast<std::size_t>(side)], 0.02) << azimuth << " side " << side;
        EXPECT_LT(box[static_cast<std::size_t>(side)], 0.98) << azimuth << " side " << side;
      }
      EXPECT_GT(std::max(box[2] - box[0], box[3] - box[1]), 0.7) << azimuth;
    }
}

TEST(Poses, BeyondTheirRangeIsSaid) {
  const auto model = mujoco::load_string(lopsided);
  ASSERT_TRUE(model) << model.error().message;
  PoseState state{.qpos = {0.9, 0.1, 50}, .time_s = {}, .joints = {}};
  EXPECT_EQ(beyond_range(**model, state), "");
  state.qpos = {-1.5, 0.25, 50};
  EXPECT_EQ(beyond_range(**model, state), "turn (-1.5 rad, range -1 .. 1), lift (0.25 m, range 0 .. 0.2)");
}

TEST(Pictures, RefusesWhatItCannotDraw) {
  const auto model = robot();
  for (const Size size : {Size{8, 600}, Size{600, 9000}, Size{-1, 600}}) {
    const auto renderer = Renderer::create(model->get(), size);
    ASSERT_FALSE(renderer);
    EXPECT_NE(renderer.error().message.find("each side must be 16 to 8192"), std::string::npos)
        << renderer.error().message;
  }
  auto renderer = Renderer::create(model->get(), {64, 64});
  ASSERT_TRUE(renderer);
  const auto d = model->make_data();
  pose_kinematics(model->get(), d.get());
  const auto image = renderer->draw(d.get(), {.camera = "side"});
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("overview"), std::string::npos) << image.error().message;
  EXPECT_EQ(image.error().kind, ErrorKind::input);
  EXPECT_FALSE(renderer->draw(d.get(), {.camera = "overview", .azimuth_deg = 10}));
  EXPECT_TRUE(renderer->draw(d.get(), {.azimuth_deg = 10, .look_at_m = std::array{0.0, 0.0, 1.0}}));
}

// A hot joint is seen: the colour of its housing is that of the legend.
TEST(Poses, HousingHasTheColourOfItsTemperature) {
  const auto model = robot();
  auto painter = PosePainter::create(model, {640, 480});
  ASSERT_TRUE(painter);
  const PoseOptions options{.scale = {20, 80}, .panel = false, .legend = false};
  const auto near = [](const Image& image, Colour c) {
    int n = 0;
    for (std::size_t i = 0; i < image.rgb.size(); i += 3)
      n += std::abs(image.rgb[i] - c.r) < 20 && std::abs(image.rgb[i + 1] - c.g) < 20 &&
           std::abs(image.rgb[i + 2] - c.b) < 20;
    return n;
  };
  PoseState state = rest(*model);
  for (auto& joint : state.joints) joint.temperature_degC = 20;
  const auto cold = painter->draw(state, options);
  state.joints[1].temperature_degC = 65;
  const auto hot = painter->draw(state, options);
  ASSERT_TRUE(cold && hot);
  EXPECT_EQ(near(*cold, viridis(0.75)), 0);
  EXPECT_GT(near(*hot, viridis(0.75)), 300);
}

TEST(Poses, NamesOfAnyKindAreDrawnAndNotRead) {
  const Image blank(640, 480);
  const std::vector<PanelRow> rows = {
      {{255, 0, 0}, true, "a <b>&amp; \"quoted\" `x` \n ü 関節 \xff\xfe", "1 °C", "2 Nm"}};
  Image image = blank;
  draw_panel(image, "<span>", rows, 0.5);
  EXPECT_NE(image, blank);
}

TEST(Poses, ScaleIsRoundAndHoldsTheValues) {
  const Scale scale = scale_around(std::vector{25.3, std::nan(""), 80.6});
  EXPECT_LE(scale.from, 25.3);
  EXPECT_GE(scale.to, 80.6);
  EXPECT_EQ(std::fmod(scale.from, 5), 0);
  const Scale flat = scale_around(std::vector{25.0, 25.0});
  EXPECT_GE(flat.to - flat.from, 5);
  EXPECT_LT(scale_around({}).from, scale_around({}).to);
  const Scale share = magnitudes_around(std::vector{0.0, 0.4});  // what is a magnitude begins at 0
  EXPECT_EQ(share.from, 0);
  EXPECT_GE(share.to, 5);
}

TEST(Overlay, ThePanelOfManyJointsFitsIntoThePicture) {
  const auto panel = [](std::size_t count, const std::string& last) {
    Image image(1280, 960);
    std::ranges::fill(image.rgb, std::uint8_t{128});
    std::vector<PanelRow> rows;
    for (std::size_t i = 1; i < count; ++i) rows.push_back({{}, true, fmt::format("joint{}", i), "25.0 °C", ""});
    rows.push_back({{}, true, last, "25.0 °C", ""});
    draw_panel(image, "1 h 23 min 05 s", rows, 1);
    return image;
  };
  const auto lowest = [](const Image& image, auto colour) {
    int y = image.height - 1;
    for (; y >= 0; --y)
      for (int x = 0; x < image.width; ++x)
        if (colour(*image.at(x, y))) return y;
    return y;
  };
  const Image full = panel(40, "last");
  EXPECT_NE(full, panel(40, "other"));  // its name is seen
  const int ink = lowest(full, [](int level) { return level < 80; });
  const int card = lowest(full, [](int level) { return level > 200; });
  EXPECT_GT(ink, 900);
  EXPECT_LT(ink, card);
  EXPECT_LT(card, 959);                                                             // and nothing of the panel is cut
  EXPECT_LT(lowest(panel(6, "last"), [](int level) { return level > 200; }), 300);  // as large as ever
}

TEST(Poses, SamplesAreEvenlyInTime) {
  const std::vector<double> time = {0, 1, 2, 50, 51, 52, 99, 100};
  EXPECT_EQ(evenly_in_time(time, 3), (std::vector<std::size_t>{0, 3, 7}));
  EXPECT_EQ(evenly_in_time(time, 1), (std::vector<std::size_t>{7}));
  EXPECT_EQ(evenly_in_time(std::vector{3.0}, 5), (std::vector<std::size_t>{0}));
  EXPECT_TRUE(evenly_in_time({}, 5).empty());
}

/// A record of one joint whose position is the time and whose friction is 100 plus its cycle; of ten cycles of 1 s the
/// first, the fourth and the last are computed.
twin::Recording some_cycles() {
  twin::Recording record;
  record.joints = {"hinge"};
  record.channels = {{"position_rad", "rad", ""}, {"temperature_degC", "degC", ""}, {"friction_nm", "Nm", ""}};
  record.values = {{{}, {}, {}}};
  record.cycle_channels = {{"cycle_temperature_degC", "degC", ""}};
  record.cycle_values = {{{}}};
  for (int cycle = 0; cycle < 10; ++cycle) {
    record.cycle_time_s.push_back(cycle + 1);
    record.cycle_values[0][0].push_back(20 + 5 * (cycle + 1));
    if (cycle != 0 && cycle != 3 && cycle != 9) continue;
    for (int i = 0; i < 100; ++i) {
      record.time_s.push_back(cycle + i / 100.0);
      record.values[0][0].push_back(i / 100.0);
      record.values[0][1].push_back(20 + 5 * record.time_s.back());
      record.values[0][2].push_back(100 + cycle);
    }
  }
  return record;
}

TEST(Moments, BetweenComputedCyclesAreInterpolatedAtTheSameMomentOfBoth) {
  const auto model = robot("xl330_pendulum");
  const auto record = some_cycles();
  const Moments moments(*model, record);
  EXPECT_NEAR(moments.period_s(), 1, 1e-9);
  const auto address = static_cast<std::size_t>(twin::position_address(model->get(), model->drives()[0]));
  for (const double t : {0.0, 0.505, 0.99, 1.25, 2.5, 3.75, 5.0, 6.125, 8.98, 9.5}) {
    const PoseState state = moments.at(t);
    EXPECT_EQ(state.time_s, t);
    EXPECT_NEAR(state.qpos[address], t - std::floor(t), 1e-6) << t;
    EXPECT_NEAR(state.joints[0].temperature_degC, 20 + 5 * t, 1e-6) << t;
    EXPECT_NEAR(state.joints[0].friction_nm, 100 + std::floor(t), 1e-6) << t;  // linear from cycle to cycle
  }
  const auto even = moments.evenly(4);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(*even[i].time_s, 9.99 * static_cast<double>(i) / 3, 1e-9);
}

TEST(Moments, AFilmOfManyCyclesShowsSomeOfThemWhole) {
  const auto model = robot("xl330_pendulum");
  const auto record = some_cycles();
  const Moments moments(*model, record);
  const auto all = moments.film_times(200, 20);  // 20 frames a cycle: all are shown
  EXPECT_EQ(all.size(), 200u);
  EXPECT_NEAR(all[1] - all[0], 9.99 / 199, 1e-9);
  const auto some = moments.film_times(30, 10);
  ASSERT_EQ(some.size(), 30u);
  for (std::size_t moment = 0; moment < 3; ++moment)
    for (std::size_t i = 0; i < 10; ++i)
      EXPECT_NEAR(some[10 * moment + i], 4.0 * static_cast<double>(moment) + static_cast<double>(i) / 10, 1e-9);
}

TEST(Theme, MapIsMonotoneInLightness) {
  double last = -1;
  for (int i = 0; i <= 100; ++i) {
    const Colour c = viridis(i / 100.0);
    const double lightness = 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b;
    EXPECT_GT(lightness, last) << i;
    last = lightness;
  }
  EXPECT_EQ(viridis(std::nan("")), viridis(0));
  EXPECT_EQ(viridis(7), viridis(1));
}

TEST(Theme, TextWithoutSurprises) {
  EXPECT_EQ(printable("joint\n2"), "joint 2");
  EXPECT_EQ(printable("joint\n2", true), "joint\n2");
  EXPECT_EQ(printable("\x1b[31m\xff"), "\uFFFD[31m\uFFFD");
  EXPECT_EQ(duration(4983), "1 h 23 min 03 s");
  EXPECT_EQ(duration(59.9), "59.90 s");
  EXPECT_EQ(digits(1234.4, 3), "1234");  // no power of ten
  EXPECT_EQ(digits(999.6, 3), "1000");
  EXPECT_EQ(digits(-110, 2), "-110");
  EXPECT_EQ(digits(25.04, 3), "25");
  EXPECT_EQ(digits(0.000012345, 2), "0.000012");
  EXPECT_EQ(digits(0.00001, 3), "0.00001");  // no trailing zeros
  EXPECT_EQ(digits(-0.00005100, 4), "-0.000051");
  EXPECT_EQ(digits(0, 3), "0");
  EXPECT_EQ(digits(1.5e9, 2), "1.5e+09");
  EXPECT_FALSE(std::signbit(ticks(-2, 20, 5).front()));  // which would be written as "-0"
  EXPECT_EQ(ticks(0, 1, 5), (std::vector<double>{0, 0.2, 0.4, 0.6000000000000001, 0.8, 1}));
}

}  // namespace
}  // namespace tribotwin::render
