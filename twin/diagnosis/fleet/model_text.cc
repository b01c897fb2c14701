#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/json_input.hpp>

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

constexpr Bounds any_number{-1e300, 1e300}, not_negative{0, 1e300}, portion{0, 1};

Eigen::VectorXd to_vector(const JsonInput& in, Eigen::Index size, Bounds bounds = any_number) {
  const auto v = in.numbers(static_cast<std::size_t>(size), static_cast<std::size_t>(size), bounds);
  return Eigen::Map<const Eigen::VectorXd>(v.data(), size);
}
Eigen::MatrixXd to_matrix(const JsonInput& in, Eigen::Index size) {
  Eigen::MatrixXd m(size, size);
  const auto rows = in.list(static_cast<std::size_t>(size), static_cast<std::size_t>(size));
  for (Eigen::Index i = 0; i < size; ++i) m.row(i) = to_vector(rows[static_cast<std::size_t>(i)], size).transpose();
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

/// Of p features and q regressors.
RegionModel region_of(const JsonInput& in, Eigen::Index p, Eigen::Index q) {
  const JsonInput root = in["typical_root"];
  return {.decouple = to_matrix(in["decouple"], p),
          .lambda = to_vector(in["lambda"], p, not_negative),
          .persistence = in["persistence_per_day"].number(portion),
          .curvature = to_vector(in["curvature"], p),
          .mean = to_vector(in["mean"], p * q),
          .between = to_matrix(in["between"], p * q),
          .mean_error = to_matrix(in["mean_error"], p * q),
          .between_freedom = in["between_freedom"].number(any_number),
          .noise_freedom = in["noise_freedom"].number(any_number),
          .lambda_variance = to_vector(in["lambda_variance"], p),
          .scale_by_lambda = to_vector(in["scale_by_lambda"], p),
          .typical_scatter = in["typical_scatter"].number(any_number),
          .typical_root = to_matrix(root, root.list(0).empty() ? 0 : p),
          .scale = in["scale"].number(any_number),
          .scale_freedom = in["scale_freedom"].number(any_number),
          .probability = in["probability"].number(not_negative)};
}

/// Counts up whenever models say something else: 2 has variances of lambda that REML leaves, and factors of shifts; 3
/// has claims by direction.
constexpr int version = 3;

InputError of_another_version(const std::string& store) {
  return InputError(store + ": its models are of another version of tribotwin: learn again (tribotwin fleet learn)");
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

namespace {

TypeModel model_of(const JsonInput& in) {
  constexpr Bounds count{0, 9007199254740992.0};
  const auto temperatures = in["temperature_degC"].numbers(2, 2);
  TypeModel t{.type = in["type"].text(),
              .joint = in["joint"].text(),
              .robots = static_cast<std::size_t>(in["robots"].number(count)),
              .observations = static_cast<std::size_t>(in["observations"].number(count)),
              .temperature_low_degC = temperatures[0],
              .temperature_high_degC = temperatures[1],
              .knows_temperature = in["knows_temperature"].truth()};
  t.within = to_matrix(in["within"], t.within.rows());
  t.load_norm = in["load_norm"].number_or_null();
  for (const JsonInput& note : in["notes"].list(0)) t.notes.push_back(note.text());
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const auto choices = in[regions[r].name].list(1);
    for (std::size_t k = 0; k < choices.size(); ++k) {
      RegionModel m = region_of(choices[k], regions[r].count, t.knows_temperature ? 2 : 1);
      (k == 0 ? t.region[r] : t.others[r].emplace_back()) = std::move(m);
    }
  }
  return t;
}

}  // namespace

TypeModel from_text(const std::string& text, const std::string& store) {
  const nlohmann::json j = parse_json(text);
  if (!j.is_object() || !j.contains("version") || j["version"] != version) throw of_another_version(store);
  const auto name = [&](const char* key) {
    return j.contains(key) && j[key].is_string() ? j[key].get<std::string>() : "?";
  };
  try {
    return model_of(JsonInput(j, ""));
  } catch (const InputError& e) {
    throw InputError(
        fmt::format("{}: its model of type '{}', joint '{}' is damaged: {}; learn again (tribotwin fleet learn)", store,
                    name("type"), name("joint"), e.what()));
  }
}

}  // namespace tribotwin::twin::diagnosis::fleet
