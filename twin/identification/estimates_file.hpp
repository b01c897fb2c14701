#pragma once

#include <string>
#include <string_view>

#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/io/input.hpp>

/// Internal to identification/, not installed: one estimate in a YAML file, name: {value, sigma, unit, group}.
namespace tribotwin::twin::identification {

/// An entry of the mapping that `out` is in. No sigma where it is NaN, no group where it is empty.
void write(YAML::Emitter& out, const Estimate& estimate, const std::string& group = {});

/// For readers, before they look at keys: throws InputError where the file is one that another command writes, with
/// the name of that command. `writer`: the command that writes what is wanted.
void refuse_other_kind(const YAML::Node& root, const std::string& file, std::string_view writer);

/// The value, and its sigma (NaN: none) where that is not null. For readers: throws InputError.
double read_estimate(Mapping& in, const std::string& name, Bounds bounds = {}, double* sigma = nullptr);

}  // namespace tribotwin::twin::identification
