// Every reader of a user's files, given any bytes: it ends in a value or in one message of ours, on printable lines,
// with the file's name. As libFuzzer: `fuzz_readers READER [options] FOLDER`. Else `fuzz_readers READER COUNT SEED
// FILE..` reads these files, then COUNT inputs made of them; `fuzz_readers` alone prints the names of the readers.
#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <unistd.h>

#include <tribotwin/hil/can/socketcand_protocol.hpp>
#include <tribotwin/hil/can/words.hpp>
#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
#include <tribotwin/hil/faults/faults.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/hil/shadow/dbc_file.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/fuzz/require.hpp>
#include <tribotwin/twin/commands/calibrate/campaign.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/diagnosis/healthy_file.hpp>
#include <tribotwin/twin/diagnosis/observation.hpp>
#include <tribotwin/twin/experiments/fault_study/study.hpp>
#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/experiments/sweep/plan.hpp>
#include <tribotwin/twin/experiments/working_days/campaign.hpp>
#include <tribotwin/twin/gears/foreign_model.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/tables/column_map.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/robot/recording.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace {

using namespace tribotwin;
using namespace tribotwin::twin;
using Path = std::filesystem::path;

long read_whole = 0, refused = 0;

void check_message(std::string_view message) {
  ++refused;
  const bool control =
      std::ranges::any_of(message, [](unsigned char c) { return c != '\n' && c != '\t' && (c < 0x20 || c == 0x7F); });
  if (!message.empty() && !control) return;
  std::fprintf(stderr, "message: '%.*s'\n", static_cast<int>(message.size()), message.data());
  require(!message.empty(), "a refusal without a message");
  require(!control, "a message with control characters");
}

template <class T>
void end(const Result<T>& result) {
  if (result)
    ++read_whole;
  else
    check_message(result.error().message);
}

const program::Robot& robot() {
  static const program::Robot once = program::load_robot("er3a_c60");
  return once;
}

std::string content(const Path& file) { return or_fail(read_bytes(file)); }

/// The columns of a joint's recording, which tables of every kind are asked for.
const std::vector<std::string> wanted{"time_s", "position_rad", "velocity_rad_s", "torque_nm"};

void read_session(const Path& file) {
  auto session = hil::SessionReader::open(file);
  if (!session) return end(session);
  hil::Turn turn;
  Result<bool> more = true;
  while (more && *more) more = session->next(turn);
  end(more);
}

void read_socketcand(const Path& file) {
  const std::string text = content(file);
  const auto parts = hil::words(text);
  const auto sent = hil::socketcand::parse_send(parts);
  const auto received = hil::socketcand::parse_frame(parts);
  if (sent) require(hil::socketcand::send_command(*sent).size() < 200, "a frame that is too long");
  ++(sent || received ? read_whole : refused);
}

/// `ending` of the files, by which readers of tables know their kind.
struct Reader {
  std::string_view name, ending;
  void (*read)(const Path&);
};

const std::array readers{
    Reader{"scenario", ".yaml", [](const Path& f) { end(load_scenario(f)); }},
    Reader{"plan", ".yaml", [](const Path& f) { end(sweep::load_plan(f)); }},
    Reader{"campaign", ".yaml", [](const Path& f) { end(load_campaign(f)); }},
    Reader{"days", ".yaml", [](const Path& f) { end(repeatability::load_campaign(f, load_yaml(f))); }},
    Reader{"study", ".yaml", [](const Path& f) { end(study::load_study(f, load_yaml(f))); }},
    Reader{"fit", ".yaml", [](const Path& f) { program::read_calibration(f, {}, {}), ++read_whole; }},
    Reader{"faults", ".yaml", [](const Path& f) { end(hil::load_faults(f, 1, 6)); }},
    Reader{"columns", ".yaml", [](const Path& f) { end(read_column_map(f)); }},
    Reader{"parameters", ".yaml", [](const Path& f) { end(identification::read_parameters(f)); }},
    Reader{"friction", ".yaml", [](const Path& f) { end(identification::read_friction(f)); }},
    Reader{"dynamics", ".yaml",
           [](const Path& f) { end(identification::read_dynamics(f, robot().regressor, robot().base)); }},
    Reader{"thermal", ".yaml", [](const Path& f) { end(identification::read_thermal(f)); }},
    Reader{"thermal_chain", ".yaml", [](const Path& f) { end(identification::read_thermal_chain(f)); }},
    Reader{"healthy", ".yaml", [](const Path& f) { end(diagnosis::read_healthy(f)); }},
    Reader{"curves", ".csv",
           [](const Path& f) { end(identification::read_samples(std::array{f}, *friction::find_law("load"), {})); }},
    Reader{"observations", ".csv", [](const Path& f) { end(diagnosis::read_observations(f, {})); }},
    Reader{"recording", ".csv", [](const Path& f) { end(identification::read_robot_recording(f, robot().regressor)); }},
    Reader{"set_points", ".csv", [](const Path& f) { end(read_set_points(f)); }},
    Reader{"bam", ".json", [](const Path& f) { end(read_set_points(f)); }},
    Reader{"npy", ".npy", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"npz", ".npz", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"mat", ".mat", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"mcap", ".mcap", [](const Path& f) { end(read_numbers(f, wanted, {.joint = "joint1"})); }},
    Reader{"telemetry", ".h5", [](const Path& f) { end(read_telemetry(f)); }},
    Reader{"mjcf", ".xml", [](const Path& f) { end(mujoco::load_file(f)); }},
    Reader{"urdf", ".urdf", [](const Path& f) { end(read_foreign_model(f)); }},
    Reader{"eds", ".eds", [](const Path& f) { end(hil::read_eds_file(f)); }},
    Reader{"dbc", ".dbc", [](const Path& f) { end(hil::read_dbc(f)); }},
    Reader{"session", ".session", read_session},
    Reader{"socketcand", ".txt", read_socketcand},
};

const Reader* chosen = nullptr;

const Reader* find(std::string_view name) {
  const auto found = std::ranges::find(readers, name, &Reader::name);
  return found == readers.end() ? nullptr : &*found;
}

/// Where inputs lie: beside models and recordings that they name, as in the source tree.
const Path& folder() {
  static const TemporaryFolder root("tribotwin-fuzz");
  static const Path inputs = [] {
    const Path below = root.path() / "twin/scenarios", source = TRIBOTWIN_SOURCE_DIR;
    std::filesystem::create_directories(below);
    std::filesystem::create_directory_symlink(source / "mjcf", root.path() / "mjcf");
    std::filesystem::create_directory_symlink(source / "tests/fuzz/corpus/bam", below / "bam");
    std::filesystem::create_symlink(source / "mjcf/scene.xml", below / "scene.xml");
    return below;
  }();
  return inputs;
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  // In memory, where there is such a place: inputs are written a thousand times a second.
  if (std::filesystem::exists("/dev/shm")) setenv("TMPDIR", "/dev/shm", 0);
  mujoco::install_message_handlers();
  chosen = *argc > 1 ? find((*argv)[1]) : nullptr;
  if (!chosen) {
    for (const Reader& reader : readers)
      std::printf("%.*s\n", static_cast<int>(reader.name.size()), reader.name.data());
    std::exit(*argc > 1 ? 2 : 0);
  }
  std::copy(*argv + 2, *argv + *argc, *argv + 1);
  --*argc;
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Path file = folder() / fmt::format("input{}", chosen->ending);  // stays there after a crash
  std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  try {
    chosen->read(file);
  } catch (const YAML::Exception&) {
    throw;  // a std::runtime_error, but not with a message of ours
  } catch (const std::runtime_error& error) {
    check_message(error.what());
  }
  return 0;
}

namespace {

/// Inputs of libFuzzer's kind, without its knowledge of what was reached: parts of files that are changed, repeated,
/// taken from each other, or replaced by what readers stumble over.
class Mutations {
 public:
  Mutations(std::vector<std::string> files, std::uint64_t seed) : files_(std::move(files)), random_(seed) {}

  std::string next() {
    std::string text = files_[below(files_.size())];
    for (std::size_t n = 1 + below(6); n > 0; --n) change(text);
    return text;
  }

 private:
  std::size_t below(std::size_t end) { return end ? random_() % end : 0; }

  void change(std::string& text) {
    static const std::array<std::string_view, 31> tokens{"-1",
                                                         "0",
                                                         "1e308",
                                                         "-1e-308",
                                                         "nan",
                                                         "inf",
                                                         "9223372036854775808",
                                                         "18446744073709551616",
                                                         "1e999999",
                                                         "~",
                                                         "null",
                                                         "true",
                                                         "[",
                                                         "]",
                                                         "{",
                                                         "}",
                                                         "&a ",
                                                         "*a",
                                                         "<<: ",
                                                         "!!binary ",
                                                         "\xEF\xBB\xBF",
                                                         "\x1B[31m",
                                                         "\xFF\xFE",
                                                         "\xC3",
                                                         "\"",
                                                         "'",
                                                         "\r\n",
                                                         "%s%n",
                                                         "../",
                                                         ",,,",
                                                         "#"};
    const std::size_t at = below(text.size() + 1), length = below(std::size_t{1} << below(8));
    switch (below(6)) {
      case 0:
        if (at < text.size()) text[at] = static_cast<char>(random_());
        break;
      case 1:
        text.erase(at, length);
        break;
      case 2:
        text.insert(at, text.substr(below(text.size()), length));
        break;
      case 3: {
        const std::string& other = files_[below(files_.size())];
        text.replace(at, length, other.substr(below(other.size()), length));
        break;
      }
      case 4:
        text.insert(at, std::string(length, static_cast<char>(below(4) ? random_() : 0)));
        break;
      default:
        replace_word(text, at, tokens[below(tokens.size())]);
    }
  }

  /// The number or word at `at`.
  static void replace_word(std::string& text, std::size_t at, std::string_view token) {
    const auto in_word = [&](std::size_t i) {
      return std::isalnum(static_cast<unsigned char>(text[i])) || text[i] == '.' || text[i] == '-';
    };
    std::size_t end = at;
    while (at > 0 && in_word(at - 1)) --at;
    while (end < text.size() && in_word(end)) ++end;
    text.replace(at, end - at, token);
  }

  std::vector<std::string> files_;
  std::mt19937_64 random_;
};

void read_input(const std::string& bytes) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

}  // namespace

/// Weak, so that libFuzzer's own main wins where it is linked.
[[gnu::weak]] int main(int argc, char** argv) {
  LLVMFuzzerInitialize(&argc, &argv);
  require(argc > 3, "READER COUNT SEED FILE..");
  std::vector<std::string> files;
  for (int i = 3; i < argc; ++i) read_input(files.emplace_back(content(argv[i])));
  const long whole = read_whole, count = std::strtol(argv[1], nullptr, 10);
  Mutations mutations(std::move(files), std::strtoull(argv[2], nullptr, 10));
  for (long i = 0; i < count; ++i) read_input(mutations.next());
  std::printf("%s: of %d files %ld read; %ld inputs made of these, %ld read, %ld refused\n",
              std::string(chosen->name).c_str(), argc - 3, whole, count, read_whole - whole, refused);
  return whole > 0 ? 0 : 1;
}
