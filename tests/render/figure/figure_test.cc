// Figures read back: what gnuplot drew is what was given.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <pugixml.hpp>
#include <unistd.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

struct Point {
  double x, y;
};
using Path = std::vector<Point>;

std::string text_of(const pugi::xml_node& node) {
  std::string all;
  for (const auto& child : node.children()) all += child.type() == pugi::node_pcdata ? child.value() : text_of(child);
  return all;
}

std::vector<double> numbers(std::string_view text) {
  std::vector<double> out;
  for (const char *at = text.data(), *end = at + text.size(); at < end;) {
    double v;
    const auto [next, error] = std::from_chars(at, end, v);
    if (error == std::errc{})
      out.push_back(v), at = next;
    else
      ++at;
  }
  return out;
}

/// A drawing as a reader sees it: its texts, and its lines in the units of its axes, which its tick labels give.
struct Drawing {
  pugi::xml_document document;
  std::vector<std::string> texts;
  double x_at = 0, x_per = 1, y_at = 0, y_per = 1;

  explicit Drawing(const std::string& svg) {
    if (!document.load_buffer(svg.data(), svg.size(), pugi::parse_default | pugi::parse_ws_pcdata))
      throw std::runtime_error("the SVG is not well-formed");
    std::vector<std::pair<double, double>> x_ticks, y_ticks;  // pixel, value
    for (const auto& found : document.select_nodes("//text")) {
      std::string text = text_of(found.node());
      const auto place =
          numbers(found.node().parent().previous_sibling("path").attribute("d").value());  // the tick mark
      const std::string anchor = found.node().parent().attribute("text-anchor").value();
      double value;
      const auto first = text.find_first_not_of(' ');
      const auto [end, error] =
          std::from_chars(text.data() + (first == std::string::npos ? 0 : first), text.data() + text.size(), value);
      if (error == std::errc{} && end == text.data() + text.size() && place.size() == 4) {
        if (anchor == "middle") x_ticks.emplace_back(place[0], value);
        if (anchor == "end") y_ticks.emplace_back(place[1], value);  // those of a colour bar start at it
      }
      texts.push_back(std::move(text));
    }
    if (x_ticks.size() > 1)
      x_per = (x_ticks.back().second - x_ticks.front().second) / (x_ticks.back().first - x_ticks.front().first),
      x_at = x_ticks.front().second - x_per * x_ticks.front().first;
    if (y_ticks.size() > 1)
      y_per = (y_ticks.back().second - y_ticks.front().second) / (y_ticks.back().first - y_ticks.front().first),
      y_at = y_ticks.front().second - y_per * y_ticks.front().first;
  }

  bool says(const std::string& what) const {
    return std::ranges::any_of(texts, [&](const std::string& t) { return t.find(what) != std::string::npos; });
  }
  Point value(double px, double py) const { return {x_at + x_per * px, y_at + y_per * py}; }

  /// The unbroken lines of plot `index` (from 1).
  std::vector<Path> lines(int index) const {
    std::vector<Path> all;
    for (const auto& found : document.select_nodes(fmt::format("//g[@id='gnuplot_plot_{}']//path", index).c_str())) {
      std::string d = found.node().attribute("d").value();
      for (std::size_t at = 0; at < d.size();) {
        const auto next = d.find('M', at + 1);
        const auto v = numbers(std::string_view(d).substr(at, next == std::string::npos ? next : next - at));
        Path path;
        for (std::size_t i = 0; i + 1 < v.size(); i += 2) path.push_back(value(v[i], v[i + 1]));
        if (path.size() > 1) all.push_back(std::move(path));
        at = next == std::string::npos ? d.size() : next;
      }
    }
    return all;
  }
  /// The markers of plot `index`.
  Path points(int index) const {
    Path all;
    for (const auto& found : document.select_nodes(fmt::format("//g[@id='gnuplot_plot_{}']//use", index).c_str())) {
      const auto v = numbers(found.node().attribute("transform").value());
      all.push_back(value(v.at(0), v.at(1)));
    }
    return all;
  }
};

Drawing drawing(const Figure& figure) {
  auto svg = draw(figure, Format::svg);
  if (!svg) throw std::runtime_error(svg.error().message);
  return Drawing(*svg);
}

std::string refusal(const Figure& figure) {
  auto svg = draw(figure, Format::svg);
  return svg ? "" : svg.error().message;
}

const Axis plain_x{.quantity = "speed", .symbol = "{/:Italic v}", .unit = "rad/s"},
    plain_y{.quantity = "friction", .unit = "Nm"};
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TEST(Figure, DrawnValuesAreTheGivenOnes) {
  Series line{.label = "law", .x = {}, .y = {}};
  for (int i = 0; i <= 20; ++i) line.x.push_back(i), line.y.push_back(3 + std::sin(0.4 * i));
  const Series points{.mark = Mark::points, .label = "measured", .x = {2, 7, 11}, .y = {3.5, 2.5, 3.1}};
  const Drawing d = drawing({.title = "T", .x = plain_x, .y = plain_y, .series = {line, points}});
  const auto lines = d.lines(1);
  // The first path is in the key or the plot; the plot's has all points.
  const auto found = std::ranges::find_if(lines, [&](const Path& p) { return p.size() == line.x.size(); });
  ASSERT_NE(found, lines.end());
  for (std::size_t i = 0; i < line.x.size(); ++i) {
    EXPECT_NEAR((*found)[i].x, line.x[i], 0.02);
    EXPECT_NEAR((*found)[i].y, line.y[i], 0.01);
  }
  const Path marks = d.points(2);
  for (std::size_t i = 0; i < points.x.size(); ++i)
    EXPECT_TRUE(std::ranges::any_of(marks, [&](Point p) {
      return std::abs(p.x - points.x[i]) < 0.02 && std::abs(p.y - points.y[i]) < 0.01;
    })) << i;
}

TEST(Figure, LabelsAndUnitsAreThere) {
  const Drawing d =
      drawing({.title = "Title", .x = plain_x, .y = plain_y, .series = {{.label = "law", .x = {0, 1}, .y = {1, 2}}}});
  EXPECT_TRUE(d.says("Title"));
  EXPECT_TRUE(d.says("speed v [rad/s]"));
  EXPECT_TRUE(d.says("friction [Nm]"));
  EXPECT_TRUE(d.says("law"));
}

TEST(Figure, NanIsAGap) {
  const Drawing d = drawing(
      {.title = "gap", .x = plain_x, .y = plain_y, .series = {{.x = {0, 1, 2, 3, 4, 5}, .y = {1, 2, 2, nan, 4, 5}}}});
  const auto lines = d.lines(1);
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_NEAR(lines[0].back().x, 2, 0.02);
  EXPECT_NEAR(lines[1].front().x, 4, 0.02);
}

TEST(Figure, AValueWithoutNeighboursIsAPoint) {
  const Drawing d = drawing({.title = "alone",
                             .x = plain_x,
                             .y = plain_y,
                             .series = {{.label = "one", .x = {2.5}, .y = {3}},
                                        {.label = "gaps", .x = {0, 1, 2, 3, 4, 5}, .y = {1, nan, 2, nan, 4, 5}},
                                        {.label = "whole", .x = {0, 5}, .y = {1.5, 3.5}}}});
  const Path one = d.points(4), gaps = d.points(5);
  ASSERT_EQ(one.size(), 1U);
  EXPECT_NEAR(one[0].x, 2.5, 0.02);
  EXPECT_NEAR(one[0].y, 3, 0.02);
  ASSERT_EQ(gaps.size(), 2U);
  EXPECT_NEAR(gaps[0].x, 0, 0.02);
  EXPECT_NEAR(gaps[1].x, 2, 0.02);
  EXPECT_TRUE(d.points(6).empty());
}

TEST(Figure, NothingIsSilentlyEmpty) {
  EXPECT_NE(refusal({.title = "F", .x = plain_x, .y = plain_y}).find("figure 'F': has nothing to show"),
            std::string::npos);
  EXPECT_NE(
      refusal({.title = "F", .x = plain_x, .y = plain_y, .series = {{.label = "a", .x = {1, 2}, .y = {nan, nan}}}})
          .find("figure 'F': series 'a' has no finite value"),
      std::string::npos);
  EXPECT_NE(refusal({.title = "F", .x = plain_x, .y = plain_y, .series = {{.label = "a"}}}).find("no finite value"),
            std::string::npos);
  EXPECT_NE(refusal({.title = "F", .x = plain_x, .y = plain_y, .series = {{.x = {1, 2}, .y = {1}}}})
                .find("series 1 has 2 x, 1 y"),
            std::string::npos);
  EXPECT_NE(refusal({.title = "F", .x = plain_x, .y = plain_y, .series = {{.x = {1, 2}, .y = {1, INFINITY}}}})
                .find("infinite value at point 2"),
            std::string::npos);
  EXPECT_NE(refusal(residual_histogram("R", plain_x, std::vector{nan})).find("no finite value"), std::string::npos);
  Figure flat{.title = "F", .x = plain_x, .y = plain_y, .z = plain_y};
  flat.surface = Surface{{0, 1}, {0, 1}, {{nan, nan}, {nan, nan}}};
  EXPECT_NE(refusal(flat).find("surface has no finite value"), std::string::npos);
  flat.surface->z = {{1, 2}};
  EXPECT_NE(refusal(flat).find("surface of 2 x 2 points has 1 rows"), std::string::npos);
}

TEST(Figure, OnePointAndConstantsHaveARange) {
  EXPECT_EQ(refusal({.title = "F", .x = plain_x, .y = plain_y, .series = {{.mark = Mark::points, .x = {1}, .y = {0}}}}),
            "");
  EXPECT_EQ(refusal({.title = "F", .x = plain_x, .y = plain_y, .series = {{.x = {1, 2}, .y = {5, 5}}}}), "");
}

TEST(Figure, TextIsShownAsItIsAndNothingIsExecuted) {
  const std::string file = fmt::format("{}tw{}", testing::TempDir(), std::random_device{}());
  for (const std::string& name : std::vector<std::string>{
           "a 'b' ''", "\"quoted\" \\\"", "`touch " + file + "`", "$(touch " + file + ")", "'; !touch " + file + "; '",
           "<script>alert(1)</script>", "F_s^{2}@&~x{/:Bold y}", "π ü 関節", "%s %d #", "END", "\\", "'"}) {
    const Drawing d = drawing({.title = name,
                               .x = {.quantity = name, .unit = name},
                               .y = plain_y,
                               .series = {{.label = name, .x = {0, 1}, .y = {1, 2}}}});
    EXPECT_EQ(std::ranges::count(d.texts, name), 2) << name;  // title and key
    EXPECT_TRUE(d.says(name + " [" + name + "]")) << name;
    EXPECT_TRUE(d.document.select_nodes("//script").empty());
  }
  const Drawing d =
      drawing({.title = "a\nb\x01\xff", .x = plain_x, .y = plain_y, .series = {{.x = {0, 1}, .y = {1, 2}}}});
  EXPECT_TRUE(d.says("a b\uFFFD\uFFFD"));
  EXPECT_NE(access(file.c_str(), F_OK), 0);
}

TEST(Figure, LongTextLosesItsMiddle) {
  const std::string name = "begin " + std::string(300, 'm') + " end ü";
  const Drawing d =
      drawing({.title = name, .x = plain_x, .y = plain_y, .series = {{.label = name, .x = {0, 1}, .y = {1, 2}}}});
  EXPECT_TRUE(std::ranges::any_of(d.texts, [](const std::string& t) {
    return t.starts_with("begin m") && t.ends_with("m end ü") && t.size() < 100 && t.find("…") != std::string::npos;
  }));
}

TEST(Figure, EveryFormat) {
  const Figure f{.title = "F", .x = plain_x, .y = plain_y, .series = {{.x = {0, 1}, .y = {1, 2}}}};
  EXPECT_TRUE(draw(f, Format::png)->starts_with("\x89PNG"));
  EXPECT_TRUE(draw(f, Format::pdf)->starts_with("%PDF"));
  EXPECT_EQ(format_of("a.b.pdf"), Format::pdf);
  EXPECT_NE(format_of("x.gif").error().message.find(".svg, .png or .pdf"), std::string::npos);
  EXPECT_EQ(format_of("x.gif").error().kind, ErrorKind::input);
  EXPECT_EQ(draw(Figure{.title = "empty"}, Format::svg).error().kind, ErrorKind::work);
}

TEST(Figure, SameValuesSameBytes) {
  const Figure f{.title = "F", .x = plain_x, .y = plain_y, .series = {{.x = {0, 1}, .y = {1, 2}}}};
  EXPECT_EQ(*draw(f, Format::svg), *draw(f, Format::svg));
  EXPECT_EQ(*draw(f, Format::png), *draw(f, Format::png));
}

/// What `f` returns in a thread of its own, where gnuplot starts anew.
template <class F>
std::string with_new_gnuplot(const F& f) {
  std::string out;
  std::thread([&] { out = f(); }).join();
  return out;
}

// One gnuplot draws them all, and none leaves anything to the next.
TEST(Figure, IsTheSameAfterOthers) {
  const Figure line{.title = "F", .x = plain_x, .y = plain_y, .series = {{.label = "a", .x = {0, 1}, .y = {1, 2}}}};
  Figure map{.title = "H", .x = plain_x, .y = plain_y, .colour = Axis{.quantity = "c", .from = 0, .to = 1}};
  map.heat_map = HeatMap{.columns = {"1", "2"}, .rows = {"a", "b"}, .values = {{0, 1}, {0.5, 0.2}}};
  Figure surface{.title = "S", .x = plain_x, .y = plain_y, .z = plain_y};
  surface.surface = Surface{{0, 1}, {0, 1}, {{0, 1}, {2, 3}}};
  Figure ranking{.title = "R", .x = plain_x};
  const Ranking::Bars bars{.label = "first", .values = {1, 2}, .low = {0.5, 1}, .high = {2, 3}};
  ranking.ranking = Ranking{.names = {"a", "b"}, .bars = {bars}};
  Figure square = line;
  square.same_scale = true;
  square.colour = Axis{.quantity = "c", .from = 0, .to = 1};
  const std::vector<Figure> all{line, map, surface, ranking, square};
  for (const Format format : {Format::svg, Format::png})
    for (const Figure& f : all) {
      const std::string alone = with_new_gnuplot([&] { return draw(f, format).value(); });
      for (const Figure& before : all) {
        ASSERT_TRUE(draw(before, format)) << before.title;
        const auto after = draw(f, format);
        ASSERT_TRUE(after) << after.error().message;
        EXPECT_EQ(*after, alone) << f.title << " after " << before.title;
      }
    }
}

TEST(Figure, MissingOrFailedGnuplotIsNamedAndStartedAgain) {
  const Figure f{.title = "F", .x = plain_x, .y = plain_y, .series = {{.x = {0, 1}, .y = {1, 2}}}};
  const std::string path = std::getenv("PATH"), folder = testing::TempDir() + "broken_gnuplot";
  std::filesystem::create_directories(folder);
  std::ofstream(folder + "/gnuplot") << "#!/bin/sh\nyes 'out of ink' | head -n 100000 >&2\nexit 3\n";
  std::filesystem::permissions(folder + "/gnuplot", std::filesystem::perms::owner_all);
  const std::string said = with_new_gnuplot([&] {
    setenv("PATH", "/nonexistent", 1);
    const std::string missing = refusal(f);
    setenv("PATH", (folder + ":" + path).c_str(), 1);
    const std::string failed = refusal(f);
    setenv("PATH", path.c_str(), 1);
    return missing + "\n" + failed.substr(0, 100) + "\n" + (draw(f, Format::svg) ? "drawn" : "not drawn");
  });
  EXPECT_NE(said.find("gnuplot is not installed; on Debian: apt-get install gnuplot-nox\n"), std::string::npos) << said;
  EXPECT_NE(said.find("gnuplot ended with exit code 3: out of ink"), std::string::npos) << said;
  EXPECT_TRUE(said.ends_with("\ndrawn")) << said;
}

// Lightness and dashes distinguish neighbours without colour.
TEST(Figure, StrokesDifferInGreyscale) {
  for (std::size_t i = 0; i < 8; ++i)
    for (std::size_t k = i + 1; k < 8; ++k) {
      const auto a = theme::stroke(i), b = theme::stroke(k);
      const auto grey = [](Colour c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; };
      EXPECT_TRUE(a.dashes != b.dashes || std::abs(grey(a.colour) - grey(b.colour)) > 35) << i << " " << k;
    }
}

// The ninth line has the colour of the first, but other dashes; so has the 49th.
TEST(Figure, StrokesDifferBeyondEight) {
  for (std::size_t i = 0; i < 56; ++i)
    for (std::size_t k = i + 1; k < 56; ++k) {
      const auto a = theme::stroke(i), b = theme::stroke(k);
      EXPECT_TRUE(a.colour != b.colour || a.dashes != b.dashes) << i << " " << k;
    }
}

class LawFigures : public testing::Test {
 protected:
  std::shared_ptr<const mujoco::Model> model =
      mujoco::load_file(std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/irb6620.xml").value();
  const drive::Drive& drive = model->drives()[1].drive;
};

// The curve in the picture is the law: at 0 load and 50 degC, evaluated here by friction::level itself.
TEST_F(LawFigures, CurvesAreTheLaw) {
  const double speed = 280 / drive.gear_ratio;
  const std::vector<FrictionPoint> measured = {
      {100 / drive.gear_ratio, 0, 50, 0.06 * drive.torque_max_nm, 0.005 * drive.torque_max_nm}};
  const Drawing d = drawing(friction_against_temperature(drive, "law", speed, 0, std::vector{50.0, 70.0}, measured));
  EXPECT_TRUE(d.says("motor speed v [rad/s]"));
  EXPECT_TRUE(d.says("friction torque τf / τmax [-]"));
  EXPECT_TRUE(d.says("temperature T [°C]"));
  for (int plot = 1; plot <= 2; ++plot) {
    const auto lines = d.lines(plot);
    ASSERT_EQ(lines.size(), 1U);
    double largest = 0;
    for (const Point& p : lines[0]) {
      const auto at = friction::at_temperature(drive.law, plot == 1 ? 50 : 70);
      largest = std::max(largest, std::abs(p.y - friction::level(drive.law, at, p.x, 0).total()));
    }
    EXPECT_GT(lines[0].size(), 100U);
    EXPECT_LT(largest, 1e-3);  // half a pixel
  }
  const Path marks = d.points(3);
  ASSERT_FALSE(marks.empty());
  EXPECT_NEAR(marks[0].x, 100, 0.5);
  EXPECT_NEAR(marks[0].y, 0.06, 1e-3);
}

TEST_F(LawFigures, WithoutColour) {
  const Figure f = friction_against_speed(drive, "law", 1.5, 0, std::vector<FrictionPoint>{{0.5, 0, 50, 300}});
  EXPECT_FALSE(f.colour);
  EXPECT_EQ(drawing(f).points(2).size(), 1U);
}

TEST_F(LawFigures, LoadAndSurface) {
  EXPECT_TRUE(
      drawing(friction_against_load(drive, "law", 1.5, 50, std::vector{0.0, 0.5})).says("load |τl| / τmax [-]"));
  const Figure one = friction_against_load(drive, "law", 1.5, 50, std::vector{0.0});
  EXPECT_EQ(refusal(one), "");
  EXPECT_EQ(one.colour->from, 0);  // a load has no sign
  const Figure slide = in_units_of(friction_against_load(drive, "law", 1.5, 50, std::vector{0.0}), true);
  EXPECT_EQ(slide.x.unit, "rad/s");  // of the motor, which turns
  const Drawing surface = drawing(friction_surface(drive, "law", 1.5, 0, 38, 81));
  EXPECT_TRUE(surface.says("friction torque τf / τmax [-]"));
  EXPECT_TRUE(surface.says("temperature T [°C]"));
  EXPECT_GT(surface.document.select_nodes("//polygon").size() + surface.document.select_nodes("//path").size(), 500U);
}

TEST(Figures, HistoryChoosesItsUnit) {
  const auto over = [](double span) {
    return drawing(history("H", plain_y, std::vector<Trace>{{"a", {0, span / 2, span}, {1, 2, 3}}}));
  };
  EXPECT_TRUE(over(50).says("time t [s]"));
  EXPECT_TRUE(over(1800).says("time t [min]"));
  const Drawing hours = over(20000);
  EXPECT_TRUE(hours.says("time t [h]"));
  const auto lines = hours.lines(1);
  EXPECT_TRUE(std::ranges::any_of(
      lines, [](const Path& p) { return p.size() == 3 && std::abs(p[2].x - 20000 / 3600.0) < 0.02; }));
}

TEST(Figures, TrackingErrorIsInMilliradians) {
  const Drawing d = drawing(tracking_error("E", std::vector<Trace>{{"joint2", {0, 1, 2}, {0.001, -0.002, 0.003}}}));
  EXPECT_TRUE(d.says("[mrad]"));
  EXPECT_TRUE(
      std::ranges::any_of(d.lines(1), [](const Path& p) { return p.size() == 3 && std::abs(p[1].y + 2) < 0.05; }));
}

TEST(Figures, HistogramCountsEveryResidualAndFitsTheNormal) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0.5, 2);
  std::vector<double> residuals = {nan};
  for (int i = 0; i < 3000; ++i) residuals.push_back(normal(random));
  const Figure f = residual_histogram("R", plain_y, residuals);
  double counted = 0;
  for (const double n : f.series[0].y) counted += n;
  EXPECT_EQ(counted, 3000);
  const double width = f.series[0].x[1] - f.series[0].x[0];
  double area = 0;
  for (std::size_t i = 1; i < f.series[1].x.size(); ++i)
    area += f.series[1].y[i] * (f.series[1].x[i] - f.series[1].x[i - 1]);
  EXPECT_NEAR(area / (3000 * width), 1, 0.01);
  const auto top = static_cast<std::size_t>(std::ranges::max_element(f.series[1].y) - f.series[1].y.begin());
  EXPECT_NEAR(f.series[1].x[top], 0.5, 0.15);
  EXPECT_TRUE(drawing(f).says("n = 3000"));
  EXPECT_EQ(refusal(residual_histogram("R", plain_y, std::vector{1.0, 1.0, 1.0})), "");
}

// Of samples drawn from the same normal distribution, the regions hold the share they promise.
TEST(Figures, EllipsesHoldTheirShare) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  Estimate e{"healthy", {1, -2}, {{{4, 1.5}, {1.5, 1}}}, {}};
  for (int i = 0; i < 20000; ++i) {
    const double a = normal(random), b = normal(random);
    e.samples.push_back({1 + 2 * a, -2 + 0.75 * a + std::sqrt(1 - 0.5625) * b});
  }
  const Figure f = confidence_ellipses("C", plain_x, plain_y, std::vector{e});
  ASSERT_EQ(f.series.size(), 3U);
  for (const auto& [series, promised] : {std::pair{1, 0.95}, {2, 0.99}}) {
    const Series& outline = f.series[static_cast<std::size_t>(series)];
    int inside = 0;
    for (const auto& p : e.samples) {
      bool in = false;
      for (std::size_t i = 0, k = outline.x.size() - 1; i < outline.x.size(); k = i++)
        if ((outline.y[i] > p[1]) != (outline.y[k] > p[1]) &&
            p[0] < (outline.x[k] - outline.x[i]) * (p[1] - outline.y[i]) / (outline.y[k] - outline.y[i]) + outline.x[i])
          in = !in;
      inside += in;
    }
    EXPECT_NEAR(inside / 20000.0, promised, 0.005);
  }
  EXPECT_EQ(refusal(f), "");
}

// With few degrees of freedom the scale of the covariance is uncertain too: regions by the F distribution.
TEST(Figures, EllipsesOfFewSamplesAreWider) {
  const auto radius = [](double degrees_of_freedom, std::size_t series) {
    const Figure f = confidence_ellipses("C", plain_x, plain_y,
                                         std::vector{Estimate{"", {0, 0}, {{{1, 0}, {0, 1}}}, {}, degrees_of_freedom}});
    return std::hypot(f.series[series].x[7], f.series[series].y[7]);
  };
  EXPECT_NEAR(std::pow(radius(10, 0), 2), 2 * 4.102821, 1e-4);  // 2 F(0.95; 2, 10), 2 F(0.99; 2, 10) of tables
  EXPECT_NEAR(std::pow(radius(10, 1), 2), 2 * 7.559432, 1e-4);
  EXPECT_NEAR(std::pow(radius(1e9, 0), 2), 5.991465, 1e-4);
}

TEST(Figures, MatrixShowsItsLowerHalf) {
  const Matrix m{{"Fc0", "v_s", "alpha"}, {{1, -0.934, 0.046}, {-0.934, 1, 0.9987}, {0.046, 0.9987, 1}}};
  const Figure f = correlation_matrix("C", m);
  const Drawing d = drawing(f);
  EXPECT_EQ(std::ranges::count(d.texts, "Fc0"), 2);
  EXPECT_EQ(std::ranges::count(d.texts, "v_s"), 2);
  for (const char* number : {"-0.93", "0.05", "0.999"})
    EXPECT_EQ(std::ranges::count_if(d.texts, [&](const std::string& t) { return t.find(number) != std::string::npos; }),
              1)
        << number;
  EXPECT_TRUE(d.says("correlation [-]"));
  EXPECT_TRUE(draw(f, Format::png)->starts_with("\x89PNG"));
  EXPECT_NE(refusal(correlation_matrix("C", {{"a", "b"}, {{1, 0.5}}})).find("2 names and 1 rows"), std::string::npos);
  EXPECT_NE(refusal(correlation_matrix("C", {{"a", "b"}, {{1, 1.5}, {1.5, 1}}})).find("beyond -1 .. 1"),
            std::string::npos);
  EXPECT_EQ(refusal(correlation_matrix("C", {{"a", "b"}, {{1, nan}, {nan, 1}}})), "");
}

TEST(Figures, HeatMapShowsItsCells) {
  Figure f{
      .title = "H", .x = plain_y, .y = plain_y, .colour = Axis{.quantity = "heat", .unit = "J", .from = 1, .to = 4}};
  f.heat_map =
      HeatMap{.columns = {"a_1", "b"}, .rows = {"top", "bottom"}, .values = {{1, 2.25}, {nan, 4}}, .decimals = 2};
  const Drawing d = drawing(f);
  for (const char* text : {"a_1", "b", "top", "bottom", "1.00", "2.25", "4.00", "–", "heat [J]"})
    EXPECT_TRUE(d.says(text)) << text;
  EXPECT_TRUE(draw(f, Format::png)->starts_with("\x89PNG"));
  f.heat_map->values = {{1, 2}};
  EXPECT_NE(refusal(f).find("2 columns, 2 rows and 1 rows of values"), std::string::npos);
  f.heat_map->values = {{1, 2}, {3, 4}};
  f.colour.reset();
  EXPECT_NE(refusal(f).find("needs a colour axis"), std::string::npos);
}

TEST(Figures, RankingShowsNamesAndIntervals) {
  Figure f{.title = "R", .x = {.quantity = "index"}, .y = {}};
  f.ranking = Ranking{.names = {"a.b_c", "d"},
                      .bars = {{.label = "total", .values = {0.8, nan}, .low = {0.7, nan}, .high = {0.9, nan}},
                               {.label = "first", .values = {0.5, 0.1}, .low = {nan, nan}, .high = {nan, nan}}}};
  const Drawing d = drawing(f);
  for (const char* text : {"a.b_c", "d", "total", "first", "index [-]"}) EXPECT_TRUE(d.says(text)) << text;
  f.ranking->bars[0].low.pop_back();
  EXPECT_NE(refusal(f).find("2 names and bars of 2, 1 and 2 numbers"), std::string::npos);
  f.ranking->bars = {{.label = "", .values = {nan, nan}, .low = {nan, nan}, .high = {nan, nan}}};
  EXPECT_NE(refusal(f).find("no finite value"), std::string::npos);
}

TEST(Figures, DistributionCountsEveryValue) {
  const std::vector<double> values{1, 2, 2, 3, nan, 7};
  const std::vector<Marked> marked{{"quantiles", 1.5}, {"median", 2}, {"quantiles", 6}, {"quantiles", nan}};
  const Figure f = distribution("D", plain_y, values, marked, "mean, 95 %", 2, 4);
  double counted = 0;
  for (const double n : f.series[0].y) counted += n;
  EXPECT_EQ(counted, 5);
  ASSERT_EQ(f.series.size(), 5);  // bars, strip, three lines
  const Drawing d = drawing(f);
  for (const char* text : {"n = 5", "mean, 95 %", "quantiles", "median"}) EXPECT_TRUE(d.says(text)) << text;
  EXPECT_EQ(std::ranges::count(d.texts, "quantiles"), 1);
  EXPECT_NE(refusal(distribution("D", plain_y, std::vector{nan}, {}, "", 0, 0)).find("no finite value"),
            std::string::npos);
}

TEST(Figure, NumbersBelowAnAxisDoNotTouch) {
  Figure f{
      .title = "F", .x = plain_y, .y = plain_y, .series = {{.mark = Mark::points, .x = {0.0261, 0.0369}, .y = {0, 1}}}};
  f.x.quantity = "x";
  const Drawing d = drawing(f);
  const auto long_numbers = std::ranges::count_if(
      d.texts, [](const std::string& t) { return t.find("0.02") != t.npos || t.find("0.03") != t.npos; });
  EXPECT_GE(long_numbers, 2);
  EXPECT_LE(long_numbers, 8);  // gnuplot's own are 11
}

// In greyscale the tone is the magnitude for both signs, and text on it stays readable.
TEST(Figures, DivergingTonesReadInGreyscale) {
  const auto linear = [](double c) {
    return c <= 0.03928 * 255 ? c / 255 / 12.92 : std::pow((c / 255 + 0.055) / 1.055, 2.4);
  };
  const auto light = [&](Colour c) { return 0.2126 * linear(c.r) + 0.7152 * linear(c.g) + 0.0722 * linear(c.b); };
  for (int i = 0; i < 10; ++i) {
    const double v = 0.1 * i;
    EXPECT_GT(light(diverging(v)), light(diverging(v + 0.1)));
    EXPECT_NEAR(light(diverging(v)), light(diverging(-v)), 0.06) << v;
    EXPECT_GT((light(diverging(-v - 0.1)) + 0.05) / (light(theme::ink) + 0.05), 4.5);
  }
  EXPECT_EQ(diverging(0), theme::paper);
  EXPECT_EQ(correlation(-0.004), "0.00");
  EXPECT_EQ(correlation(-0.99993), "-0.99993");
  EXPECT_EQ(correlation(1), "1.00");
}

TEST(Figures, ScatterCountsAllAndDrawsSome) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<double> x, y;
  for (int i = 0; i < 24000; ++i) x.push_back(i % 12), y.push_back((i % 12 == 7 ? 3 : 0) + 0.5 * normal(random));
  x.push_back(nan), y.push_back(1);
  const Figure f = scatter("S", plain_x, plain_y, x, y, 1000);
  ASSERT_EQ(f.series.size(), 4U);
  EXPECT_EQ(f.series[0].x.size(), 1000U);
  for (int level = 0; level < 12; ++level)
    EXPECT_GT(std::ranges::count(f.series[0].x, level), 50) << level;  // the rhythm of 12 is not met
  ASSERT_EQ(f.series[1].x.size(), 12U);                                // what is equal stays together
  EXPECT_EQ(f.series[1].x[7], 7);
  EXPECT_NEAR(f.series[1].y[7], 3, 0.05);
  EXPECT_NEAR(f.series[1].y[6], 0, 0.05);
  EXPECT_NEAR(f.series[2].y[7] - f.series[1].y[7], 0.5, 0.03);
  EXPECT_EQ(refusal(f), "");
  EXPECT_EQ(drawing(f).points(1).size(), 1000U);
}

TEST(Figures, ThinnedIsEvenAndWhole) {
  EXPECT_EQ(thinned(0, 10).size(), 0U);
  EXPECT_EQ(thinned(3, 10), (std::vector<std::size_t>{0, 1, 2}));
  const auto rows = thinned(1000003, 1000);
  ASSERT_EQ(rows.size(), 1000U);
  for (std::size_t k = 0; k < rows.size(); ++k)
    EXPECT_TRUE(rows[k] >= k * 1000003 / 1000 && rows[k] < (k + 1) * 1000003 / 1000) << k;
  EXPECT_EQ(rows, thinned(1000003, 1000));
}

TEST(Figures, HysteresisKeepsItsOrder) {
  const Drawing d = drawing(hysteresis_loop("L", {.quantity = "position", .unit = "rad"}, plain_y,
                                            std::vector<Loop>{{"loop", {0, 1, 1, 0, 0}, {0, 0, 2, 2, 0}}}));
  EXPECT_TRUE(std::ranges::any_of(d.lines(1), [](const Path& p) {
    return p.size() == 5 && std::abs(p[2].y - 2) < 0.02 && std::abs(p[3].x) < 0.02;
  }));
}

}  // namespace
}  // namespace tribotwin::render
