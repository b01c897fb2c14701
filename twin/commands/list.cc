#include <algorithm>
#include <memory>
#include <sstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/gears/gear_class.hpp>
#include <tribotwin/twin/identification/dynamic_friction/bouc_wen.hpp>
#include <tribotwin/twin/identification/dynamic_friction/bristles.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::program {
namespace {

using Json = nlohmann::ordered_json;

Json shipped(Purpose purpose) {
  Json rows = Json::array();
  for (const auto& file : shipped_scenarios(purpose))
    rows.push_back({{"name", file.stem().string()},
                    {"description", load_yaml(file)["description"].as<std::string>("")},
                    {"file", file.string()}});
  return rows;
}

Json scenarios() { return shipped(Purpose::scenario); }
Json campaigns() { return shipped(Purpose::campaign); }
Json fits() { return shipped(Purpose::fit); }
Json plans() { return shipped(Purpose::plan); }

/// The first sentence of the comment at the head of a model, which says what it is.
std::string head_of(const std::string& model) {
  const auto begin = model.find("<!--"), end = model.find("-->", begin);
  if (end == model.npos) return {};
  std::istringstream words(model.substr(begin + 4, end - begin - 4));
  std::string head;
  for (std::string word; words >> word && !head.ends_with('.');) head += (head.empty() ? "" : " ") + word;
  if (head.ends_with('.')) head.pop_back();
  return head;
}

Json models() {
  Json rows = Json::array();
  for (const auto& file : shipped_models()) {
    const std::string model = or_throw(read_text(file, "a model"));
    if (model.find("<body") != model.npos)  // else it is a part of others
      rows.push_back({{"name", file.stem().string()}, {"description", head_of(model)}, {"file", file.string()}});
  }
  return rows;
}

/// Models with a state, which are beside or over the law of a drive.
constexpr struct {
  std::string_view name, text, use;
} with_state[] = {
    {"bouc_wen", identification::bouc_wen_equation,
     "hysteretic spring of a gear beside a law, from tribotwin identify --law bouc_wen and calibrate"},
    {"lugre", identification::lugre_equation,
     "bristles over a law (dynamics: lugre of a drive), from tribotwin identify --law lugre --static and calibrate"}};

Json laws() {
  Json rows = Json::array();
  for (const auto& law : friction::laws()) {
    Json parameters = Json::array();
    for (const auto& p : law.parameters) parameters.push_back(p.name);
    rows.push_back({{"name", law.name},
                    {"description", fmt::format("{} ({})", law.equation, law.source)},
                    {"equation", law.equation},
                    {"source", law.source},
                    {"use", "law of a drive; tribotwin identify --law, dynamics --friction"},
                    {"parameters", parameters}});
  }
  for (const auto& [name, text, use] : with_state) {
    const auto end = text.rfind("; ");  // "EQUATION; SOURCE"
    rows.push_back({{"name", name},
                    {"description", fmt::format("{}: {} ({})", use, text.substr(0, end), text.substr(end + 2))},
                    {"equation", text.substr(0, end)},
                    {"source", text.substr(end + 2)},
                    {"use", use}});
  }
  return rows;
}

Json faults() {
  Json rows = Json::array();
  for (const auto& fault : drive::faults())
    rows.push_back({{"name", fault.name},
                    {"description", fault.footprint},
                    {"severity_unit", fault.unit},
                    {"severity_maximum", fault.maximum}});
  return rows;
}

Json gears() {
  Json rows = Json::array();
  for (const auto& gear : gear_classes())
    rows.push_back({{"name", gear.name},
                    {"description", fmt::format("{} of {:g} {}, ratio {:g}{}, law {}: {}", gear.family,
                                                gear.torque_max_nm, unit_of("Nm", gear.linear), gear.gear_ratio,
                                                gear.linear ? " rad/m" : "", gear.law, gear.source)},
                    {"family", gear.family},
                    {"torque_max_nm", gear.torque_max_nm},
                    {"torque_max_unit", unit_of("Nm", gear.linear)},
                    {"gear_ratio", gear.gear_ratio},
                    {"gear_ratio_unit", gear.linear ? "rad/m" : ""},
                    {"law", gear.law},
                    {"source", gear.source}});
  return rows;
}

struct Kind {
  const char *name, *description;
  Json (*rows)();  ///< each with at least name and description
};

/// A row for each table that users choose from by name.
constexpr Kind kinds[] = {
    {"scenarios", "Motions that ship, for tribotwin run and tribotwin-hil", scenarios},
    {"campaigns", "Series of measurements that ship, for tribotwin lab", campaigns},
    {"fits", "Fits of whole twins that ship, for tribotwin calibrate", fits},
    {"plans", "Sweeps of a scenario that ship, for tribotwin sweep", plans},
    {"models", "Robots that ship", models},
    {"laws", "Friction laws, for models and tribotwin identify", laws},
    {"faults", "Faults of a drive, for events of scenarios", faults},
    {"gears", "Gear classes with starter parameters, for tribotwin add-drives", gears},
};

struct Arguments {
  Destination output;
  bool json = false;
};

/// Names are bold with `colour`.
std::string table(const Json& rows, bool colour) {
  TextTable table{{TextTable::left(), TextTable::left()}};
  for (const auto& row : rows) {
    const auto& name = row["name"].get_ref<const std::string&>();
    table.add({colour ? bold(name, Stream::output) : name, row["description"].get<std::string>()});
  }
  return table.text();
}

Result<Exit> list(const Kind& kind, const Arguments& a) {
  const Json rows = kind.rows();
  if (rows.empty()) return work_failed(fmt::format("the {} are not where they were built or installed", kind.name));
  return deliver(a.json ? dump_json(rows, 2) + "\n" : table(rows, !a.output.named()), a.output);
}

}  // namespace

void add_list(CLI::App& app, int& code) {
  auto* command = app.add_subcommand("list", "What there is to choose from: scenarios, models, laws and more");
  command->require_subcommand(1);
  for (const Kind& kind : kinds) {
    const auto a = std::make_shared<Arguments>();
    auto* one = command->add_subcommand(kind.name, kind.description);
    a->output.add_to(*one, "File to write (default: stdout)");
    one->add_flag("--json", a->json, "Print JSON instead of the table");
    one->footer(fmt::format("Example:\n  tribotwin list {}", kind.name));
    one->callback([&kind, a, &code] {
      check(a->output, {});
      code = or_throw(list(kind, *a));
    });
  }
}

}  // namespace tribotwin::twin::program
