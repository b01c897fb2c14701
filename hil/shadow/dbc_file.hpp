#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/hil/shadow/signal.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// What a DBC file says of the signals in frames: BO_, SG_ (with simple multiplexing) and SIG_VALTYPE_ lines. All other
/// lines are skipped.
namespace tribotwin::hil {

struct DbcSignal {
  std::string name, unit;
  std::size_t line = 0;
  Signal signal;
  bool selects = false;                    ///< the multiplexor of its message
  std::optional<std::uint64_t> selection;  ///< in the frame only while the multiplexor has this value
};
struct DbcMessage {
  std::string name;
  std::size_t line = 0;
  std::uint32_t id = 0;
  bool extended = false;
  int size = 0;  ///< bytes
  std::vector<DbcSignal> signals;

  const DbcSignal* multiplexor() const;
};
struct DbcFile {
  std::filesystem::path file;
  std::vector<DbcMessage> messages;
};

/// Fails with file and line where a message or signal has a wrong number, does not fit in its frame, or is there twice.
Result<DbcFile> read_dbc(const std::filesystem::path& file);

}  // namespace tribotwin::hil
