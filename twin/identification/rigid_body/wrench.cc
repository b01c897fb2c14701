#include <limits>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/wrench.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

Result<MatrixXd> external_wrench(const mujoco::Model& model, const std::string& site, const JointMotion& motion,
                                 const MatrixXd& predicted) {
  constexpr double nearly_singular = 0.01;  // smallest singular value over the largest
  const mjModel* m = model.get();
  const int id = mj_name2id(m, mjOBJ_SITE, site.c_str());
  if (id < 0) {
    std::vector<std::string> names;
    for (int s = 0; s < m->nsite; ++s)
      if (const char* name = mj_id2name(m, mjOBJ_SITE, s)) names.emplace_back(name);
    return tl::unexpected(fmt::format("has no site '{}'; {}", site,
                                      names.empty() ? "it has none" : fmt::format("its sites: {}", joined(names))));
  }
  const auto d = model.make_data();
  Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::RowMajor> J(6, m->nv);
  MatrixXd out = MatrixXd::Constant(6, motion.size(), std::numeric_limits<double>::quiet_NaN());
  for (Index i = 0; i < motion.size(); ++i) {
    Eigen::Map<VectorXd>(d->qpos, m->nq) = motion.q.col(i);
    mj_kinematics(m, d.get());
    mj_comPos(m, d.get());
    mj_jacSite(m, d.get(), J.data(), J.data() + 3 * m->nv, id);
    std::vector<Index> moving;
    for (Index j = 0; j < m->nv; ++j)
      if (motion.moving(j, i)) moving.push_back(j);
    if (moving.size() < 6) continue;
    const MatrixXd Jt = J(Eigen::all, moving).transpose();
    const VectorXd beyond = predicted.col(i) - motion.torque.col(i);
    if (const auto wrench = well_conditioned_solution(Jt, beyond(moving), nearly_singular)) out.col(i) = *wrench;
  }
  return out;
}

}  // namespace tribotwin::twin::identification
