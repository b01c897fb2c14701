#include <algorithm>
#include <cmath>
#include <mutex>
#include <sstream>
#include <thread>

#include <Eigen/Dense>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pugixml.hpp>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/mujoco/source.hpp>
#include <tribotwin/twin/identification/by_simulation.hpp>
#include <tribotwin/twin/numerics/cma_es.hpp>

namespace tribotwin::twin::identification {
namespace {

namespace fs = std::filesystem;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN(),
                 impossible = std::numeric_limits<double>::infinity();

struct Key {
  Place place;
  std::string_view name;
  double minimum, maximum;
  double DcPositionOptions::*option = nullptr;
};
constexpr Key keys[] = {
    {Place::joint, "armature", 0, 1e9},
    {Place::joint, "damping", 0, 1e9},
    {Place::joint, "ref", -1e3, 1e3},
    {Place::control, "kp", 0, 1e9, &DcPositionOptions::kp},
    {Place::control, "error_gain", 0, 1e9, &DcPositionOptions::error_gain},
    {Place::control, "supply_V", 0, 1e6, &DcPositionOptions::supply_V},
    {Place::control, "resistance_ohm", 1e-9, 1e9, &DcPositionOptions::resistance_ohm},
    {Place::control, "supply_resistance_ohm", 0, 1e9, &DcPositionOptions::supply_resistance_ohm},
    {Place::control, "kt_nm_A", 0, 1e6, &DcPositionOptions::kt_nm_A},
    {Place::control, "torque_limit_nm", 0, 1e9, &DcPositionOptions::torque_limit_nm},
    {Place::motion, "delay_s", 0, 10},
};

const Key* find_key(Place place, std::string_view name) {
  const auto found = std::ranges::find_if(keys, [&](const Key& k) { return k.place == place && k.name == name; });
  return found == std::end(keys) ? nullptr : found;
}

bool is_law_parameter(std::string_view key) {
  return std::ranges::any_of(friction::laws(), [&](const auto& law) {
    return std::ranges::find(law.parameters, key, &friction::Parameter::name) != law.parameters.end();
  });
}

std::string text_of(const pugi::xml_document& document) {
  std::ostringstream text;
  document.save(text, "  ");
  return text.str();
}

void absolute_folders(pugi::xml_node root, const fs::path& folder) {
  for (const char* attribute : {"meshdir", "texturedir"}) {
    std::string given;
    for (pugi::xml_node compiler : root.children("compiler")) {
      if (compiler.attribute(attribute)) given = compiler.attribute(attribute).value();
      compiler.remove_attribute(attribute);
    }
    if (!given.empty() || root.select_node("//asset//*[@file]"))
      root.append_child("compiler").append_attribute(attribute) =
          (fs::absolute(folder) / given).lexically_normal().c_str();
  }
}

/// The engine's XML compiler keeps process-wide state.
std::mutex compiler;

double mean_error(Norm norm, const Recording& recording, std::span<const double> positions) {
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const double e = positions[i] - recording.points.measured_rad[i];
    if (!std::isfinite(e)) continue;
    sum += norm == Norm::squared ? e * e : std::abs(e);
    ++count;
  }
  return sum / static_cast<double>(count);
}

}  // namespace

std::string_view name(Place place) {
  static constexpr std::string_view names[] = {"drive", "joint", "control", "motion"};
  return names[static_cast<std::size_t>(place)];
}

std::string_view name(ParameterStatus knowledge) {
  static constexpr std::string_view names[] = {"known", "estimated", "prior", "at_bound"};
  return names[static_cast<std::size_t>(knowledge)];
}

std::vector<std::string_view> keys_of(Place place, const friction::LawInfo& law) {
  std::vector<std::string_view> all;
  if (place == Place::drive) {
    for (const auto& p : law.parameters) all.push_back(p.name);
    for (const char* key : drive::all_keys())
      if (!is_law_parameter(key) && std::string_view(key) != "law" && std::string_view(key) != "thermal" &&
          std::string_view(key) != "validity")
        all.emplace_back(key);
  }
  for (const Key& key : keys)
    if (key.place == place) all.push_back(key.name);
  return all;
}

std::pair<double, double> accepted_range(Place place, const friction::LawInfo& law, std::string_view key) {
  if (const Key* known = find_key(place, key)) return {known->minimum, known->maximum};
  const auto p = std::ranges::find(law.parameters, key, &friction::Parameter::name);
  return p != law.parameters.end() ? std::pair{p->minimum, p->maximum} : std::pair{-1e300, 1e300};
}

std::string Quantity::path() const { return fmt::format("{}.{}", name(place), key); }

double Quantity::scale() const {
  if (sigma > 0) return sigma;
  return (logarithmic ? std::log(high / low) : high - low) / 6;  // the bounds as three sigma either way
}

double Quantity::value(double z) const {
  if (!sought) return start;
  return std::clamp(logarithmic ? start * std::exp(scale() * z) : start + scale() * z, low, high);
}

double Quantity::coordinate(double value) const {
  return (logarithmic ? std::log(value / start) : value - start) / scale();
}

std::vector<std::size_t> VariantTwins::sought() const {
  std::vector<std::size_t> all;
  for (std::size_t i = 0; i < variant_->quantities.size(); ++i)
    if (variant_->quantities[i].sought) all.push_back(i);
  return all;
}

std::string VariantTwins::edited(const std::string& text, std::span<const double> values) const {
  pugi::xml_document document;
  document.load_string(text.c_str());
  const pugi::xml_node actuator = document.select_node("//actuator/plugin[@plugin='tribotwin.drive']").node();
  const auto named = [&](const char* path, const char* attribute) {
    for (const auto& match : document.select_nodes(path))
      if (std::string_view(match.node().attribute("name").value()) == actuator.attribute(attribute).value())
        return match.node();
    return pugi::xml_node();
  };
  pugi::xml_node instance = named("//extension/plugin[@plugin='tribotwin.drive']/instance", "instance"),
                 joint = named("//worldbody//joint", "joint");
  const auto config = [&](std::string_view key) {
    for (pugi::xml_node c : instance.children("config"))
      if (c.attribute("key").value() == key) return c;
    return pugi::xml_node();
  };
  const auto set = [&](std::string_view key, const std::string& value) {
    pugi::xml_node c = config(key);
    if (!c) {
      c = instance.append_child("config");
      c.append_attribute("key") = std::string(key).c_str();
      c.append_attribute("value");
    }
    c.attribute("value") = value.c_str();
  };
  if (config("law").attribute("value").value() != variant_->law->name) {
    std::vector<pugi::xml_node> old;
    for (pugi::xml_node c : instance.children("config"))
      if (is_law_parameter(c.attribute("key").value())) old.push_back(c);
    for (const pugi::xml_node c : old) instance.remove_child(c);
    set("law", std::string(variant_->law->name));
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Quantity& q = variant_->quantities[i];
    const std::string value = fmt::format("{}", values[i]);
    if (q.place == Place::drive) set(q.key, value);
    if (q.place != Place::joint) continue;
    if (!joint.attribute(q.key.c_str())) joint.append_attribute(q.key.c_str());
    joint.attribute(q.key.c_str()) = value.c_str();
  }
  return text_of(document);
}

Result<std::shared_ptr<const mujoco::Model>> VariantTwins::load(const std::string& text,
                                                                std::span<const double> values) const {
  const std::string mjcf = edited(text, values);
  const std::lock_guard lock(compiler);
  return mujoco::load_string(mjcf, {.timestep_s = variant_->timestep_s});
}

Result<VariantTwins> VariantTwins::open(const Variant& variant) {
  VariantTwins twins;
  twins.variant_ = std::make_shared<const Variant>(variant);
  const auto given = mujoco::load_file(variant.model);
  if (!given) return tl::unexpected("model: " + given.error().message);
  if ((*given)->drives().size() != 1)
    return tl::unexpected(fmt::format("model: {} has {} drives, but a recording of one joint needs exactly 1",
                                      variant.model.string(), (*given)->drives().size()));
  const auto document = mujoco::load_merged(variant.model);
  if (!document) return tl::unexpected("model: " + document.error().message);
  const fs::path folder = variant.model.has_parent_path() ? variant.model.parent_path() : fs::path(".");
  absolute_folders((*document)->document_element(), folder);
  twins.text_ = text_of(**document);

  std::vector<double> values;
  for (const auto& q : variant.quantities) values.push_back(q.start);
  auto reference = twins.load(twins.text_, values);
  if (!reference) return tl::unexpected("with the start values: " + reference.error().message);
  twins.reference_ = *reference;
  twins.try_without_scenery();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Quantity& q = variant.quantities[i];
    if (!q.sought || (q.place != Place::drive && q.place != Place::joint)) continue;
    for (const double bound : {q.low, q.high}) {
      auto edge = values;
      edge[i] = bound;
      if (const auto model = twins.load(twins.lean_, edge); !model)
        return tl::unexpected(fmt::format("{}: its bound {:g} is refused: {}", q.path(), bound, model.error().message));
    }
  }
  return twins;
}

/// Geometry that is only seen costs more than half of a small model's step. It goes where that changes no bit: the
/// masses it stood for stay.
void VariantTwins::try_without_scenery() {
  lean_ = text_;
  pugi::xml_document document;
  document.load_string(text_.c_str());
  const mujoco::Model& m = *reference_;
  int id = 0;
  for (const auto& match : document.select_nodes("//worldbody//body")) {
    if (++id >= m->nbody) return;
    pugi::xml_node body = match.node();
    if (body.child("inertial") || m->body_mass[id] == 0) continue;
    pugi::xml_node inertial = body.prepend_child("inertial");
    const auto give = [&](const char* attribute, const mjtNum* first, int count) {
      inertial.append_attribute(attribute) = fmt::format("{}", fmt::join(first, first + count, " ")).c_str();
    };
    give("mass", m->body_mass + id, 1);
    give("pos", m->body_ipos + 3 * id, 3);
    give("quat", m->body_iquat + 4 * id, 4);
    give("diaginertia", m->body_inertia + 3 * id, 3);
  }
  for (const char* path :
       {"//worldbody//geom", "//worldbody//site", "//worldbody//light", "//worldbody//camera", "//asset", "//visual"})
    for (const auto& match : document.select_nodes(path)) match.node().parent().remove_child(match.node());
  for (const auto& match : document.select_nodes("//@material")) match.parent().remove_attribute(match.attribute());
  const std::string stripped = text_of(document);
  std::vector<double> values;
  for (const auto& q : variant_->quantities) values.push_back(q.start);
  const auto lean = load(stripped, values);
  if (!lean || (**lean)->nv != (*reference_)->nv || (**lean)->nbody != (*reference_)->nbody) return;
  const mujoco::DataPtr a = reference_->make_data(), b = (*lean)->make_data();
  // A whole turn each way: were something to touch, or to weigh, the trajectories would part.
  const auto& drive = reference_->drives()[0];
  for (int k = 0; k < 4000; ++k) {
    for (const auto& d : {a.get(), b.get()})
      d->ctrl[drive.control] = (k / 1000 % 2 ? -0.5 : 0.5) * drive.drive.torque_max_nm / drive.gear;
    reference_->step(a.get());
    (*lean)->step(b.get());
    if (!std::equal(a->qpos, a->qpos + (**lean)->nq, b->qpos) || a->ncon != 0) return;
  }
  lean_ = stripped;
}

std::string VariantTwins::mjcf(std::span<const double> values) const { return edited(text_, values); }

Result<VariantTwins::Candidate> VariantTwins::candidate(std::vector<double> values) const {
  auto model = load(lean_, values);
  if (!model) return tl::unexpected(model.error());
  return Candidate{std::move(*model), std::move(values)};
}

DcPositionOptions VariantTwins::control(std::span<const double> values, const Recording& recording) const {
  DcPositionOptions o;
  for (const auto& [key, value] : recording.points.numbers)
    if (key == "kp") o.kp = value;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (const Key* key = find_key(variant_->quantities[i].place, variant_->quantities[i].key); key && key->option)
      o.*key->option = values[i];
  for (const auto& [key, value] : recording.control) o.*find_key(Place::control, key)->option = value;
  return o;
}

double VariantTwins::delay_s(std::span<const double> values) const {
  for (std::size_t i = 0; i < values.size(); ++i)
    if (variant_->quantities[i].place == Place::motion) return values[i];
  return 0;
}

Result<std::vector<double>> VariantTwins::positions(const Candidate& candidate, const Recording& recording) const {
  const SetPoints& r = recording.points;
  Scenario scenario;
  scenario.model = candidate.model;
  scenario.duration_s = recording.duration_s();
  scenario.start_rad = {r.measured_rad[0]};
  const double recorded = r.temperature_degC[0];
  scenario.temperature_degC = {recording.temperature_degC.value_or(
      std::isfinite(recorded) ? recorded : candidate.model->drives()[0].drive.thermal.T_amb_degC)};
  scenario.control = control(candidate.values, recording);
  scenario.motion.emplace(scenario.start_rad);
  const double delay = delay_s(candidate.values);
  for (std::size_t i = 0; i < r.time_s.size(); ++i)
    scenario.motion->hold_at(r.time_s[i] - r.time_s[0] + delay, {r.position_rad[0][i]});
  scenario.recording = SetPoints{.time_s = r.time_s, .torque_on = r.torque_on};

  Twin twin(std::move(scenario));
  const int address = position_address(twin.model().get(), twin.model().drives()[0]);
  std::vector<double> positions(r.time_s.size(), unknown);
  std::size_t next = 0;
  while (twin.steps() < twin.steps_total()) {
    for (; next < r.time_s.size() && r.time_s[next] - r.time_s[0] <= twin.time_s() + 1e-12; ++next)
      positions[next] = twin.data()->qpos[address];
    if (const auto ok = twin.step(); !ok) return tl::unexpected(ok.error());
  }
  return positions;
}

double mae_mrad(const Recording& recording, std::span<const double> positions) {
  return 1e3 * mean_error(Norm::absolute, recording, positions);
}

namespace {

struct Interrupted {};

/// Counts simulations for the progress line.
class Counter {
 public:
  Counter(const Watch& watch, double total) : watch_(watch), total_(total) {}
  /// Throws when the user wants to stop.
  void add(double simulations) {
    if (watch_.stop && *watch_.stop) throw Interrupted{};
    if (!watch_.progress) return;
    const std::lock_guard lock(mutex_);
    done_ += simulations;
    watch_.progress(std::min(1.0, done_ / total_));
  }

 private:
  const Watch& watch_;
  double total_, done_ = 0;
  std::mutex mutex_;
};

/// n ln(error) + 1/2 sum z^2 over the sought quantities; infinite where the twin is refused or diverges.
class Posterior {
 public:
  Posterior(const VariantTwins& twins, const std::vector<Recording>& recordings, std::vector<std::size_t> learn,
            const SearchOptions& options, Counter& counter)
      : twins_(twins),
        recordings_(recordings),
        learn_(std::move(learn)),
        options_(options),
        counter_(counter),
        sought_(twins.sought()) {
    for (const std::size_t i : learn_)
      independent_ += std::max(1.0, recordings_[i].duration_s() / options.correlation_s);
  }

  Index size() const { return static_cast<Index>(sought_.size()); }
  double independent() const { return independent_; }
  const Quantity& quantity(Index i) const { return twins_.variant().quantities[sought_[static_cast<std::size_t>(i)]]; }

  std::vector<double> values(const VectorXd& z) const {
    std::vector<double> all;
    for (const auto& q : twins_.variant().quantities) all.push_back(q.start);
    for (Index i = 0; i < size(); ++i) all[sought_[static_cast<std::size_t>(i)]] = quantity(i).value(z(i));
    return all;
  }

  /// Error of all recordings to learn from: mean square [rad^2] or mean absolute [rad].
  double error(const VectorXd& z) const {
    const auto candidate = twins_.candidate(values(z));
    counter_.add(static_cast<double>(learn_.size()));
    if (!candidate) return impossible;
    double sum = 0;
    for (const std::size_t i : learn_) {
      const auto positions = twins_.positions(*candidate, recordings_[i]);
      if (!positions) return impossible;
      sum += mean_error(options_.norm, recordings_[i], *positions);
    }
    return sum / static_cast<double>(learn_.size());
  }

  double operator()(const VectorXd& z) const {
    const double e = error(z);
    return e == impossible
               ? impossible
               : independent_ * (options_.norm == Norm::squared ? 0.5 : 1.0) * std::log(std::max(e, 1e-30)) + prior(z);
  }

  /// J^T J of the positions over their mean square error, every recording weighing the same.
  MatrixXd information(const VectorXd& z, double step) const {
    MatrixXd total = MatrixXd::Zero(size(), size());
    const double mean_square = [&] {
      double sum = 0;
      const auto candidate = twins_.candidate(values(z));
      if (!candidate) return impossible;
      for (const std::size_t i : learn_) {
        const auto positions = twins_.positions(*candidate, recordings_[i]);
        sum += positions ? mean_error(Norm::squared, recordings_[i], *positions) : impossible;
      }
      return sum / static_cast<double>(learn_.size());
    }();
    std::vector<std::pair<Result<VariantTwins::Candidate>, Result<VariantTwins::Candidate>>> moved;
    for (Index j = 0; j < size(); ++j) {
      VectorXd up = z, down = z;
      up(j) += step, down(j) -= step;
      moved.emplace_back(twins_.candidate(values(up)), twins_.candidate(values(down)));
    }
    for (const std::size_t i : learn_) {
      counter_.add(2 * static_cast<double>(size()));
      const auto count = static_cast<Index>(recordings_[i].points.time_s.size());
      MatrixXd J = MatrixXd::Zero(count, size());
      for (Index j = 0; j < size(); ++j) {
        const auto& [high, low] = moved[static_cast<std::size_t>(j)];
        if (!high || !low) continue;
        const auto up = twins_.positions(*high, recordings_[i]), down = twins_.positions(*low, recordings_[i]);
        if (!up || !down) continue;
        for (Index k = 0; k < count; ++k) {
          const double d = ((*up)[static_cast<std::size_t>(k)] - (*down)[static_cast<std::size_t>(k)]) / (2 * step);
          if (std::isfinite(d)) J(k, j) = d;
        }
      }
      total += J.transpose() * J / static_cast<double>(count);
    }
    return total * (independent_ / (mean_square * static_cast<double>(learn_.size())));
  }

 private:
  double prior(const VectorXd& z) const {
    double sum = 0;
    for (Index i = 0; i < size(); ++i) {
      const Quantity& q = quantity(i);
      const double held = std::clamp(z(i), q.coordinate(q.low), q.coordinate(q.high)), beyond = z(i) - held;
      sum += (q.sigma > 0 ? 0.5 * held * held : 0) +
             10 * beyond * beyond;  // leads back to where the value still follows z
    }
    return sum;
  }

  const VariantTwins& twins_;
  const std::vector<Recording>& recordings_;
  const std::vector<std::size_t> learn_;
  const SearchOptions& options_;
  Counter& counter_;
  const std::vector<std::size_t> sought_;
  double independent_ = 0;
};

Minimum descend(const Posterior& posterior, int start, const SearchOptions& options, Counter& counter,
                double simulations_each) {
  const Index n = posterior.size();
  Gaussian gaussian(options.seed * 1000003 + static_cast<std::uint64_t>(start));
  const VectorXd mean = start == 0 ? VectorXd(VectorXd::Zero(n)) : VectorXd(0.5 * gaussian(n));
  const Minimum best =
      cma_es([&](const VectorXd& z) { return posterior(z); }, mean, {.evaluations = options.evaluations}, gaussian);
  if (n > 0) counter.add((options.evaluations - best.evaluations) * simulations_each);
  return best;
}

/// Sigmas from the curvature at the minimum: likelihood by Gauss-Newton plus prior.
void judge(const Posterior& posterior, const VectorXd& z, const std::vector<std::size_t>& sought, SimulationFit& fit) {
  constexpr double step = 0.1;
  MatrixXd H = posterior.information(z, step);
  std::vector<Index> open;
  for (Index i = 0; i < posterior.size(); ++i) {
    const Quantity& q = posterior.quantity(i);
    if (z(i) > q.coordinate(q.low) + 1e-6 && z(i) < q.coordinate(q.high) - 1e-6)
      open.push_back(i);
    else
      fit.knowledge[sought[static_cast<std::size_t>(i)]] = ParameterStatus::at_bound;
    if (q.sigma > 0) H(i, i) += 1;
  }
  const MatrixXd covariance = MatrixXd(H(open, open)).completeOrthogonalDecomposition().pseudoInverse();
  for (std::size_t k = 0; k < open.size(); ++k) {
    const Quantity& q = posterior.quantity(open[k]);
    const std::size_t at = sought[static_cast<std::size_t>(open[k])];
    const double deviation = std::sqrt(std::max(0.0, covariance(static_cast<Index>(k), static_cast<Index>(k))));
    fit.knowledge[at] = q.sigma > 0 && deviation > 0.8 ? ParameterStatus::prior : ParameterStatus::estimated;
    fit.sigma[at] = deviation * q.scale() * (q.logarithmic ? fit.values[at] : 1);
    for (std::size_t l = 0; l < open.size(); ++l) {
      const auto a = static_cast<Index>(k), b = static_cast<Index>(l);
      fit.correlation(static_cast<Index>(at), static_cast<Index>(sought[static_cast<std::size_t>(open[l])])) =
          covariance(a, b) / std::sqrt(covariance(a, a) * covariance(b, b));
    }
  }
}

}  // namespace

Result<void> calibrate(const Plan& plan, const std::vector<SimulationFit>& have, const Watch& watch) {
  struct Job {
    SimulationFit fit;
    std::vector<std::size_t> learn;
    std::vector<Minimum> minima;
    int open = 0;
  };
  std::vector<VariantTwins> twins;
  for (const auto& variant : plan.variants) {
    auto opened = VariantTwins::open(variant);
    if (!opened) return tl::unexpected(fmt::format("variant '{}': {}", variant.label, opened.error().message));
    twins.push_back(std::move(*opened));
  }
  std::vector<Job> jobs;
  double total = 0;
  const auto add = [&](std::size_t variant, std::size_t split, std::size_t fold,
                       const std::vector<std::size_t>& held_out) {
    if (std::ranges::any_of(
            have, [&](const SimulationFit& f) { return f.variant == variant && f.split == split && f.fold == fold; }))
      return;
    Job& job = jobs.emplace_back();
    job.fit.variant = variant, job.fit.split = split, job.fit.fold = fold;
    for (std::size_t i = 0; i < plan.recordings.size(); ++i)
      if (std::ranges::find(held_out, i) == held_out.end()) job.learn.push_back(i);
    job.minima.resize(static_cast<std::size_t>(plan.search.starts));
    job.open = plan.search.starts;
    total += static_cast<double>(job.learn.size()) * plan.search.evaluations * plan.search.starts;
    if (split == SimulationFit::all)
      total += 2 * static_cast<double>(job.learn.size() * twins[variant].sought().size());
  };
  for (std::size_t v = 0; v < plan.variants.size(); ++v) {
    add(v, SimulationFit::all, 0, {});
    for (std::size_t s = 0; s < plan.splits.size(); ++s)
      for (std::size_t f = 0; f < plan.splits[s].folds.size(); ++f) add(v, s, f, plan.splits[s].folds[f].held_out);
  }

  Counter counter(watch, total);
  std::mutex mutex;
  std::atomic<std::size_t> next = 0;
  std::atomic<bool> gave_up = false;
  std::string failure;
  const auto finish = [&](Job& job) {
    const VariantTwins& t = twins[job.fit.variant];
    const Posterior posterior(t, plan.recordings, job.learn, plan.search, counter);
    const Minimum& best = *std::ranges::min_element(job.minima, {}, &Minimum::objective);
    const auto fail = [&](const std::string& why) {
      throw std::runtime_error(fmt::format("variant '{}': {}", plan.variants[job.fit.variant].label, why));
    };
    if (!std::isfinite(best.objective)) fail("every twin tried was refused or diverged");
    SimulationFit& fit = job.fit;
    fit.values = posterior.values(best.z);
    fit.objective = best.objective;
    for (const Minimum& m : job.minima) fit.minima.push_back(m.objective);
    fit.sigma.assign(fit.values.size(), unknown);
    fit.knowledge.assign(fit.values.size(), ParameterStatus::known);
    fit.correlation = MatrixXd::Constant(std::ssize(fit.values), std::ssize(fit.values), unknown);
    const auto sought = t.sought();
    for (const std::size_t i : sought) fit.knowledge[i] = ParameterStatus::estimated;
    const auto candidate = t.candidate(fit.values);
    if (!candidate) fail(candidate.error().message);
    for (const auto& recording : plan.recordings) {
      const auto positions = t.positions(*candidate, recording);
      if (!positions) fail(fmt::format("{}: {}", recording.file.filename().string(), positions.error().message));
      fit.mae_mrad.push_back(mae_mrad(recording, *positions));
    }
    if (fit.split == SimulationFit::all) judge(posterior, best.z, sought, fit);
    const std::lock_guard lock(mutex);
    if (watch.done) watch.done(fit);
  };
  const auto work = [&] {
    const auto starts = static_cast<std::size_t>(plan.search.starts);
    try {
      for (std::size_t task; (task = next++) < jobs.size() * starts && !gave_up;) {
        Job& job = jobs[task / starts];
        const Posterior posterior(twins[job.fit.variant], plan.recordings, job.learn, plan.search, counter);
        job.minima[task % starts] = descend(posterior, static_cast<int>(task % starts), plan.search, counter,
                                            static_cast<double>(job.learn.size()));
        const bool last = [&] {
          const std::lock_guard lock(mutex);
          return --job.open == 0;
        }();
        if (last) finish(job);
      }
    } catch (const Interrupted&) {
      gave_up = true;
    } catch (const std::exception& e) {
      gave_up = true;
      const std::lock_guard lock(mutex);
      if (failure.empty()) failure = e.what();
    }
  };
  {
    std::vector<std::jthread> workers;
    for (unsigned i = 1; i < watch.threads; ++i) workers.emplace_back(work);
    work();
  }
  if (!failure.empty()) return tl::unexpected(failure);
  return {};
}

}  // namespace tribotwin::twin::identification
