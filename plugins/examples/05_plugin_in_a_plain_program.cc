// The friction of a drive in a MuJoCo program of your own: load, set motor torques, step, read. MuJoCo 3.2 and newer
// loads the plugin by itself and nothing of this project is linked; MuJoCo 2.2.2 has no plugins, so the program links
// tribotwin::plugins_mujoco. Arguments: a model with drives, such as mjcf/xl330_pendulum.xml, and on 3.x the plugin
// libtribotwin_drive-VERSION.so.
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include <mujoco/mujoco.h>

#if mjVERSION_HEADER >= 320

int main(int argc, char** argv) {
  if (argc != 3) return std::fprintf(stderr, "usage: 05_plugin_in_a_plain_program MODEL.xml PLUGIN.so\n"), 2;

  mj_loadPluginLibrary(argv[2]);
  char error[1000] = "";
  mjModel* m = mj_loadXML(argv[1], nullptr, error, sizeof error);
  if (!m) return std::fprintf(stderr, "%s\n", error), 2;

  mjData* d = mj_makeData(m);
  while (d->time < 10) {
    d->ctrl[0] = 0.3 * std::sin(2 * d->time);  // motor torque, arm side [Nm]
    mj_step(m, d);
    if (std::fmod(d->time + 1e-9, 2) < 0.5 * m->opt.timestep)
      std::printf("%4.1f s: joint at %7.4f rad\n", d->time, d->qpos[0]);
  }
  mj_deleteData(d);
  mj_deleteModel(m);
}

#else

#include <tribotwin/plugins/mujoco/loader.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin;
  if (argc != 2) return std::fprintf(stderr, "usage: 05_plugin_in_a_plain_program MODEL.xml\n"), 2;

  const auto model = mujoco::load_file(argv[1]);
  if (!model) return std::fprintf(stderr, "%s\n", model.error().message.c_str()), 2;

  const mujoco::DataPtr data = (*model)->make_data();
  mjData* d = data.get();
  while (d->time < 10) {
    d->ctrl[0] = 0.3 * std::sin(2 * d->time);  // motor torque, arm side [Nm]
    (*model)->step(d);
    if (std::fmod(d->time + 1e-9, 2) < 0.5 * (*model)->get()->opt.timestep)
      std::printf("%4.1f s: joint at %7.4f rad, friction %7.4f Nm\n", d->time, d->qpos[0],
                  mujoco::workspace(d, (*model)->drives()[0]).friction_nm);
  }
}

#endif
