#pragma once

namespace tribotwin::mujoco {

/// From now on failed allocations are counted. Part of install_message_handlers().
void watch_memory();

/// Throws std::bad_alloc where an allocation has failed in the scope of this object, after watch_memory(). Streams
/// swallow that exception: a number of more than 15 digits that the engine reads through one is then missing, and the
/// model is another one.
class MemoryCheck {
 public:
  void pass() const;

 private:
  unsigned before_ = failures();
  static unsigned failures();
};

}  // namespace tribotwin::mujoco
