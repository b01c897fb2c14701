#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <stdexcept>

#include <tribotwin/plugins/mujoco/callbacks.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>

namespace tribotwin::mujoco {
namespace {

std::mutex mutex;  // guards installation, never taken in a step
int registered = 0;
std::atomic<mjfGeneric> previous{nullptr}, previous_passive{nullptr};
std::atomic<mjfSensor> previous_sensor{nullptr};

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
  if (const mjfGeneric earlier = previous_passive.load(std::memory_order_acquire)) earlier(m, d);
  if (const Registration* r = find(m)) limit_friction_of(*r, d, Stage::passive);
}

void control(const mjModel* m, mjData* d) {
  if (const mjfGeneric earlier = previous.load(std::memory_order_acquire)) earlier(m, d);
  if (under_way.data == d && under_way.controller.call) under_way.controller.call(under_way.controller.context, m, d);
  if constexpr (!TRIBOTWIN_ENGINE_PLUGINS)
    if (const Registration* r = find(m)) {
      limit_friction_of(*r, d, Stage::actuation);
      for (const Spring& spring : r->springs()) d->ctrl[spring.control] = -spring_torque(m, d, spring);
    }
}

void sensor(const mjModel* m, mjData* d, int stage) {
  if (const mjfSensor earlier = previous_sensor.load(std::memory_order_acquire)) earlier(m, d, stage);
  if (stage != mjSTAGE_ACC) return;
  if (const Registration* r = find(m))
    for (const Sensor& s : r->sensors()) measure(m, d, r->drives()[static_cast<std::size_t>(s.drive)], s);
}

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
  if (registered++ == 0 && mjcb_control != control) {
    previous = mjcb_control;
    mjcb_control = control;
    if constexpr (!TRIBOTWIN_ENGINE_PLUGINS) {
      previous_passive = mjcb_passive;
      mjcb_passive = passive;
      previous_sensor = mjcb_sensor;
      mjcb_sensor = sensor;
    }
  }
}

Registration::~Registration() {
  const std::lock_guard lock(mutex);
  for (auto& slot : slots)
    if (slot.load() == this) slot.store(nullptr, std::memory_order_release);
  if (--registered == 0 && mjcb_control == control) {
    mjcb_control = previous;
    previous = nullptr;
    if (mjcb_passive == passive) {
      mjcb_passive = previous_passive;
      previous_passive = nullptr;
    }
    if (mjcb_sensor == sensor) {
      mjcb_sensor = previous_sensor;
      previous_sensor = nullptr;
    }
  }
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
    std::_Exit(1);
  };
}

}  // namespace tribotwin::mujoco
