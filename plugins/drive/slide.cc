#include <cmath>

#include <tribotwin/plugins/drive/slide.hpp>

namespace tribotwin::drive {
namespace {

bool usable(double x, double most) { return std::abs(x) <= most; }  // false for NaN

}  // namespace

double slide(const Drive& drive, const thermal::Decay& decay, double speed_rad_s, double load_nm, Sliding& s) {
  const bool wrong = !usable(speed_rad_s, slide_speed_max_rad_s) || !usable(load_nm, slide_load_max_nm);
  const double speed = usable(speed_rad_s, slide_speed_max_rad_s) ? speed_rad_s : 0,
               load = usable(load_nm, slide_load_max_nm) ? load_nm : 0, dt = decay.dt_s;
  const bool advances = dt > 0 && dt <= slide_dt_max_s;
  if (!(drive.load_filter_s > 0))
    s.state.load_nm = load;
  else if (advances)
    s.state.load_nm += (load - s.state.load_nm) * -std::expm1(-dt / drive.load_filter_s);
  const double seen = s.state.load_nm;
  const double limit = begin_step(drive, s.state, s.workspace, s.time_s, speed, s.position_rad);
  if (wrong) s.workspace.outside = 1;
  const double row = speed > 0 ? limit : speed < 0 ? -limit : 0;
  if (!advances) {
    s.workspace.friction_nm = gear_friction_nm(s.workspace, row);
    return s.workspace.friction_nm;
  }
  const double end_rad = s.position_rad + speed * dt;
  const double delivered = load + (s.workspace.applied_nm + row) + drive.offset_nm;
  const double needed = delivered / (1 - s.workspace.faults.torque_loss) / (1 - s.workspace.hot_torque_loss);
  end_step(drive, decay,
           {.friction_nm = row,
            .torque_nm = within_current_limit(drive, s.workspace, needed),
            .qd_end_rad_s = speed,
            .q_end_rad = end_rad},
           dt, s.state, s.workspace);
  s.state.load_nm = seen;  // the load is given, not what remains of a torque
  s.position_rad = end_rad;
  s.time_s += dt;
  return s.workspace.friction_nm;
}

}  // namespace tribotwin::drive
