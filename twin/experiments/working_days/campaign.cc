#include <algorithm>
#include <random>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/experiments/working_days/campaign.hpp>

namespace tribotwin::twin::repeatability {
namespace {

constexpr const char* procedure = "working_days";
enum Purpose : std::uint64_t { of_friction = 1, of_inertia = 2, of_ambient = 3 };

Fault read_fault(Mapping in, const Campaign& c) {
  in.accept({"robot", "day", "time_s", "joint", "factors"});
  Fault f{.robot = in.whole("robot", {1, static_cast<double>(c.robots)}) - 1,
          .day = in.whole("day", {1, static_cast<double>(c.days)}) - 1,
          .time_s = in.number("time_s", {0, c.duration_s}),
          .wear = {}};
  f.wear = read_wear(in, *c.model);
  in.done();
  return f;
}

/// The model; resolves its path in `root`.
void read_model(Mapping& in, const std::filesystem::path& file, YAML::Node root, Campaign& c) {
  const auto path = in.file("model", std::filesystem::absolute(file).parent_path());
  root["model"] = path.string();
  const auto model = mujoco::load_file(path);
  if (!model) throw InputError(model.error().message);
  c.model = *model;
  if (static_cast<std::size_t>((*c.model)->nv) != c.model->drives().size())
    in.fail("model", "has joints without a tribotwin.drive");
  for (const auto& binding : c.model->drives()) {
    if (binding.drive.law.info != &law_of_days())
      in.fail("model",
              fmt::format("has the law '{}' in {}; working days need '{}', Pagani's", binding.drive.law.info->name,
                          joint_name(c.model->get(), binding), law_of_days().name));
    if (binding.drive.thermal.order == thermal::Order::prescribed)
      in.fail("model", fmt::format("has no thermal model in {}", joint_name(c.model->get(), binding)));
  }
}

void read_scatter(Mapping& in, Campaign& c) {
  if (auto ambient = in.mapping("ambient")) {
    ambient->accept({"mean_degC", "std_K"});
    c.ambient_degC = ambient->number_or("mean_degC", c.ambient_degC, {-40, 60});
    c.ambient_std_K = ambient->number_or("std_K", 0, {0, 10});
  }
  if (auto scatter = in.mapping("scatter")) {
    scatter->accept({"friction", "inertia"});
    c.friction_scatter = scatter->number_or("friction", 0, {0, 0.3});
    c.inertia_scatter = scatter->number_or("inertia", 0, {0, 0.3});
  }
  if (auto sensors = in.mapping("sensors")) {
    sensors->accept({"encoder_increments_per_turn", "torque_noise_share", "sampling_hz"});
    c.encoder_increments_per_turn = sensors->number_or("encoder_increments_per_turn", 0, {0, 1e12});
    c.torque_noise_share = sensors->number_or("torque_noise_share", 0, {0, 1});
    c.sampling_hz = sensors->number_or("sampling_hz", c.sampling_hz, {50, 1000});
  }
}

void read_excitation(Mapping& in, Campaign& c) {
  c.excitation.seed = c.seed;
  auto excitation = in.mapping("excitation");
  if (!excitation) return;
  excitation->accept({"share", "evaluations", "heating_s"});
  c.excitation.share = excitation->number_or("share", c.excitation.share, {0.01, 1});
  c.excitation.evaluations = static_cast<int>(
      excitation->whole_or("evaluations", static_cast<std::size_t>(c.excitation.evaluations), {10, 1e7}));
  c.excitation.heating_s = excitation->number_or("heating_s", c.excitation.heating_s, {10, 3600});
}

}  // namespace

bool is_repeatability(const YAML::Node& root) {
  return root.IsMap() && root["procedure"] && root["procedure"].IsScalar() && root["procedure"].Scalar() == procedure;
}

const friction::LawInfo& law_of_days() {
  static const friction::LawInfo& law = *friction::find_law("polynomial");
  return law;
}

Result<Campaign> load_campaign(const std::filesystem::path& file, YAML::Node root) try {
  Campaign c;
  c.file = file;
  Mapping in(file.string(), "", root);
  in.accept({"name", "description", "procedure", "model", "robots", "days", "duration_s", "ambient", "scatter",
             "sensors", "excitation", "faults", "seed"});
  in.choice("procedure", {procedure});
  c.name = in.file_name_or("name", file.stem().string());
  root["name"] = c.name;
  c.description = in.text_or("description", "");
  c.seed = in.whole_or("seed", 1, {0, 9007199254740992.0});
  read_model(in, file, root, c);
  c.robots = in.whole_or("robots", 2, {1, 20});
  c.days = in.whole_or("days", 4, {1, 50});
  c.duration_s = in.number_or("duration_s", c.duration_s, {60, 1e5});
  read_scatter(in, c);
  read_excitation(in, c);
  for (Mapping fault : in.mappings("faults")) c.faults.push_back(read_fault(std::move(fault), c));
  in.done();
  c.resolved_yaml = resolved_yaml(*c.model, root);
  return c;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

std::uint64_t seed_for(const Campaign& campaign, std::uint64_t purpose, std::uint64_t number) {
  std::seed_seq sequence{static_cast<std::uint32_t>(campaign.seed), static_cast<std::uint32_t>(campaign.seed >> 32),
                         static_cast<std::uint32_t>(purpose), static_cast<std::uint32_t>(number)};
  return std::mt19937_64(sequence)();
}

Result<Individual> individual(const Campaign& campaign, std::size_t robot) {
  Individual out;
  std::mt19937_64 random(seed_for(campaign, of_friction, robot));
  // At most three standard deviations: factors stay positive.
  const auto factor = [&](double scatter) {
    return 1 + scatter * std::clamp(std::normal_distribution<double>()(random), -3.0, 3.0);
  };
  for (std::size_t i = 0; i < campaign.model->drives().size(); ++i)
    out.friction.push_back(factor(campaign.friction_scatter));
  random.seed(seed_for(campaign, of_inertia, robot));
  auto model = mujoco::variant(*campaign.model, [&](mjModel* m) {
    for (int body = 1; body < m->nbody; ++body) {
      const double by = factor(campaign.inertia_scatter);
      m->body_mass[body] *= by;
      for (int i = 0; i < 3; ++i) m->body_inertia[3 * body + i] *= by;
    }
    for (int dof = 0; dof < m->nv; ++dof) m->dof_armature[dof] *= factor(campaign.inertia_scatter);
  });
  if (!model) return tl::unexpected(model.error());
  out.model = *model;
  return out;
}

std::filesystem::path file_of(const Campaign& campaign, std::size_t test) {
  return std::filesystem::path("tests") /
         fmt::format("robot{}_day{}.json", campaign.robot_of(test) + 1, campaign.day_of(test) + 1);
}

double ambient_degC(const Campaign& campaign, std::size_t day) {
  std::mt19937_64 random(seed_for(campaign, of_ambient, day));
  return campaign.ambient_degC + campaign.ambient_std_K * std::normal_distribution<double>()(random);
}

}  // namespace tribotwin::twin::repeatability
