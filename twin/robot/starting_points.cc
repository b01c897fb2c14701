#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/starting_points.hpp>

namespace tribotwin::twin {

std::string starting_point_name(std::string_view joint) { return "tribotwin.starting_point." + std::string(joint); }

std::string_view starting_point(const mujoco::Model& model, const mujoco::Binding& drive) {
  const mjModel* m = model.get();
  const int id = mj_name2id(m, mjOBJ_TEXT, starting_point_name(joint_name(m, drive)).c_str());
  return id < 0 ? std::string_view() : m->text_data + m->text_adr[id];
}

}  // namespace tribotwin::twin
