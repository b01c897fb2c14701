#include <tribotwin/twin/output/output.hpp>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

#include <fmt/format.h>
#include <unistd.h>

namespace tribotwin::twin {

int complain(std::string_view program, Exit code, std::string_view message) {
  fmt::print(stderr, "{}: {}\n", program, message);
  return code;
}

tl::expected<void, std::string> write_file(const std::filesystem::path& file, std::string_view bytes) {
  const std::filesystem::path partial = file.string() + ".partial";
  std::FILE* out = std::fopen(partial.c_str(), "wb");
  bool good = out && std::fwrite(bytes.data(), 1, bytes.size(), out) == bytes.size();
  const int why = errno;
  if (out) good = std::fclose(out) == 0 && good;
  if (good && std::rename(partial.c_str(), file.c_str()) == 0) return {};
  const std::string reason = std::strerror(good ? errno : why);
  std::error_code ignored;
  if (out) std::filesystem::remove(partial, ignored);
  return tl::unexpected(fmt::format("{}: cannot be written ({})", file.string(), reason));
}

Progress::Progress(bool quiet, std::string what) : what_(std::move(what)), on_(!quiet && ::isatty(STDERR_FILENO)) {
  if (!what_.empty()) what_ += ' ';
}

Progress::~Progress() {
  if (shown_) fmt::print(stderr, "\r\033[K");
}

void Progress::operator()(double share, double seconds_left) {
  const int percent = static_cast<int>(100 * share);
  if (!on_ || percent == last_) return;
  last_ = percent;
  shown_ = true;
  fmt::print(stderr, "\r\033[K{}{:3d} %{}", what_, percent, seconds_left >= 0 ? fmt::format(", {:.0f} s left", seconds_left) : "");
  std::fflush(stderr);
}

}  // namespace tribotwin::twin
