#pragma once

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
};

/// Runs a program to its end and returns its stdout. Fails when it is not installed or ends with an error: the
/// message has what it wrote to stderr.
Result<std::string> run(const Program& program, std::string_view input);

/// A program that reads input while it works. Its stdout is that of this process. Killed by the destructor.
class Child {
 public:
  static Result<Child> start(const Program& program);
  Child(Child&&) noexcept = default;
  Child& operator=(Child&&) = delete;
  ~Child();
  /// Fails when the program no longer reads its input.
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
