#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <new>

#include <pugixml.hpp>

#include <tribotwin/plugins/mujoco/memory.hpp>

namespace tribotwin::mujoco {
namespace {

std::atomic<unsigned> failed = 0;

/// Without memory for an attribute pugixml goes on without the attribute, and must not be left by an exception.
void* memory_of_xml(std::size_t size) {
  if (void* const memory = std::malloc(size)) return memory;
  std::fputs("tribotwin: out of memory\n", stderr);
  std::fflush(nullptr);
  std::quick_exit(1);
}

}  // namespace

void watch_memory() {
  std::set_new_handler([] {
    ++failed;
    throw std::bad_alloc();
  });
  pugi::set_memory_management_functions(memory_of_xml, std::free);
}

unsigned MemoryCheck::failures() { return failed; }

void MemoryCheck::pass() const {
  if (failures() != before_) throw std::bad_alloc();
}

}  // namespace tribotwin::mujoco
