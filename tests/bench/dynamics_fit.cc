// For bench/dynamics.py: fit_dynamics on synthetic motion of the ER3A with noise, every sample used, joints weighed
// alike. Arguments: number of samples, file for [regressor, torque] as doubles row by row ("" for none).
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/resource.h>

#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

using namespace tribotwin;
using namespace tribotwin::twin;
using namespace tribotwin::twin::identification;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

int main(int, char** argv) {
  const Index samples = std::atol(argv[1]);
  const std::string file = argv[2];
  const auto model = mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/er3a_c60.xml");
  auto regressor = *Regressor::create((*model)->get());
  const BaseParameters base = base_parameters(regressor);
  const auto friction = *robot_friction(**model, regressor, coulomb_viscous());
  const Index n = regressor.joints(), columns = base.size() + 3 * n;
  JointMotion motion{
      .segments = {{0, samples}}, .time_s = std::vector<double>(static_cast<std::size_t>(samples)), .file = {0}};
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  for (auto* m : {&motion.q, &motion.qd, &motion.qdd, &motion.torque}) m->resize(n, samples);
  motion.temperature_degC.setConstant(n, samples, 20);
  motion.moving.setConstant(n, samples, true);
  const VectorXd phi = regressor.model_parameters();
  std::FILE* out = file.empty() ? nullptr : std::fopen(file.c_str(), "wb");
  VectorXd row(columns + 1);
  for (Index i = 0; i < samples; ++i) {
    for (Index j = 0; j < n; ++j)
      motion.q(j, i) = normal(random), motion.qd(j, i) = normal(random), motion.qdd(j, i) = 5 * normal(random);
    const MatrixXd& Y = regressor.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i));
    motion.torque.col(i) = Y * phi;
    for (Index j = 0; j < n; ++j) {
      motion.torque(j, i) += std::copysign(2, motion.qd(j, i)) + 0.5 * motion.qd(j, i) + 0.1 * normal(random);
      if (!out) continue;
      row.setZero();
      row.head(base.size()) = Y.row(j)(base.independent);
      row.segment<3>(base.size() + 3 * j) << std::copysign(1, motion.qd(j, i)), motion.qd(j, i), 1;
      row(columns) = motion.torque(j, i);
      std::fwrite(row.data(), sizeof(double), static_cast<std::size_t>(row.size()), out);
    }
  }
  motion.direction = motion.qd.cwiseSign();
  if (out) std::fclose(out);
  const auto start = std::chrono::steady_clock::now();
  const auto fit = fit_dynamics(regressor, base, friction, motion, {.weigh = false, .threads = 2});
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::vector<double> parameters(fit->parameters.base.begin(), fit->parameters.base.end());
  for (const auto& f : fit->parameters.friction) parameters.insert(parameters.end(), f.begin(), f.end());
  ::rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  fmt::print("{{\"seconds\": {}, \"columns\": {}, \"peak_GiB\": {}, \"parameters\": [{}]}}\n", seconds, columns,
             static_cast<double>(usage.ru_maxrss) / 1048576, fmt::join(parameters, ", "));
}
