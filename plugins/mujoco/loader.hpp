#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <mujoco/mujoco.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/mujoco/callbacks.hpp>

namespace tribotwin::mujoco {

struct ModelDeleter {
  void operator()(mjModel* m) const { mj_deleteModel(m); }
};
struct DataDeleter {
  void operator()(mjData* d) const { mj_deleteData(d); }
};
using ModelPtr = std::unique_ptr<mjModel, ModelDeleter>;
using DataPtr = std::unique_ptr<mjData, DataDeleter>;

/// An engine model with its drives, ready to step. Immutable; shared by any number of mjData and threads.
class Model {
 public:
  Model(ModelPtr model, std::vector<Binding> drives, std::vector<Spring> springs = {},
        std::vector<Sensor> sensors = {});
  Model(const Model&) = delete;
  Model& operator=(const Model&) = delete;

  const mjModel* get() const { return model_.get(); }
  const mjModel* operator->() const { return model_.get(); }
  /// In the order of the actuators.
  std::span<const Binding> drives() const { return drives_; }
  std::span<const Spring> springs() const { return springs_; }
  /// Their `drive` is an index of drives().
  std::span<const Sensor> sensors() const { return sensors_; }

  DataPtr make_data() const;
  void step(mjData* d, Controller controller = {}) const { mujoco::step(registration_, d, controller); }

 private:
  ModelPtr model_;
  std::vector<Binding> drives_;
  std::vector<Spring> springs_;
  std::vector<Sensor> sensors_;
  Registration registration_;
};

/// The time steps that are accepted, of a file and of options. Shorter ones would not advance the clock of a long run.
inline constexpr double shortest_timestep_s = 1e-6, longest_timestep_s = 1;

/// Settings that override those of the model; checked together with the drives.
struct Options {
  std::optional<double> timestep_s{};
  std::optional<std::string> integrator;  ///< as in MJCF; what this engine has
  std::optional<std::string> solver;      ///< Newton, CG, PGS
};

/// Loads MJCF that uses the plugin vocabulary (plugins/README.md), on every engine. On 2.2.2, whose schema has no
/// plugins, drives become torque actuators in memory. Fails with one message that names file, line and element.
Result<std::shared_ptr<const Model>> load_file(const std::filesystem::path& file, const Options& = {});

/// The same from text; `<include>` and assets are looked up in `folder`.
Result<std::shared_ptr<const Model>> load_string(std::string_view mjcf, const Options& = {},
                                                 const std::filesystem::path& folder = ".");

/// A copy of `model` changed by `change`, with the same drives checked against it (an arm with another payload).
Result<std::shared_ptr<const Model>> variant(const Model& model, const std::function<void(mjModel*)>& change);

}  // namespace tribotwin::mujoco
