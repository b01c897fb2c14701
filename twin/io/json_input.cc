#include <limits>

#include <fmt/format.h>

#include <tribotwin/twin/io/json_input.hpp>

namespace tribotwin::twin {

std::string JsonInput::below(std::string_view key) const {
  return fmt::format("{}{}{}", where_, where_.empty() ? "" : ": ", key);
}

void JsonInput::fail(const std::string& what) const { throw InputError(where_.empty() ? what : where_ + ": " + what); }

JsonInput JsonInput::operator[](std::string_view key) const {
  if (!has(key)) fail(fmt::format("has no '{}'", key));
  return {value_.at(key), below(key)};
}

double JsonInput::number(Bounds bounds) const {
  if (!value_.is_number()) fail("must be a number");
  const double x = value_.get<double>();
  if (!(x >= bounds.minimum && x <= bounds.maximum))
    fail(fmt::format("is {} but must be {:g} to {:g}", x, bounds.minimum, bounds.maximum));
  return x;
}

double JsonInput::number_or_null(Bounds bounds) const {
  return is_null() ? std::numeric_limits<double>::quiet_NaN() : number(bounds);
}

bool JsonInput::truth() const {
  if (!value_.is_boolean()) fail("must be true or false");
  return value_.get<bool>();
}

std::string JsonInput::text() const {
  if (!value_.is_string()) fail("must be a text");
  return value_.get<std::string>();
}

std::vector<JsonInput> JsonInput::list(std::size_t min_count, std::size_t max_count) const {
  if (!value_.is_array()) fail("must be a list");
  if (value_.size() < min_count || value_.size() > max_count)
    fail(min_count == max_count ? fmt::format("has {} entries but must have {}", value_.size(), min_count)
                                : fmt::format("must be a list of at least {}", min_count));
  std::vector<JsonInput> all;
  for (const nlohmann::json& one : value_) all.emplace_back(one, fmt::format("{} {}", where_, all.size() + 1));
  return all;
}

std::vector<double> JsonInput::numbers(std::size_t min_count, std::size_t max_count, Bounds bounds) const {
  std::vector<double> all;
  for (const JsonInput& one : list(min_count, max_count)) all.push_back(one.number(bounds));
  return all;
}

std::vector<std::pair<std::string, JsonInput>> JsonInput::entries() const {
  if (!value_.is_object() || value_.empty()) fail("must be a mapping that is not empty");
  std::vector<std::pair<std::string, JsonInput>> all;
  for (const auto& [key, one] : value_.items()) all.emplace_back(key, JsonInput(one, below(key)));
  return all;
}

}  // namespace tribotwin::twin
