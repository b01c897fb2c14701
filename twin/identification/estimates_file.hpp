#pragma once

#include <string>

#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/io/input.hpp>

/// Internal to identification/, not installed: one estimate in a YAML file, name: {value, sigma, unit, group}.
namespace tribotwin::twin::identification {

/// An entry of the mapping that `out` is in. No sigma where it is NaN, no group where it is empty.
void write(YAML::Emitter& out, const Estimate& estimate, const std::string& group = {});

/// The value. For readers: throws InputError.
double read_estimate(Mapping& in, const std::string& name, Bounds bounds = {});

}  // namespace tribotwin::twin::identification
