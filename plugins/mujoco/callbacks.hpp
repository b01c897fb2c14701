#pragma once

#include <mujoco/mujoco.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/mujoco/sensor.hpp>
#include <tribotwin/plugins/mujoco/spring.hpp>

/// The one place that touches MuJoCo's process-global callbacks. A callback that was there before is called first.
namespace tribotwin::mujoco {

/// Keeps the callbacks installed while it lives and, on engines without plugins, drives the friction of `model`.
/// Models that are not registered are left alone. Registering is thread-safe; stepping takes no lock.
class Registration {
 public:
  Registration(const mjModel* model, std::span<const Binding> drives, std::span<const Spring> springs = {},
               std::span<const Sensor> sensors = {});
  ~Registration();
  Registration(const Registration&) = delete;
  Registration& operator=(const Registration&) = delete;

  const mjModel* model() const { return model_; }
  std::span<const Binding> drives() const { return drives_; }
  std::span<const Spring> springs() const { return springs_; }
  std::span<const Sensor> sensors() const { return sensors_; }

 private:
  const mjModel* model_;
  std::span<const Binding> drives_;
  std::span<const Spring> springs_;
  std::span<const Sensor> sensors_;
};

/// Sees positions, velocities and gravity of the step under way and writes d->ctrl: feedback that is not one step late.
/// Called once per stage of the integrator.
struct Controller {
  void (*call)(void* context, const mjModel* m, mjData* d) = nullptr;
  void* context = nullptr;
};

/// mj_step, and the friction of the step in the drives' totals, on every engine. The controller, if any, acts in this
/// call only.
void step(const Registration& registration, mjData* d, Controller controller = {});

/// Engine warnings and errors become lines on stderr instead of a log file and a wait for a key; a fatal engine error,
/// and a lack of memory while MJCF is read or written, ends the process with exit code 1. For programs; a library user
/// keeps their own handlers.
void install_message_handlers();

}  // namespace tribotwin::mujoco
