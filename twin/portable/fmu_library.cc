#include <cerrno>
#include <cstring>
#include <fstream>

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/portable/fmu.hpp>

namespace tribotwin::twin {
namespace {

/// Exit code of a program, whose output goes to `messages`; errno below 0 where it cannot be started.
int run(std::vector<std::string> command, const std::string& messages) {
  std::vector<char*> arguments;
  for (std::string& word : command) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, messages.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  ::posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  pid_t pid = 0;
  const int error = ::posix_spawnp(&pid, arguments[0], &actions, nullptr, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return -error;
  int status = 0;
  while (::waitpid(pid, &status, 0) < 0)
    if (errno != EINTR) return -errno;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace

std::string fmu_library_name(const std::string& name, FmiVersion version) {
#if defined(__x86_64__)
  const char* platform = version == FmiVersion::two ? "linux64" : "x86_64-linux";
#elif defined(__aarch64__)
  const char* platform = version == FmiVersion::two ? "" : "aarch64-linux";
#else
  const char* platform = "";
  (void)version;
#endif
  return platform[0] ? fmt::format("binaries/{}/{}.so", platform, name) : "";
}

Result<std::string> fmu_library(const std::vector<FmuFile>& files, const std::string& name, FmiVersion version) {
  const TemporaryFolder folder("tribotwin-fmu");
  if (folder.path().empty()) return work_failed("a temporary folder for the compiler cannot be created");
  const auto in_folder = [&](const std::string& file) { return (folder.path() / file).string(); };
  const std::string sources = "sources/", result = in_folder(name + ".so"), messages = in_folder("messages");
  std::vector<std::string> command{"",      "-std=c99", "-O2", "-ffp-contract=off",
                                   "-fPIC", "-shared",  "-s",  "-fvisibility=hidden"};
  command.push_back(fmt::format("-DFMI{}_OVERRIDE_FUNCTION_PREFIX", static_cast<int>(version)));
  for (const FmuFile& file : files) {
    if (!file.name.starts_with(sources) || !file.name.ends_with(".c")) continue;
    command.push_back(in_folder(file.name.substr(sources.size())));
    std::ofstream out(command.back(), std::ios::binary);
    out << file.content;
    if (!out.flush()) return work_failed(fmt::format("{}: cannot be written", command.back()));
  }
  command.insert(command.end(), {"-o", result, "-lm"});
  for (const char* compiler : {"cc", "gcc", "clang"}) {
    command[0] = compiler;
    const int code = run(command, messages);
    if (code == -ENOENT) continue;
    if (code < 0) return work_failed(fmt::format("{}: cannot be started ({})", compiler, std::strerror(-code)));
    if (code != 0)
      return work_failed(fmt::format("{}: exit code {}: {}", compiler, code, read_bytes(messages).value_or("")));
    std::string library = read_bytes(result).value_or("");
    if (library.empty()) return work_failed(fmt::format("{}: wrote no library", compiler));
    return library;
  }
  return std::string();
}

}  // namespace tribotwin::twin
