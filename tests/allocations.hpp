#pragma once

#include <cstdlib>
#include <new>

/// Counts what C++ code allocates in this thread; C, such as HDF5, does not pass here. For one source of a program: it
/// replaces the global operators.
static thread_local long allocations = 0;
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++allocations;
  if (void* p = std::malloc(size ? size : 1)) return p;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }
