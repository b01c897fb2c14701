#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

typedef struct _GSubprocess GSubprocess;

/// Programs we draw with. Arguments go to them as they are, input through a pipe; there is never a shell.
namespace tribotwin::render {

/// A program to start, and how to get it.
struct Program {
  std::vector<std::string> arguments;  ///< the first is the program, looked up in PATH
  std::string package;                 ///< Debian package that has it
};

/// Runs a program to its end and returns its stdout. Fails when it is not installed or ends with an error: the
/// message has what it wrote to stderr.
Result<std::string> run(const Program& program, std::string_view input);

/// A program that is fed while it works. Its stdout is ours. Killed when abandoned.
class Child {
 public:
  static Result<Child> start(const Program& program);
  Child(Child&&) noexcept = default;
  Child& operator=(Child&&) = delete;
  ~Child();
  /// Fails once the program does not take input any more.
  Result<void> write(std::string_view bytes);
  /// Ends the input and waits. Returns what the program wrote to stderr.
  Result<std::string> finish();

 private:
  struct Unref {
    void operator()(GSubprocess* process) const;
  };
  Child(std::string name, GSubprocess* process) : name_(std::move(name)), process_(process) {}
  std::string name_;
  std::unique_ptr<GSubprocess, Unref> process_;
};

/// A word of a command that the user may copy into a shell: quoted where it must be.
std::string shell_word(std::string_view word);

}  // namespace tribotwin::render
