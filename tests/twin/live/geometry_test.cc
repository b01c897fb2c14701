#include <atomic>
#include <map>
#include <thread>

#include "client.hpp"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/live/protocol/geometry.hpp>
#include <tribotwin/twin/live/twin_feed.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin::live {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::StartsWith;

json geometry_of(const mujoco::Model& model, const GeometryLimits& limits = {}) {
  return json::parse(geometry_json(model, limits));
}

/// The rule of MuJoCo's viewer, written once more.
bool is_visual(const mjModel* m, int geom) {
  const bool own = m->geom_rgba[4 * geom] != .5F || m->geom_rgba[4 * geom + 1] != .5F ||
                   m->geom_rgba[4 * geom + 2] != .5F || m->geom_rgba[4 * geom + 3] != 1;
  const int material = m->geom_matid[geom];
  return m->geom_group[geom] <= 2 &&
         (material >= 0 && !own ? m->mat_rgba[4 * material + 3] : m->geom_rgba[4 * geom + 3]) > 0;
}

constexpr const char* arm = R"(<mujoco><asset>
  <material name="red" rgba="1 0 0 1"/><material name="glass" rgba="1 1 1 0"/>
  <mesh name="tent" vertex="0 0 0 2 0 0 0 3 0 0 0 4 1 1 0"/><mesh name="unused" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>
  <hfield name="hills" nrow="2" ncol="2" size="1 1 1 1"/></asset>
  <worldbody><geom type="plane" size="0 0 1"/><geom type="hfield" hfield="hills"/>
  <body name="upper" pos="0 0 1" quat="1 0 0 1"><joint name="shoulder" axis="0 1 0"/>
    <geom name="tent" type="mesh" mesh="tent" material="red" pos=".1 .2 .3" quat="1 1 0 0"/>
    <geom type="sphere" size=".1" material="glass"/><geom type="box" size=".1 .2 .3" group="3"/>
    <geom type="capsule" size=".1 .2" rgba="0 1 0 .5" material="red"/>
    <body name="lower" pos="1 0 0"><joint name="elbow" axis="0 1 0"/>
      <geom type="ellipsoid" size=".1 .2 .3"/><geom type="cylinder" size=".1 .2"/><geom type="mesh" mesh="tent"/>
    </body></body></worldbody></mujoco>)";

/// Every visual geom of the model, with its place, size and colour; nothing else.
void expect_all(const mujoco::Model& model) {
  const mjModel* m = model.get();
  const json geometry = geometry_of(model);
  ASSERT_EQ(geometry["bodies"].size(), static_cast<std::size_t>(m->nbody));
  int left_out = 0;
  for (int body = 0; body < m->nbody; ++body) {
    const json& said = geometry["bodies"][static_cast<std::size_t>(body)];
    const char* name = mj_id2name(m, mjOBJ_BODY, body);
    EXPECT_EQ(said["name"], name ? name : "");
    EXPECT_EQ(said["parent"], m->body_parentid[body]);
    std::size_t at = 0;
    for (int geom = 0; geom < m->ngeom; ++geom) {
      if (m->geom_bodyid[geom] != body || !is_visual(m, geom)) continue;
      if (m->geom_type[geom] == mjGEOM_HFIELD) {
        ++left_out;
        continue;
      }
      ASSERT_LT(at, said["geoms"].size()) << name;
      const json& shape = said["geoms"][at++];
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(shape["pos"][k], m->geom_pos[3 * static_cast<std::size_t>(geom) + k]);
        EXPECT_EQ(shape["size"][k], m->geom_size[3 * static_cast<std::size_t>(geom) + k]);
      }
      for (std::size_t k = 0; k < 4; ++k)
        EXPECT_EQ(shape["quat"][k], m->geom_quat[4 * static_cast<std::size_t>(geom) + k]);
      EXPECT_EQ(shape["mesh"].is_null(), m->geom_type[geom] != mjGEOM_MESH);
    }
    EXPECT_EQ(at, said["geoms"].size()) << name;
  }
  EXPECT_EQ(geometry["left_out"], left_out);
}

TEST(Geometry, HasEveryVisualGeomOfTheShippedModels) {
  for (const char* name : {"irb6620", "br609", "er3a_c60", "rh380n_bench", "xl330_pendulum"}) {
    SCOPED_TRACE(name);
    const auto model = mujoco::load_file(fmt::format("{}/mjcf/{}.xml", TRIBOTWIN_SOURCE_DIR, name)).value();
    expect_all(*model);
    std::map<std::string, int> housings;
    const json geometry = geometry_of(*model);
    for (const json& body : geometry["bodies"])
      for (const json& geom : body["geoms"])
        if (!geom["housing"].is_null()) ++housings[geom["housing"]];
    for (const auto& drive : model->drives()) {
      const std::string joint = joint_name(model->get(), drive);
      EXPECT_GE(housings[joint], 1) << joint;
      if (mj_name2id(model->get(), mjOBJ_GEOM, ("housing_" + joint).c_str()) >= 0) EXPECT_EQ(housings[joint], 1);
    }
    EXPECT_EQ(housings.size(), model->drives().size());
  }
}

TEST(Geometry, HasMeshesOnceAndColoursAsTheyAreDrawn) {
  const auto model = mujoco::load_string(arm).value();
  expect_all(*model);
  const json geometry = geometry_of(*model);
  ASSERT_EQ(geometry["meshes"].size(), 1);
  const json& mesh = geometry["meshes"][0];
  EXPECT_EQ(mesh["name"], "tent");
  const mjModel* m = model->get();
  const float* from = m->mesh_vert + 3 * m->mesh_vertadr[0];
  EXPECT_EQ(mesh["vertices"].get<std::vector<float>>(), std::vector<float>(from, from + 3 * m->mesh_vertnum[0]));
  EXPECT_EQ(mesh["faces"].size(), 3 * static_cast<std::size_t>(m->mesh_facenum[0]));
  EXPECT_EQ(mesh["faces_of_model"], m->mesh_facenum[0]);
  const json& upper = geometry["bodies"][1]["geoms"];
  EXPECT_EQ(upper[0]["rgba"], json({1, 0, 0, 1}));
  EXPECT_EQ(upper[1]["rgba"], json({0, 1, 0, .5}));
  EXPECT_EQ(geometry["bodies"][0]["geoms"].size(), 1);
  EXPECT_EQ(geometry["left_out"], 1);
}

/// A ball of rings x around triangles.
std::string ball(int rings, int around) {
  std::string vertices, faces;
  for (int i = 0; i <= rings; ++i)
    for (int k = 0; k < around; ++k) {
      const double a = mjPI * (i + .01) / (rings + .02), b = 2 * mjPI * k / around;
      vertices += fmt::format("{} {} {} ", std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a));
    }
  for (int i = 0; i < rings; ++i)
    for (int k = 0; k < around; ++k) {
      const int next = (k + 1) % around, here = i * around, there = here + around;
      faces +=
          fmt::format("{} {} {} {} {} {} ", here + k, there + k, there + next, here + k, there + next, here + next);
    }
  return fmt::format(R"(<mesh name="ball{}" vertex="{}" face="{}"/>)", rings, vertices, faces);
}

TEST(Geometry, SimplifiesLargeMeshesAndSaysSo) {
  const auto model =
      mujoco::load_string("<mujoco><asset>" + ball(100, 100) + ball(6, 10) + R"(</asset><worldbody><body><joint/>
        <geom type="mesh" mesh="ball100"/><geom type="mesh" mesh="ball6"/></body></worldbody></mujoco>)")
          .value();
  const json whole = geometry_of(*model)["meshes"], few = geometry_of(*model, {.triangles = 2000})["meshes"];
  EXPECT_EQ(whole[0]["faces"].size(), 3 * 20'000);
  EXPECT_EQ(few[1], whole[1]);  // the small one stays
  EXPECT_EQ(few[0]["faces_of_model"], 20'000);
  const std::size_t left = few[0]["faces"].size() / 3;
  EXPECT_LE(left, 2000 - 120);
  EXPECT_GT(left, 500);
  const auto vertices = few[0]["vertices"].get<std::vector<double>>();
  for (const int place : few[0]["faces"]) ASSERT_LT(static_cast<std::size_t>(place), vertices.size() / 3);
  for (std::size_t v = 0; v < vertices.size(); v += 3)
    EXPECT_NEAR(std::hypot(vertices[v], vertices[v + 1], vertices[v + 2]), 1, .05);
  EXPECT_EQ(geometry_of(*model, {.geoms = 1})["left_out"], 1);
}

std::unique_ptr<Server> start(Hello hello, bool guarded = false) {
  return std::move(
      Server::start({.address = {.port = 0, .loopback = !guarded}, .readonly = false, .limits = {}}, std::move(hello))
          .value());
}

Scenario hold() {
  return load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
}

TEST(Geometry, IsServedToWhoMaySeeTheBench) {
  const Scenario scenario = hold();
  const auto server = start(hello_of(scenario, "run", "1"));
  const std::string answer = Client(port_of(*server)).get("/geometry.json");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("Content-Security-Policy: default-src 'none'"));
  EXPECT_EQ(answer.substr(answer.find("\r\n\r\n") + 4), geometry_json(*scenario.model));
  const auto guarded = start(hello_of(scenario, "run", "1"), true);
  EXPECT_THAT(Client(port_of(*guarded)).get("/geometry.json"), StartsWith("HTTP/1.1 403"));
  const auto without = start({.columns = {{"", "time_s", "s"}}});
  EXPECT_THAT(Client(port_of(*without)).get("/geometry.json"), StartsWith("HTTP/1.1 404"));
}

TEST(Poses, AreThoseOfTheRowThatTheyName) {
  Scenario scenario = hold();
  const auto server = start(hello_of(scenario, "run", "1"));
  Client client(port_of(*server));
  ASSERT_TRUE(client.watch());
  ASSERT_FALSE(client.hear_text("hello").empty());
  Twin twin(std::move(scenario));
  TwinFeed feed(*server, false);
  const mjModel* m = twin.model().get();
  const std::size_t count = static_cast<std::size_t>(m->nbody);
  std::vector<std::vector<float>> expected;
  const auto begin = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() < begin + std::chrono::milliseconds(1200)) {
    twin.data()->qpos[0] += 1e-3;  // each pose is another one
    ASSERT_TRUE(twin.step());
    feed.sample(twin, twin.time_s());
    std::vector<float>& row = expected.emplace_back();
    for (std::size_t b = 0; b < count; ++b) {
      for (std::size_t k = 0; k < 3; ++k) row.push_back(static_cast<float>(twin.data()->xpos[3 * b + k]));
      for (std::size_t k = 0; k < 4; ++k) row.push_back(static_cast<float>(twin.data()->xquat[4 * b + k]));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  std::uint64_t number = 0, last = 0;
  int poses = 0;
  while (last + 1 < expected.size()) {
    const auto message = client.hear();
    ASSERT_TRUE(message);
    if (message->opcode != 2 || message->content[0] != 2) continue;
    std::uint32_t head[2];
    std::memcpy(head, message->content.data(), sizeof head);
    std::memcpy(&number, message->content.data() + sizeof head, sizeof number);
    ASSERT_EQ(head[1], count);
    ASSERT_EQ(message->content.size(), 16 + 4 * pose_numbers * count);
    ASSERT_LT(number, expected.size());
    EXPECT_GE(number, last);
    std::vector<float> values(pose_numbers * count);
    std::memcpy(values.data(), message->content.data() + 16, sizeof(float) * values.size());
    EXPECT_EQ(values, expected[number]) << number;
    last = number, ++poses;
  }
  EXPECT_GE(poses, 5);
  EXPECT_LE(poses, 30 * 1.2 + 5);  // 30 a second, whatever the rate of rows
  Client late(port_of(*server));
  ASSERT_TRUE(late.watch());  // the last pose is for who comes when nothing moves any more, too
  for (std::string content; content.empty() || content[0] != 2;) {
    const auto message = late.hear();
    ASSERT_TRUE(message);
    if (message->opcode == 2) content = message->content;
    if (!content.empty()) EXPECT_EQ(content[0], 2);
  }
}

}  // namespace
}  // namespace tribotwin::twin::live
