#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/twin/experiments/sweep/parameter_set.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/estimates_file.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::sweep {
namespace {

namespace fs = std::filesystem;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using identification::Estimate;

constexpr double half_of_95 = 1.959963984540054;  ///< sigmas of a normal variate

/// One identified joint, whichever file it is of.
struct Identified {
  friction::Law law;
  double asymmetry = 0, offset_nm = 0, offset_unit_nm = 1;  ///< [Nm] per unit of the estimate `offset`
  std::vector<Estimate> estimates;
  MatrixXd covariance;
};

/// The law of an estimate's parameter; offsets in Nm.
struct Limits {
  double low = -1e9, high = 1e9;
};
Limits limits_of(const friction::LawInfo& law, const std::string& name) {
  for (const auto& p : law.parameters)
    if (p.name == name) return {p.minimum, p.maximum};
  return name == "asymmetry" ? Limits{-0.99, 0.99} : Limits{};
}

double deviation_of(const Estimate& e) {
  const double half = (e.high - e.low) / 2;
  return std::isfinite(half) && half > 0 ? half / half_of_95 : e.sigma;
}

/// The keys of the drive with the identified law that differ from those it has.
std::vector<std::pair<std::string, std::string>> changed_keys(const drive::Drive& old, const Identified& found,
                                                              const std::string& prefix) {
  drive::Drive drive = old;
  drive.law = found.law;
  drive.law.validity = old.law.validity;
  drive.asymmetry = found.asymmetry;
  drive.offset_nm = found.offset_nm;
  const auto before = drive::configuration_of(old);
  std::vector<std::pair<std::string, std::string>> keys;
  for (const auto& entry : drive::configuration_of(drive))
    if (std::ranges::find(before, entry) == before.end() || entry.first == "law")
      keys.emplace_back(prefix + entry.first, entry.second);
  return keys;
}

/// Fails where the correlations are no correlations.
Result<void> set_covariance(ParameterSet& set, const Identified& found, const std::vector<std::size_t>& drawn) {
  constexpr double rounding = 1e-4;  // of the six digits of a file
  const auto n = static_cast<Index>(drawn.size());
  MatrixXd correlation = MatrixXd::Identity(n, n);
  for (Index a = 0; a < n; ++a)
    for (Index b = 0; b < n; ++b) {
      const auto i = static_cast<Index>(drawn[static_cast<std::size_t>(a)]),
                 k = static_cast<Index>(drawn[static_cast<std::size_t>(b)]);
      const double r = found.covariance(i, k) / std::sqrt(found.covariance(i, i) * found.covariance(k, k));
      if (a != b && std::isfinite(r)) correlation(a, b) = r;
      if (a > b && std::abs(correlation(a, b) - correlation(b, a)) > rounding) {
        const auto name = [&](Index of) { return found.estimates[static_cast<std::size_t>(of)].name; };
        return tl::unexpected(
            Error(fmt::format("correlation: {0} with {1} is {2:.4g}, {1} with {0} is {3:.4g}; both are one", name(k),
                              name(i), correlation(b, a), correlation(a, b))));
      }
    }
  if (symmetric_eigenvalues(correlation).minCoeff() < -rounding)
    return tl::unexpected(
        Error(fmt::format("correlation: those of {} contradict each other (the matrix has a negative eigenvalue), so "
                          "nothing can be drawn; take the file as it was identified",
                          set.joint)));
  set.root = triangular_root(correlation).transpose();
  return {};
}

/// One parameter of the set, in the unit of the drive's key.
void add(ParameterSet& set, const Estimate& e, const Identified& found, const std::string& prefix, Index at) {
  const bool offset = e.name == "offset";
  const double unit = offset ? found.offset_unit_nm : 1;
  const Limits limits = limits_of(*found.law.info, e.name);
  set.keys.push_back(prefix + (offset ? "offset_nm" : e.name));
  set.mean(at) = e.value * unit;
  set.deviation(at) = deviation_of(e) * unit;
  set.low(at) = limits.low, set.high(at) = limits.high;
}

void note_unknown(ParameterSet& set, const fs::path& file, const std::vector<std::string>& without_sigma) {
  if (!without_sigma.empty())
    set.notes.push_back(
        fmt::format("{}: {} of {} {} no sigma in the file (held, or at a bound); every run has the "
                    "value of the file, and results do not count how uncertain it is",
                    file.string(), joined(without_sigma), set.joint, without_sigma.size() == 1 ? "has" : "have"));
}

Result<ParameterSet> set_of(const fs::path& file, const drive::Drive& drive, const std::string& joint,
                            const Identified& found) {
  if (joint.find('.') != joint.npos)
    return tl::unexpected(
        Error(fmt::format("{}: joint '{}' has a dot in its name, which no setting can name", file.string(), joint)));
  const std::string prefix = "drives." + joint + ".";
  ParameterSet set{.joint = joint, .fixed = changed_keys(drive, found, prefix), .keys = {}, .notes = {}};
  std::vector<std::size_t> drawn;
  std::vector<std::string> without_sigma;
  for (std::size_t i = 0; i < found.estimates.size(); ++i) {
    const Estimate& e = found.estimates[i];
    if (e.low > e.high)
      return tl::unexpected(Error(fmt::format("{}: confidence_95: that of {} goes from {:g} to {:g}; the smaller first",
                                              file.string(), e.name, e.low, e.high)));
    if (deviation_of(e) > 0)
      drawn.push_back(i);
    else if (e.status != identification::Status::fixed)
      without_sigma.push_back(e.name);
  }
  const auto n = static_cast<Index>(drawn.size());
  for (VectorXd* v : {&set.mean, &set.deviation, &set.low, &set.high}) v->resize(n);
  for (Index k = 0; k < n; ++k) add(set, found.estimates[drawn[static_cast<std::size_t>(k)]], found, prefix, k);
  if (n == 0)
    return tl::unexpected(
        Error(fmt::format("{}: no parameter of {} has a sigma, so nothing can be drawn", file.string(), joint)));
  if (auto ok = set_covariance(set, found, drawn); !ok)
    return tl::unexpected(Error(fmt::format("{}: {}", file.string(), ok.error().message)));
  std::erase_if(set.fixed,
                [&](const auto& entry) { return std::ranges::find(set.keys, entry.first) != set.keys.end(); });
  note_unknown(set, file, without_sigma);
  return set;
}

Result<void> require_torque(const fs::path& file, const drive::Drive& drive, const std::string& joint, double of_file,
                            bool counts) {
  if (!counts || of_file <= 0 || std::abs(of_file - drive.torque_max_nm) <= 1e-9 * drive.torque_max_nm) return {};
  return tl::unexpected(Error(fmt::format(
      "{}: torque_max_nm is {}, but the drive of {} has {}; the law's torques are in units of it. Identify with "
      "--tau-max {}, or set drives.{}.torque_max_nm",
      file.string(), of_file, joint, drive.torque_max_nm, drive.torque_max_nm, joint)));
}

/// Of the torque by position, which drives do not have.
bool by_position(const Estimate& e) {
  return e.name == identification::cosine_name || e.name == identification::sine_name;
}

/// The friction of a joint in a file of dynamics.
Result<Identified> of_dynamics(const fs::path& file, const identification::FrictionEstimates& joint) {
  if (!friction::find_law(joint.law)) {
    std::vector<std::string_view> names;
    for (const auto& law : friction::laws()) names.push_back(law.name);
    return tl::unexpected(
        Error(fmt::format("{}: friction_law: '{}' is not a law of drives; run tribotwin dynamics with "
                          "--friction and one of {}",
                          file.string(), joint.law, joined(names))));
  }
  Identified found;
  std::vector<std::pair<std::string, double>> values;
  std::vector<Index> kept;
  for (std::size_t p = 0; p < joint.estimates.size(); ++p) {
    const Estimate& e = joint.estimates[p];
    if (by_position(e)) continue;
    kept.push_back(static_cast<Index>(p));
    found.estimates.push_back(e);
    if (e.name == identification::offset_name)
      found.offset_nm = e.value;
    else if (e.name == identification::asymmetry_name)
      found.asymmetry = e.value;
    else
      values.emplace_back(e.name, e.value);
  }
  auto law = friction::make_law(joint.law, values);
  if (!law)
    return tl::unexpected(
        Error(fmt::format("{}: friction of {}: {}", file.string(), joint.joint, law.error().message)));
  found.law = *law;
  found.covariance = joint.covariance(kept, kept);
  return found;
}

}  // namespace

VectorXd ParameterSet::draw(std::span<const double> u) const {
  VectorXd z(static_cast<Index>(size()));
  for (Index i = 0; i < z.size(); ++i) z(i) = normal_quantile(u[static_cast<std::size_t>(i)]);
  const VectorXd x = mean + deviation.cwiseProduct(root.triangularView<Eigen::Lower>() * z);
  return x.cwiseMax(low).cwiseMin(high);
}

bool ParameterSet::at_limit(std::size_t parameter, double value) const {
  const auto i = static_cast<Index>(parameter);
  return (value <= low(i) || value >= high(i)) && value != mean(i);
}

Result<ParameterSet> law_parameters(const fs::path& file, const mujoco::Model& model, const std::string& joint) {
  const auto index = find_drive(model, joint);
  if (!index) return tl::unexpected(Error(index.error().message));
  const auto read = identification::read_parameters(file);
  if (!read) return tl::unexpected(read.error());
  const drive::Drive& drive = model.drives()[*index].drive;
  if (auto ok = require_torque(file, drive, joint, read->torque_max_nm, read->law.info->normalised); !ok)
    return tl::unexpected(ok.error());
  drive::Drive scaled = drive;
  scaled.law = read->law;
  Identified found{.law = read->law,
                   .asymmetry = read->asymmetry,
                   .offset_nm = read->offset * scaled.torque_scale_nm(),
                   .offset_unit_nm = scaled.torque_scale_nm(),
                   .estimates = read->found.parameters,
                   .covariance = read->found.covariance};
  return set_of(file, drive, joint, found);
}

bool is_of_dynamics(const fs::path& file) { return static_cast<bool>(load_yaml(file)["base_parameters"]); }

Result<std::vector<ParameterSet>> robot_parameters(const fs::path& file, const mujoco::Model& model) {
  const auto read = identification::read_friction(file);
  if (!read) return tl::unexpected(read.error());
  std::vector<ParameterSet> sets;
  const YAML::Node coupling = load_yaml(file)["coupling"];
  for (const auto& joint : *read) {
    const auto index = find_drive(model, joint.joint);
    if (!index) return tl::unexpected(Error(fmt::format("{}: {}", file.string(), index.error().message)));
    const auto found = of_dynamics(file, joint);
    if (!found) return tl::unexpected(found.error());
    const drive::Drive& drive = model.drives()[*index].drive;
    if (auto ok = require_torque(file, drive, joint.joint, joint.torque_max_nm, found->law.info->normalised); !ok)
      return tl::unexpected(ok.error());
    auto set = set_of(file, drive, joint.joint, *found);
    if (!set) return tl::unexpected(set.error());
    if (std::ranges::any_of(joint.estimates, by_position))
      set->notes.push_back(
          fmt::format("{}: the torque of {} by position is no drive's; the simulated robot does not "
                      "have it",
                      file.string(), joint.joint));
    if (!joint.correlated)
      set->notes.push_back(
          fmt::format("{}: says nothing of correlations between the parameters of {}; they are drawn "
                      "independently. Identify again with this version of tribotwin dynamics",
                      file.string(), joint.joint));
    sets.push_back(std::move(*set));
  }
  if (sets.empty()) return tl::unexpected(Error(fmt::format("{}: friction: names no joint", file.string())));
  if (coupling && coupling.IsMap() && coupling.size() > 0)
    sets[0].notes.push_back(fmt::format(
        "{}: the friction of coupled motors is no drive's; the simulated robot does not have it", file.string()));
  return sets;
}

}  // namespace tribotwin::twin::sweep
