#pragma once

#include "fmu_importer.hpp"
#include <gtest/gtest.h>

/// What holds for every FMU.
namespace tribotwin::twin {

inline void begin(Instance& instance) {
  ASSERT_TRUE(instance.exists());
  ASSERT_EQ(instance.enter(0), ok);
  ASSERT_EQ(instance.exit(), ok);
}

/// Every function is there and answers: without an instance, and with one, which `instantiated` makes, where all other
/// arguments are zero.
template <class Instantiated>
void every_function_answers(const Library& library, FmiVersion version, const Instantiated& instantiated) {
  const std::string prefix = version == FmiVersion::two ? "fmi2" : "fmi3";
  for (const std::string& name : functions_of(version)) {
    SCOPED_TRACE(name);
    ASSERT_TRUE(library.find(prefix + name));
    if (name.starts_with("Instantiate") || name == "FreeInstance" || name == "GetTypesPlatform" || name == "GetVersion")
      continue;
    const auto function = library.function<AnyFunction>(prefix + name);
    EXPECT_EQ(function(nullptr, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0), error);
    const auto fresh = instantiated();
    begin(*fresh);
    EXPECT_LT(function(fresh->handle(), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0), fatal);
  }
}

}  // namespace tribotwin::twin
