#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/estimates_file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr std::pair<Status, std::string_view> statuses[] = {
    {Status::estimated, "estimated"}, {Status::fixed, "fixed"}, {Status::held, "held"}, {Status::at_bound, "at_bound"}};

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

std::string_view name_of(Status status) {
  for (const auto& [s, name] : statuses)
    if (s == status) return name;
  return "";
}

std::string list(const std::vector<std::string>& items) {
  std::vector<std::string> q;
  for (const auto& i : items) q.push_back(quoted(i));
  return fmt::format("[{}]", joined(q));
}

/// A mapping in block style; {} where it is empty, which would otherwise read as null.
std::string block(const std::string& head, const std::string& entries) {
  const auto comment = head.find(" ");
  return entries.empty() ? head.substr(0, comment) + " {}\n" : head + "\n" + entries;
}

/// Estimates and their uncertainty; `range` is the inside of a flow mapping, or empty.
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
    correlations += fmt::format("  {}: [{}]\n", e.name, joined(row));
  }
  s += block("sigma:   # one standard deviation, of estimated parameters", sigmas) +
       block("confidence_95:", intervals) + block("correlation:   # in the order of sigma", correlations);
  if (!range.empty()) s += fmt::format("range: {{{}}}\n", range);
  s += fmt::format("residual: {{mean: {}, std: {}, max_abs: {}}}\nsamples: {}\n", found.residual.mean,
                   found.residual.std, found.residual.max_abs, found.samples);
  // Not defined where nothing is estimated or friction never changes.
  for (const auto& [key, value] :
       {std::pair{"condition_number", found.condition_number}, {"r_squared", found.r_squared}})
    if (std::isfinite(value)) s += fmt::format("{}: {}\n", key, value);
  return s + fmt::format("unidentifiable: {}\ndata: {}\nnotes: {}\n", list(found.unidentifiable), list(data),
                         list(found.notes));
}

/// What friction laws know nothing of, with its accepted range.
struct OfDirection {
  const char* name;
  double ParameterFile::*value;
  double limit;
};
constexpr OfDirection of_direction[] = {{"asymmetry", &ParameterFile::asymmetry, 0.99},
                                        {"offset", &ParameterFile::offset, 1e9}};

friction::Law read_law(Mapping& m, const std::filesystem::path& path, ParameterFile& file) {
  const std::string law = m.text("law");
  if (!friction::find_law(law)) {
    std::vector<std::string_view> names;
    for (const auto& l : friction::laws()) names.push_back(l.name);
    m.fail("law", fmt::format("is '{}'; the laws are {}", law, joined(names)));
  }
  auto parameters = m.mapping("parameters");
  if (!parameters) m.fail("parameters", "is missing");
  std::vector<std::pair<std::string, double>> values;
  for (const auto& name : parameters->names()) {
    const auto extra = std::ranges::find(of_direction, name, &OfDirection::name);
    if (extra == std::end(of_direction))
      values.emplace_back(name, parameters->number(name));
    else
      file.*extra->value = parameters->number(name, {-extra->limit, extra->limit});
  }
  auto made = friction::make_law(law, values);
  if (!made) throw InputError(fmt::format("{}: {}", path.string(), made.error().message));
  parameters->done();
  return *made;
}

/// Value, status, sigma and interval of a law's parameters.
std::vector<Estimate> read_estimates(Mapping& m, const ParameterFile& file) {
  const friction::Law& law = file.law;
  auto status = m.mapping("status"), sigma = m.mapping("sigma"), interval = m.mapping("confidence_95");
  std::vector<std::string_view> accepted;
  for (const auto& [s, text] : statuses) accepted.push_back(text);
  std::vector<Estimate> all;
  const auto read = [&](const std::string& name, std::string_view unit, double value) {
    Estimate e{.name = name,
               .unit = std::string(unit),
               .value = value,
               .sigma = unknown,
               .low = unknown,
               .high = unknown,
               .status = Status::fixed};
    if (status && status->has(name))
      e.status =
          std::ranges::find(statuses, status->choice(name, accepted), [](const auto& s) { return s.second; })->first;
    if (sigma && sigma->has(name)) e.sigma = sigma->number(name, {0, 1e300});
    if (interval && interval->has(name)) {
      const auto ends = interval->numbers(name);
      if (ends.size() != 2) interval->fail(name, "must hold two numbers, [low, high]");
      e.low = ends[0], e.high = ends[1];
    }
    all.push_back(std::move(e));
  };
  for (std::size_t i = 0; i < law.info->parameters.size(); ++i)
    read(std::string(law.info->parameters[i].name), law.info->parameters[i].unit, law.parameters[i]);
  if (file.asymmetry != 0 || file.offset != 0) {
    read("asymmetry", "1", file.asymmetry);
    read("offset", law.info->normalised ? "-" : "Nm", file.offset);
  }
  for (auto* part : {&status, &sigma, &interval})
    if (*part) (*part)->done();
  return all;
}

/// From the correlations of the parameters with a sigma; NaN for the others.
Eigen::MatrixXd read_covariance(Mapping& m, const std::vector<Estimate>& estimates) {
  const auto n = static_cast<Eigen::Index>(estimates.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Constant(n, n, unknown);
  auto correlation = m.mapping("correlation");
  if (!correlation) return covariance;
  std::vector<std::size_t> estimated;
  for (std::size_t i = 0; i < estimates.size(); ++i)
    if (!std::isnan(estimates[i].sigma)) estimated.push_back(i);
  for (const std::size_t i : estimated) {
    const auto row = correlation->numbers(estimates[i].name, {-1.000001, 1.000001});
    if (row.size() != estimated.size())
      correlation->fail(estimates[i].name,
                        fmt::format("must hold {} numbers, one per parameter with a sigma", estimated.size()));
    for (std::size_t k = 0; k < row.size(); ++k)
      covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(estimated[k])) =
          row[k] * estimates[i].sigma * estimates[estimated[k]].sigma;
  }
  correlation->done();
  return covariance;
}

void read_range(Mapping& m, friction::Range& r) {
  auto range = m.mapping("range");
  if (!range) return;
  range->accept({"speed_max_rad_s", "load_max", "temperature_min_degC", "temperature_max_degC"});
  r.speed_max_rad_s = range->number_or("speed_max_rad_s", r.speed_max_rad_s, {0, 1e6});
  r.load_max = range->number_or("load_max", r.load_max, {0, 1000});
  r.temperature_min_degC = range->number_or("temperature_min_degC", r.temperature_min_degC, {-273.15, 1000});
  r.temperature_max_degC = range->number_or("temperature_max_degC", r.temperature_max_degC, {-273.15, 1000});
  range->done();
}

void read_statistics(Mapping& m, Estimates& found) {
  if (auto residual = m.mapping("residual")) {
    found.residual.mean = residual->number_or("mean", 0);
    found.residual.std = residual->number_or("std", 0);
    found.residual.max_abs = residual->number_or("max_abs", 0);
    residual->done();
  }
  found.samples = m.whole_or("samples", 0, {0, 1e12});
  found.condition_number = m.number_or("condition_number", 0);
  found.r_squared = m.number_or("r_squared", 0);
  found.unidentifiable = m.texts("unidentifiable");
  found.notes = m.texts("notes");
}

std::optional<drive::Bristles> read_bristles(Mapping& m) {
  auto lugre = m.mapping("lugre");
  if (!lugre) return {};
  auto values = lugre->mapping("parameters");
  if (!values) lugre->fail("parameters", "is missing");
  const drive::Bristles bristles{.sigma0 = values->number("sigma0", {1e-12, 1e15}),
                                 .sigma1 = values->number("sigma1", {0, 1e15}),
                                 .vd = values->number("vd", {1e-9, 1e9})};
  values->done();
  return bristles;
}

}  // namespace

ParameterFile parameter_file(const Fit& fit, std::vector<std::string> data, double torque_max_nm, double gear_ratio) {
  return {.law = fit.law,
          .torque_max_nm = torque_max_nm,
          .gear_ratio = gear_ratio,
          .found = fit,
          .data = std::move(data),
          .bristles = {},
          .asymmetry = fit.asymmetry,
          .offset = fit.offset};
}

std::string to_yaml(const ParameterFile& f) {
  const friction::LawInfo& info = *f.law.info;
  std::string s = fmt::format(
      "# {} = {}; {}\n{}law: {}\n", info.normalised ? "friction / torque_max_nm" : "friction [Nm]", info.equation,
      info.source,
      f.asymmetry == 0 && f.offset == 0 ? "" : "# of motion with sign s: sign(s) friction (1 + s asymmetry) + offset\n",
      info.name);
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
      return work_failed(fmt::format(
          "the fit gives no finite number for {}; check the data for values that no joint can have", e.name));
    if (std::ranges::find(of_direction, e.name, &OfDirection::name) == std::end(of_direction))
      values.emplace_back(e.name, e.value);
  }
  const auto& r = found.residual;
  if (!std::isfinite(r.mean) || !std::isfinite(r.std) || !std::isfinite(r.max_abs))
    return work_failed("the residuals of the fit are not finite; check the data for values that no joint can have");
  if (!law) return {};
  if (const auto made = friction::make_law(law->name, values); !made)
    return work_failed(fmt::format("these data give no law that can be used: {}", made.error().message));
  return {};
}

Result<ParameterFile> read_parameters(const std::filesystem::path& path) try {
  const YAML::Node root = load_yaml(path);
  refuse_other_kind(root, path.string(), "tribotwin identify");
  Mapping m(path.string(), "", root);
  m.accept({"law", "torque_max_nm", "gear_ratio", "parameters", "status", "sigma", "confidence_95", "correlation",
            "range", "residual", "samples", "condition_number", "r_squared", "unidentifiable", "data", "notes",
            "lugre"});
  ParameterFile f;
  f.law = read_law(m, path, f);
  f.torque_max_nm = m.number_or("torque_max_nm", 0, {0, 1e9});
  f.gear_ratio = m.number_or("gear_ratio", 0, {0, 1e6});
  f.found.parameters = read_estimates(m, f);
  f.found.covariance = read_covariance(m, f.found.parameters);
  read_range(m, f.law.range);
  read_statistics(m, f.found);
  f.data = m.texts("data");
  f.bristles = read_bristles(m);
  m.done();
  return f;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<transmission::Hysteresis> hysteresis_of(const std::filesystem::path& path, std::string name,
                                               const std::string& drive) try {
  Mapping m(path.string(), "", load_yaml(path));
  transmission::Configuration keys{{"drive", drive}};
  for (const char* part : {"parameters", "range"}) {
    auto numbers = m.mapping(part);
    if (!numbers) m.fail(part, "is missing");
    for (const auto& key : numbers->names()) keys.emplace_back(key, fmt::format("{}", numbers->number(key)));
  }
  auto made = transmission::make_hysteresis(std::move(name), keys);
  if (!made) return work_failed(made.error().message);
  return made;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

Result<drive::Drive> drive_of(const ParameterFile& f, std::string name) {
  if (!(f.torque_max_nm > 0)) return tl::unexpected(Error("the file holds no torque_max_nm; give it by --tau-max"));
  if (!(f.gear_ratio > 0)) return tl::unexpected(Error("the file holds no gear_ratio; give it by --gear-ratio"));
  drive::Drive d;
  d.name = std::move(name);
  d.law = f.law;
  d.torque_max_nm = f.torque_max_nm;
  d.gear_ratio = f.gear_ratio;
  d.asymmetry = f.asymmetry;
  d.offset_nm = f.offset * d.torque_scale_nm();
  if (f.bristles) d.dynamics = drive::Dynamics::lugre, d.bristles = *f.bristles;
  return d;
}

}  // namespace tribotwin::twin::identification
