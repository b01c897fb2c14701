#pragma once

#include <string>

#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/io/input.hpp>

/// One estimate in a YAML file: name: {value, sigma, unit, group}.
namespace tribotwin::twin::identification {

/// As an entry of the mapping that `out` is in. Without a sigma where there is none, without a group where it is empty.
void write(YAML::Emitter& out, const Estimate& estimate, const std::string& group = {});

/// The value. Throws InputError.
double read_estimate(Mapping& in, const std::string& name, Bounds bounds = {});

}  // namespace tribotwin::twin::identification
