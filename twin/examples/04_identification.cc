// The parameters of a law from measured friction. The measurements are made up here from known parameters, so that the
// result can be judged; read_samples() reads them from files.
#include <cmath>
#include <cstdio>
#include <random>

#include <tribotwin/twin/identification/curves/fit.hpp>

int main() {
  using namespace tribotwin;
  namespace identification = twin::identification;

  const auto truth = friction::published_law("extended");
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0, 5e-4);  // of the maximum torque
  identification::Samples samples;
  std::uint32_t curve = 0;
  for (const double degC : {40.0, 55.0, 70.0})
    for (const double load : {0.1, 0.4, 0.7}) {
      for (double speed_rad_s = 2; speed_rad_s < 280; speed_rad_s *= 1.2) {
        samples.speed.push_back(speed_rad_s);
        samples.load.push_back(load);
        samples.temperature_degC.push_back(degC);
        samples.friction.push_back(friction::torque(*truth, speed_rad_s, load, degC) + noise(random));
        samples.curve.push_back(curve);
      }
      ++curve;
    }

  const auto fit = identification::fit(*truth->info, samples, {.fixed = {{"alpha", 1.36}}});
  if (!fit) return std::fprintf(stderr, "%s\n", fit.error().message.c_str()), 1;
  for (std::size_t i = 0; i < fit->parameters.size(); ++i) {
    const auto& p = fit->parameters[i];
    const bool fixed = p.status == identification::Status::fixed;
    std::printf("%-6s %9.3g, %s, true %9.3g\n", p.name.c_str(), p.value,
                fixed                                                    ? "fixed          "
                : std::abs(p.value - truth->parameters[i]) < 3 * p.sigma ? "within 3 sigma "
                                                                         : "off by 3 sigma ",
                truth->parameters[i]);
  }
  std::printf("R^2 %.4f\n", fit->r_squared);
}

// Prints:
// Fc0       0.0309, within 3 sigma , true    0.0311
// Fcl       0.0236, within 3 sigma , true    0.0234
// Fs0      -0.0245, within 3 sigma , true    -0.025
// FsT       0.0016, within 3 sigma , true    0.0016
// Fsl        0.126, within 3 sigma , true     0.126
// vs0        -24.5, within 3 sigma , true     -24.8
// vsT        0.972, within 3 sigma , true      0.98
// vsl         9.26, within 3 sigma , true      9.22
// alpha       1.36, fixed          , true      1.36
// Fv0     0.000134, within 3 sigma , true   0.00013
// FvT      0.00141, within 3 sigma , true   0.00132
// TV0         19.9, within 3 sigma , true      20.7
// R^2 0.9998
