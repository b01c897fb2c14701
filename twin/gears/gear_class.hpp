#pragma once

#include <span>
#include <string>
#include <string_view>
#include <utility>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// Starter parameters for a joint of which only the torque is known. Selection, help, `tribotwin list gears`, messages
/// and the table of README.md follow from one table.
namespace tribotwin::twin {

struct GearClass {
  std::string_view name;       ///< of this size, for --joint NAME=CLASS
  std::string_view family;     ///< of its sizes; the one nearest in torque is scaled to the joint
  bool linear;                 ///< for slides: torques are forces [N], angles are lengths [m]
  double torque_max_nm;        ///< joint side [Nm; N]: what the parameters hold for
  double gear_ratio;           ///< motor turns per joint turn; motor rad per m for a slide
  double rotor_inertia_kg_m2;  ///< motor side
  double speed_max_rad_s;      ///< joint side [rad/s; m/s]: up to which motions are planned
  std::string_view law;        ///< of plugins/friction
  double friction_scale;       ///< multiplies those of `parameters` that are torques [Nm]
  std::span<const std::pair<std::string_view, double>> parameters;
  double law_speed_max_rad_s;  ///< end of the law's range on its side; 0: that of the law
  double law_load_max;         ///< end of the law's range of load [-]; 0: that of the law
  double R_th_K_W, kappa_s;    ///< first-order thermal model
  std::string_view source;     ///< what is published, what is scaled, what is chosen; by author and year
};

/// Every class; the sizes of a family stand together, ascending.
std::span<const GearClass> gear_classes();

/// The class with the name, or the size of the family whose torque is nearest to `effort_nm` [Nm; N].
/// The names of classes and families.
std::vector<std::string_view> gear_names();
/// Fails with the nearest name that exists.
Result<const GearClass*> find_gear_class(std::string_view name, double effort_nm);

/// The family that robots of this effort mostly have: hobby_servo below 5 Nm, planetary for legs up to 60 Nm, harmonic
/// below 500 Nm, else cycloidal; ball_screw for a slide.
std::string_view usual_family(double effort_nm, bool slide, bool legged);

/// Keys of a drive of this class with torques scaled by `scale` > 0; gear ratio, speeds and times stay.
drive::Configuration configuration_of(const GearClass& gear, double scale);

/// "NAME, scaled by 1.15 from 130 Nm" or "NAME", for messages and comments.
std::string description(const GearClass& gear, double scale);

/// The warning that belongs to every use of the table.
inline constexpr std::string_view starting_points =
    "friction and heat are starting points from the table of gear classes, not measured on this robot; identify yours "
    "and give them by the option params";

/// The table as Markdown, for README.md.
std::string gear_classes_markdown();

}  // namespace tribotwin::twin
