#include <csignal>
#include <cstring>

#include <fmt/format.h>
#include <gio/gio.h>
#include <sys/mman.h>
#include <unistd.h>

#include <tribotwin/render/process/child.hpp>

namespace tribotwin::render {
namespace {

struct Free {
  void operator()(GError* error) const { g_error_free(error); }
  void operator()(GBytes* bytes) const { g_bytes_unref(bytes); }
};
using Bytes = std::unique_ptr<GBytes, Free>;

std::string message(GError* error) { return std::unique_ptr<GError, Free>(error)->message; }

std::string text(GBytes* bytes) {
  gsize size = 0;
  const auto* data = static_cast<const char*>(g_bytes_get_data(bytes, &size));
  return {data, data + size};
}

std::string one_line(std::string said) {
  while (!said.empty() && g_ascii_isspace(said.back())) said.pop_back();
  return said.substr(said.find_first_not_of(" \n\r") == std::string::npos ? 0 : said.find_first_not_of(" \n\r"));
}

/// A file in memory that holds `input`, at its beginning; -1 and errno when there is none. A program that ends before
/// it has read its input may break a pipe, and its error message would be lost; a file avoids that.
int file_in_memory(std::string_view input) {
  const int file = memfd_create("input", MFD_CLOEXEC);
  while (file >= 0 && !input.empty()) {
    const auto n = ::write(file, input.data(), input.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return close(file), -1;
    input.remove_prefix(static_cast<std::size_t>(n));
  }
  if (file >= 0) lseek(file, 0, SEEK_SET);
  return file;
}

/// `stdin_file` becomes the program's standard input and is closed here; -1: as `flags` say.
Result<GSubprocess*> spawn(const Program& program, int flags, int stdin_file = -1) {
  std::signal(SIGPIPE, SIG_IGN);  // a program that stops reading is reported as an error
  std::vector<const char*> argv;
  for (const auto& argument : program.arguments) argv.push_back(argument.c_str());
  argv.push_back(nullptr);
  GError* error = nullptr;
  const std::unique_ptr<GSubprocessLauncher, decltype(&g_object_unref)> launcher(
      g_subprocess_launcher_new(static_cast<GSubprocessFlags>(flags)), g_object_unref);
  if (stdin_file >= 0) g_subprocess_launcher_take_stdin_fd(launcher.get(), stdin_file);
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

Result<std::string> run(const Program& program, std::string_view input) {
  const int script = file_in_memory(input);
  if (script < 0)
    return work_failed(fmt::format("{}: no memory for its input of {} bytes: {}", program.arguments[0], input.size(),
                                   std::strerror(errno)));
  auto process = spawn(program, G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_PIPE, script);
  if (!process) return tl::unexpected(process.error());
  const std::unique_ptr<GSubprocess, decltype(&g_object_unref)> owner(*process, g_object_unref);
  GBytes *out = nullptr, *err = nullptr;
  GError* error = nullptr;
  if (!g_subprocess_communicate(*process, nullptr, nullptr, &out, &err, &error))
    return work_failed(fmt::format("{}: {}", program.arguments[0], message(error)));
  const Bytes out_owner(out), err_owner(err);
  if (auto good = verdict(program.arguments[0], *process, one_line(text(err))); !good)
    return tl::unexpected(good.error());
  return text(out);
}

void Child::Unref::operator()(GSubprocess* process) const { g_object_unref(process); }

Result<Child> Child::start(const Program& program) {
  auto process = spawn(program, G_SUBPROCESS_FLAGS_STDIN_PIPE | G_SUBPROCESS_FLAGS_STDERR_PIPE);
  if (!process) return tl::unexpected(process.error());
  return Child(program.arguments[0], *process);
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

Result<std::string> Child::finish() {
  g_output_stream_close(g_subprocess_get_stdin_pipe(process_.get()), nullptr, nullptr);
  std::string said;
  char buffer[4096];
  for (gssize n; (n = g_input_stream_read(g_subprocess_get_stderr_pipe(process_.get()), buffer, sizeof buffer, nullptr,
                                          nullptr)) > 0;)
    said.append(buffer, static_cast<std::size_t>(n));
  g_subprocess_wait(process_.get(), nullptr, nullptr);
  said = one_line(said);
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
