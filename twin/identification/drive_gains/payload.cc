#include <algorithm>
#include <cmath>
#include <sstream>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/identification/drive_gains/payload.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::Matrix3d, Eigen::MatrixXd, Eigen::Vector3d, Eigen::VectorXd;

constexpr const char* form =
    "FILE=\"MASS kg [+- SIGMA] [at X Y Z [+- SIGMA]] [inertia XX YY ZZ [XY XZ YZ]] [on SITE]\", lengths in m";
/// No payload's centre of mass is farther from the flange [m]: beyond it the unit is another.
constexpr double farthest_m = 3;
constexpr double unknown_centre_m = 0.5, unknown_gyration_m = 0.2;

/// The words of a payload, one after the other.
class Words {
 public:
  explicit Words(const std::string& text) {
    std::istringstream in(text);
    for (std::string word; in >> word;) words_.push_back(word);
  }
  bool done() const { return next_ == words_.size(); }
  const std::string& take() { return words_[next_++]; }
  bool take(std::string_view word) {
    if (done() || words_[next_] != word) return false;
    ++next_;
    return true;
  }
  std::optional<double> number() {
    if (done()) return std::nullopt;
    const auto value = to_number(words_[next_]);
    if (!value || !std::isfinite(*value)) return std::nullopt;
    ++next_;
    return value;
  }
  std::vector<double> numbers() {
    std::vector<double> all;
    while (const auto x = number()) all.push_back(*x);
    return all;
  }

 private:
  std::vector<std::string> words_;
  std::size_t next_ = 0;
};

using Problem = std::optional<std::string>;

/// "+- SIGMA", where it follows.
Problem read_sigma(Words& words, double& sigma) {
  if (!words.take("+-")) return {};
  const auto value = words.number();
  if (!value || *value < 0) return "'+-' needs a standard deviation that is not negative";
  sigma = *value;
  return {};
}

Problem read_centre(Words& words, KnownPayload& out) {
  const auto at = words.numbers();
  if (at.size() != 3) return fmt::format("'at' needs three coordinates [m], it has {}", at.size());
  out.centre_m = Vector3d(at[0], at[1], at[2]);
  if (out.centre_m->norm() > farthest_m)
    return fmt::format("the centre of mass is {:g} m from the flange; coordinates are in m", out.centre_m->norm());
  return read_sigma(words, out.centre_sigma_m);
}

Problem read_inertia(Words& words, KnownPayload& out) {
  const auto given = words.numbers();
  if (given.size() != 3 && given.size() != 6)
    return fmt::format("'inertia' needs XX YY ZZ, or XX YY ZZ XY XZ YZ [kg m^2], it has {} numbers", given.size());
  auto& inertia = out.inertia_kg_m2.emplace(Eigen::Matrix<double, 6, 1>::Zero());
  std::ranges::copy(given, inertia.begin());
  const double half = inertia.head<3>().sum() / 2;
  if (inertia.head<3>().minCoeff() < 0 || inertia.head<3>().maxCoeff() > half * (1 + 1e-9))
    return "of XX YY ZZ none is negative and none larger than the sum of the others, of any real body";
  return {};
}

Problem read_mass(Words& words, KnownPayload& out) {
  const auto mass = words.number();
  if (!mass || !(*mass > 0) || !words.take("kg")) return "the mass, above 0, comes first, with its unit: '3.2 kg'";
  out.mass_kg = *mass;
  if (Problem p = read_sigma(words, out.mass_sigma_kg)) return p;
  words.take("kg");  // of the sigma
  if (out.mass_sigma_kg > 0.5 * out.mass_kg) return "the mass is not known to half of itself: weigh the payload";
  return {};
}

Problem read_known(const std::string& text, KnownPayload& out) {
  Words words(text);
  if (Problem p = read_mass(words, out)) return p;
  while (!words.done()) {
    Problem p;
    const std::string word = words.take();
    if (word == "at" && !out.centre_m)
      p = read_centre(words, out);
    else if (word == "inertia" && !out.inertia_kg_m2)
      p = read_inertia(words, out);
    else if (word == "on" && out.on.empty() && !words.done())
      out.on = words.take();
    else
      p = fmt::format("'{}' is not understood there", word);
    if (p) return p;
  }
  if (out.inertia_kg_m2 && !out.centre_m) return "'inertia' is about the centre of mass: say where that is, 'at X Y Z'";
  return {};
}

/// A frame of the model within a body.
struct Place {
  int body = -1;
  Vector3d origin = Vector3d::Zero();
  Matrix3d axes = Matrix3d::Identity();
};

Place of_site(const mjModel* m, int site) {
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> axes;
  mju_quat2Mat(axes.data(), m->site_quat + 4 * site);
  return {m->site_bodyid[site], Vector3d(m->site_pos + 3 * site), axes};
}

Result<Place> place_of(const std::string& on, const mjModel* m) {
  const std::string wanted = on.empty() ? "flange" : on;
  if (const int site = mj_name2id(m, mjOBJ_SITE, wanted.c_str()); site >= 0) return of_site(m, site);
  if (on.empty()) return Place{.body = m->dof_bodyid[m->nv - 1]};
  if (const int body = mj_name2id(m, mjOBJ_BODY, wanted.c_str()); body >= 0) return Place{.body = body};
  std::vector<std::string> names;
  for (int s = 0; s < m->nsite; ++s)
    if (const char* name = mj_id2name(m, mjOBJ_SITE, s)) names.emplace_back(name);
  return tl::unexpected(Error(
      fmt::format("the model has no site or body '{}'; its sites: {}", on, names.empty() ? "none" : joined(names))));
}

/// The regressor's parameters of a body, from its inertia about its centre in the axes of `place`.
VectorXd parameters_of(double mass, const Vector3d& centre, const Eigen::Matrix<double, 6, 1>& inertia,
                       const Place& place) {
  const Vector3d c = place.axes * centre + place.origin;
  Matrix3d I;
  I << inertia(0), inertia(3), inertia(4), inertia(3), inertia(1), inertia(5), inertia(4), inertia(5), inertia(2);
  I = place.axes * I * place.axes.transpose();
  I += mass * (c.squaredNorm() * Matrix3d::Identity() - c * c.transpose());
  VectorXd out(10);
  out << I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2), mass * c, mass;
  return out;
}

}  // namespace

Result<KnownPayload> known_payload(std::string_view text) {
  const auto sign = text.rfind('=');
  KnownPayload out;
  Problem p;
  if (sign == text.npos || sign == 0) {
    p = "no file";
  } else {
    out.file = text.substr(0, sign);
    out.text = text.substr(sign + 1);
    p = read_known(out.text, out);
  }
  if (p) return tl::unexpected(Error(fmt::format("--payload '{}': {}; the form is {}", printable(text), *p, form)));
  return out;
}

Result<PlacedPayload> placed(const KnownPayload& payload, const Regressor& regressor) {
  const auto place = place_of(payload.on, regressor.model());
  const auto refused = [&](const std::string& why) {
    return tl::unexpected(Error(fmt::format("--payload {}=\"{}\": {}", payload.file, payload.text, why)));
  };
  if (!place) return refused(place.error().message);
  if (first_column(regressor, place->body) < 0) return refused("that body does not move with any joint");
  const Vector3d centre = payload.centre_m.value_or(Vector3d::Zero());
  const auto inertia = payload.inertia_kg_m2.value_or(Eigen::Matrix<double, 6, 1>::Zero());
  const auto at = [&](const Vector3d& c) { return parameters_of(payload.mass_kg, c, inertia, *place); };
  PlacedPayload out{.body = {.body = place->body, .parameters = at(centre)},
                    .spread = {},
                    .origin = place->origin,
                    .axes = place->axes};
  std::vector<VectorXd> columns;
  // The same shape, heavier.
  if (payload.mass_sigma_kg > 0) columns.push_back(out.body.parameters * payload.mass_sigma_kg / payload.mass_kg);
  const double sigma_m = payload.centre_m ? payload.centre_sigma_m : unknown_centre_m;
  for (int axis = 0; axis < 3 && sigma_m > 0; ++axis) {
    constexpr double step = 0.01;  // parameters are quadratic in the centre: any step gives the slope
    const Vector3d aside = step * Vector3d::Unit(axis);
    columns.push_back(sigma_m * (at(centre + aside) - at(centre - aside)) / (2 * step));
  }
  const double gyration = payload.centre_m ? unknown_gyration_m : unknown_centre_m;
  for (int k = 0; k < 6 && !payload.inertia_kg_m2; ++k)
    columns.push_back(payload.mass_kg * gyration * gyration * VectorXd::Unit(10, k));
  out.spread.resize(10, static_cast<Index>(columns.size()));
  for (std::size_t k = 0; k < columns.size(); ++k) out.spread.col(static_cast<Index>(k)) = columns[k];
  return out;
}

Centre centre_of(const PlacedPayload& payload, const VectorXd& parameters, const MatrixXd& covariance) {
  const double mass = parameters(9);
  const Matrix3d in_body = covariance.block<3, 3>(6, 6) / (mass * mass);
  return {.position_m = payload.axes.transpose() * (parameters.segment<3>(6) / mass - payload.origin),
          .sigma_m = (payload.axes.transpose() * in_body * payload.axes).diagonal().cwiseMax(0).cwiseSqrt()};
}

}  // namespace tribotwin::twin::identification
