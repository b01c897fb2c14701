#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/hil/shadow/signal.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// What a DBC file says of the signals in frames: BO_, SG_ (with simple multiplexing), SIG_VALTYPE_ and SG_MUL_VAL_
/// lines. All other lines are skipped.
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
  /// Why its frames cannot be read here: extended multiplexing, a message of many frames (J1939).
  struct Unreadable {
    std::size_t line = 0;
    std::string why;
  };
  std::optional<Unreadable> unreadable;

  const DbcSignal* multiplexor() const;
};
struct DbcFile {
  std::filesystem::path file;
  std::vector<DbcMessage> messages;
};

/// Fails with file and line where a message or signal has a wrong number, does not fit in its frame, or is there twice.
/// What no single frame with simple multiplexing can hold makes its message `unreadable`, not the file.
Result<DbcFile> read_dbc(const std::filesystem::path& file);

}  // namespace tribotwin::hil
