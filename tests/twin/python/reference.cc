// What C++ computes, for comparison with the Python module, bit by bit. Arguments: what, then its own; doubles come
// from stdin and go to stdout.
//   law NAME=VALUE... (law=NAME first)   rows of speed, load, temperature; of each the scalar law, then all of the
//   batch
//   slide DT KEY=VALUE...                rows of speed, load; of each friction, temperature, winding temperature,
//   current fault:NAME=SEVERITY among the keys   a fault of the drive twin SCENARIO N KEY=VALUE...         torques per
//   joint; N steps, of each position, friction, temperature per joint time N REPEATS                       seconds of
//   each evaluation of the batch at N random states, for the benchmark scenario SCENARIO KEY=VALUE...       the
//   scenario to its end; the same of the last step
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>
#include <vector>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/plugins/drive/slide.hpp>
#include <tribotwin/plugins/friction/batch.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

namespace {

using namespace tribotwin;
using Settings = std::vector<std::pair<std::string, std::string>>;

template <class T>
T need(Result<T> value) {
  if (!value) std::fprintf(stderr, "%s\n", value.error().message.c_str()), std::exit(2);
  return std::move(*value);
}

Settings settings_of(int argc, char** argv, int from) {
  Settings all;
  for (int i = from; i < argc; ++i) {
    const std::string text = argv[i];
    all.emplace_back(text.substr(0, text.find('=')), text.substr(text.find('=') + 1));
  }
  return all;
}

std::vector<double> input() {
  std::vector<double> all;
  for (double x; std::fread(&x, sizeof x, 1, stdin) == 1;) all.push_back(x);
  return all;
}
void put(double x) { std::fwrite(&x, sizeof x, 1, stdout); }

int law(const Settings& settings) {
  std::vector<std::pair<std::string, double>> parameters;
  for (std::size_t i = 1; i < settings.size(); ++i)
    parameters.emplace_back(settings[i].first, std::strtod(settings[i].second.c_str(), nullptr));
  const auto law = need(friction::make_law(settings[0].second, parameters));
  const auto rows = input();
  const auto n = static_cast<Eigen::Index>(rows.size() / 3);
  Eigen::ArrayXd speed(n), load(n), temperature(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double* row = rows.data() + 3 * i;
    speed(i) = row[0], load(i) = row[1], temperature(i) = row[2];
    put(friction::torque(law, row[0], row[1], row[2]));
  }
  const Eigen::ArrayXd batch = friction::torque(law, speed, load, temperature);
  for (Eigen::Index i = 0; i < n; ++i) put(batch(i));
  return 0;
}

int slide(double dt_s, const Settings& settings) {
  drive::Configuration keys;
  drive::Faults faults{};
  for (const auto& [key, value] : settings) {
    if (key.starts_with("fault:"))
      drive::find_fault(key.substr(6))->add(faults, std::strtod(value.c_str(), nullptr));
    else
      keys.emplace_back(key, value);
  }
  const auto d = need(drive::make_drive("joint", keys));
  const auto decay = thermal::decay(d.thermal, dt_s);
  drive::Sliding s;
  drive::set_faults(s.workspace, faults);
  const auto rows = input();
  for (std::size_t i = 0; i + 1 < rows.size(); i += 2) {
    put(drive::slide(d, decay, rows[i], rows[i + 1], s));
    put(drive::temperature_degC(d, s.state));
    put(drive::winding_degC(d, s.state));
    put(s.workspace.current_A);
  }
  return 0;
}

double cpu_seconds() {
  std::timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

int time_of_law(long n, int repeats) {
  const auto law = need(friction::published_law("extended"));
  const Eigen::ArrayXd speed = 140 * (Eigen::ArrayXd::Random(n) + 1), load = 0.3 * (Eigen::ArrayXd::Random(n) + 1),
                       temperature = 60 + 20 * Eigen::ArrayXd::Random(n);
  for (int k = 0; k < repeats; ++k) {
    const double begin = cpu_seconds();
    const Eigen::ArrayXd torque = friction::torque(law, speed, load, temperature);
    const double seconds = cpu_seconds() - begin;
    if (!(torque(0) >= 0)) return 1;
    std::printf("%.9f\n", seconds);
  }
  return 0;
}

void put_state(twin::Twin& t) {
  for (std::size_t i = 0; i < t.model().drives().size(); ++i) {
    put(t.data()->qpos[twin::position_address(t.model().get(), t.model().drives()[i])]);
    put(t.drive(i).friction_nm);
    put(t.temperature_degC(i));
  }
}

twin::Scenario scenario_of(const char* name, const Settings& settings) {
  std::vector<std::string> texts;
  for (const auto& [key, value] : settings) texts.push_back(key + "=" + value);
  return need(twin::load_scenario(twin::given_or_shipped(name, ".yaml"), texts));
}

int commanded(const char* name, int steps, const Settings& settings) {
  twin::Twin t(scenario_of(name, settings), twin::Twin::commanded);
  const auto torques = input();
  const std::size_t joints = t.model().drives().size();
  for (int k = 0; k < steps; ++k) {
    for (std::size_t i = 0; i < joints; ++i)
      t.commands()[i] = {.mode = twin::DriveCommand::Mode::torque,
                         .torque_nm = torques[static_cast<std::size_t>(k) * joints + i]};
    need(t.step());
    put_state(t);
  }
  return 0;
}

int to_the_end(const char* name, const Settings& settings) {
  twin::Twin t(scenario_of(name, settings));
  while (need(t.step()) == twin::Status::running) {
  }
  put_state(t);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 2 ? argv[1] : "";
  if (what == "law") return law(settings_of(argc, argv, 2));
  if (what == "slide") return slide(std::strtod(argv[2], nullptr), settings_of(argc, argv, 3));
  if (what == "time" && argc > 3) return time_of_law(std::atol(argv[2]), std::atoi(argv[3]));
  if (what == "scenario") return to_the_end(argv[2], settings_of(argc, argv, 3));
  if (what == "twin" && argc > 3) return commanded(argv[2], std::atoi(argv[3]), settings_of(argc, argv, 4));
  return 2;
}
