#pragma once

#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

typedef struct _GSubprocess GSubprocess;

/// External programs. Arguments are passed as they are and input through a pipe, never through a shell.
namespace tribotwin::render {

/// A program to start, and how to get it.
struct Program {
  std::vector<std::string> arguments;  ///< the first is the program, looked up in PATH
  std::string package;                 ///< Debian package that has it
  /// A file that it gets beside its standard streams, as /proc/self/fd/3; it stays the caller's. -1: none.
  int file = -1;
};

/// A program that reads input while it works. Killed by the destructor.
class Child {
 public:
  /// What becomes of the program's stdout: that of this process, or what `answer` returns.
  enum class Stdout { ours, answers };
  static Result<Child> start(const Program& program, Stdout out = Stdout::ours);
  Child(Child&&) noexcept = default;
  Child& operator=(Child&&) = delete;
  ~Child();
  /// Fails when the program no longer reads its input: the message has what it wrote to stderr.
  Result<void> write(std::string_view bytes);
  /// With Stdout::answers: writes `input`, which the program must read to its end before it answers, and returns the
  /// answer up to `end`, which the input must make it write. Fails when the program ends: the message has what it wrote
  /// to stderr.
  Result<std::string> answer(std::string_view input, std::string_view end);
  /// Ends the input and waits. Returns what the program wrote to stderr.
  Result<std::string> finish();

 private:
  struct Unref {
    void operator()(GSubprocess* process) const;
  };
  using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;
  Child(std::string name, GSubprocess* process, File said)
      : name_(std::move(name)), process_(process), said_(std::move(said)) {}
  std::string name_;
  std::unique_ptr<GSubprocess, Unref> process_;
  File said_;  ///< its stderr, in memory: a pipe that nobody reads would stop a program that says much
};

/// A word of a command that the user may copy into a shell: quoted where it must be.
std::string shell_word(std::string_view word);

}  // namespace tribotwin::render
