#include <cstdlib>

#include <GL/osmesa.h>
#include <dlfcn.h>

#include <tribotwin/render/offscreen/context.hpp>

namespace tribotwin::render {
namespace {

/// The library is loaded by the first context: it brings LLVM along, which takes longer to load than most commands that
/// draw no robot take. MuJoCo looks for its functions among those of the whole program.
struct Osmesa {
  void* library = ::dlopen("libOSMesa.so.8", RTLD_LAZY | RTLD_GLOBAL);
  decltype(&OSMesaCreateContextExt) create = find<decltype(create)>("OSMesaCreateContextExt");
  decltype(&OSMesaMakeCurrent) make_current = find<decltype(make_current)>("OSMesaMakeCurrent");
  decltype(&OSMesaDestroyContext) destroy = find<decltype(destroy)>("OSMesaDestroyContext");
  decltype(&OSMesaGetProcAddress) function = find<decltype(function)>("OSMesaGetProcAddress");

  bool complete() const { return create && make_current && destroy && function; }

 private:
  template <class Function>
  Function find(const char* name) const {
    return library ? reinterpret_cast<Function>(::dlsym(library, name)) : nullptr;
  }
};

const Osmesa& osmesa() {
  static const Osmesa loaded;
  return loaded;
}

}  // namespace

void Context::Destroy::operator()(osmesa_context* context) const { osmesa().destroy(context); }

Result<Context> Context::create() {
  // With this extension MuJoCo 3.x biases its shadow map by so little that Mesa's rasteriser speckles the lit floor;
  // without it the bias is the one of old. 2.2.2 does not look at it.
  setenv("MESA_EXTENSION_OVERRIDE", "-GL_ARB_clip_control", 0);
  const Osmesa& mesa = osmesa();
  Context c;
  c.screen_ = std::make_unique<unsigned char[]>(4);
  if (mesa.complete()) c.context_.reset(mesa.create(OSMESA_RGBA, 24, 8, 0, nullptr));
  if (!c.context_ || !mesa.make_current(c.context_.get(), c.screen_.get(), GL_UNSIGNED_BYTE, 1, 1))
    return work_failed("no OpenGL context: is libosmesa6 installed completely?");
  using GetInteger = void (*)(GLenum, GLint*);
  if (const auto get = reinterpret_cast<GetInteger>(mesa.function("glGetIntegerv")))
    get(GL_MAX_RENDERBUFFER_SIZE, &c.side_max_);
  return c;
}

}  // namespace tribotwin::render
