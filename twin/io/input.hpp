#pragma once

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/plugins/friction/error.hpp>

/// Strict reading of YAML: every key must be known, every value of its type and range, every message says where.
namespace tribotwin::twin {

/// The user's input is wrong; what() says where and what would be right. Programs answer with exit code 2.
struct InputError : std::runtime_error {
  explicit InputError(std::string what) : std::runtime_error(without_controls(std::move(what))) {}
};

/// The value, or its message thrown as InputError: exit code 2.
template <class T>
T or_wrong_input(Result<T> value) {
  if (!value) throw InputError(value.error().message);
  if constexpr (!std::is_void_v<T>) return std::move(*value);
}

/// The value, or its message thrown as std::runtime_error: exit code 1.
template <class T>
T or_fail(Result<T> value) {
  if (!value) throw std::runtime_error(value.error().message);
  if constexpr (!std::is_void_v<T>) return std::move(*value);
}

/// The value, or its message thrown as its kind demands: ErrorKind::input as InputError, ErrorKind::work as
/// std::runtime_error.
template <class T>
T or_throw(Result<T> value) {
  if (!value && value.error().kind == ErrorKind::input) throw InputError(value.error().message);
  return or_fail(std::move(value));
}

struct Bounds {
  double minimum = -1e300, maximum = 1e300;
};

/// One mapping of a YAML file. Read every known key, then call done().
class Mapping {
 public:
  /// `where` is the path of keys from the root, "" for the root.
  Mapping(std::string file, std::string where, YAML::Node node);

  /// Fails on any key that is not in `accepted`: mistyped keys are named before missing ones.
  void accept(const std::vector<std::string_view>& accepted) const;
  bool has(const std::string& key) const { return static_cast<bool>(node_[key]); }
  double number(const std::string& key, Bounds bounds = {});
  double number_or(const std::string& key, double fallback, Bounds bounds = {});
  /// A whole number of at least 0 and at most 2^53.
  std::size_t whole(const std::string& key, Bounds bounds);
  std::size_t whole_or(const std::string& key, std::size_t fallback, Bounds bounds);
  bool flag_or(const std::string& key, bool fallback);
  std::string text(const std::string& key);
  std::string text_or(const std::string& key, std::string fallback);
  /// One of `accepted`.
  std::string choice(const std::string& key, const std::vector<std::string_view>& accepted);
  std::vector<double> numbers(const std::string& key, Bounds bounds = {});
  /// Empty where the key is missing.
  std::vector<std::string> texts(const std::string& key);
  /// Text that may become the name of a file or folder (unfit_file_name).
  std::string file_name_or(const std::string& key, std::string fallback);
  /// A file that exists; relative names are those of `folder`, or else of what ships (shipped.hpp).
  std::filesystem::path file(const std::string& key, const std::filesystem::path& folder);
  std::optional<Mapping> mapping(const std::string& key);
  std::vector<Mapping> mappings(const std::string& key);
  /// The keys of a mapping whose keys are names of something (joints, parameters).
  std::vector<std::string> names() const;
  YAML::Node raw(const std::string& key);

  /// Fails on keys that were not read, with the nearest known key.
  void done() const;
  [[noreturn]] void fail(const std::string& key, const std::string& why) const;

 private:
  YAML::Node take(const std::string& key);
  double to_number(const std::string& key, const YAML::Node& node, Bounds bounds) const;
  std::string at(const YAML::Mark& mark) const;
  std::string file_, where_;
  YAML::Node node_;
  std::set<std::string> known_;
};

/// The value of the row whose name stands at `key`. The rows of `table` are pairs of name and value.
template <class Table>
auto choice_of(Mapping& in, const std::string& key, const Table& table) {
  std::vector<std::string_view> names;
  for (const auto& [name, value] : table) names.push_back(name);
  const std::string chosen = in.choice(key, names);
  return std::ranges::find_if(table, [&](const auto& row) { return row.first == chosen; })->second;
}

/// Reads a YAML file within limits::yaml_*; the root must be a mapping. Throws InputError.
YAML::Node load_yaml(const std::filesystem::path& file);

/// The first document of a text, within the same limits but of any kind. `where` is the file or option, for messages.
/// Throws InputError where it is not well formed or beyond a limit.
YAML::Node parse_yaml(const std::string& text, const std::string& where);

/// Applies one `--set key=value` to the tree of a YAML file. Dotted keys descend into mappings and, by numbers, into
/// lists; missing mappings are created. `examples` completes the message "must be key=value, for example ...". Throws
/// InputError.
void apply_setting(YAML::Node root, const std::string& setting, std::string_view examples);

/// `text` as a YAML scalar of one line, for any text.
std::string quoted(const std::string& text);

/// Ends with a line break; every number reads back as the same double.
std::string to_text(const YAML::Node& node);

}  // namespace tribotwin::twin
