#pragma once

#include <array>
#include <cstdarg>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <dlfcn.h>

#include <tribotwin/twin/portable/fmu.hpp>

/// A small importer of both versions of the standard, written from its lists of functions and independent of the code
/// that the FMU is made of.
namespace tribotwin::twin {

enum Status { ok, warning, discard, error, fatal };

/// What instances have reported since it was cleared.
inline std::vector<std::string>& reported() {
  static std::vector<std::string> texts;
  return texts;
}

class Library {
 public:
  explicit Library(const std::string& file) : handle_(dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (!handle_) throw std::runtime_error(dlerror());
  }
  Library(const Library&) = delete;
  ~Library() { dlclose(handle_); }
  void* find(const std::string& name) const { return dlsym(handle_, name.c_str()); }
  template <class Function>
  Function* function(const std::string& name) const {
    void* found = find(name);
    if (!found) throw std::runtime_error(name + " is missing");
    return reinterpret_cast<Function*>(found);
  }

 private:
  void* handle_;
};

/// An instance, under either version.
class Instance {
 public:
  virtual ~Instance() = default;
  virtual bool exists() const = 0;
  virtual Status enter(double start_s, bool has_stop = false, double stop_s = 0) = 0;
  virtual Status step(double time_s, double dt_s) = 0;
  virtual Status get(const std::vector<unsigned>& references, double* values) = 0;
  virtual Status set(const std::vector<unsigned>& references, const double* values) = 0;
  virtual Status outside(unsigned reference, bool& value) = 0;

  void* handle() const { return instance_; }
  Status exit() { return call("ExitInitializationMode"); }
  Status terminate() { return call("Terminate"); }
  Status reset() { return call("Reset"); }
  double get(unsigned reference) {
    double value = -12345;
    if (get({reference}, &value) != ok) throw std::runtime_error("get failed");
    return value;
  }
  Status set(unsigned reference, double value) { return set({reference}, &value); }
  Status save(void** state) { return on_state<Status(void*, void**)>("Get", "", state); }
  Status restore(void* state) { return on_state<Status(void*, void*)>("Set", "", state); }
  Status release(void** state) { return on_state<Status(void*, void**)>("Free", "", state); }
  std::vector<char> serialized(void* state) {
    std::size_t size = 0;
    if (on_state<Status(void*, void*, std::size_t*)>("Serialized", "Size", state, &size) != ok) return {};
    std::vector<char> bytes(size);
    const Status made = on_state<Status(void*, void*, char*, std::size_t)>("Serialize", "", state, bytes.data(), size);
    return made == ok ? bytes : std::vector<char>();
  }
  Status deserialize(const std::vector<char>& bytes, void** state) {
    const char* verb = version_ == FmiVersion::two ? "DeSerialize" : "Deserialize";
    return on_state<Status(void*, const char*, std::size_t, void**)>(verb, "", bytes.data(), bytes.size(), state);
  }
  Status call(const std::string& function) { return library_.function<Status(void*)>(prefix_ + function)(instance_); }

 protected:
  Instance(const Library& library, FmiVersion version)
      : library_(library), version_(version), prefix_(version == FmiVersion::two ? "fmi2" : "fmi3") {}
  template <class Function, class... Arguments>
  Status on_state(const std::string& verb, const std::string& end, Arguments... arguments) {
    const std::string noun = version_ == FmiVersion::two ? "FMUstate" : "FMUState";
    return library_.function<Function>(prefix_ + verb + noun + end)(instance_, arguments...);
  }

  const Library& library_;
  const FmiVersion version_;
  const std::string prefix_;
  void* instance_ = nullptr;
};

class Instance2 final : public Instance {
 public:
  Instance2(const Library& library, const std::string& token, int type = 1) : Instance(library, FmiVersion::two) {
    using Create = void*(const char*, int, const char*, const char*, const void*, int, int);
    instance_ = library.function<Create>("fmi2Instantiate")("one", type, token.c_str(), "", &callbacks_, 0, 0);
  }
  ~Instance2() override { library_.function<void(void*)>("fmi2FreeInstance")(instance_); }
  bool exists() const override { return instance_; }
  Status enter(double start_s, bool has_stop, double stop_s) override {
    using Setup = Status(void*, int, double, double, int, double);
    const Status set_up = library_.function<Setup>("fmi2SetupExperiment")(instance_, 0, 0, start_s, has_stop, stop_s);
    return set_up == ok ? call("EnterInitializationMode") : set_up;
  }
  Status step(double time_s, double dt_s) override {
    return library_.function<Status(void*, double, double, int)>("fmi2DoStep")(instance_, time_s, dt_s, 1);
  }
  using Instance::get, Instance::set;
  Status get(const std::vector<unsigned>& references, double* values) override {
    using Get = Status(void*, const unsigned*, std::size_t, double*);
    return library_.function<Get>("fmi2GetReal")(instance_, references.data(), references.size(), values);
  }
  Status set(const std::vector<unsigned>& references, const double* values) override {
    using Set = Status(void*, const unsigned*, std::size_t, const double*);
    return library_.function<Set>("fmi2SetReal")(instance_, references.data(), references.size(), values);
  }
  Status outside(unsigned reference, bool& value) override {
    int got = -1;
    using Get = Status(void*, const unsigned*, std::size_t, int*);
    const Status status = library_.function<Get>("fmi2GetBoolean")(instance_, &reference, 1, &got);
    value = got == 1;
    return status;
  }

 private:
  static void log(void*, const char* name, int, const char* category, const char* format, ...) {
    char text[500];
    va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    reported().push_back(std::string(name) + " " + category + " " + text);
  }
  struct {
    void (*logger)(void*, const char*, int, const char*, const char*, ...) = log;
    void *allocate = nullptr, *release = nullptr, *finished = nullptr, *environment = nullptr;
  } callbacks_;
};

class Instance3 final : public Instance {
 public:
  Instance3(const Library& library, const std::string& token, bool event_mode = false)
      : Instance(library, FmiVersion::three) {
    using Create = void*(const char*, const char*, const char*, bool, bool, bool, bool, const unsigned*, std::size_t,
                         void*, void (*)(void*, int, const char*, const char*), void*);
    instance_ = library.function<Create>("fmi3InstantiateCoSimulation")(
        "one", token.c_str(), nullptr, false, false, event_mode, true, nullptr, 0, nullptr, log, nullptr);
  }
  ~Instance3() override { library_.function<void(void*)>("fmi3FreeInstance")(instance_); }
  bool exists() const override { return instance_; }
  Status enter(double start_s, bool has_stop, double stop_s) override {
    using Enter = Status(void*, bool, double, double, bool, double);
    return library_.function<Enter>("fmi3EnterInitializationMode")(instance_, false, 0, start_s, has_stop, stop_s);
  }
  Status step(double time_s, double dt_s) override {
    bool event = true, stop = true, early = true;
    double last = -1;
    using Step = Status(void*, double, double, bool, bool*, bool*, bool*, double*);
    const Status status =
        library_.function<Step>("fmi3DoStep")(instance_, time_s, dt_s, true, &event, &stop, &early, &last);
    if (status == ok && (event || stop || early || last != time_s + dt_s)) return fatal;
    return status;
  }
  using Instance::get, Instance::set;
  Status get(const std::vector<unsigned>& references, double* values) override {
    using Get = Status(void*, const unsigned*, std::size_t, double*, std::size_t);
    const std::size_t n = references.size();
    return library_.function<Get>("fmi3GetFloat64")(instance_, references.data(), n, values, n);
  }
  Status set(const std::vector<unsigned>& references, const double* values) override {
    using Set = Status(void*, const unsigned*, std::size_t, const double*, std::size_t);
    const std::size_t n = references.size();
    return library_.function<Set>("fmi3SetFloat64")(instance_, references.data(), n, values, n);
  }
  Status outside(unsigned reference, bool& value) override {
    using Get = Status(void*, const unsigned*, std::size_t, bool*, std::size_t);
    return library_.function<Get>("fmi3GetBoolean")(instance_, &reference, 1, &value, 1);
  }

 private:
  static void log(void*, int, const char* category, const char* text) {
    reported().push_back(std::string("one ") + category + " " + text);
  }
};

inline std::unique_ptr<Instance> instantiate(const Library& library, FmiVersion version, const std::string& token) {
  if (version == FmiVersion::two) return std::make_unique<Instance2>(library, token);
  return std::make_unique<Instance3>(library, token);
}

}  // namespace tribotwin::twin
