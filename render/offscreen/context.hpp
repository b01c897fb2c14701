#pragma once

#include <memory>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>

struct osmesa_context;

namespace tribotwin::render {

/// An OpenGL context in main memory (OSMesa), current in the thread that made it for as long as it lives. Needs no
/// display, no GPU, no EGL. MuJoCo draws into framebuffers of its own in it.
class Context {
 public:
  static Result<Context> create();
  /// Longest side of a framebuffer [pixels].
  int side_max() const { return side_max_; }

 private:
  struct Destroy {
    void operator()(osmesa_context* context) const;
  };
  Context() = default;
  std::unique_ptr<unsigned char[]> screen_;  // the 1x1 buffer that OSMesa requires
  std::unique_ptr<osmesa_context, Destroy> context_;
  int side_max_ = 0;
};

}  // namespace tribotwin::render
