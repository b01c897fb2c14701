#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>
#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/io/table.hpp>
#include <tribotwin/twin/numerics/filter.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using Problem = std::optional<std::string>;

constexpr double degrees = 57.29577951308232;
/// No joint of an arm moves faster, rad/s or m/s.
constexpr double speed_most = 60;
/// Below this share of its largest speed a joint may stick; friction of sliding does not hold there.
constexpr double slow = 0.01;
/// Periods of the cut-off for which the filtered step of Coulomb friction rings after a reversal, to a thousandth of
/// it.
constexpr double ringing = 2;

/// Between samples a part of the range is passed at rest and in noise; the speed that is hardly ever exceeded tells
/// more than the largest.
double speed_hardly_exceeded(const std::vector<double>& time, const VectorXd& position) {
  std::vector<double> speeds;
  for (std::size_t i = 1; i < time.size(); ++i)
    speeds.push_back(std::abs(position(static_cast<Index>(i)) - position(static_cast<Index>(i) - 1)) /
                     (time[i] - time[i - 1]));
  const auto at = speeds.begin() + static_cast<std::ptrdiff_t>(speeds.size() * 95 / 100);
  std::ranges::nth_element(speeds, at);
  return *at;
}

Problem implausible_position(const Regressor& r, const RobotRecording& rec, Index joint, const std::string& column) {
  const mjModel* m = r.model();
  const VectorXd q = rec.position.row(joint);
  const double least = q.minCoeff(), most = q.maxCoeff(), low = m->jnt_range[2 * joint],
               high = m->jnt_range[2 * joint + 1], slack = 0.1 * (high - low);
  if (m->jnt_limited[joint] && (least < low - slack || most > high + slack)) {
    const bool fits = !r.is_slide(joint) && least / degrees >= low - slack && most / degrees <= high + slack &&
                      std::max(std::abs(least), std::abs(most)) > 3;
    return fmt::format(
        "{}: {} goes from {:.4g} to {:.4g}, the joint's range is {:.4g} .. {:.4g}; {}", rec.file.string(), column,
        least, most, low, high,
        fits ? "are these degrees, or is it another column, the torque?" : "is it another column, such as the torque?");
  }
  const double speed = speed_hardly_exceeded(rec.time_s, q);
  if (speed > speed_most)
    return fmt::format(
        "{}: {} moves at {:.4g} {}/s, where {:g} is beyond any robot; are these degrees, or is it another column, such "
        "as the torque?",
        rec.file.string(), column, speed, r.is_slide(joint) ? "m" : "rad", speed_most);
  return {};
}

/// A velocity against the slope of the position.
Problem implausible_velocity(const RobotRecording& rec, Index joint, const std::vector<double>& velocity,
                             const std::string& column, const std::string& position) {
  double cross = 0, own = 0;
  for (std::size_t i = 1; i < rec.time_s.size(); ++i) {
    const double step = rec.position(joint, static_cast<Index>(i)) - rec.position(joint, static_cast<Index>(i) - 1);
    cross += step * 0.5 * (velocity[i] + velocity[i - 1]) * (rec.time_s[i] - rec.time_s[i - 1]);
    own += step * step;
  }
  const double ratio = own > 0 ? cross / own : 1;
  if (ratio > 0.5 && ratio < 2) return {};
  const bool degree =
      std::abs(std::log(std::abs(ratio) / degrees)) < 0.3 || std::abs(std::log(std::abs(ratio) * degrees)) < 0.3;
  return fmt::format("{}: {} is {:.3g} times the slope of {}{}", rec.file.string(), column, ratio, position,
                     degree ? ": one of them is in degrees" : "; one of them is not what its name says");
}

struct Stretch {
  std::size_t first, last;  ///< inclusive
};

/// Cubic through the four samples around a time (fewer at the ends): a line through two would add steps to every
/// acceleration.
double interpolated(const std::vector<double>& time, const MatrixXd& values, Index joint, const Stretch& s, double t) {
  const auto after = static_cast<std::size_t>(std::upper_bound(time.begin() + static_cast<std::ptrdiff_t>(s.first),
                                                               time.begin() + static_cast<std::ptrdiff_t>(s.last), t) -
                                              time.begin());
  const std::size_t first = std::clamp(after < 2 ? 0 : after - 2, s.first, s.last - 3);
  double sum = 0;
  for (std::size_t a = first; a < first + 4; ++a) {
    double basis = values(joint, static_cast<Index>(a));
    for (std::size_t b = first; b < first + 4; ++b)
      if (b != a) basis *= (t - time[b]) / (time[a] - time[b]);
    sum += basis;
  }
  return sum;
}

std::vector<double> equidistant(const RobotRecording& rec, const MatrixXd& values, Index joint, const Stretch& s,
                                double period, bool regular) {
  std::vector<double> out;
  if (regular) {
    out.reserve(s.last - s.first + 1);
    for (std::size_t i = s.first; i <= s.last; ++i) out.push_back(values(joint, static_cast<Index>(i)));
    return out;
  }
  const auto count = static_cast<std::size_t>((rec.time_s[s.last] - rec.time_s[s.first]) / period + 1e-6) + 1;
  for (std::size_t k = 0; k < count; ++k)
    out.push_back(interpolated(rec.time_s, values, joint, s, rec.time_s[s.first] + static_cast<double>(k) * period));
  return out;
}

}  // namespace

Result<RobotRecording> read_robot_recording(const std::filesystem::path& file, const Regressor& r) {
  const auto n = static_cast<std::size_t>(r.joints());
  std::vector<std::string> wanted{"time_s"};
  enum { position, torque, velocity, temperature, kinds };
  for (std::size_t j = 0; j < n; ++j) {
    const auto& name = r.joint_name(static_cast<Index>(j));
    const bool slide = r.is_slide(static_cast<Index>(j));
    for (const auto& column :
         {fmt::format("position_{}_{}", name, slide ? "m" : "rad"),
          fmt::format("torque_{}_{}", name, slide ? "n" : "nm"),
          fmt::format("velocity_{}_{}_s", name, slide ? "m" : "rad"), fmt::format("temperature_{}_degC", name)})
      wanted.push_back(column);
  }
  auto table = read_numbers(file, wanted);
  if (!table) return tl::unexpected(table.error());
  const auto has = [&](const std::string& name) { return std::ranges::find(table->names, name) != table->names.end(); };
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    const bool optional = k > 0 && ((k - 1) % kinds == velocity || (k - 1) % kinds == temperature);
    if (!optional && !has(wanted[k])) {
      const auto& joint = k ? r.joint_name(static_cast<Index>((k - 1) / kinds)) : wanted[0];
      return tl::unexpected(fmt::format(
          "{}:1: no column '{}'; {}the header names {}", file.string(), wanted[k],
          k ? fmt::format("every joint of the model is needed, {} too, as what it does acts on the others; ", joint)
            : "",
          fmt::join(table->names, ", ")));
    }
  }
  RobotRecording rec{.file = file, .time_s = std::move(table->columns[0])};
  if (rec.time_s.size() < 10)
    return tl::unexpected(
        fmt::format("{}: {} rows of finite numbers; at least 10 are needed", file.string(), rec.time_s.size()));
  if (table->left_out)
    rec.notes.push_back(fmt::format("{}: {} rows with empty, NaN or infinite cells are gaps, the first in line {}",
                                    file.string(), table->left_out, table->first_left_out));
  if (const Problem p = not_increasing(*table, rec.time_s)) return tl::unexpected(*p);

  const auto samples = static_cast<Index>(rec.time_s.size());
  rec.position.resize(r.joints(), samples);
  rec.torque.resize(r.joints(), samples);
  std::size_t with_temperature = 0;
  for (std::size_t j = 0; j < n; ++j) with_temperature += has(wanted[1 + kinds * j + temperature]);
  if (with_temperature && with_temperature < n)
    rec.notes.push_back(
        fmt::format("{}: {} of {} joints have a temperature; none is used", file.string(), with_temperature, n));
  if (with_temperature == n) rec.temperature_degC.resize(r.joints(), samples);
  for (std::size_t j = 0; j < n; ++j) {
    const auto row = static_cast<Index>(j);
    const auto column = [&](int kind) -> std::vector<double>& {
      return table->columns[1 + kinds * j + static_cast<std::size_t>(kind)];
    };
    const auto name = [&](int kind) -> const std::string& {
      return wanted[1 + kinds * j + static_cast<std::size_t>(kind)];
    };
    rec.position.row(row) = Eigen::Map<const VectorXd>(column(position).data(), samples);
    rec.torque.row(row) = Eigen::Map<const VectorXd>(column(torque).data(), samples);
    if (const Problem p = implausible_position(r, rec, row, name(position))) return tl::unexpected(*p);
    if (!column(velocity).empty())
      if (const Problem p = implausible_velocity(rec, row, column(velocity), name(velocity), name(position)))
        return tl::unexpected(*p);
    if (with_temperature < n) continue;
    rec.temperature_degC.row(row) = Eigen::Map<const VectorXd>(column(temperature).data(), samples);
    if (const Problem p = implausible_temperature(file, name(temperature), column(temperature)))
      return tl::unexpected(*p);
  }
  if ((rec.position.rowwise().maxCoeff() - rec.position.rowwise().minCoeff()).maxCoeff() < 1e-3)
    return tl::unexpected(
        fmt::format("{}: the robot stands; dynamics are told by motion (tribotwin excite makes one)", file.string()));
  return rec;
}

Result<JointMotion> prepare(std::span<const RobotRecording> recordings, const Regressor& r,
                            const Preparation& preparation) {
  JointMotion out;
  struct Part {
    MatrixXd q, qd, qdd, torque, temperature;
    std::vector<double> time;
    std::size_t file;
    double edge_s;
    Index guard;
  };
  std::vector<Part> parts;
  const Index n = r.joints();
  out.has_temperature =
      std::ranges::all_of(recordings, [](const RobotRecording& rec) { return rec.temperature_degC.size() > 0; });
  for (std::size_t f = 0; f < recordings.size(); ++f) {
    const RobotRecording& rec = recordings[f];
    out.notes.insert(out.notes.end(), rec.notes.begin(), rec.notes.end());
    const auto& time = rec.time_s;
    std::vector<double> steps;
    for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
    const double typical = median_of(steps);
    std::vector<Stretch> stretches{{0, 0}};
    std::size_t gaps = 0, uneven = 0;
    for (std::size_t i = 1; i < time.size(); ++i) {
      if (steps[i - 1] > 2.5 * typical) {
        stretches.push_back({i, i});
        ++gaps;
      } else {
        stretches.back().last = i;
        uneven += std::abs(steps[i - 1] - typical) > 0.02 * typical;
      }
    }
    if (gaps)
      out.notes.push_back(fmt::format("{}: {} gaps in time_s; the stretches between them are used one by one",
                                      rec.file.string(), gaps));
    const bool regular = uneven == 0;
    if (!regular)
      out.notes.push_back(
          fmt::format("{}: time_s is not equidistant ({} of {} steps differ from {:.4g} s); resampled at that period",
                      rec.file.string(), uneven, steps.size(), typical));
    double used_s = 0;
    for (const Stretch& s : stretches) {
      const double length = time[s.last] - time[s.first];
      if (length < 1 || s.last - s.first < 20) continue;
      used_s += length;
      const double period = regular ? length / static_cast<double>(s.last - s.first) : typical, rate = 1 / period;
      const double cutoff = preparation.cutoff_hz > 0 ? preparation.cutoff_hz : std::min(20.0, rate / 5);
      if (cutoff > 0.45 * rate)
        return tl::unexpected(
            fmt::format("{}: is sampled at {:.4g} Hz; the cut-off must be below {:.4g} Hz, it is {:g}",
                        rec.file.string(), rate, 0.45 * rate, cutoff));
      const Index every = preparation.decimation
                              ? preparation.decimation
                              : std::max<Index>(1, static_cast<Index>(std::floor(rate / (5 * cutoff) + 1e-6)));
      if (out.period_s == 0) out.period_s = period * static_cast<double>(every), out.cutoff_hz = cutoff;
      // What the filter made of the ends, and of a central difference's first and last sample, is left out.
      const auto edge = static_cast<Index>(std::ceil(0.5 * rate / cutoff)) + 1;
      Part part{.file = f,
                .edge_s = static_cast<double>(edge) * period,
                .guard = static_cast<Index>(std::ceil(ringing * rate / cutoff / static_cast<double>(every)))};
      Index count = 0;
      for (Index j = 0; j < n; ++j) {
        const auto q = low_passed(equidistant(rec, rec.position, j, s, period, regular), rate, cutoff);
        const auto torque = low_passed(equidistant(rec, rec.torque, j, s, period, regular), rate, cutoff);
        const auto temperature = out.has_temperature ? equidistant(rec, rec.temperature_degC, j, s, period, regular)
                                                     : std::vector<double>(q.size(), 20.0);
        if (j == 0) {
          count = (static_cast<Index>(q.size()) - 2 * edge + every - 1) / every;
          if (count < 1) break;
          for (auto* m : {&part.q, &part.qd, &part.qdd, &part.torque, &part.temperature}) m->resize(n, count);
          for (Index k = 0; k < count; ++k)
            part.time.push_back(time[s.first] + static_cast<double>(edge + k * every) * period);
        }
        for (Index k = 0; k < count; ++k) {
          const auto i = static_cast<std::size_t>(edge + k * every);
          part.q(j, k) = q[i];
          part.qd(j, k) = (q[i + 1] - q[i - 1]) * rate / 2;
          part.qdd(j, k) = (q[i + 1] - 2 * q[i] + q[i - 1]) * rate * rate;
          part.torque(j, k) = torque[i];
          part.temperature(j, k) = temperature[i];
        }
      }
      if (count >= 1) parts.push_back(std::move(part));
    }
    if (used_s == 0)
      return tl::unexpected(
          fmt::format("{}: no stretch of a second with regular time_s (typical step {:.4g} s, {} gaps)",
                      rec.file.string(), typical, gaps));
  }
  Index total = 0;
  for (const Part& p : parts) total += p.q.cols();
  for (auto* m : {&out.q, &out.qd, &out.qdd, &out.torque, &out.temperature_degC}) m->resize(n, total);
  out.moving.setConstant(n, total, false);
  VectorXd fastest = VectorXd::Zero(n);
  for (const Part& p : parts) fastest = fastest.cwiseMax(p.qd.cwiseAbs().rowwise().maxCoeff());
  for (Index j = 0; j < n; ++j)
    if (fastest(j) < 1e-2)
      return tl::unexpected(fmt::format(
          "joint {} stands in all recordings (it never exceeds {:.2g} {}/s); move every joint, or weld it in the model",
          r.joint_name(j), fastest(j), r.is_slide(j) ? "m" : "rad"));
  Index at = 0;
  for (Part& p : parts) {
    const Index count = p.q.cols();
    out.segments.emplace_back(at, at + count);
    out.file.push_back(p.file);
    out.edge_s.push_back(p.edge_s);
    out.time_s.insert(out.time_s.end(), p.time.begin(), p.time.end());
    out.q.middleCols(at, count) = p.q, out.qd.middleCols(at, count) = p.qd, out.qdd.middleCols(at, count) = p.qdd;
    out.torque.middleCols(at, count) = p.torque, out.temperature_degC.middleCols(at, count) = p.temperature;
    for (Index j = 0; j < n; ++j) {
      // Samples since the last slow one, and to the next; before the first and after the last nothing is known to be
      // near.
      const auto slow_at = [&](Index k) { return std::abs(p.qd(j, k)) < slow * fastest(j); };
      Index since = p.guard;
      for (Index k = 0; k < count; ++k) {
        since = slow_at(k) ? 0 : since + 1;
        out.moving(j, at + k) = since > p.guard;
      }
      since = p.guard;
      for (Index k = count; k-- > 0;) {
        since = slow_at(k) ? 0 : since + 1;
        out.moving(j, at + k) = out.moving(j, at + k) && since > p.guard;
      }
    }
    at += count;
  }
  return out;
}

}  // namespace tribotwin::twin::identification
