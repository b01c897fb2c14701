#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/verdict/report.hpp>
#include <tribotwin/twin/io/text_table.hpp>

namespace tribotwin::twin::identification {

using Json = nlohmann::ordered_json;

Json json_of(std::span<const Lacking> lacking) {
  Json all = Json::array();
  for (const auto& one : lacking)
    all.push_back(
        {{"parameter", one.parameter}, {"withheld", one.withheld}, {"reason", one.reason}, {"record_next", one.next}});
  return all;
}

Json json_of(const JointVerdict& v) {
  Json j{{"badly_explained", v.badly_explained()},
         {"relative_error", v.octaves.empty() ? Json(nullptr) : Json(v.relative_error)},
         {"of_variation", v.octaves.empty() ? Json(nullptr) : Json(v.of_variation)},
         {"dependence", Json::object()},
         {"octaves", Json::array()},
         {"half_below_hz", v.half_below_hz},
         {"white_half_hz", v.white_half_hz}};
  for (const auto& d : v.dependence) {
    Json bins = Json::array();
    for (const auto& b : d.bins) bins.push_back({{"from", b.from}, {"to", b.to}, {"mean", b.mean}, {"sigma", b.sigma}});
    j["dependence"][d.on] = {{"share", d.share}, {"chance", d.chance}, {"growth", d.growth}, {"bins", std::move(bins)}};
  }
  for (const auto& o : v.octaves)
    j["octaves"].push_back({{"from_hz", o.from_hz}, {"to_hz", o.to_hz}, {"share", o.share}});
  return j;
}

std::string table_of(std::span<const JointVerdict> verdicts) {
  constexpr auto right = TextTable::right;
  constexpr const char* quantities[] = {"speed", "load", "position", "time", "temperature"};
  std::size_t columns = 4;
  for (const auto& v : verdicts)
    if (v.dependence.size() > 4 && v.dependence[4].on == quantities[4]) columns = 5;
  std::vector<TextTable::Column> heads{TextTable::left("joint"), right("unexplained")};
  for (std::size_t k = 0; k < columns; ++k) heads.push_back(right(fmt::format("by {}", quantities[k])));
  heads.push_back(right("half below"));
  TextTable table(heads);
  for (const auto& v : verdicts) {
    if (v.octaves.empty()) continue;
    std::vector<std::string> row{v.joint, fmt::format("{:.1f} %", 100 * v.of_variation)};
    for (std::size_t k = 0; k < columns; ++k)
      row.push_back(k < v.dependence.size() && v.dependence[k].shown()
                        ? fmt::format("{:.0f} %", 100 * v.dependence[k].share)
                        : "-");
    row.push_back(fmt::format("{:.2g} Hz", v.half_below_hz));
    table.add(std::move(row));
  }
  return table.text();
}

}  // namespace tribotwin::twin::identification
