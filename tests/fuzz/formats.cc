// Readers of twin/io and of models, for harness.cc: a program that links little, so that libFuzzer's build of it is
// quick.
#include <array>
#include <string>
#include <vector>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/fuzz/reader.hpp>
#include <tribotwin/twin/io/tables/column_map.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::fuzz {
namespace {

using namespace tribotwin::twin;

/// The columns of a joint's recording, which tables of every kind are asked for.
const std::vector<std::string> wanted{"time_s", "position_rad", "velocity_rad_s", "torque_nm"};

const std::array all{
    Reader{"columns", ".yaml", [](const Path& f) { end(read_column_map(f)); }},
    Reader{"npy", ".npy", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"npz", ".npz", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"mat", ".mat", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"mcap", ".mcap", [](const Path& f) { end(read_numbers(f, wanted, {.joint = "joint1"})); }},
    Reader{"telemetry", ".h5", [](const Path& f) { end(read_telemetry(f)); }},
    Reader{"mjcf", ".xml", [](const Path& f) { end(mujoco::load_file(f)); }},
};

}  // namespace

std::span<const Reader> readers() { return all; }

}  // namespace tribotwin::fuzz
