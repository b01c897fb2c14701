#pragma once

#include <string>

#include <tribotwin/twin/diagnosis/fleet/type_model.hpp>

/// A model as JSON, as the store keeps it.
namespace tribotwin::twin::diagnosis::fleet {

std::string to_text(const TypeModel& model);
/// Throws std::runtime_error where the text is not one of to_text.
TypeModel from_text(const std::string& text);

}  // namespace tribotwin::twin::diagnosis::fleet
