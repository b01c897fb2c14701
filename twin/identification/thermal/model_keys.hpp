#pragma once

#include <string_view>
#include <vector>

#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/io/input.hpp>

/// Internal to identification/, not installed: the keys of a thermal model in PARAMS.yaml, `thermal`, `T_amb` and the
/// parameters of its order.
namespace tribotwin::twin::identification {

void write(YAML::Emitter& out, const thermal::Model& model);

/// For readers: throws InputError. `beside`: other keys that are accepted.
thermal::Model read_model(Mapping& in, std::vector<std::string_view> beside = {});

}  // namespace tribotwin::twin::identification
