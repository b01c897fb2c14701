#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin {

/// A value of a JSON file with its place in the file: strict reading, as Mapping for YAML. Everything throws InputError
/// with "WHERE: KEY: what is wrong". The value must outlive it.
class JsonInput {
 public:
  /// `where` is the file, or empty where the caller adds it.
  JsonInput(const nlohmann::json& value, std::string where) : value_(value), where_(std::move(where)) {}

  JsonInput operator[](std::string_view key) const;
  bool has(std::string_view key) const { return value_.is_object() && value_.contains(key); }
  bool is_null() const { return value_.is_null(); }
  double number(Bounds bounds = {-1e12, 1e12}) const;
  /// NaN where the file has null.
  double number_or_null(Bounds bounds = {-1e12, 1e12}) const;
  bool truth() const;
  std::string text() const;
  /// Entries of a list, counted from 1 in messages.
  std::vector<JsonInput> list(std::size_t min_count, std::size_t max_count = static_cast<std::size_t>(-1)) const;
  std::vector<double> numbers(std::size_t min_count, std::size_t max_count = static_cast<std::size_t>(-1),
                              Bounds bounds = {-1e12, 1e12}) const;
  /// Those of a mapping, at least one.
  std::vector<std::pair<std::string, JsonInput>> entries() const;
  [[noreturn]] void fail(const std::string& what) const;

 private:
  std::string below(std::string_view key) const;
  const nlohmann::json& value_;
  std::string where_;
};

}  // namespace tribotwin::twin
