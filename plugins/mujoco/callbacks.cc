#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <stdexcept>

#include <tribotwin/plugins/mujoco/callbacks.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/memory.hpp>

namespace tribotwin::mujoco {
namespace {

std::mutex mutex;  // guards installation, never taken in a step
int registered = 0;

/// One of the engine's global callbacks, and what was there before us. Several copies of this library may live in one
/// process (each FMU of a robot holds one) and come and go in any order: one that cannot be removed, because another
/// one lies above it, stays in that one's chain, and lies above it in turn when it is installed again. The chain then
/// passes here more than once; the outermost passage works, and each calls what it was installed upon.
template <class Function>
class Hook {
 public:
  constexpr Hook(Function& global, Function own) : global_(global), own_(own) {}
  void install() {
    if (global_ == own_) return;
    const std::size_t n = count_.load();
    if (n == earlier_.size()) throw std::length_error("the engine's callbacks are nested more than 64 deep");
    earlier_[n].store(global_, std::memory_order_release);
    count_.store(n + 1, std::memory_order_release);
    global_ = own_;
  }
  void remove() {
    if (global_ != own_) return;
    const std::size_t n = count_.load() - 1;
    global_ = earlier_[n].load();
    count_.store(n, std::memory_order_release);
  }
  /// What the passage of this depth was installed upon; null for none.
  Function earlier(std::size_t depth) const {
    const std::size_t n = count_.load(std::memory_order_acquire);
    return depth < n ? earlier_[n - 1 - depth].load(std::memory_order_acquire) : nullptr;
  }

 private:
  Function& global_;
  Function own_;
  std::array<std::atomic<Function>, 64> earlier_{};
  std::atomic<std::size_t> count_{0};
};

/// Calls what was there before; false where this is no outermost passage.
template <class Function, class... Arguments>
bool pass(const Hook<Function>& hook, std::size_t& depth, Arguments... arguments) {
  if (const Function earlier = hook.earlier(depth)) {
    ++depth;
    earlier(arguments...);
    --depth;
  }
  return depth == 0;
}

extern Hook<mjfGeneric> control_hook, passive_hook;
extern Hook<mjfSensor> sensor_hook;
thread_local std::size_t control_depth = 0, passive_depth = 0, sensor_depth = 0;

std::array<std::atomic<const Registration*>, 1024> slots{};
std::atomic<std::size_t> slots_used{0};  // high-water mark

struct StepUnderWay {
  const mjData* data = nullptr;
  Controller controller;
};
thread_local StepUnderWay under_way;

const Registration* find(const mjModel* m) {
  const std::size_t used = slots_used.load(std::memory_order_acquire);
  for (std::size_t i = 0; i < used; ++i)
    if (const Registration* r = slots[i].load(std::memory_order_acquire); r && r->model() == m) return r;
  return nullptr;
}

void limit_friction_of(const Registration& r, mjData* d, Stage stage) {
  for (const Binding& b : r.drives()) limit_friction(r.model(), d, b, stage, workspace(d, b).passive_nm);
}

void passive(const mjModel* m, mjData* d) {
  if (!pass(passive_hook, passive_depth, m, d)) return;
  if (const Registration* r = find(m)) limit_friction_of(*r, d, Stage::passive);
}

void control(const mjModel* m, mjData* d) {
  if (!pass(control_hook, control_depth, m, d)) return;
  if (under_way.data == d && under_way.controller.call) under_way.controller.call(under_way.controller.context, m, d);
  if constexpr (!TRIBOTWIN_ENGINE_PLUGINS)
    if (const Registration* r = find(m)) {
      limit_friction_of(*r, d, Stage::actuation);
      for (const Spring& spring : r->springs()) d->ctrl[spring.control] = -spring_torque(m, d, spring);
    }
}

void sensor(const mjModel* m, mjData* d, int stage) {
  if (!pass(sensor_hook, sensor_depth, m, d, stage)) return;
  if (stage != mjSTAGE_ACC) return;
  if (const Registration* r = find(m))
    for (const Sensor& s : r->sensors()) measure(m, d, r->drives()[static_cast<std::size_t>(s.drive)], s);
}

constinit Hook<mjfGeneric> control_hook(mjcb_control, control), passive_hook(mjcb_passive, passive);
constinit Hook<mjfSensor> sensor_hook(mjcb_sensor, sensor);

}  // namespace

Registration::Registration(const mjModel* model, std::span<const Binding> drives, std::span<const Spring> springs,
                           std::span<const Sensor> sensors)
    : model_(model), drives_(drives), springs_(springs), sensors_(sensors) {
  const std::lock_guard lock(mutex);
  std::size_t i = 0;
  while (i < slots.size() && slots[i].load()) ++i;
  if (i == slots.size()) throw std::length_error("more than 1024 models with drives are registered at once");
  slots[i].store(this, std::memory_order_release);
  if (i >= slots_used) slots_used.store(i + 1, std::memory_order_release);
  if (registered++ > 0) return;
  control_hook.install();
  if constexpr (!TRIBOTWIN_ENGINE_PLUGINS) passive_hook.install(), sensor_hook.install();
}

Registration::~Registration() {
  const std::lock_guard lock(mutex);
  for (auto& slot : slots)
    if (slot.load() == this) slot.store(nullptr, std::memory_order_release);
  if (--registered > 0) return;
  control_hook.remove();
  if constexpr (!TRIBOTWIN_ENGINE_PLUGINS) passive_hook.remove(), sensor_hook.remove();
}

void step(const Registration& registration, mjData* d, Controller controller) {
  const StepUnderWay outer = std::exchange(under_way, {d, controller});
  mj_step(registration.model(), d);
  under_way = outer;
  if constexpr (!TRIBOTWIN_ENGINE_PLUGINS) {
    for (const Spring& spring : registration.springs()) book_spring(d, spring);
    for (const Binding& binding : registration.drives()) book_friction(registration.model(), d, binding);
  }
}

void install_message_handlers() {
  // Warnings are counted in mjData as well, where the run looks for them.
  mju_user_warning = [](const char*) {};
  mju_user_error = [](const char* message) {
    std::fprintf(stderr, "tribotwin: the engine gave up: %s\n", message);
    std::fflush(nullptr);
    std::quick_exit(1);
  };
  watch_memory();
}

}  // namespace tribotwin::mujoco
