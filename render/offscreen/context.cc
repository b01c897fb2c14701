#include <cstdlib>

#include <GL/osmesa.h>

#include <tribotwin/render/offscreen/context.hpp>

namespace tribotwin::render {

void Context::Destroy::operator()(osmesa_context* context) const { OSMesaDestroyContext(context); }

Result<Context> Context::create() {
  // With this extension MuJoCo 3.x biases its shadow map by so little that Mesa's rasteriser speckles the lit floor;
  // without it the bias is the one of old. 2.2.2 does not look at it.
  setenv("MESA_EXTENSION_OVERRIDE", "-GL_ARB_clip_control", 0);
  Context c;
  c.screen_ = std::make_unique<unsigned char[]>(4);
  c.context_.reset(OSMesaCreateContextExt(OSMESA_RGBA, 24, 8, 0, nullptr));
  if (!c.context_ || !OSMesaMakeCurrent(c.context_.get(), c.screen_.get(), GL_UNSIGNED_BYTE, 1, 1))
    return work_failed("no OpenGL context: is libosmesa6 installed completely?");
  // Asked for by name: linking a gl function would bring in libGL.
  using GetInteger = void (*)(GLenum, GLint*);
  if (const auto get = reinterpret_cast<GetInteger>(OSMesaGetProcAddress("glGetIntegerv")))
    get(GL_MAX_RENDERBUFFER_SIZE, &c.side_max_);
  return c;
}

}  // namespace tribotwin::render
