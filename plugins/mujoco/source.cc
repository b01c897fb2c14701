#include <algorithm>
#include <optional>
#include <regex>
#include <span>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/plugins/mujoco/source.hpp>

namespace tribotwin::mujoco {
namespace {

using Problem = std::optional<std::string>;

/// The element after `node` in the order of the text, or none; `depth` follows.
pugi::xml_node next_element(pugi::xml_node node, int& depth) {
  const auto element_from = [](pugi::xml_node n) {
    while (n && n.type() != pugi::node_element) n = n.next_sibling();
    return n;
  };
  if (const pugi::xml_node child = element_from(node.first_child())) return ++depth, child;
  for (; node; node = node.parent(), --depth)
    if (const pugi::xml_node sibling = element_from(node.next_sibling())) return sibling;
  return {};
}

/// Calls `visit(element, depth)` for every element in the order of the text, until it returns false.
void for_each_element(pugi::xml_node root, const std::function<bool(pugi::xml_node, int)>& visit) {
  int depth = 1;
  for (pugi::xml_node node = root; node && visit(node, depth) && depth > 0; node = next_element(node, depth)) continue;
}

Problem too_deep(const Source& source) {
  Problem problem;
  for_each_element(source.document->document_element(), [&](pugi::xml_node element, int depth) {
    if (depth > limits::model_depth)
      problem = fmt::format("{}: is nested {} elements deep, but at most {} are possible", at(source, element), depth,
                            limits::model_depth);
    return !problem;
  });
  return problem;
}

/// A number, or the product of up to `most` of them.
std::optional<double> product(std::string_view text, int most) {
  constexpr std::string_view blanks = " \t\r\n";
  double all = 1;
  int count = 0;
  for (auto begin = text.find_first_not_of(blanks); begin < text.size(); ++count) {
    const auto end = std::min(text.find_first_of(blanks, begin), text.size());
    const auto value = to_number(text.substr(begin, end - begin).substr(text[begin] == '+' ? 1 : 0));
    if (!value || count == most || (most > 1 && *value < 0)) return std::nullopt;
    all *= *value;
    begin = text.find_first_not_of(blanks, end);
  }
  return count > 0 ? std::optional(all) : std::nullopt;
}

/// Numbers that the engine accepts without a check but that make a run impossible, or for which it takes any memory.
constexpr struct {
  const char *element, *attribute, *unit;
  double minimum, maximum;
  int numbers = 1;
} checked_numbers[] = {{"option", "timestep", " s", shortest_timestep_s, longest_timestep_s},
                       {"size", "nuserdata", "", 0, limits::model_user_data},
                       {"size", "nkey", "", -1, limits::model_user_numbers},
                       {"size", "nstack", "", -1, limits::model_stack},
                       {"size", "njmax", "", -1, limits::model_constraints},
                       {"size", "nconmax", "", -1, limits::model_constraints},
                       {"size", "nuser_body", "", -1, limits::model_user_numbers},
                       {"size", "nuser_jnt", "", -1, limits::model_user_numbers},
                       {"size", "nuser_geom", "", -1, limits::model_user_numbers},
                       {"size", "nuser_site", "", -1, limits::model_user_numbers},
                       {"size", "nuser_cam", "", -1, limits::model_user_numbers},
                       {"size", "nuser_tendon", "", -1, limits::model_user_numbers},
                       {"size", "nuser_actuator", "", -1, limits::model_user_numbers},
                       {"size", "nuser_sensor", "", -1, limits::model_user_numbers},
                       {"texture", "width", " pixels", 0, limits::model_pixels},
                       {"texture", "height", " pixels", 0, 6 * limits::model_pixels},  // six sides of a cube
                       {"hfield", "nrow", "", 0, limits::model_pixels},
                       {"hfield", "ncol", "", 0, limits::model_pixels},
                       {"composite", "count", " (their product)", 0, limits::model_copies, 3}};

Problem out_of_range(const Source& source) {
  Problem problem;
  for_each_element(source.document->document_element(), [&](pugi::xml_node element, int) {
    for (const auto& n : checked_numbers) {
      if (std::string_view(element.name()) != n.element) continue;
      const char* text = element.attribute(n.attribute).as_string(nullptr);
      const auto value = text ? product(text, n.numbers) : std::nullopt;
      if (text && !(value && *value >= n.minimum && *value <= n.maximum))
        problem = fmt::format("{}: {} is '{}' but must be within {:g} .. {:g}{}", at(source, element), n.attribute,
                              text, n.minimum, n.maximum, n.unit);
      if (problem) break;
    }
    return !problem;
  });
  return problem;
}

constexpr std::ptrdiff_t block = 4096;  ///< of Source::breaks [bytes]

Result<Source> parse(std::string name, std::string text) {
  Source source{std::move(name), std::move(text)};
  source.breaks.push_back(0);
  for (std::ptrdiff_t at = 0; at + block <= std::ssize(source.text); at += block)
    source.breaks.push_back(source.breaks.back() +
                            std::count(source.text.begin() + at, source.text.begin() + at + block, '\n'));
  if (const auto tags = std::count(source.text.begin(), source.text.end(), '<'); tags > limits::model_tags)
    return tl::unexpected(
        fmt::format("{}: has {} tags, but at most {} are read of a file", source.name, tags, limits::model_tags));
  const pugi::xml_parse_result result = source.document->load_buffer(source.text.data(), source.text.size());
  if (!result)
    return tl::unexpected(
        fmt::format("{}:{}: not well-formed XML ({})", source.name, source.line(result.offset), result.description()));
  if (!source.document->document_element()) return tl::unexpected(source.name + ": holds no XML element");
  if (const Problem p = too_deep(source)) return tl::unexpected(*p);
  if (const Problem p = out_of_range(source)) return tl::unexpected(*p);
  return source;
}

/// A mesh, texture or height field that the engine would read without end: a device, a pipe, a file of any length.
Problem unfit_asset(const std::vector<Source>& sources, const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> folders{folder};
  for (const Source& source : sources)
    for (const auto& match : source.document->select_nodes("//compiler"))
      for (const char* attribute : {"meshdir", "texturedir", "assetdir"})
        if (const auto given = match.node().attribute(attribute)) folders.push_back(folder / given.value());
  const auto problem_of = [&](const Source& source, pugi::xml_node element, const std::filesystem::path& given) {
    for (const auto& name : {given, given.filename()})  // filename: with strippath
      for (const auto& each : folders)
        if (std::error_code error; !name.empty() && std::filesystem::exists(each / name, error) &&
                                   !std::filesystem::is_directory(each / name, error))
          if (const auto ok = check_input_file(each / name, "a file of a model", limits::asset_bytes, Pipes::refuse);
              !ok)
            return Problem(fmt::format("{}: {}", at(source, element), ok.error().message));
    return Problem();
  };
  Problem problem;
  for (const Source& source : sources)
    for_each_element(source.document->document_element(), [&](pugi::xml_node element, int) {
      const std::string_view kind = element.name();
      if (kind != "mesh" && kind != "texture" && kind != "hfield" && kind != "skin") return true;
      for (const pugi::xml_attribute a : element.attributes())
        if (!problem && std::string_view(a.name()).starts_with("file"))
          problem = problem_of(source, element, a.value());
      return !problem;
    });
  return problem;
}

/// What an element of <extension> may contain: MuJoCo's own vocabulary, except what the loader does not merge.
struct Vocabulary {
  std::string_view element;
  std::span<const std::string_view> attributes, children;
};
constexpr std::string_view of_extension[] = {"plugin", "include"}, of_plugin[] = {"instance", "include"},
                           of_instance[] = {"config"};
constexpr std::string_view plugin_attributes[] = {"plugin"}, instance_attributes[] = {"name"},
                           config_attributes[] = {"key", "value"}, include_attributes[] = {"file"};
constexpr Vocabulary vocabulary[] = {{"extension", {}, of_extension},
                                     {"plugin", plugin_attributes, of_plugin},
                                     {"instance", instance_attributes, of_instance},
                                     {"config", config_attributes, {}},
                                     {"include", include_attributes, {}}};

std::string did_you_mean(std::string_view given, std::span<const std::string_view> accepted) {
  return accepted.empty()
             ? std::string()
             : fmt::format("; did you mean '{}'?", nearest(given, std::vector(accepted.begin(), accepted.end())));
}

/// What is wrong with an element below <extension>, or in it.
Problem unknown_in(const Source& source, pugi::xml_node element) {
  const auto known = std::ranges::find(vocabulary, std::string_view(element.name()), &Vocabulary::element);
  const std::string where = at(source, element);
  for (const pugi::xml_attribute a : element.attributes())
    if (std::ranges::find(known->attributes, std::string_view(a.name())) == known->attributes.end())
      return fmt::format("{}: attribute '{}' is not known{}", where, a.name(),
                         did_you_mean(a.name(), known->attributes));
  for (const pugi::xml_node child : element.children()) {
    if (child.type() == pugi::node_pcdata || child.type() == pugi::node_cdata) {
      const std::string text = child.value(),
                        shown = text.substr(std::min(text.find_first_not_of(" \t\r\n"), text.size()));
      return fmt::format("{}: holds the text '{}', which nobody reads", where,
                         shown.substr(0, std::min<std::size_t>(40, shown.find_first_of("\r\n"))));
    }
    if (child.type() != pugi::node_element) continue;
    if (std::ranges::find(known->children, std::string_view(child.name())) == known->children.end())
      return fmt::format("{}: is not known in <{}>{}", at(source, child), element.name(),
                         did_you_mean(child.name(), known->children));
    if (const Problem p = unknown_in(source, child)) return p;
  }
  return {};
}

/// A plugin of <extension> or <actuator> that neither we nor the engine have.
Problem unknown_plugin(const Source& source, pugi::xml_node element) {
  const std::vector<std::string_view> ours{plugin_name, spring_plugin_name, sensor_plugin_name};
  const std::string_view name = element.attribute("plugin").value();
  if (std::ranges::find(ours, name) != ours.end() || (TRIBOTWIN_ENGINE_PLUGINS && !name.starts_with("tribotwin.")))
    return {};
  return fmt::format("{}: plugin '{}' is not known; did you mean '{}'?", at(source, element), name,
                     nearest(name, ours));
}

/// The position in an error message of the engine: ", line 3", ", line = 3, column = 1".
const std::regex& position() {
  static const std::regex pattern(R"(,\s*line\s*=?\s*(-?\d+)(,\s*column\s*=?\s*-?\d+)?)");
  return pattern;
}

}  // namespace

std::ptrdiff_t Source::line(std::ptrdiff_t offset) const {
  offset = std::clamp<std::ptrdiff_t>(offset, 0, std::ssize(text));
  const std::ptrdiff_t begin = offset / block;
  return 1 + breaks[static_cast<std::size_t>(begin)] +
         std::count(text.begin() + begin * block, text.begin() + offset, '\n');
}

std::string at(const Source& source, pugi::xml_node element) {
  const char* name = element.attribute("name").as_string(nullptr);
  return fmt::format("{}:{}: <{}{}>", source.name, source.line(element.offset_debug()), element.name(),
                     name ? fmt::format(" name=\"{}\"", name) : "");
}

Result<std::string> read_text(const std::filesystem::path& file) {
  auto text = read_input_file(file, "an MJCF file", limits::model_bytes);
  if (!text) return text;
  auto utf8 = to_utf8(std::move(*text));
  if (!utf8) return tl::unexpected(fmt::format("{}:{}", file.string(), utf8.error().message));
  return utf8;
}

Result<std::vector<Source>> read_sources(std::string name, std::string text, const std::filesystem::path& folder) {
  std::vector<Source> sources;
  auto main = parse(std::filesystem::path(name).lexically_normal().string(), std::move(text));
  if (!main) return tl::unexpected(main.error());
  sources.push_back(std::move(*main));
  for (std::size_t i = 0; i < sources.size(); ++i)
    for (const auto& match : sources[i].document->select_nodes("//include")) {
      const pugi::xml_node element = match.node();
      const std::string where = at(sources[i], element);
      const char* file = element.attribute("file").as_string(nullptr);
      if (!file) return tl::unexpected(where + ": lacks its file attribute");
      const std::string path = (folder / file).lexically_normal().string();
      if (std::ranges::any_of(sources, [&](const Source& s) { return s.name == path; }))
        return tl::unexpected(where + ": this file is included twice");
      const auto included = read_text(path);
      if (!included) return tl::make_unexpected(Error(where + ": " + included.error().message, included.error().kind));
      auto source = parse(path, *included);
      if (!source) return tl::unexpected(source.error());
      sources.push_back(std::move(*source));
    }
  if (const Problem p = unfit_asset(sources, folder)) return tl::unexpected(*p);
  return sources;
}

Result<void> check_extensions(const std::vector<Source>& sources) {
  for (const Source& source : sources) {
    for (const auto& match : source.document->select_nodes("//extension"))
      if (const Problem p = unknown_in(source, match.node())) return tl::unexpected(*p);
    for (const auto& match :
         source.document->select_nodes("//extension/plugin | //actuator/plugin | //sensor/plugin")) {
      if (const Problem p = unknown_plugin(source, match.node())) return tl::unexpected(*p);
      const bool of_actuator = std::string_view(match.node().parent().name()) == "actuator";
      if (const pugi::xml_node child = match.node().first_child();
          of_actuator && std::string_view(match.node().attribute("plugin").value()).starts_with("tribotwin.") &&
          child.type() == pugi::node_element)
        return tl::unexpected(
            fmt::format("{}: is not known here; keys belong into the <instance> of <extension>", at(source, child)));
    }
  }
  return {};
}

Origins::Origins(const std::vector<Source>& sources) : main_(&sources.front()) {
  for (const Source& source : sources) {
    std::ptrdiff_t line = 1, counted = 0;
    for_each_element(source.document->document_element(), [&](pugi::xml_node element, int) {
      const auto offset = std::clamp(element.offset_debug(), counted, std::ssize(source.text));
      line += std::count(source.text.begin() + counted, source.text.begin() + offset, '\n');
      counted = offset;
      lines_.push_back({line, element.name(), {&source, offset}});
      return true;
    });
  }
}

void Origins::add_copy(const Source& source, pugi::xml_node original, pugi::xml_node copy) {
  int from_depth = 1, to_depth = 1;
  for (pugi::xml_node from = original, to = copy; from && to && from_depth > 0 && to_depth > 0;
       from = next_element(from, from_depth), to = next_element(to, to_depth)) {
    // A part of `source` may itself have been copied there from another file.
    const auto earlier = copies_.find(from.hash_value());
    copies_[to.hash_value()] = earlier != copies_.end() ? earlier->second : Place{&source, from.offset_debug()};
  }
}

void Origins::saved_as(const std::string& text, const pugi::xml_document& document) {
  lines_.clear();
  pugi::xml_document read;
  if (!read.load_buffer(text.data(), text.size())) return;
  std::ptrdiff_t line = 1, counted = 0;
  int here_depth = 1, there_depth = 1;
  for (pugi::xml_node here = document.document_element(), there = read.document_element(); here && there;
       here = next_element(here, here_depth), there = next_element(there, there_depth)) {
    const std::ptrdiff_t offset = there.offset_debug();
    line += std::count(text.begin() + counted, text.begin() + offset, '\n');
    counted = offset;
    const auto copied = copies_.find(here.hash_value());
    lines_.push_back(
        {line, there.name(), copied != copies_.end() ? copied->second : Place{main_, here.offset_debug()}});
  }
}

std::string without_position(const std::string& message) { return std::regex_replace(message, position(), ""); }

std::string Origins::located(std::string message, const std::string& name) const {
  static const std::regex element(R"(Element '([^']*)')"), breaks(R"(\s*\n\s*)");
  std::string where = name;
  if (std::smatch found; std::regex_search(message, found, position())) {
    std::smatch of;
    const std::string kind = std::regex_search(message, of, element) ? of[1].str() : "";
    const long number = std::strtol(found[1].str().c_str(), nullptr, 10);
    const auto is_meant = [&](const Line& l) {
      return l.number == number && (kind.empty() || l.element == kind) && l.place.offset > 0;
    };
    // Several files have such a line only where the engine reads them by itself and does not say which.
    if (std::ranges::count_if(lines_, is_meant) == 1) {
      const Place& place = std::ranges::find_if(lines_, is_meant)->place;
      where = fmt::format("{}:{}", place.source->name, place.source->line(place.offset));
    }
    message = without_position(message);
  }
  message.erase(message.find_last_not_of(" \n") + 1);
  return fmt::format("{}: {}", where, std::regex_replace(message, breaks, "; "));
}

void merge_includes(const std::vector<Source>& sources, const std::filesystem::path& folder, Origins* origins) {
  const pugi::xml_document& main = *sources.front().document;
  while (const pugi::xml_node include = main.select_node("//include").node()) {
    const std::string path = (folder / include.attribute("file").value()).lexically_normal().string();
    const Source& source = *std::ranges::find(sources, path, &Source::name);
    for (const pugi::xml_node child : source.document->document_element()) {
      const pugi::xml_node copy = include.parent().insert_copy_before(child, include);
      if (origins) origins->add_copy(source, child, copy);
    }
    include.parent().remove_child(include);
  }
}

void remove_extensions(pugi::xml_document& document) {
  for (const auto& match : document.select_nodes("//extension/plugin[starts-with(@plugin, 'tribotwin.')]"))
    match.node().parent().remove_child(match.node());
  for (const auto& match : document.select_nodes("//extension[not(plugin)]"))
    match.node().parent().remove_child(match.node());
}

void make_native(pugi::xml_node actuator, const drive::Drive& drive) {
  for (const char* attribute : {"plugin", "instance", "actdim", "dyntype"}) actuator.remove_attribute(attribute);
  if (drive.control == drive::Control::torque) {
    actuator.set_name("motor");
    return;
  }
  actuator.set_name("general");
  actuator.append_attribute("gainprm") = fmt::format("{}", drive.kp_nm_rad).c_str();
  actuator.append_attribute("biastype") = "affine";
  actuator.append_attribute("biasprm") = fmt::format("0 {} {}", -drive.kp_nm_rad, -drive.kv_nm_s_rad).c_str();
}

void make_asset_folders_absolute(pugi::xml_document& document, const std::filesystem::path& folder) {
  const std::filesystem::path base = std::filesystem::absolute(folder);
  pugi::xml_node root = document.document_element();
  for (const char* attribute : {"meshdir", "texturedir"}) {
    std::string given;  // assetdir (2.3.0) stands for both
    for (const pugi::xml_node compiler : root.children("compiler"))
      if (compiler.attribute("assetdir")) given = compiler.attribute("assetdir").value();
    for (pugi::xml_node compiler : root.children("compiler")) {
      if (compiler.attribute(attribute)) given = compiler.attribute(attribute).value();
      compiler.remove_attribute(attribute);
    }
    root.append_child("compiler").append_attribute(attribute) = (base / given).lexically_normal().c_str();
  }
}

std::string text_of(const pugi::xml_document& document, unsigned format) {
  struct Writer : pugi::xml_writer {
    std::string text;
    void write(const void* data, std::size_t size) override { text.append(static_cast<const char*>(data), size); }
  } writer;
  document.save(writer, "  ", format);
  return std::move(writer.text);
}

Result<std::unique_ptr<pugi::xml_document>> load_merged(const std::filesystem::path& file) {
  const auto text = read_text(file);
  if (!text) return tl::unexpected(text.error());
  auto sources = read_sources(file.string(), *text, file.parent_path());
  if (!sources) return tl::unexpected(sources.error());
  merge_includes(*sources, file.parent_path());
  return std::move(sources->front().document);
}

}  // namespace tribotwin::mujoco
