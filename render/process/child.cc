#include <csignal>
#include <cstring>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <gio/gio.h>
#include <sys/mman.h>
#include <unistd.h>

#include <tribotwin/render/process/child.hpp>

namespace tribotwin::render {
namespace {

struct Free {
  void operator()(GError* error) const { g_error_free(error); }
};

std::string message(GError* error) { return std::unique_ptr<GError, Free>(error)->message; }

std::string one_line(std::string said) {
  while (!said.empty() && g_ascii_isspace(said.back())) said.pop_back();
  return said.substr(said.find_first_not_of(" \n\r") == std::string::npos ? 0 : said.find_first_not_of(" \n\r"));
}

/// All that is in a file, wherever others read and write.
std::string content(std::FILE* file) {
  std::string all;
  char buffer[4096];
  for (ssize_t n; (n = pread(fileno(file), buffer, sizeof buffer, static_cast<off_t>(all.size()))) > 0;)
    all.append(buffer, static_cast<std::size_t>(n));
  return all;
}

/// `stderr_file` stays the caller's.
Result<GSubprocess*> spawn(const Program& program, int flags, int stderr_file) {
  std::signal(SIGPIPE, SIG_IGN);  // a program that stops reading is reported as an error
  std::vector<const char*> argv;
  for (const auto& argument : program.arguments) argv.push_back(argument.c_str());
  argv.push_back(nullptr);
  GError* error = nullptr;
  const std::unique_ptr<GSubprocessLauncher, decltype(&g_object_unref)> launcher(
      g_subprocess_launcher_new(static_cast<GSubprocessFlags>(flags)), g_object_unref);
  g_subprocess_launcher_take_stderr_fd(launcher.get(), fcntl(stderr_file, F_DUPFD_CLOEXEC, 0));
  if (program.file >= 0) {
    const int copy = fcntl(program.file, F_DUPFD_CLOEXEC, 0);
    if (copy < 0)
      return work_failed(fmt::format("{} cannot be started: {}", program.arguments[0], std::strerror(errno)));
    g_subprocess_launcher_take_fd(launcher.get(), copy, 3);
  }
  GSubprocess* process = g_subprocess_launcher_spawnv(launcher.get(), argv.data(), &error);
  if (process) return process;
  const bool missing = g_error_matches(error, G_SPAWN_ERROR, G_SPAWN_ERROR_NOENT);
  const std::string why = message(error);
  if (missing)
    return work_failed(
        fmt::format("{} is not installed; on Debian: apt-get install {}", program.arguments[0], program.package));
  return work_failed(fmt::format("{} cannot be started: {}", program.arguments[0], why));
}

Result<void> verdict(const std::string& name, GSubprocess* process, const std::string& said) {
  if (g_subprocess_get_if_exited(process) && g_subprocess_get_exit_status(process) == 0) return {};
  const std::string ending = g_subprocess_get_if_exited(process)
                                 ? fmt::format("ended with exit code {}", g_subprocess_get_exit_status(process))
                                 : fmt::format("was ended by signal {}", g_subprocess_get_term_sig(process));
  return work_failed(fmt::format("{} {}{}{}", name, ending, said.empty() ? "" : ": ", said));
}

}  // namespace

void Child::Unref::operator()(GSubprocess* process) const { g_object_unref(process); }

Result<Child> Child::start(const Program& program, Stdout out) {
  const std::string& name = program.arguments[0];
  const int memory = memfd_create("stderr", MFD_CLOEXEC);
  File said(memory < 0 ? nullptr : fdopen(memory, "r"), &std::fclose);
  if (!said) return work_failed(fmt::format("{}: no memory for its messages: {}", name, std::strerror(errno)));
  const int answers = out == Stdout::answers ? G_SUBPROCESS_FLAGS_STDOUT_PIPE : G_SUBPROCESS_FLAGS_NONE;
  auto process = spawn(program, G_SUBPROCESS_FLAGS_STDIN_PIPE | answers, fileno(said.get()));
  if (!process) return tl::unexpected(process.error());
  return Child(name, *process, std::move(said));
}

Child::~Child() {
  if (!process_) return;
  g_subprocess_force_exit(process_.get());
  g_subprocess_wait(process_.get(), nullptr, nullptr);
}

Result<void> Child::write(std::string_view bytes) {
  GError* error = nullptr;
  gsize written = 0;
  if (g_output_stream_write_all(g_subprocess_get_stdin_pipe(process_.get()), bytes.data(), bytes.size(), &written,
                                nullptr, &error))
    return {};
  const std::string why = message(error);
  auto ended = finish();
  return work_failed(ended ? fmt::format("{}: {}", name_, why) : ended.error().message);
}

Result<std::string> Child::answer(std::string_view input, std::string_view end) {
  if (auto ok = write(input); !ok) return tl::unexpected(ok.error());
  std::string said;
  std::vector<char> buffer(65536);
  while (!said.ends_with(end)) {
    GError* error = nullptr;
    const gssize n = g_input_stream_read(g_subprocess_get_stdout_pipe(process_.get()), buffer.data(), buffer.size(),
                                         nullptr, &error);
    if (n < 0) return work_failed(fmt::format("{}: {}", name_, message(error)));
    if (n == 0) {
      auto ended = finish();
      return ended ? work_failed(name_ + " ended before its work was done") : ended;
    }
    said.append(buffer.data(), static_cast<std::size_t>(n));
  }
  said.resize(said.size() - end.size());
  return said;
}

Result<std::string> Child::finish() {
  g_output_stream_close(g_subprocess_get_stdin_pipe(process_.get()), nullptr, nullptr);
  g_subprocess_wait(process_.get(), nullptr, nullptr);
  std::string said = one_line(content(said_.get()));
  const auto good = verdict(name_, process_.get(), said);
  process_.reset();
  if (!good) return tl::unexpected(good.error());
  return said;
}

std::string shell_word(std::string_view word) {
  constexpr std::string_view harmless = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./=:+,";
  if (!word.empty() && word.find_first_not_of(harmless) == std::string_view::npos) return std::string(word);
  const std::unique_ptr<char, decltype(&g_free)> quoted(g_shell_quote(std::string(word).c_str()), g_free);
  return quoted.get();
}

}  // namespace tribotwin::render
