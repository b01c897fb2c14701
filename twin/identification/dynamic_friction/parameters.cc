#include <cmath>
#include <sstream>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr std::pair<Status, std::string_view> statuses[] = {
    {Status::estimated, "estimated"}, {Status::fixed, "fixed"}, {Status::held, "held"}, {Status::at_bound, "at_bound"}};

std::string_view name_of(Status status) {
  for (const auto& [s, name] : statuses)
    if (s == status) return name;
  return "";
}

std::string list(const std::vector<std::string>& items) {
  std::vector<std::string> q;
  for (const auto& i : items) q.push_back(quoted(i));
  return fmt::format("[{}]", fmt::join(q, ", "));
}

/// A mapping in block style. One without entries would read as nothing at all.
std::string block(const std::string& head, const std::string& entries) {
  const auto comment = head.find(" ");
  return entries.empty() ? head.substr(0, comment) + " {}\n" : head + "\n" + entries;
}

/// What was found and how sure it is; `range` is the inside of a flow mapping, or empty.
std::string results(const Estimates& found, const std::string& range, const std::vector<std::string>& data) {
  std::string s = "parameters:\n";
  for (const auto& e : found.parameters) s += fmt::format("  {}: {}   # {}\n", e.name, e.value, e.unit);
  s += "status:\n";
  for (const auto& e : found.parameters) s += fmt::format("  {}: {}\n", e.name, name_of(e.status));
  std::string sigmas, intervals, correlations;
  for (std::size_t i = 0; i < found.parameters.size(); ++i) {
    const Estimate& e = found.parameters[i];
    if (std::isfinite(e.low) && std::isfinite(e.high))
      intervals += fmt::format("  {}: [{}, {}]\n", e.name, e.low, e.high);
    if (!std::isfinite(e.sigma)) continue;
    sigmas += fmt::format("  {}: {}\n", e.name, e.sigma);
    std::vector<std::string> row;
    for (std::size_t j = 0; j < found.parameters.size(); ++j)
      if (std::isfinite(found.parameters[j].sigma))
        row.push_back(fmt::format("{:.6g}", std::isfinite(found.correlation(i, j)) ? found.correlation(i, j)
                                            : i == j                               ? 1.0
                                                                                   : 0.0));
    correlations += fmt::format("  {}: [{}]\n", e.name, fmt::join(row, ", "));
  }
  s += block("sigma:   # one standard deviation of those that were estimated", sigmas) +
       block("confidence_95:", intervals) + block("correlation:   # in the order of sigma", correlations);
  if (!range.empty()) s += fmt::format("range: {{{}}}\n", range);
  s += fmt::format("residual: {{mean: {}, std: {}, max_abs: {}}}\nsamples: {}\n", found.residual.mean,
                   found.residual.std, found.residual.max_abs, found.samples);
  // Neither exists where nothing is estimated, or friction never changes.
  for (const auto& [key, value] :
       {std::pair{"condition_number", found.condition_number}, {"r_squared", found.r_squared}})
    if (std::isfinite(value)) s += fmt::format("{}: {}\n", key, value);
  return s + fmt::format("unidentifiable: {}\ndata: {}\nnotes: {}\n", list(found.unidentifiable), list(data),
                         list(found.notes));
}

}  // namespace

ParameterFile parameter_file(const Fit& fit, std::vector<std::string> data, double torque_max_nm, double gear_ratio) {
  return {
      .law = fit.law, .torque_max_nm = torque_max_nm, .gear_ratio = gear_ratio, .found = fit, .data = std::move(data)};
}

std::string to_yaml(const ParameterFile& f) {
  const friction::LawInfo& info = *f.law.info;
  std::string s =
      fmt::format("# {} = {}; {}\nlaw: {}\n", info.normalised ? "friction / torque_max_nm" : "friction [Nm]",
                  info.equation, info.source, info.name);
  if (f.torque_max_nm > 0) s += fmt::format("torque_max_nm: {}\n", f.torque_max_nm);
  if (f.gear_ratio > 0) s += fmt::format("gear_ratio: {}\n", f.gear_ratio);
  const auto& r = f.law.range;
  std::string range = fmt::format("speed_max_rad_s: {}", r.speed_max_rad_s);
  if (info.load_dependent) range += fmt::format(", load_max: {}", r.load_max);
  if (info.temperature_dependent)
    range += fmt::format(", temperature_min_degC: {}, temperature_max_degC: {}", r.temperature_min_degC,
                         r.temperature_max_degC);
  return s + results(f.found, range, f.data);
}

std::string to_yaml(const HysteresisFit& fit, const std::vector<std::string>& data) {
  const auto& h = fit.hysteresis;
  return fmt::format("# {}\nlaw: bouc_wen\n", bouc_wen_equation) +
         results(fit,
                 fmt::format("torsion_max_rad: {}, temperature_min_degC: {}, temperature_max_degC: {}",
                             h.torsion_max_rad, h.temperature_min_degC, h.temperature_max_degC),
                 data);
}

std::string to_yaml(const ParameterFile& of_law, const BristleFit& fit, const std::vector<std::string>& data) {
  std::string s = to_yaml(of_law) + fmt::format("# {}\nlugre:\n", lugre_equation);
  std::istringstream lines(results(fit, "", data));
  for (std::string line; std::getline(lines, line);) s += "  " + line + "\n";
  return s;
}

Result<void> usable(const Estimates& found, const friction::LawInfo* law) {
  std::vector<std::pair<std::string, double>> values;
  for (const auto& e : found.parameters) {
    if (!std::isfinite(e.value))
      return tl::unexpected(
          fmt::format("the fit gives no finite number for {}; what is in the data that no joint has?", e.name));
    values.emplace_back(e.name, e.value);
  }
  const auto& r = found.residual;
  if (!std::isfinite(r.mean) || !std::isfinite(r.std) || !std::isfinite(r.max_abs))
    return tl::unexpected(
        std::string("the residuals of the fit are not finite; what is in the data that no joint has?"));
  if (!law) return {};
  if (const auto made = friction::make_law(law->name, values); !made)
    return tl::unexpected(fmt::format("what these data give is no law that can be used: {}", made.error().message));
  return {};
}

ParameterFile read_parameters(const std::filesystem::path& path) {
  Mapping m(path.string(), "", load_yaml(path));
  m.accept({"law", "torque_max_nm", "gear_ratio", "parameters", "status", "sigma", "confidence_95", "correlation",
            "range", "residual", "samples", "condition_number", "r_squared", "unidentifiable", "data", "notes",
            "lugre"});
  ParameterFile f;
  const std::string law = m.text("law");
  const friction::LawInfo* info = friction::find_law(law);
  if (!info) {
    std::vector<std::string_view> names;
    for (const auto& l : friction::laws()) names.push_back(l.name);
    m.fail("law", fmt::format("is '{}'; the laws are {}", law, fmt::join(names, ", ")));
  }
  f.torque_max_nm = m.number_or("torque_max_nm", 0, {0, 1e9});
  f.gear_ratio = m.number_or("gear_ratio", 0, {0, 1e6});
  auto parameters = m.mapping("parameters");
  if (!parameters) m.fail("parameters", "is missing");
  std::vector<std::pair<std::string, double>> values;
  for (const auto& name : parameters->names()) values.emplace_back(name, parameters->number(name));
  auto made = friction::make_law(law, values);
  if (!made) throw InputError(fmt::format("{}: {}", path.string(), made.error().message));
  f.law = *made;
  auto status = m.mapping("status"), sigma = m.mapping("sigma"), interval = m.mapping("confidence_95"),
       correlation = m.mapping("correlation");
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  const auto n = static_cast<Eigen::Index>(info->parameters.size());
  f.found.covariance = Eigen::MatrixXd::Constant(n, n, unknown);
  std::vector<Eigen::Index> estimated;
  for (std::size_t i = 0; i < info->parameters.size(); ++i) {
    const auto& p = info->parameters[i];
    const std::string name(p.name);
    Estimate e{.name = name,
               .unit = std::string(p.unit),
               .value = f.law.parameters[i],
               .sigma = unknown,
               .low = unknown,
               .high = unknown,
               .status = Status::fixed};
    if (status && status->has(name)) {
      const std::string given = status->choice(name, {"estimated", "fixed", "held", "at_bound"});
      for (const auto& [s, text] : statuses)
        if (text == given) e.status = s;
    }
    if (sigma && sigma->has(name)) {
      e.sigma = sigma->number(name, {0, 1e300});
      estimated.push_back(static_cast<Eigen::Index>(i));
    }
    if (interval && interval->has(name)) {
      const auto ends = interval->numbers(name);
      if (ends.size() != 2) interval->fail(name, "must hold two numbers, [low, high]");
      e.low = ends[0], e.high = ends[1];
    }
    f.found.parameters.push_back(std::move(e));
  }
  if (correlation)
    for (const Eigen::Index i : estimated) {
      const std::string& name = f.found.parameters[static_cast<std::size_t>(i)].name;
      const auto row = correlation->numbers(name, {-1.000001, 1.000001});
      if (row.size() != estimated.size())
        correlation->fail(name, fmt::format("must hold {} numbers, one per parameter with a sigma", estimated.size()));
      for (std::size_t k = 0; k < row.size(); ++k)
        f.found.covariance(i, estimated[k]) = row[k] * f.found.parameters[static_cast<std::size_t>(i)].sigma *
                                              f.found.parameters[static_cast<std::size_t>(estimated[k])].sigma;
    }
  for (auto* part : {&status, &sigma, &interval, &correlation, &parameters})
    if (*part) (*part)->done();
  if (auto range = m.mapping("range")) {
    range->accept({"speed_max_rad_s", "load_max", "temperature_min_degC", "temperature_max_degC"});
    auto& r = f.law.range;
    r.speed_max_rad_s = range->number_or("speed_max_rad_s", r.speed_max_rad_s, {0, 1e6});
    r.load_max = range->number_or("load_max", r.load_max, {0, 1000});
    r.temperature_min_degC = range->number_or("temperature_min_degC", r.temperature_min_degC, {-273.15, 1000});
    r.temperature_max_degC = range->number_or("temperature_max_degC", r.temperature_max_degC, {-273.15, 1000});
    range->done();
  }
  if (auto residual = m.mapping("residual")) {
    f.found.residual.mean = residual->number_or("mean", 0);
    f.found.residual.std = residual->number_or("std", 0);
    f.found.residual.max_abs = residual->number_or("max_abs", 0);
    residual->done();
  }
  f.found.samples = m.whole_or("samples", 0, {0, 1e12});
  f.found.condition_number = m.number_or("condition_number", 0);
  f.found.r_squared = m.number_or("r_squared", 0);
  f.found.unidentifiable = m.texts("unidentifiable");
  f.data = m.texts("data");
  f.found.notes = m.texts("notes");
  if (const auto lugre = m.mapping("lugre")) {
    auto values_of = Mapping(*lugre).mapping("parameters");
    if (!values_of) lugre->fail("parameters", "is missing");
    f.bristles = drive::Bristles{.sigma0 = values_of->number("sigma0", {1e-12, 1e15}),
                                 .sigma1 = values_of->number("sigma1", {0, 1e15}),
                                 .vd = values_of->number("vd", {1e-9, 1e9})};
    values_of->done();
  }
  m.done();
  return f;
}

Result<transmission::Hysteresis> hysteresis_of(const std::filesystem::path& path, std::string name,
                                               const std::string& drive) {
  Mapping m(path.string(), "", load_yaml(path));
  transmission::Configuration keys{{"drive", drive}};
  for (const char* part : {"parameters", "range"}) {
    auto numbers = m.mapping(part);
    if (!numbers) m.fail(part, "is missing");
    for (const auto& key : numbers->names()) keys.emplace_back(key, fmt::format("{}", numbers->number(key)));
  }
  return transmission::make_hysteresis(std::move(name), keys);
}

Result<drive::Drive> drive_of(const ParameterFile& f, std::string name) {
  if (!(f.torque_max_nm > 0))
    return tl::unexpected(std::string("the file holds no torque_max_nm; give it by --tau-max"));
  if (!(f.gear_ratio > 0)) return tl::unexpected(std::string("the file holds no gear_ratio; give it by --gear-ratio"));
  drive::Drive d;
  d.name = std::move(name);
  d.law = f.law;
  d.torque_max_nm = f.torque_max_nm;
  d.gear_ratio = f.gear_ratio;
  if (f.bristles) d.dynamics = drive::Dynamics::lugre, d.bristles = *f.bristles;
  return d;
}

}  // namespace tribotwin::twin::identification
