#pragma once

#include <string>

#include <tribotwin/twin/diagnosis/fleet/type_model.hpp>

/// A model as JSON, as the store keeps it.
namespace tribotwin::twin::diagnosis::fleet {

std::string to_text(const TypeModel& model);
/// Throws InputError where the text is not one of to_text: with `store`, where it stands, and the key whose size or
/// range is wrong.
TypeModel from_text(const std::string& text, const std::string& store);

}  // namespace tribotwin::twin::diagnosis::fleet
