// Readers of twin/io and of models, for harness.cc: a program that links little, so that libFuzzer's build of it is
// quick.
#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/fuzz/reader.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/tables/column_map.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/telemetry/column_reader.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::fuzz {
namespace {

using namespace tribotwin::twin;

/// The columns of a joint's recording, which tables of every kind are asked for.
const std::vector<std::string> wanted{"time_s", "position_rad", "velocity_rad_s", "torque_nm"};

/// Every column of a table in HDF5, as `fleet` reads it.
void read_table(const Path& file) {
  const auto table = ColumnReader::open(file);
  if (!table) return end(table);
  for (std::size_t column = 0; column < table->names().size(); ++column)
    end(table->texts(column, 0, std::min(table->rows(), ColumnReader::rows_at_once)));
}

/// As `recover` reads the record of a killed run.
void read_killed(const Path& file) {
  const TemporaryFolder run("tribotwin-fuzz-run");
  or_fail(write_unforced(run.path() / "telemetry.h5", or_fail(read_bytes(file))));
  if (const auto recovered = recover(run.path()); !recovered) return end(recovered);
  const auto record = read_telemetry(run.path() / "telemetry.h5");
  require(record.has_value(), "what recover has written cannot be read");
  ++read_whole;
}

const std::array all{
    Reader{"columns", ".yaml", [](const Path& f) { end(read_column_map(f)); }},
    Reader{"npy", ".npy", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"npz", ".npz", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"mat", ".mat", [](const Path& f) { end(read_numbers(f, wanted)); }},
    Reader{"mcap", ".mcap", [](const Path& f) { end(read_numbers(f, wanted, {.joint = "joint1"})); }},
    Reader{"table", ".h5", read_table},
    Reader{"telemetry", ".h5", [](const Path& f) { end(read_telemetry(f)); }},
    Reader{"killed", ".h5", read_killed},
    Reader{"mjcf", ".xml", [](const Path& f) { end(mujoco::load_file(f)); }},
};

}  // namespace

std::span<const Reader> readers() { return all; }

}  // namespace tribotwin::fuzz
