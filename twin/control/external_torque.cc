#include <algorithm>
#include <cmath>

#include <Eigen/Dense>
#include <fmt/format.h>

#include <tribotwin/twin/control/external_torque.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {

ExternalTorque::ExternalTorque(std::shared_ptr<const mujoco::Model> model, double gain_1_s)
    : model_(std::move(model)),
      data_(model_->make_data()),
      observers_(model_->drives().size(), MomentumObserver(gain_1_s)) {
  for (auto* values : {&external_nm_, &momentum_, &speed_, &load_nm_}) values->resize(observers_.size());
  for (auto* values : {&step_, &moved_}) values->resize(static_cast<std::size_t>((*model_)->nv));
  slides_.resize(observers_.size());
}

Result<ExternalTorque> ExternalTorque::make(std::shared_ptr<const mujoco::Model> model, double gain_1_s) {
  for (int dof = 0; dof < (*model)->nv; ++dof)
    if (std::ranges::none_of(model->drives(), [dof](const auto& drive) { return drive.dof == dof; }))
      return tl::unexpected(fmt::format("joint '{}' has no tribotwin.drive: what moves it is not known",
                                        (*model)->names + (*model)->name_jntadr[(*model)->dof_jntid[dof]]));
  return ExternalTorque(std::move(model), gain_1_s);
}

void ExternalTorque::update(std::span<const double> position_rad, std::span<const double> speed_rad_s,
                            std::span<const double> torque_nm, std::span<const double> temperature_degC, double dt_s) {
  const mjModel* m = model_->get();
  mjData* d = data_.get();
  const auto drives = model_->drives();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    d->qpos[drives[i].position] = position_rad[i];
    d->qvel[drives[i].dof] = speed_rad_s[i];
  }
  mj_kinematics(m, d);
  mj_comPos(m, d);
  mj_crb(m, d);
  mj_comVel(m, d);
  mj_rne(m, d, 0, d->qfrc_bias);
  // p' less the part of M' qd is M qdd: the sum of M dqd serves as the momentum, and no derivative of M is needed.
  for (std::size_t i = 0; i < drives.size(); ++i) step_[drives[i].dof] = fresh_ ? 0 : speed_rad_s[i] - speed_[i];
  mj_mulM(m, d, moved_.data(), step_.data());
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const drive::Drive& drive = drives[i].drive;
    const int dof = drives[i].dof;
    momentum_[i] += moved_[dof];
    const double w = speed_rad_s[i] * drive.speed_scale();
    const auto level = drive::level(drive, friction::at_temperature(drive.law, temperature_degC[i]), w,
                                    load_nm_[i] / drive.torque_max_nm);
    const double friction = (w == 0 ? 0 : std::copysign(level.total() * drive.torque_scale_nm(), w)) + drive.offset_nm;
    external_nm_[i] = -observers_[i].update(torque_nm[i] - friction - d->qfrc_bias[dof], momentum_[i], dt_s);
    load_nm_[i] = torque_nm[i] - friction - m->dof_armature[dof] * step_[dof] / dt_s;
    slides_[i] = w * speed_[i] > 0;
    speed_[i] = speed_rad_s[i];
  }
  fresh_ = false;
}

std::array<double, 6> ExternalTorque::wrench(int site) {
  const mjModel* m = model_->get();
  Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::RowMajor> jacobian(6, m->nv);
  mj_jacSite(m, data_.get(), jacobian.data(), jacobian.data() + 3 * m->nv, site);
  Eigen::VectorXd torque(m->nv);
  for (std::size_t i = 0; i < external_nm_.size(); ++i) torque[model_->drives()[i].dof] = external_nm_[i];
  const Eigen::VectorXd w = ShortestSolution(jacobian.transpose())(torque);
  std::array<double, 6> out;
  std::copy_n(w.data(), 6, out.begin());
  return out;
}

}  // namespace tribotwin::twin
