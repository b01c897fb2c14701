#pragma once

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/plugins/drive/keys.hpp>
#include <tribotwin/plugins/drive/slide.hpp>

/// Random joints for the files that other tools get, and a folder to compile these in.
namespace tribotwin::twin {

using drive::Configuration, drive::Drive;
using Random = std::mt19937_64;

inline double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
inline bool coin(Random& random) { return random() & 1; }

/// A value that a parameter may have, of any size that a joint may have.
inline double value_of(const friction::Parameter& p, Random& random) {
  const double size = std::pow(10, uniform(random, -4, 1.5));
  return std::clamp(p.minimum < 0 && random() % 3 == 0 ? -size : size, p.minimum, p.maximum);
}

/// A winding that warms within seconds and minutes, with currents that reach its limits.
inline void add_winding(Configuration& keys, Random& random) {
  const auto add = [&](std::string_view key, double value) { keys.emplace_back(key, fmt::format("{}", value)); };
  add("winding_resistance_ohm", std::pow(10, uniform(random, -1, 1)));
  add("torque_constant_nm_A", std::pow(10, uniform(random, -1, 2)));
  add("winding_heat_capacity_J_K", std::pow(10, uniform(random, 0, 3)));
  add("winding_thermal_resistance_K_W", std::pow(10, uniform(random, -1, 1)));
  if (coin(random)) add("winding_copper_1_K", uniform(random, 0, 0.01));
  if (coin(random)) add("winding_magnet_1_K", uniform(random, 0, 0.01));
  if (coin(random)) add("winding_reference_degC", uniform(random, 0, 40));
  const double warning = uniform(random, 60, 200);
  add("winding_warning_degC", warning), add("winding_limit_degC", warning + uniform(random, 1, 50));
  const double most = std::pow(10, uniform(random, 0, 2));
  if (coin(random)) add("current_max_A", most);
  if (coin(random))
    add("current_rated_A", most * uniform(random, 0.01, 0.5)), add("overload_s", uniform(random, 1, 60));
}

inline Configuration keys_of(const friction::LawInfo& law, Random& random) {
  Configuration keys{{"law", std::string(law.name)}};
  const auto add = [&](std::string_view key, double value) { keys.emplace_back(key, fmt::format("{}", value)); };
  for (const auto& p : law.parameters) add(p.name, value_of(p, random));
  add("torque_max_nm", uniform(random, 1, 1e4)), add("gear_ratio", uniform(random, 1, 300));
  add("T_amb", uniform(random, -10, 60));
  if (coin(random)) keys.emplace_back("validity", "extrapolate");
  if (coin(random)) add("asymmetry", uniform(random, -0.5, 0.5));
  if (coin(random)) add("load_filter_s", uniform(random, 1e-3, 1));
  add("offset_nm", uniform(random, -3, 3));
  switch (random() % 3) {
    case 0:
      keys.emplace_back("thermal", "prescribed");
      break;
    case 1:
      keys.emplace_back("thermal", "first_order");
      add("R_th", uniform(random, 1e-3, 1)), add("kappa", uniform(random, 1, 1e4));
      break;
    default:
      keys.emplace_back("thermal", "second_order");
      for (const char* c : {"c1", "c2"}) add(c, uniform(random, 1e-6, 1e-4));
      for (const char* t : {"t1", "t2"}) add(t, uniform(random, 1, 1e4));
  }
  if (coin(random)) {
    keys.emplace_back("load_table_speeds", "0 3.5 90");
    keys.emplace_back("load_table_loads", "-0.7 -0.1 0.2 0.9");
    keys.emplace_back("load_table_values", "0.1 0 0.01 0.2 0.1 0.05 0 -0.01 0.03 0.02 0.01 0.3");
  }
  if (coin(random)) add_winding(keys, random);
  return keys;
}

inline void add_dynamics(Configuration& keys, unsigned which, Random& random) {
  const auto add = [&](std::string_view key, double value) { keys.emplace_back(key, fmt::format("{}", value)); };
  if (which == 1) {
    keys.emplace_back("friction", "lugre");
    add("sigma0", uniform(random, 1, 100)), add("sigma1", 1e-3), add("vd", uniform(random, 1e-3, 1));
  } else if (which == 2) {
    keys.emplace_back("friction", "gear_loss");
    add("mu_avg", uniform(random, 0.1, 0.3)), add("mu_dif", uniform(random, -0.1, 0.1));
    add("h", uniform(random, 1e-3, 1));
  }
}

/// Drives of every law of the table, of every dynamics, whatever else a drive may have; the same for the same seed.
inline std::vector<Drive> drives(unsigned per_kind) {
  Random random(20261125);
  std::vector<Drive> all;
  for (const auto& law : friction::laws())
    for (unsigned dynamics = 0; dynamics < 3; ++dynamics)
      for (unsigned n = 0, tries = 0; n < per_kind && tries < 200'000; ++tries) {
        Configuration keys = keys_of(law, random);
        add_dynamics(keys, dynamics, random);
        if (auto made = drive::make_drive("joint", keys)) all.push_back(std::move(*made)), ++n;
      }
  return all;
}

class Folder {
 public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "tribotwin_c_XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  std::filesystem::path file(const std::string& name) const { return path_ / name; }
  void write(const std::string& name, const std::string& text) const { std::ofstream(file(name)) << text; }
  /// Exit code of a command in the folder.
  int run(const std::string& command) const {
    return std::system(fmt::format("cd {} && {}", path_.string(), command).c_str());
  }

 private:
  std::filesystem::path path_;
};

inline constexpr const char* strict = "-std=c99 -Wall -Wextra -Wpedantic -Werror";

/// Faults of the table in an arbitrary mixture.
inline drive::Faults faults_of(Random& random) {
  drive::Faults faults{};
  for (const auto& fault : drive::faults())
    if (random() % 4 == 0)
      fault.add(faults, uniform(random, 0, std::min(fault.maximum, fault.unit == "rad" ? 1e-2 : 1.0)));
  return faults;
}

/// The same drive with other numbers of every kind.
inline Drive tuned(Drive drive, Random& random) {
  const auto other = [&](double x) { return x * uniform(random, 0.5, 2); };
  std::vector<double> law(drive.law.values().begin(), drive.law.values().end());
  for (double& x : law) x = other(x);
  drive.law = friction::with_parameters(drive.law, law);
  drive.torque_max_nm = other(drive.torque_max_nm), drive.gear_ratio = other(drive.gear_ratio);
  drive.load_filter_s = coin(random) ? 0 : uniform(random, 1e-3, 1);
  drive.asymmetry = coin(random) ? 0 : uniform(random, -0.5, 0.5);
  for (double* x : drive::dynamics_values(drive)) *x = other(*x);
  std::vector<double> heat = thermal::values(drive.thermal);
  for (double& x : heat) x = other(x);
  drive.thermal = thermal::make_model(drive.thermal.order, drive.thermal.T_amb_degC, heat);
  if (drive.winding.present()) {
    thermal::Winding& w = drive.winding;
    drive.offset_nm = other(drive.offset_nm);
    for (double* x : {&w.resistance_ohm, &w.torque_constant_nm_A, &w.heat_capacity_J_K, &w.thermal_resistance_K_W,
                      &w.copper_1_K, &w.magnet_1_K, &w.reference_degC, &w.overload_s})
      *x = other(*x);
    const double degC = other(1), amperes = other(1);  // they stay in their order
    w.warning_degC *= degC, w.limit_degC *= degC, w.current_max_A *= amperes, w.current_rated_A *= amperes;
  }
  return drive;
}

}  // namespace tribotwin::twin
