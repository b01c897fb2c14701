#include <cmath>
#include <limits>
#include <stdexcept>

#include <nlohmann/json.hpp>

#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Json = nlohmann::ordered_json;

Json matrix(const Eigen::MatrixXd& m) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    Json row = Json::array();
    for (Eigen::Index k = 0; k < m.cols(); ++k) row.push_back(m(i, k));
    rows.push_back(std::move(row));
  }
  return rows;
}
Json vector(const Eigen::VectorXd& v) { return Json(std::vector<double>(v.begin(), v.end())); }

Eigen::VectorXd to_vector(const Json& j) {
  const auto v = j.get<std::vector<double>>();
  return Eigen::Map<const Eigen::VectorXd>(v.data(), static_cast<Eigen::Index>(v.size()));
}
Eigen::MatrixXd to_matrix(const Json& j) {
  const auto rows = static_cast<Eigen::Index>(j.size());
  Eigen::MatrixXd m(rows, rows);
  for (Eigen::Index i = 0; i < rows; ++i) m.row(i) = to_vector(j.at(static_cast<std::size_t>(i))).transpose();
  return m;
}

Json json_of(const RegionModel& m) {
  return {{"decouple", matrix(m.decouple)},
          {"lambda", vector(m.lambda)},
          {"persistence_per_day", m.persistence},
          {"curvature", vector(m.curvature)},
          {"mean", vector(m.mean)},
          {"between", matrix(m.between)},
          {"mean_error", matrix(m.mean_error)},
          {"between_freedom", m.between_freedom},
          {"noise_freedom", m.noise_freedom},
          {"lambda_variance", vector(m.lambda_variance)},
          {"scale_by_lambda", vector(m.scale_by_lambda)},
          {"probability", m.probability},
          {"typical_scatter", m.typical_scatter},
          {"typical_root", matrix(m.typical_root)},
          {"scale", m.scale},
          {"scale_freedom", m.scale_freedom}};
}

RegionModel region_of(const Json& j) {
  return {.decouple = to_matrix(j.at("decouple")),
          .lambda = to_vector(j.at("lambda")),
          .persistence = j.at("persistence_per_day"),
          .curvature = to_vector(j.at("curvature")),
          .mean = to_vector(j.at("mean")),
          .between = to_matrix(j.at("between")),
          .mean_error = to_matrix(j.at("mean_error")),
          .between_freedom = j.at("between_freedom"),
          .noise_freedom = j.at("noise_freedom"),
          .lambda_variance = to_vector(j.at("lambda_variance")),
          .scale_by_lambda = to_vector(j.at("scale_by_lambda")),
          .typical_scatter = j.at("typical_scatter"),
          .typical_root = to_matrix(j.at("typical_root")),
          .scale = j.at("scale"),
          .scale_freedom = j.at("scale_freedom"),
          .probability = j.at("probability")};
}

/// Counts up whenever models say something else: 2 has variances of lambda that REML leaves, and factors of shifts; 3
/// has claims by direction.
constexpr int version = 3;

InputError of_another_version() {
  return InputError("the store's models are of another version of tribotwin: learn again (tribotwin fleet learn)");
}

}  // namespace

std::string to_text(const TypeModel& t) {
  Json j{{"version", version},
         {"type", t.type},
         {"joint", t.joint},
         {"robots", t.robots},
         {"observations", t.observations},
         {"temperature_degC", {t.temperature_low_degC, t.temperature_high_degC}},
         {"knows_temperature", t.knows_temperature},
         {"within", matrix(t.within)},
         {"load_norm", std::isfinite(t.load_norm) ? Json(t.load_norm) : Json(nullptr)},
         {"notes", t.notes}};
  for (std::size_t r = 0; r < regions.size(); ++r) {
    Json& all = j[regions[r].name] = Json::array();
    for (std::size_t k = 0; k < t.choices(r); ++k) all.push_back(json_of(t.choice(r, k)));
  }
  return dump_json(j);
}

TypeModel from_text(const std::string& text) try {
  const Json j = parse_ordered_json(text);
  if (j.at("version") != version) throw of_another_version();
  TypeModel t{.type = j.at("type"),
              .joint = j.at("joint"),
              .robots = j.at("robots"),
              .observations = j.at("observations"),
              .temperature_low_degC = j.at("temperature_degC").at(0),
              .temperature_high_degC = j.at("temperature_degC").at(1),
              .knows_temperature = j.at("knows_temperature")};
  t.within = to_matrix(j.at("within"));
  if (!j.at("load_norm").is_null()) t.load_norm = j.at("load_norm");
  t.notes = j.at("notes").get<std::vector<std::string>>();
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const Json& all = j.at(std::string(regions[r].name));
    t.region[r] = region_of(all.at(0));
    for (std::size_t k = 1; k < all.size(); ++k) t.others[r].push_back(region_of(all.at(k)));
  }
  return t;
} catch (const Json::exception&) {
  throw of_another_version();
}

}  // namespace tribotwin::twin::diagnosis::fleet
