#include <algorithm>
#include <cstdlib>
#include <fstream>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/twin/experiments/fault_study/study.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin::study {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path shipped = fs::path(TRIBOTWIN_SOURCE_DIR) / "twin" / "scenarios" / "br609_diagnosis.yaml";

struct Folder {
  fs::path path = [] {
    std::string name = (fs::temp_directory_path() / "tribotwin_XXXXXX").string();
    return fs::path(mkdtemp(name.data()));
  }();
  ~Folder() { fs::remove_all(path); }
};

/// The shipped study with the series of Tables II and III, and beyond them those named.
YAML::Node tables_and(const std::vector<std::string>& more) {
  YAML::Node tree = *campaign_tree(shipped, {"diagnosis.draws=0"}), series, check;
  const auto wanted = [&](const YAML::Node& node, const char* key) {
    const auto name = node[key].Scalar();
    return name.starts_with("healthy") || name.starts_with("load") || name == "evolution" || name == "second_day" ||
           std::ranges::count(more, name);
  };
  for (const auto& s : tree["series"])
    if (wanted(s, "name")) series.push_back(s);
  for (const auto& c : tree["diagnosis"]["check"])
    if (wanted(c, "series")) check.push_back(c);
  tree["series"] = series;
  tree["diagnosis"]["check"] = check;
  return tree;
}

TEST(Study, TablesTwoAndThreeHaveThePapersStructure) {
  const Folder folder;
  const Study study = load_study(shipped, tables_and({})).value();
  ASSERT_EQ(study.joints.size(), 2u);
  for (const Joint& joint : study.joints)
    EXPECT_EQ(std::ranges::count_if(joint.campaign.curves,
                                    [&](const Curve& c) { return std::ranges::count(study.learn, c.series); }),
              20);
  const auto summary = run_study(study, {.directory = folder.path});
  ASSERT_TRUE(summary) << summary.error().message;
  std::ifstream file(folder.path / "diagnosis.json");
  const auto json = nlohmann::json::parse(file);
  for (const auto& [joint, flagged_from_kg] : {std::pair{"joint3", 2.0}, {"joint5", 5.0}}) {
    double healthy = 0, loaded = 0;
    ASSERT_EQ(json[joint]["observations"].size(), 6u);
    for (const auto& o : json[joint]["observations"]) {
      const double kg = o["load_kg"];
      EXPECT_EQ(o["region1"]["anomalous"], kg >= flagged_from_kg) << joint << " " << o;
      EXPECT_EQ(o["region2"]["anomalous"], false) << joint << " " << o;
      double& largest = kg == 0 ? healthy : loaded;
      largest = std::max<double>(largest, o["region1"]["distance"]);
    }
    EXPECT_LT(healthy, 4) << joint;  // Zhou 2024's own threshold: a temperature is no anomaly
    EXPECT_GT(loaded, 5 * healthy) << joint;
  }
  // Errors of one joint are not those of the other.
  EXPECT_NE(study.joints[0].campaign.seed, study.joints[1].campaign.seed);
}

TEST(Study, FaultsOfTwiceTheirDetectionLimitAreNamed) {
  const Folder folder;
  YAML::Node tree = tables_and({"wear", "thickening", "pitted_bearing", "torque_constant", "backlash", "lubricant_loss",
                                "preload_loss"}),
             check, series, joints;
  for (const auto& c : tree["diagnosis"]["check"])
    if (c["series"].Scalar() == c["state"].Scalar()) check.push_back(c);
  for (const auto& s : tree["series"]) {
    if (s["name"].Scalar() == "evolution") series.push_back(s);
    if (!s["fault"]) continue;
    YAML::Node warm = YAML::Clone(s), only;
    only.push_back(s["temperature"]["heating"]["steps"][1]);
    warm["temperature"]["heating"]["steps"] = only;
    series.push_back(warm);
  }
  joints["joint5"] = YAML::Node(YAML::NodeType::Map);
  tree["joints"] = joints;
  tree["series"] = series;
  tree["diagnosis"]["check"] = check;
  tree["diagnosis"]["learn"] = YAML::Load("[evolution]");
  tree["diagnosis"]["draws"] = 20;
  const auto summary = run_study(load_study(shipped, tree).value(), {.directory = folder.path});
  ASSERT_TRUE(summary) << summary.error().message;
  std::ifstream file(folder.path / "diagnosis.json");
  const auto json = nlohmann::json::parse(file);
  int named = 0;
  for (const auto& o : json["joint5"]["observations"]) named += o["pattern"] == o["state"];
  EXPECT_GE(named, 6) << "of 7 simulated ones";
  ASSERT_EQ(json["joint5"]["power"].size(), drive::faults().size());
  for (const auto& p : json["joint5"]["power"]) {
    const std::string fault = p["fault"];
    EXPECT_GE(p["named_at_twice_the_limit"].value(fault, 0.0), 0.8) << p;
    EXPECT_LT(p["detection_limit"], p["unit"] == "rad" ? 2e-4 : 0.3) << p;
    for (const auto& point : p["roc"])
      if (point["severity"] > 1.4 * p["detection_limit"].get<double>())
        EXPECT_GE(point["detected"], 0.9) << fault << point;
  }
}

TEST(Study, WrongOnesAreRefusedWithFileAndKey) {
  const Folder folder;
  const fs::path file = folder.path / "study.yaml";
  std::ofstream(file)
      << "model: " << TRIBOTWIN_SOURCE_DIR
      << "/mjcf/br609.xml\nprocedure: test_cycle\njoints: {joint3: {}, joint5: {}}\n"
         "diagnosis: {learn: [evolution], check: [{series: evolution, state: cold}]}\n"
         "series: [{name: evolution, load: {by: payload, mass_kg: 0}, temperature: {prescribed_degC: 40}}]\n";
  const auto error = [&](const std::vector<std::string>& settings) -> std::string {
    const auto study = load_study(file, campaign_tree(file, settings).value());
    return study ? "accepted" : study.error().message;
  };
  EXPECT_EQ(error({}), "accepted");
  EXPECT_THAT(error({"diagnosis.learn=[evolutoin]"}),
              testing::AllOf(HasSubstr("study.yaml"), HasSubstr("'evolutoin' is no series")));
  EXPECT_THAT(error({"diagnosis.learn=evolution"}), HasSubstr("must be a list of series"));
  EXPECT_THAT(error({"diagnosis.check.0.state=[]"}), HasSubstr("state"));
  EXPECT_THAT(error({"diagnosis.chekc=1"}), HasSubstr("chekc"));
  EXPECT_THAT(error({"seed=one"}), HasSubstr("seed"));
  EXPECT_THAT(error({"diagnosis.draws=10", "procedure=plus_minus", "speeds_rad_s=[10, 50]"}), HasSubstr("draws"));
  EXPECT_THAT(error({"joints={joint9: {}}"}), HasSubstr("joint"));
  EXPECT_THAT(error({"joints={joint3: {procedrue: test_cycle}}"}), HasSubstr("procedrue"));
  EXPECT_THAT(error({"series.0.fault={type: waer, severity: 1}"}), HasSubstr("did you mean 'wear'"));
  EXPECT_THAT(error({"series.0.fault={type: wear, severity: -1}"}), HasSubstr("severity"));
}

}  // namespace
}  // namespace tribotwin::twin::study
