#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>

#include <fmt/format.h>
#include <yaml-cpp/anchor.h>
#include <yaml-cpp/eventhandler.h>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

const char* kind(const YAML::Node& node) {
  switch (node.Type()) {
    case YAML::NodeType::Map:
      return "a mapping";
    case YAML::NodeType::Sequence:
      return "a list";
    case YAML::NodeType::Null:
      return "empty";
    default:
      return "a value";
  }
}

std::string place(const std::string& file, const YAML::Mark& mark) {
  return mark.line < 0 ? file : fmt::format("{}:{}", file, mark.line + 1);
}

/// Whether apply_setting has put the key or its value there. A value in a file cannot stand at its beginning.
bool is_setting(const YAML::Node& key, const YAML::Node& value) {
  return key.Mark().line < 0 || (value.Mark().pos == 0 && value.Mark().line == 0);
}

/// A mapping whose keys are names, each given once.
YAML::Node checked(const std::string& file, const std::string& where, const YAML::Node& node) {
  if (!node.IsMap())
    throw InputError(
        fmt::format("{}: '{}' is {} but must be a mapping of keys", place(file, node.Mark()), where, kind(node)));
  const std::string below = where.empty() ? "" : where + ".";
  std::set<std::string> seen;
  for (const auto& entry : node) {
    const YAML::Mark mark = entry.first.Mark();
    // yaml-cpp cannot look up such a key.
    if (!entry.first.IsScalar() || entry.first.Scalar().empty())
      throw InputError(fmt::format("{}: {}{}a key is {} but must be a name", place(file, mark), where,
                                   where.empty() ? "" : ": ", kind(entry.first)));
    if (const std::string& key = entry.first.Scalar(); !seen.insert(key).second)
      throw InputError(fmt::format("{}: {}{}: is given twice", place(file, mark), below, key));
  }
  return node;
}

}  // namespace

Mapping::Mapping(std::string file, std::string where, YAML::Node node)
    : file_(std::move(file)), where_(std::move(where)), node_(checked(file_, where_, node)) {}

std::string Mapping::at(const YAML::Mark& mark) const { return place(file_, mark); }

void Mapping::fail(const std::string& key, const std::string& why) const {
  YAML::Mark mark = node_.Mark();
  const std::string path = where_ + (where_.empty() ? "" : ".") + key;
  const bool from_file = !where_.empty() || mark.line >= 0;  // a command of a page has no places
  for (const auto& entry : node_) {
    if (entry.first.Scalar() != key) continue;
    mark = entry.first.Mark();
    if (from_file && is_setting(entry.first, entry.second))
      throw InputError(fmt::format("{}: --set {}: {}", file_, path, why));
  }
  throw InputError(fmt::format("{}: {}: {}", at(mark), path, why));
}

YAML::Node Mapping::take(const std::string& key) {
  known_.insert(key);
  return node_[key];
}

YAML::Node Mapping::raw(const std::string& key) { return take(key); }

double Mapping::to_number(const std::string& key, const YAML::Node& node, Bounds bounds) const {
  if (!node.IsScalar()) fail(key, fmt::format("is {} but must be a number", kind(node)));
  const std::string& text = node.Scalar();
  const auto value = tribotwin::to_number(std::string_view(text).substr(text.starts_with('+') ? 1 : 0));
  if (!value || !std::isfinite(*value)) fail(key, fmt::format("is '{}' but must be a finite number", text));
  if (*value < bounds.minimum || *value > bounds.maximum)
    fail(key, bounds.maximum >= 1e300
                  ? fmt::format("is {} but must be at least {:g}", *value, bounds.minimum)
                  : fmt::format("is {} but must be within {:g} .. {:g}", *value, bounds.minimum, bounds.maximum));
  return *value;
}

double Mapping::number(const std::string& key, Bounds bounds) {
  const YAML::Node node = take(key);
  if (!node) fail(key, "is missing");
  return to_number(key, node, bounds);
}
double Mapping::number_or(const std::string& key, double fallback, Bounds bounds) {
  const YAML::Node node = take(key);
  return node ? to_number(key, node, bounds) : fallback;
}
std::size_t Mapping::whole(const std::string& key, Bounds bounds) {
  const double value = number(key, bounds);
  if (value != std::floor(value)) fail(key, fmt::format("is {} but must be a whole number", value));
  return static_cast<std::size_t>(value);
}
std::size_t Mapping::whole_or(const std::string& key, std::size_t fallback, Bounds bounds) {
  if (has(key)) return whole(key, bounds);
  take(key);
  return fallback;
}
bool Mapping::flag_or(const std::string& key, bool fallback) {
  const YAML::Node node = take(key);
  if (!node) return fallback;
  bool value = false;
  if (!node.IsScalar() || !YAML::convert<bool>::decode(node, value)) fail(key, "must be true or false");
  return value;
}
std::string Mapping::text(const std::string& key) {
  const YAML::Node node = take(key);
  if (!node) fail(key, "is missing");
  if (!node.IsScalar()) fail(key, fmt::format("is {} but must be text", kind(node)));
  if (node.Scalar().empty()) fail(key, "is empty but must be text");
  return node.Scalar();
}
std::string Mapping::text_or(const std::string& key, std::string fallback) {
  return has(key) ? text(key) : (take(key), fallback);
}
std::string Mapping::choice(const std::string& key, const std::vector<std::string_view>& accepted) {
  const std::string value = text(key);
  for (const auto& a : accepted)
    if (a == value) return value;
  fail(key, fmt::format("'{}' is not known; did you mean '{}'? Accepted: {}", value, nearest(value, accepted),
                        joined(accepted)));
}
std::vector<double> Mapping::numbers(const std::string& key, Bounds bounds) {
  const YAML::Node node = take(key);
  if (!node || !node.IsSequence()) fail(key, "must be a list of numbers");
  std::vector<double> values;
  for (const auto& item : node) values.push_back(to_number(key, item, bounds));
  return values;
}
std::vector<std::string> Mapping::texts(const std::string& key) {
  const YAML::Node node = take(key);
  std::vector<std::string> all;
  if (!node) return all;
  if (!node.IsSequence()) fail(key, fmt::format("is {} but must be a list of texts", kind(node)));
  for (const auto& item : node) {
    if (!item.IsScalar()) fail(key, fmt::format("holds {} but must be a list of texts", kind(item)));
    all.push_back(item.Scalar());
  }
  return all;
}
std::string Mapping::file_name_or(const std::string& key, std::string fallback) {
  std::string name = text_or(key, std::move(fallback));
  if (const auto why = unfit_file_name(name)) fail(key, *why);
  return name;
}
std::filesystem::path Mapping::file(const std::string& key, const std::filesystem::path& folder) {
  const std::string given = text(key);
  std::filesystem::path path = (folder / given).lexically_normal();
  std::error_code error;
  if (!std::filesystem::exists(path, error)) try {
      if (const auto shipped = given_or_shipped(given, ""); shipped != given) path = shipped;
    } catch (const InputError& e) {
      fail(key, e.what());  // with the place of the name
    }
  if (std::filesystem::is_directory(path, error)) fail(key, fmt::format("'{}' is a folder, not a file", path.string()));
  if (!std::filesystem::exists(path, error))
    fail(key, fmt::format("'{}' cannot be read: it does not exist", path.string()));
  return path;
}
std::optional<Mapping> Mapping::mapping(const std::string& key) {
  const YAML::Node node = take(key);
  if (!node) return std::nullopt;
  return Mapping(file_, where_.empty() ? key : where_ + "." + key, node);
}
std::vector<Mapping> Mapping::mappings(const std::string& key) {
  const YAML::Node node = take(key);
  std::vector<Mapping> all;
  if (!node) return all;
  if (!node.IsSequence()) fail(key, fmt::format("is {} but must be a list", kind(node)));
  for (const auto& item : node) all.emplace_back(file_, fmt::format("{}[{}]", key, all.size()), item);
  return all;
}
std::vector<std::string> Mapping::names() const {
  std::vector<std::string> all;
  for (const auto& entry : node_) all.push_back(entry.first.Scalar());
  return all;
}

void Mapping::accept(const std::vector<std::string_view>& accepted) const {
  for (const auto& entry : node_)
    if (const std::string& key = entry.first.Scalar(); std::ranges::find(accepted, key) == accepted.end())
      fail(key, accepted.empty() ? std::string("is not known here")
                                 : fmt::format("is not known; did you mean '{}'?", nearest(key, accepted)));
}

void Mapping::done() const { accept({known_.begin(), known_.end()}); }

namespace {

/// Counts what a text holds, before a tree is made of it: aliases as what they stand for, since what visits a tree
/// visits them so.
class YamlLimits final : public YAML::EventHandler {
 public:
  explicit YamlLimits(const std::string& where) : where_(where) {}

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { add_value(mark, anchor); }
  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor, const std::string&) override {
    add_value(mark, anchor);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    open(mark, anchor);
  }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    open(mark, anchor);
  }
  void OnSequenceEnd() override { close(); }
  void OnMapEnd() override { close(); }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto known = anchors_.find(anchor);
    if (known == anchors_.end()) fail(mark, "an alias stands within what it stands for");
    add(mark, known->second);
  }

 private:
  struct Size {
    std::size_t values = 0, depth = 0;
  };
  struct Open {
    YAML::anchor_t anchor;
    Size size;
  };

  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what) const {
    throw InputError(fmt::format("{}: {}", place(where_, mark), what));
  }
  void add(const YAML::Mark& mark, Size size) {
    if (size.depth + open_.size() > limits::yaml_depth)
      fail(mark, fmt::format("mappings and lists are nested deeper than {}", limits::yaml_depth));
    // Sums stay far below overflow: each is checked.
    if ((values_ += size.values) > limits::yaml_values)
      fail(mark, fmt::format("holds more than {} values, aliases counted as what they stand for", limits::yaml_values));
    if (open_.empty()) return;
    open_.back().size.values += size.values;
    open_.back().size.depth = std::max(open_.back().size.depth, size.depth);
  }
  void add_value(const YAML::Mark& mark, YAML::anchor_t anchor) {
    add(mark, {1, 0});
    if (anchor != YAML::NullAnchor) anchors_[anchor] = {1, 0};
  }
  void open(const YAML::Mark& mark, YAML::anchor_t anchor) {
    add(mark, {1, 1});
    open_.push_back({anchor, {}});
  }
  void close() {
    const Open closed = open_.back();
    open_.pop_back();
    const Size size{closed.size.values + 1, closed.size.depth + 1};
    if (closed.anchor != YAML::NullAnchor) anchors_[closed.anchor] = size;
    if (open_.empty()) return;
    open_.back().size.values += closed.size.values;
    open_.back().size.depth = std::max(open_.back().size.depth, size.depth);
  }

  const std::string& where_;
  std::size_t values_ = 0;
  std::vector<Open> open_;
  std::map<YAML::anchor_t, Size> anchors_;
};

}  // namespace

YAML::Node parse_yaml(const std::string& text, const std::string& where) try {
  std::istringstream stream(text);
  YAML::Parser parser(stream);
  YamlLimits limits(where);
  parser.HandleNextDocument(limits);
  return YAML::Load(text);
} catch (const YAML::Exception& e) {
  throw InputError(fmt::format("{}:{}: not well-formed YAML ({})", where, e.mark.line + 1, e.msg));
}

YAML::Node load_yaml(const std::filesystem::path& file) {
  const std::string text = or_throw(read_text(file, "a YAML file"));
  if (text.size() > limits::yaml_bytes)
    throw InputError(fmt::format("{}: has {} bytes; at most {} are read of a YAML file", file.string(), text.size(),
                                 limits::yaml_bytes));
  YAML::Node node = parse_yaml(text, file.string());
  if (!node.IsMap())
    throw InputError(fmt::format("{}: is {} but must be a mapping of keys", file.string(), kind(node)));
  return node;
}

namespace {

/// The node below `node` that `key` names. `parent` is the path of keys so far, for messages.
YAML::Node below(YAML::Node node, const std::string& key, const std::string& parent, const std::string& setting) {
  if (node.IsDefined() && node.IsSequence()) {
    const auto index = to_integer<std::size_t>(key);
    if (!index || *index >= node.size())
      throw InputError(fmt::format("--set {}: '{}' must be a number from 0 to {}, an entry of the list", setting, key,
                                   node.size() - 1));
    return node[*index];
  }
  if (node.IsDefined() && !node.IsNull() && !node.IsMap())
    throw InputError(fmt::format("--set {}: '{}' is no mapping, so it has no key '{}'", setting, parent, key));
  return node[key];
}

}  // namespace

void apply_setting(YAML::Node root, const std::string& setting, std::string_view examples) {
  const auto equals = setting.find('=');
  if (equals == std::string::npos || equals == 0)
    throw InputError(fmt::format("--set {}: must be key=value, for example {}", setting, examples));
  YAML::Node node;
  node.reset(root);
  const std::string path = setting.substr(0, equals);
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t dot = std::min(path.find('.', begin), path.size());
    const std::string key = path.substr(begin, dot - begin);
    if (key.empty()) throw InputError(fmt::format("--set {}: an empty key", setting));
    node.reset(below(node, key, path.substr(0, begin ? begin - 1 : 0), setting));
    begin = dot + 1;
  }
  node = parse_yaml(setting.substr(equals + 1), "--set " + setting.substr(0, equals));
}

std::string quoted(const std::string& text) {
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; };
  const bool escaped = std::ranges::any_of(text, is_control);  // only double quotes allow escapes
  std::string out;
  for (const char c : text) {
    if (is_control(c))
      out += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
    else if (escaped && (c == '"' || c == '\\'))
      out += {'\\', c};
    else
      out += c == '\'' && !escaped ? std::string("''") : std::string(1, c);
  }
  return escaped ? '"' + out + '"' : "'" + out + "'";
}

std::string to_text(const YAML::Node& node) {
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << node;
  return std::string(out.c_str()) + "\n";
}

}  // namespace tribotwin::twin
