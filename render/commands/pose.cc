#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/commands/picture.hpp>
#include <tribotwin/render/pose/moment.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render::program {
namespace {

using twin::InputError;

struct Arguments : PictureOptions {
  std::vector<std::string> pose, temperature;
  std::optional<double> time;
};

/// What is drawn; `run` where it comes from one.
struct Subject {
  std::unique_ptr<RunData> run;
  std::shared_ptr<const mujoco::Model> model;
  PoseState state;
};

Subject subject_of(const Arguments& a) {
  if (!std::filesystem::is_directory(a.target)) {
    if (a.time) throw InputError("--time: is for the folder of a run, not for a model");
    std::shared_ptr<const mujoco::Model> model =
        twin::or_wrong_input(mujoco::load_file(twin::given_or_shipped(a.target, ".xml")));
    return {.run = nullptr, .model = model, .state = rest(*model)};
  }
  auto run = run_with_model(a.target);
  const auto& time = run->record.time_s;
  if (a.time && !(*a.time >= time.front() && *a.time <= time.back()))
    throw InputError(fmt::format("--time {}: the record spans {} to {} s", *a.time, time.front(), time.back()));
  const auto model = run->scenario->model;
  PoseState state = Moments(*model, run->record).at(a.time.value_or(time.back()));
  if (a.time && std::abs(*state.time_s - *a.time) > 1e-6)
    twin::note("--time {}: the record has no sample there; drawn is {} s, the nearest one", *a.time, *state.time_s);
  return {std::move(run), model, std::move(state)};
}

/// The names of the objects of this type that `fits`, with commas.
std::string names_of(const mjModel* m, int count, mjtObj type, auto fits) {
  std::string names;
  for (int i = 0; i < count; ++i)
    if (const char* name = mj_id2name(m, type, i); name && fits(i))
      names += (names.empty() ? "" : ", ") + std::string(name);
  return names;
}

void set_keyframe(PoseState& state, const mjModel* m, const std::string& given) {
  const int key = mj_name2id(m, mjOBJ_KEY, given.c_str());
  if (key < 0) {
    const std::string names = names_of(m, m->nkey, mjOBJ_KEY, [](int) { return true; });
    throw InputError(fmt::format("--pose {}: is neither JOINT=RAD nor a keyframe; the model has {}", given,
                                 names.empty() ? "no keyframes" : "the keyframes " + names));
  }
  state.qpos.assign(m->key_qpos + key * m->nq, m->key_qpos + (key + 1) * m->nq);
}

void set_position(PoseState& state, const mjModel* m, const std::string& given) {
  const auto movable = [m](int joint) {
    return m->jnt_type[joint] == mjJNT_HINGE || m->jnt_type[joint] == mjJNT_SLIDE;
  };
  const auto [name, value] = assignment("--pose", given);
  const int joint = mj_name2id(m, mjOBJ_JOINT, name.c_str());
  if (joint < 0 || !movable(joint))
    throw InputError(fmt::format("--pose {}: the model has the hinge and slide joints {}", given,
                                 names_of(m, m->njnt, mjOBJ_JOINT, movable)));
  state.qpos[static_cast<std::size_t>(m->jnt_qposadr[joint])] = value;
}

void set_temperature(PoseState& state, const mujoco::Model& model, const std::string& given) {
  const auto [name, value] = assignment("--joint-temperature", given);
  const auto index = twin::find_drive(model, name);
  if (!index) throw InputError(fmt::format("--joint-temperature {}: {}", given, index.error().message));
  state.joints[*index].temperature_degC = value;
}

/// A model is coloured only where the user says by what; a run always is.
PoseOptions options_of(const Arguments& a, const Subject& subject) {
  PoseOptions options;
  options.view = a.view();
  options.text_scale = a.text_scale;
  const bool known = subject.run || !a.temperature.empty() || !a.colour_by.empty();
  options.colour_by = a.colours(known ? ColourBy::temperature : ColourBy::nothing);
  options.panel = known && options.colour_by != ColourBy::nothing;
  options.scale = subject.run && options.colour_by == ColourBy::friction
                      ? scale_of(*subject.model, subject.run->record, options.colour_by)
                      : scale_of(*subject.model, subject.state, options.colour_by);
  return options;
}

int execute(const Arguments& a) {
  a.check_output("a pose", ".png");
  const Size size = a.pixels();
  Subject subject = subject_of(a);
  for (const auto& given : a.pose) {
    const auto set = given.find('=') == std::string::npos ? set_keyframe : set_position;
    set(subject.state, subject.model->get(), given);
  }
  for (const auto& given : a.temperature) set_temperature(subject.state, *subject.model, given);
  if (const auto beyond = beyond_range(*subject.model, subject.state); !beyond.empty())
    twin::note("the pose is beyond the range of {}", beyond);
  const PoseOptions options = options_of(a, subject);
  auto painter = twin::or_throw(PosePainter::create(subject.model, size));
  write(a.output, png(twin::or_throw(painter.draw(subject.state, options))));
  return twin::done;
}

}  // namespace

void add_pose(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("pose", "A picture of a model, or of a run at one time");
  a->add_to(*command, "MJCF model, or the folder of a run", "1280x960", "pose.png");
  command->add_option("--pose", a->pose, "JOINT=RAD (metres for a slide) or the name of a keyframe; may be repeated")
      ->allow_extra_args(false);
  command->add_option("--joint-temperature,--temperature", a->temperature, "JOINT=DEGC; may be repeated")
      ->allow_extra_args(false);
  command->add_option("--time", a->time, "Time of the run [s] (default: its end)");
  command->footer(
      "Example:\n  tribotwin-report pose mjcf/irb6620.xml --pose joint2=0.6 --joint-temperature joint2=72 -o pose.png");
  command->callback([a, &call] { call.code = execute(*a); });
}

}  // namespace tribotwin::render::program
