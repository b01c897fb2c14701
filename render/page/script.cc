#include <algorithm>
#include <string_view>

#include <tribotwin/render/page/script.hpp>

namespace tribotwin::render {
namespace {

/// A module's text without what binds it to others: in one file all names are known.
std::string unbound(std::string_view module) {
  std::string out;
  while (!module.empty()) {
    const auto end = std::min(module.find('\n'), module.size() - 1) + 1;
    std::string_view line = module.substr(0, end);
    module.remove_prefix(end);
    constexpr std::string_view exported = "export ";
    if (line.starts_with("import ")) continue;
    if (line.starts_with(exported)) line.remove_prefix(exported.size());
    out += line;
  }
  return out;
}

}  // namespace

std::string script(bool robot) {
  std::string text = "'use strict';\n{\n";
  for (const char* shared : {"/scale.js", "/colours.js"}) text += unbound(twin::live::page_file(shared)->content);
  for (const char* shared : {"/orbit.js", "/robot.js", "/view.js"})
    if (robot) text += unbound(twin::live::page_file(shared)->content);
  for (const auto& file : script_files())
    if (robot || file.name != "robot_figure.js") text += unbound(file.content);
  return text + "}\n";
}

}  // namespace tribotwin::render
