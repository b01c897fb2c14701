#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/offscreen/renderer.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

/// Pictures of a robot whose joint housings have the colour of their temperature or friction. The housing is the geom
/// "housing_JOINT" where the model has one, else all geoms of the joint's body.
namespace tribotwin::render {

/// A drive's joint at one instant; NaN where it is not known.
struct JointState {
  std::string name;
  double temperature_degC, friction_nm;  ///< friction signed, arm side
};

struct PoseState {
  std::vector<double> qpos;  ///< mjModel.nq
  std::optional<double> time_s;
  std::vector<JointState> joints;  ///< in the order of the model's drives
};

/// The model at rest: keyframe "home" if there is one, else qpos0; joints at the drives' start temperature.
PoseState rest(const mujoco::Model& model);
/// Sample `index` of a record. Joints the record does not have keep their place at rest.
PoseState recorded(const mujoco::Model& model, const twin::Recording& record, std::size_t index);
/// The same, with the model's rest(), for many samples.
PoseState recorded(const mujoco::Model& model, const twin::Recording& record, std::size_t index, PoseState at_rest);

enum class ColourBy { temperature, friction, nothing };

/// The ends of the colour bar: degC, or percent of torque_max_nm.
struct Scale {
  double from = 20, to = 80;
};
/// Round limits around all these values, at least 5 apart; the default without any finite one.
Scale scale_around(std::span<const double> values);
/// The same for magnitudes: from 0 on.
Scale magnitudes_around(std::span<const double> values);
/// The scale for all states of a record, or for one state.
Scale scale_of(const mujoco::Model& model, const twin::Recording& record, ColourBy by);
Scale scale_of(const mujoco::Model& model, const PoseState& state, ColourBy by);

/// What a camera must see that shows all poses of a record: for View::whole.
std::vector<Point> outline(const mujoco::Model& model, const twin::Recording& record);
/// "joint2 (1.2 rad, range -1 .. 1)" for every joint with a limit that the pose is beyond; empty where none is.
std::string beyond_range(const mujoco::Model& model, const PoseState& state);

struct PoseOptions {
  View view;
  ColourBy colour_by = ColourBy::temperature;
  Scale scale;
  bool panel = true;      ///< time, and per joint name, temperature and friction
  bool legend = true;     ///< the colour bar
  double text_scale = 1;  ///< size of the text; 1 is for a picture seen as large as it is
};

/// Draws poses of one model, in one size at a time.
class PosePainter {
 public:
  static Result<PosePainter> create(std::shared_ptr<const mujoco::Model> model, Size size, Quality quality = {});
  Result<Image> draw(const PoseState& state, const PoseOptions& options);
  const mujoco::Model& model() const { return *model_; }
  Size size() const { return size_; }
  /// Of the next pictures: no side longer than at first.
  void resize(Size size);

 private:
  PosePainter(std::shared_ptr<const mujoco::Model> model, Size size, Renderer renderer);
  std::shared_ptr<const mujoco::Model> model_;
  Size size_;
  Renderer renderer_;
  mujoco::DataPtr data_;
};

/// States beside each other in one picture of about 16:10, each in the painter's size, under one colour bar.
Result<Image> contact_sheet(PosePainter& painter, std::span<const PoseState> states, const PoseOptions& options,
                            const std::function<void(double)>& progress = {});
/// `count` samples, evenly in time from first to last, without repetition.
std::vector<std::size_t> evenly_in_time(std::span<const double> time_s, std::size_t count);

}  // namespace tribotwin::render
