#include "robots.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string>

#include <fmt/format.h>
#include <pugixml.hpp>

namespace tribotwin::bench {
namespace {

const std::filesystem::path folder = TRIBOTWIN_SOURCE_DIR "/mjcf";

std::string replaced(const std::string& text, const char* pattern, const std::string& by) {
  return std::regex_replace(text, std::regex(pattern), by);
}

/// Removes the element with all that is in it.
void remove(std::string& text, const std::string& element) {
  const std::string end = "</" + element + ">";
  const std::size_t from = text.find("<" + element + ">");
  if (from != text.npos) text.erase(from, text.find(end, from) + end.size() - from);
}

/// Repeats what stands between `begin` and `end`, wrapped by `wrap`; names get the number of the robot.
void repeat(std::string& text, const std::string& begin, const std::string& end, int count,
            const std::function<std::string(const std::string&, int)>& wrap) {
  const std::size_t from = text.find(begin) + begin.size(), to = text.find(end, from);
  const std::string one = text.substr(from, to - from);
  std::string all;
  for (int k = 0; k < count; ++k)
    all += wrap(replaced(one, R"re(\b(name|joint|instance)="([^"]*)")re", fmt::format("$1=\"$2_{}\"", k)), k);
  text.replace(from, to - from, all);
}

/// `count` robots side by side.
std::string row_of(std::string text, int count) {
  if (count == 1) return text;
  const auto as_it_is = [](const std::string& one, int) { return one; };
  const auto on_a_stand = [](const std::string& one, int k) {
    return fmt::format("<body name=\"stand_{}\" pos=\"{} 0 0\">{}</body>", k, 6 * k, one);
  };
  remove(text, "keyframe");
  repeat(text, "<plugin plugin=\"tribotwin.drive\">", "</plugin>", count, as_it_is);
  repeat(text, "<worldbody>", "</worldbody>", count, on_a_stand);
  repeat(text, "<actuator>", "</actuator>", count, as_it_is);
  return text;
}

/// The same drives on one instance, whose keys have a value for each of them.
std::string on_one_instance(const std::string& text) {
  pugi::xml_document document;
  document.load_string(text.c_str());
  pugi::xml_node plugin = document.select_node("//extension/plugin[@plugin='tribotwin.drive']").node();
  std::vector<std::pair<std::string, std::string>> keys;
  while (const pugi::xml_node instance = plugin.child("instance")) {
    for (const pugi::xml_node config : instance.children("config")) {
      const std::string key = config.attribute("key").value(), value = config.attribute("value").value();
      const auto known = std::ranges::find(keys, key, [](const auto& entry) { return entry.first; });
      if (known == keys.end())
        keys.emplace_back(key, value);
      else
        known->second += " " + value;
    }
    plugin.remove_child(instance);
  }
  pugi::xml_node instance = plugin.append_child("instance");
  instance.append_attribute("name") = "arm";
  for (const auto& [key, value] : keys) {
    pugi::xml_node config = instance.append_child("config");
    config.append_attribute("key") = key.c_str();
    config.append_attribute("value") = value.c_str();
  }
  for (const auto& match : document.select_nodes("//actuator/plugin")) match.node().attribute("instance") = "arm";
  std::ostringstream out;
  document.save(out);
  return out.str();
}

std::string irb6620(const RobotOptions& options) {
  std::ifstream file(folder / "irb6620.xml");
  std::string text{std::istreambuf_iterator<char>(file), {}};
  if (options.lugre) {
    text = replaced(text, "actdim=\"3\"", "actdim=\"4\"");
    text = replaced(text, "<instance name=\"[^\"]*\">",
                    R"($& <config key="friction" value="lugre"/> <config key="sigma0" value="0.1"/>)"
                    R"( <config key="sigma1" value="0.002"/> <config key="vd" value="2"/>)");
  }
  return text;
}

}  // namespace

Rivals rivals(const RobotOptions& options) {
  const std::string text = row_of(irb6620(options), options.count);
  Rivals both{mujoco::load_string(options.one_instance ? on_one_instance(text) : text,
                                  {.integrator = options.integrator}, folder)
                  .value(),
              nullptr};

  std::string plain = text;
  remove(plain, "extension");
  plain = replaced(plain, R"re( plugin="tribotwin.drive" instance="[^"]*" actdim="[^"]*" dyntype="[^"]*")re", "");
  plain = replaced(plain, R"(<plugin (name="drive))", "<motor $1");
  const auto native = mujoco::load_string(plain, {.integrator = options.integrator}, folder).value();
  if (!native->drives().empty()) throw std::logic_error("the rival has drives");
  both.native.reset(mj_copyModel(nullptr, native->get()));
  for (const auto& b : both.ours->drives()) {
    both.native->dof_frictionloss[b.dof] = mujoco::friction_nm(b.drive, 0.5, 0.1, 50);
    if (options.damping) both.native->dof_damping[b.dof] = 20;
  }
  return both;
}

Swing::Swing(const Rivals& rivals)
    : rivals_(rivals), ours_(rivals.ours->make_data()), native_(mj_makeData(rivals.native.get())) {
  for (const auto& b : rivals.ours->drives()) drive::set_temperature(b.drive, mujoco::state(ours_.get(), b), 50);
}

void Swing::command(mjData* d, int step) const {
  for (const auto& b : rivals_.ours->drives())
    d->ctrl[b.control] = d->qfrc_bias[b.dof] - 0.5 * b.drive.torque_max_nm * d->qpos[b.dof] +
                         0.2 * b.drive.torque_max_nm * std::sin(0.004 * step);
}

void Swing::step_ours(int steps) {
  for (int n = 0; n < steps; ++n) {
    command(ours_.get(), ours_steps_++);
    rivals_.ours->step(ours_.get());
  }
}

void Swing::step_native(int steps) {
  for (int n = 0; n < steps; ++n) {
    command(native_.get(), native_steps_++);
    mj_step(rivals_.native.get(), native_.get());
  }
}

}  // namespace tribotwin::bench
