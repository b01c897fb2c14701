// Sensors of a drive in mjData.sensordata, and models with drives attached to others.
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/plugins/mujoco/source.hpp>

namespace tribotwin::mujoco {
namespace {

using testing::HasSubstr;

const std::string bench = std::string(TRIBOTWIN_SOURCE_DIR) + "/mjcf/rh380n_bench.xml";

/// Two drives under gravity, the second with bristles, and what is put into <extension> and <sensor>.
std::string arm(std::string_view extension, std::string_view sensors) {
  return fmt::format(
      R"(<mujoco><option timestep="0.001" tolerance="1e-14" iterations="100"/>
  <extension><plugin plugin="tribotwin.drive">
    <instance name="a"><config key="law" value="stribeck"/><config key="Fc" value="0.03"/>
      <config key="Fs" value="0.05"/><config key="vs" value="10"/><config key="alpha" value="1.3"/>
      <config key="Fv" value="0.0005"/><config key="torque_max_nm" value="100"/><config key="gear_ratio" value="50"/>
      <config key="brake_torque_nm" value="80"/><config key="thermal" value="first_order"/>
      <config key="R_th" value="2"/><config key="kappa" value="600"/><config key="T_amb" value="20"/></instance>
    <instance name="b"><config key="law" value="stribeck"/><config key="Fc" value="0.03"/>
      <config key="Fs" value="0.05"/><config key="vs" value="10"/><config key="alpha" value="1.3"/>
      <config key="Fv" value="0.0005"/><config key="torque_max_nm" value="50"/><config key="gear_ratio" value="50"/>
      <config key="friction" value="lugre"/><config key="sigma0" value="1"/><config key="sigma1" value="0.002"/>
      <config key="vd" value="2"/></instance></plugin>
    {}</extension>
  <worldbody>
    <body><joint name="a" axis="0 1 0" armature="1" frictionloss="1" solreffriction=".001 1"
      solimpfriction=".9999 .9999 .001 .5 2"/><geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5" mass="4"/>
    <body pos="0 0 -.5"><joint name="b" axis="0 1 0" armature="1" frictionloss="1" solreffriction=".001 1"
      solimpfriction=".9999 .9999 .001 .5 2"/><geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5" mass="4"/></body>
    </body>
  </worldbody>
  <actuator><plugin name="da" joint="a" plugin="tribotwin.drive" instance="a" actdim="3"/>
    <plugin name="db" joint="b" plugin="tribotwin.drive" instance="b" actdim="4"/></actuator>
  <sensor><jointpos joint="a"/>{}</sensor></mujoco>)",
      extension, sensors);
}

constexpr char declared[] = R"(<plugin plugin="tribotwin.sensor"/>)";

std::string one(std::string_view name, std::string_view actuator, std::string_view quantity) {
  return fmt::format(
      R"(<plugin name="{}" plugin="tribotwin.sensor" objtype="actuator" objname="{}"><config key="quantity"
         value="{}"/></plugin>)",
      name, actuator, quantity);
}

std::span<const mjtNum> values(const mjModel* m, const mjData* d, const char* name) {
  const int id = mj_name2id(m, mjOBJ_SENSOR, name);
  EXPECT_GE(id, 0) << name;
  return {d->sensordata + m->sensor_adr[id], static_cast<std::size_t>(m->sensor_dim[id])};
}

TEST(Sensors, TellWhatTheDriveOfTheStepHad) {
  std::string sensors = R"(<plugin name="all_a" plugin="tribotwin.sensor" objtype="actuator" objname="da"/>
                           <plugin name="all_b" plugin="tribotwin.sensor" objtype="actuator" objname="db"/>)";
  for (const SensorQuantity& q : sensor_quantities()) sensors += one(q.name, "da", q.name);
  const auto model = load_string(arm(declared, sensors));
  ASSERT_TRUE(model) << model.error().message;
  const mjModel* m = (*model)->get();
  const DataPtr d = (*model)->make_data();
  const Binding &a = (*model)->drives()[0], &b = (*model)->drives()[1];
  drive::set_temperature(a.drive, state(d.get(), a), 55);
  drive::set_wear(workspace(d.get(), a), 0, 1.2);
  drive::set_wear(workspace(d.get(), a), 1, 1.4);
  int stuck_steps = 0;
  for (int i = 0; i < 2000; ++i) {
    const bool braked = i >= 1500;
    workspace(d.get(), a).brake_engaged = braked;
    d->ctrl[0] = braked ? 0 : 30 * std::sin(0.005 * i);
    d->ctrl[1] = 10;
    const double temperature = drive::temperature_degC(a.drive, state(d.get(), a));
    const double load_a = state(d.get(), a).load_nm, load_b = state(d.get(), b).load_nm;
    const double stuck_s = workspace(d.get(), a).stuck_s;
    (*model)->step(d.get());
    const auto all = values(m, d.get(), "all_a");
    ASSERT_EQ(all.size(), sensor_quantities().size());
    EXPECT_EQ(all[0], temperature);
    EXPECT_EQ(all[1], workspace(d.get(), a).friction_nm);
    EXPECT_EQ(all[2], load_a);
    EXPECT_EQ(all[3], braked);
    EXPECT_EQ(all[4], workspace(d.get(), a).stuck_s > stuck_s);
    EXPECT_DOUBLE_EQ(all[5], 0.4);
    stuck_steps += all[4] != 0;
    for (std::size_t k = 0; k < all.size(); ++k) {
      const auto single = values(m, d.get(), sensor_quantities()[k].name);
      ASSERT_EQ(single.size(), 1u);
      EXPECT_EQ(single[0], all[k]) << sensor_quantities()[k].name;
    }
    EXPECT_EQ(values(m, d.get(), "all_b")[1], workspace(d.get(), b).friction_nm);
    EXPECT_EQ(values(m, d.get(), "all_b")[2], load_b);
  }
  EXPECT_GT(stuck_steps, 400);
  EXPECT_LT(stuck_steps, 1500);
}

TEST(Sensors, ChangeNothing) {
  const auto with = load_string(arm(declared, one("t", "da", "friction"))), without = load_string(arm("", ""));
  ASSERT_TRUE(with && without);
  const DataPtr d = (*with)->make_data(), e = (*without)->make_data();
  for (int i = 0; i < 500; ++i) {
    d->ctrl[0] = e->ctrl[0] = 20;
    (*with)->step(d.get());
    (*without)->step(e.get());
  }
  EXPECT_EQ(d->qpos[0], e->qpos[0]);
  EXPECT_EQ(d->qpos[1], e->qpos[1]);
}

TEST(Sensors, MistakesAreNamed) {
  const auto error = [](std::string_view extension, std::string_view sensor) {
    const auto model = load_string(arm(extension, sensor));
    return model ? std::string("loaded") : model.error().message;
  };
  EXPECT_THAT(error(declared, one("t", "da", "temperatur")),
              testing::AllOf(HasSubstr("<plugin name=\"t\">"), HasSubstr("'quantity' is 'temperatur'"),
                             HasSubstr("temperature, friction, load, brake, stuck, wear")));
  EXPECT_THAT(error(declared, one("t", "nobody", "load")), HasSubstr("'nobody' is no actuator with plugin"));
  EXPECT_THAT(error(declared, R"(<plugin name="t" plugin="tribotwin.sensor" objtype="joint" objname="a"/>)"),
              HasSubstr("needs name, objtype=\"actuator\" and objname"));
  EXPECT_THAT(error(declared, R"(<plugin name="t" plugin="tribotwin.sensr" objtype="joint" objname="a"/>)"),
              HasSubstr("did you mean 'tribotwin.sensor'?"));
  EXPECT_THAT(error(declared, R"(<plugin name="t" plugin="tribotwin.sensor" objtype="actuator" objname="da">
                                   <config key="unit" value="K"/></plugin>)"),
              HasSubstr("'unit' is not known"));
  const std::string instance =
      R"(<plugin plugin="tribotwin.sensor"><instance name="oil"><config key="quantity" value="temperature"/></instance>
         </plugin>)";
  EXPECT_EQ(error(instance, R"(<plugin name="t" plugin="tribotwin.sensor" instance="oil" objtype="actuator"
                                 objname="da"/>)"),
            "loaded");
  EXPECT_THAT(error(instance, R"(<plugin name="t" plugin="tribotwin.sensor" instance="oi" objtype="actuator"
                                   objname="da"/>)"),
              HasSubstr("no <instance name=\"oi\">"));
}

/// The key names the drive; without it, it is the one on the tendon.
TEST(Sensors, TransmissionFindsItsDriveByTheTendon) {
  const auto text = read_text(bench);
  ASSERT_TRUE(text);
  const auto key = text->find("<config key=\"drive\"");
  ASSERT_NE(key, std::string::npos);
  std::string without = *text;
  without.erase(key, text->find("/>", key) + 2 - key);
  const auto folder = std::filesystem::path(bench).parent_path();
  const auto named = load_string(*text, {}, folder), found = load_string(without, {}, folder);
  ASSERT_TRUE(named) << named.error().message;
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ((*named)->springs()[0].drive.actuator, (*found)->springs()[0].drive.actuator);

  std::string wrong = *text;
  wrong.replace(wrong.find("value=\"", key) + 7, 1, "?");
  const auto refused = load_string(wrong, {}, folder);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("which is no instance of tribotwin.drive that an actuator uses"));
}

#if mjVERSION_HEADER >= 332  // mjs_attach

/// A model with the child attached twice, by prefixes.
ModelPtr attached_twice(const std::function<mjSpec*(char* error, int size)>& read_child) {
  char error[1000] = "";
  const std::unique_ptr<mjSpec, decltype(&mj_deleteSpec)> inner(read_child(error, sizeof error), mj_deleteSpec),
      outer(mj_makeSpec(), mj_deleteSpec);
  if (!inner) throw std::runtime_error(error);
  mjs_setDeepCopy(outer.get(), 1);
  outer->option.timestep = inner->option.timestep;
  outer->option.tolerance = 1e-14;
  outer->option.iterations = 100;
  for (const char* prefix : {"left_", "right_"}) {
    mjsFrame* frame = mjs_addFrame(mjs_findBody(outer.get(), "world"), nullptr);
    frame->pos[1] = prefix[0] == 'l' ? 0 : 10;
    if (!mjs_attach(frame->element, mjs_findBody(inner.get(), "world")->element, prefix, ""))
      throw std::runtime_error(mjs_getError(outer.get()));
  }
  ModelPtr model(mj_compile(outer.get(), nullptr));
  if (!model) throw std::runtime_error(mjs_getError(outer.get()));
  return model;
}

TEST(Sensors, SurviveAttaching) {
  const std::string child = arm(declared, one("t", "da", "temperature") + one("f", "db", "friction"));
  const auto single = load_string(child);
  ASSERT_TRUE(single) << single.error().message;
  const ModelPtr m =
      attached_twice([&](char* error, int size) { return mj_parseXMLString(child.c_str(), nullptr, error, size); });
  const DataPtr twice(mj_makeData(m.get())), once = (*single)->make_data();
  for (int i = 0; i < 500; ++i) {
    for (int k = 0; k < 4; ++k) twice->ctrl[k] = 20;
    for (int k = 0; k < 2; ++k) once->ctrl[k] = 20;
    mj_step(m.get(), twice.get());
    (*single)->step(once.get());
  }
  for (const char* name : {"t", "f"})
    for (const char* prefix : {"left_", "right_"})
      EXPECT_NEAR(values(m.get(), twice.get(), (std::string(prefix) + name).c_str())[0],
                  values((*single)->get(), once.get(), name)[0], 1e-9)
          << prefix << name;
  EXPECT_GT(std::abs(values(m.get(), twice.get(), "left_f")[0]), 0.1);
}

TEST(Sensors, AnAttachedTransmissionHeatsItsOwnDrive) {
  const ModelPtr m =
      attached_twice([](char* error, int size) { return mj_parseXML(bench.c_str(), nullptr, error, size); });
  const DataPtr d(mj_makeData(m.get()));
  const int motor = mj_name2id(m.get(), mjOBJ_ACTUATOR, "right_load");
  ASSERT_GE(motor, 0);
  for (int i = 0; i < 3000; ++i) {
    d->ctrl[motor] = 3000 * std::sin(0.01 * i);
    mj_step(m.get(), d.get());
  }
  const auto rise = [&](const std::string& drive) {
    return d->act[m->actuator_actadr[mj_name2id(m.get(), mjOBJ_ACTUATOR, drive.c_str())]];
  };
  EXPECT_GT(rise("right_motor"), 1e-6);
  EXPECT_LT(rise("left_motor"), 1e-2 * rise("right_motor"));
}

#endif

}  // namespace
}  // namespace tribotwin::mujoco
