#pragma once

#include <array>
#include <cstdarg>
#include <cstdint>
#include <iterator>
#include <map>
#include <memory>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <dlfcn.h>

#include <tribotwin/twin/portable/fmu.hpp>

/// A small importer of both versions of the standard, written from its lists of functions and independent of the code
/// that the FMU is made of.
namespace tribotwin::twin {

enum FmiStatus { ok, warning, discard, error, fatal };

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

/// What modelDescription.xml says: value references by name, and the token.
struct Described {
  explicit Described(const std::string& xml) {
    const std::regex variable("<\\w+ name=\"([^\"]+)\" valueReference=\"(\\d+)\"");
    for (std::sregex_iterator at(xml.begin(), xml.end(), variable), end; at != end; ++at)
      references[(*at)[1]] = static_cast<unsigned>(std::stoul((*at)[2]));
    std::smatch found;
    std::regex_search(xml, found, std::regex("(guid|instantiationToken)=\"([^\"]*)\""));
    token = found[2];
    text = xml;
  }
  /// The unit of a variable; empty without one.
  std::string unit(const std::string& name) const {
    const std::size_t at = text.find(" name=\"" + name + "\""), unit = text.find(" unit=\"", at);
    if (at == std::string::npos || unit >= text.find(" name=\"", at + 1)) return "";
    return text.substr(unit + 7, text.find('"', unit + 7) - unit - 7);
  }
  std::map<std::string, unsigned> references;
  std::string token, text;
};

/// An instance, under either version.
class Instance {
 public:
  virtual ~Instance() = default;
  virtual bool exists() const = 0;
  virtual FmiStatus enter(double start_s, bool has_stop = false, double stop_s = 0) = 0;
  virtual FmiStatus step(double time_s, double dt_s) = 0;
  virtual FmiStatus get(const std::vector<unsigned>& references, double* values) = 0;
  virtual FmiStatus set(const std::vector<unsigned>& references, const double* values) = 0;
  virtual FmiStatus outside(unsigned reference, bool& value) = 0;

  void* handle() const { return instance_; }
  FmiStatus exit() { return call("ExitInitializationMode"); }
  FmiStatus terminate() { return call("Terminate"); }
  FmiStatus reset() { return call("Reset"); }
  double get(unsigned reference) {
    double value = -12345;
    if (get({reference}, &value) != ok) throw std::runtime_error("get failed");
    return value;
  }
  FmiStatus set(unsigned reference, double value) { return set({reference}, &value); }
  FmiStatus save(void** state) { return on_state<FmiStatus(void*, void**)>("Get", "", state); }
  FmiStatus restore(void* state) { return on_state<FmiStatus(void*, void*)>("Set", "", state); }
  FmiStatus release(void** state) { return on_state<FmiStatus(void*, void**)>("Free", "", state); }
  std::vector<char> serialized(void* state) {
    std::size_t size = 0;
    if (on_state<FmiStatus(void*, void*, std::size_t*)>("Serialized", "Size", state, &size) != ok) return {};
    std::vector<char> bytes(size);
    const FmiStatus made =
        on_state<FmiStatus(void*, void*, char*, std::size_t)>("Serialize", "", state, bytes.data(), size);
    return made == ok ? bytes : std::vector<char>();
  }
  FmiStatus deserialize(const std::vector<char>& bytes, void** state) {
    const char* verb = version_ == FmiVersion::two ? "DeSerialize" : "Deserialize";
    return on_state<FmiStatus(void*, const char*, std::size_t, void**)>(verb, "", bytes.data(), bytes.size(), state);
  }
  FmiStatus call(const std::string& function) {
    return library_.function<FmiStatus(void*)>(prefix_ + function)(instance_);
  }

 protected:
  Instance(const Library& library, FmiVersion version)
      : library_(library), version_(version), prefix_(version == FmiVersion::two ? "fmi2" : "fmi3") {}
  template <class Function, class... Arguments>
  FmiStatus on_state(const std::string& verb, const std::string& end, Arguments... arguments) {
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
  Instance2(const Library& library, const std::string& token, int type = 1, const std::string& resources = "")
      : Instance(library, FmiVersion::two) {
    using Create = void*(const char*, int, const char*, const char*, const void*, int, int);
    instance_ =
        library.function<Create>("fmi2Instantiate")("one", type, token.c_str(), resources.c_str(), &callbacks_, 0, 0);
  }
  ~Instance2() override { library_.function<void(void*)>("fmi2FreeInstance")(instance_); }
  bool exists() const override { return instance_; }
  FmiStatus enter(double start_s, bool has_stop, double stop_s) override {
    using Setup = FmiStatus(void*, int, double, double, int, double);
    const FmiStatus set_up =
        library_.function<Setup>("fmi2SetupExperiment")(instance_, 0, 0, start_s, has_stop, stop_s);
    return set_up == ok ? call("EnterInitializationMode") : set_up;
  }
  FmiStatus step(double time_s, double dt_s) override {
    return library_.function<FmiStatus(void*, double, double, int)>("fmi2DoStep")(instance_, time_s, dt_s, 1);
  }
  using Instance::get, Instance::set;
  FmiStatus get(const std::vector<unsigned>& references, double* values) override {
    using Get = FmiStatus(void*, const unsigned*, std::size_t, double*);
    return library_.function<Get>("fmi2GetReal")(instance_, references.data(), references.size(), values);
  }
  FmiStatus set(const std::vector<unsigned>& references, const double* values) override {
    using Set = FmiStatus(void*, const unsigned*, std::size_t, const double*);
    return library_.function<Set>("fmi2SetReal")(instance_, references.data(), references.size(), values);
  }
  FmiStatus outside(unsigned reference, bool& value) override {
    int got = -1;
    using Get = FmiStatus(void*, const unsigned*, std::size_t, int*);
    const FmiStatus status = library_.function<Get>("fmi2GetBoolean")(instance_, &reference, 1, &got);
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
  Instance3(const Library& library, const std::string& token, bool event_mode = false,
            const std::string& resources = "")
      : Instance(library, FmiVersion::three) {
    using Create = void*(const char*, const char*, const char*, bool, bool, bool, bool, const unsigned*, std::size_t,
                         void*, void (*)(void*, int, const char*, const char*), void*);
    instance_ = library.function<Create>("fmi3InstantiateCoSimulation")(
        "one", token.c_str(), resources.empty() ? nullptr : resources.c_str(), false, false, event_mode, true, nullptr,
        0, nullptr, log, nullptr);
  }
  ~Instance3() override { library_.function<void(void*)>("fmi3FreeInstance")(instance_); }
  bool exists() const override { return instance_; }
  FmiStatus enter(double start_s, bool has_stop, double stop_s) override {
    using Enter = FmiStatus(void*, bool, double, double, bool, double);
    return library_.function<Enter>("fmi3EnterInitializationMode")(instance_, false, 0, start_s, has_stop, stop_s);
  }
  FmiStatus step(double time_s, double dt_s) override {
    bool event = true, stop = true, early = true;
    double last = -1;
    using Step = FmiStatus(void*, double, double, bool, bool*, bool*, bool*, double*);
    const FmiStatus status =
        library_.function<Step>("fmi3DoStep")(instance_, time_s, dt_s, true, &event, &stop, &early, &last);
    if (status == ok && (event || stop || early || last != time_s + dt_s)) return fatal;
    return status;
  }
  using Instance::get, Instance::set;
  FmiStatus get(const std::vector<unsigned>& references, double* values) override {
    using Get = FmiStatus(void*, const unsigned*, std::size_t, double*, std::size_t);
    const std::size_t n = references.size();
    return library_.function<Get>("fmi3GetFloat64")(instance_, references.data(), n, values, n);
  }
  FmiStatus set(const std::vector<unsigned>& references, const double* values) override {
    using Set = FmiStatus(void*, const unsigned*, std::size_t, const double*, std::size_t);
    const std::size_t n = references.size();
    return library_.function<Set>("fmi3SetFloat64")(instance_, references.data(), n, values, n);
  }
  FmiStatus outside(unsigned reference, bool& value) override {
    using Get = FmiStatus(void*, const unsigned*, std::size_t, bool*, std::size_t);
    return library_.function<Get>("fmi3GetBoolean")(instance_, &reference, 1, &value, 1);
  }

 private:
  static void log(void*, int, const char* category, const char* text) {
    reported().push_back(std::string("one ") + category + " " + text);
  }
};

inline std::unique_ptr<Instance> instantiate(const Library& library, FmiVersion version, const std::string& token,
                                             const std::string& resources = "") {
  if (version == FmiVersion::two) return std::make_unique<Instance2>(library, token, 1, resources);
  return std::make_unique<Instance3>(library, token, false, resources);
}

// Integer and pointer arguments share registers, and doubles are not needed to refuse: zeros stand for all.
using AnyFunction = FmiStatus(void*, std::size_t, std::size_t, std::size_t, std::size_t, std::size_t, std::size_t,
                              std::size_t, std::size_t, double, double, double);

/// The functions of the standard; of FMI 2.0 those for co-simulation.
inline constexpr const char* functions_2 =
    R"(GetTypesPlatform GetVersion SetDebugLogging Instantiate FreeInstance SetupExperiment EnterInitializationMode
ExitInitializationMode Terminate Reset GetReal GetInteger GetBoolean GetString SetReal SetInteger SetBoolean
SetString GetFMUstate SetFMUstate FreeFMUstate SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate
GetDirectionalDerivative SetRealInputDerivatives GetRealOutputDerivatives DoStep CancelStep GetStatus GetRealStatus
GetIntegerStatus GetBooleanStatus GetStringStatus)";
inline constexpr const char* functions_3 =
    R"(GetVersion SetDebugLogging InstantiateModelExchange InstantiateCoSimulation InstantiateScheduledExecution
FreeInstance EnterInitializationMode ExitInitializationMode EnterEventMode Terminate Reset GetFloat32 GetFloat64
GetInt8 GetUInt8 GetInt16 GetUInt16 GetInt32 GetUInt32 GetInt64 GetUInt64 GetBoolean GetString GetBinary GetClock
SetFloat32 SetFloat64 SetInt8 SetUInt8 SetInt16 SetUInt16 SetInt32 SetUInt32 SetInt64 SetUInt64 SetBoolean SetString
SetBinary SetClock GetNumberOfVariableDependencies GetVariableDependencies GetFMUState SetFMUState FreeFMUState
SerializedFMUStateSize SerializeFMUState DeserializeFMUState GetDirectionalDerivative GetAdjointDerivative
EnterConfigurationMode ExitConfigurationMode GetIntervalDecimal GetIntervalFraction GetShiftDecimal GetShiftFraction
SetIntervalDecimal SetIntervalFraction SetShiftDecimal SetShiftFraction EvaluateDiscreteStates UpdateDiscreteStates
EnterContinuousTimeMode CompletedIntegratorStep SetTime SetContinuousStates GetContinuousStateDerivatives
GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates GetNumberOfEventIndicators
GetNumberOfContinuousStates EnterStepMode GetOutputDerivatives DoStep ActivateModelPartition)";

inline std::vector<std::string> functions_of(FmiVersion version) {
  std::istringstream words(version == FmiVersion::two ? functions_2 : functions_3);
  return {std::istream_iterator<std::string>(words), {}};
}

}  // namespace tribotwin::twin
