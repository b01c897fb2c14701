#pragma once

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <span>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/tests/fuzz/require.hpp>

/// What a program of readers (formats.cc, readers.cc) and its harness (harness.cc) share.
namespace tribotwin::fuzz {

using Path = std::filesystem::path;

/// `ending` of the files, by which readers of tables know their kind. `read` calls end(), or throws a
/// std::runtime_error with a message.
struct Reader {
  std::string_view name, ending;
  void (*read)(const Path&);
};

/// Those of the program.
std::span<const Reader> readers();

inline long read_whole = 0, refused = 0;

inline void check_message(std::string_view message) {
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

}  // namespace tribotwin::fuzz
