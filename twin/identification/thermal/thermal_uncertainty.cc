#include <cmath>
#include <numeric>

#include <tribotwin/twin/identification/matrix_input.hpp>
#include <tribotwin/twin/identification/thermal/thermal_uncertainty.hpp>

namespace tribotwin::twin::identification {

Surroundings Surroundings::of(std::span<const double> ambient_degC) {
  const auto days = static_cast<double>(ambient_degC.size());
  const double mean = std::accumulate(ambient_degC.begin(), ambient_degC.end(), 0.0) / days;
  double squares = (supposed_days - 1) * supposed_K * supposed_K;
  for (const double T : ambient_degC) squares += (T - mean) * (T - mean);
  return {.days = ambient_degC.size(), .deviation_K = std::sqrt(squares / (supposed_days - 1 + days - 1))};
}

double Surroundings::variance(bool seen) const {
  const auto n = static_cast<double>(days);
  return deviation_K * deviation_K * (seen ? (n - 1) / n : (n + 1) / n);
}

bool can_be_propagated(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& numbers) {
  constexpr double free_sigmas = 1e5;
  const auto sigma = covariance.diagonal().array().max(0).sqrt();
  return covariance.allFinite() && (sigma < free_sigmas * numbers.array().abs().max(1)).all();
}

void write(YAML::Emitter& out, const ThermalUncertainty& u) {
  const auto entry = [&](const char* name, double value) { out << YAML::Key << name << YAML::Value << value; };
  out << YAML::Key << "uncertainty" << YAML::Value << YAML::Block << YAML::BeginMap << YAML::Key << "covariance"
      << YAML::Value << YAML::Load(yaml_of(u.covariance));
  entry("sigmas", u.sigmas);
  out << YAML::Key << "noise" << YAML::Value << YAML::Flow << YAML::BeginMap;
  entry("white_K", u.noise.white), entry("slow_K", u.noise.slow), entry("correlation_s", u.noise.correlation_s);
  out << YAML::EndMap << YAML::Key << "surroundings" << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key
      << "days" << YAML::Value << u.surroundings.days;
  entry("deviation_K", u.surroundings.deviation_K);
  out << YAML::EndMap;
  if (!u.slower.empty()) {
    out << YAML::Key << "slower" << YAML::Value << YAML::BeginSeq;
    for (const WarmBodies& bodies : u.slower) {
      out << YAML::Flow << YAML::BeginMap << YAML::Key << "t_s" << YAML::Value << bodies.t_s << YAML::Key << "gain_K_J"
          << YAML::Value << bodies.gain_K_J;
      entry("T_amb", bodies.ambient_degC);
      out << YAML::EndMap;
    }
    out << YAML::EndSeq;
  }
  out << YAML::EndMap;
}

ThermalUncertainty read_uncertainty(Mapping& in, Eigen::Index numbers) {
  in.accept({"covariance", "sigmas", "noise", "surroundings", "slower"});
  const auto part = [](Mapping& of, const char* key) {
    auto inner = of.mapping(key);
    if (!inner) of.fail(key, "is missing");
    return *inner;
  };
  ThermalUncertainty out{.covariance = read_matrix(in, "covariance", numbers, numbers),
                         .sigmas = in.number("sigmas", {1, 100}),
                         .noise = {},
                         .surroundings = {},
                         .slower = {}};
  Mapping noise = part(in, "noise"), surroundings = part(in, "surroundings");
  noise.accept({"white_K", "slow_K", "correlation_s"});
  out.noise = {noise.number("white_K", {0, 1e3}), noise.number("slow_K", {0, 1e3}),
               noise.number("correlation_s", {0, 1e9})};
  surroundings.accept({"days", "deviation_K"});
  out.surroundings = {surroundings.whole("days", {1, 1e6}), surroundings.number("deviation_K", {0, 100})};
  for (Mapping& bodies : in.mappings("slower")) {
    bodies.accept({"t_s", "gain_K_J", "T_amb"});
    out.slower.push_back({bodies.numbers("t_s", {1e-3, 1e9}), bodies.numbers("gain_K_J", {0, 1e9}),
                          bodies.number("T_amb", {-1e6, 1e6})});
    if (const WarmBodies& one = out.slower.back(); one.t_s.empty() || one.t_s.size() != one.gain_K_J.size())
      bodies.fail("t_s", "must be as many as gain_K_J");
  }
  return out;
}

}  // namespace tribotwin::twin::identification
