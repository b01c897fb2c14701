#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <tribotwin/plugins/friction/input_file.hpp>

namespace tribotwin {
namespace {

std::string too_long(std::uintmax_t most_bytes) {
  return fmt::format("is longer than {} bytes, the most that is read of such a file", most_bytes);
}

/// Nothing where a file of this kind can be read.
const char* unfit_kind(const struct stat& file, Pipes pipes, const char* name) {
  if (S_ISDIR(file.st_mode)) return "a folder";
  if (S_ISSOCK(file.st_mode)) return "a socket";
  if (S_ISFIFO(file.st_mode)) return pipes == Pipes::accept ? nullptr : "a pipe";
  if (S_ISBLK(file.st_mode)) return "a device";
  if (!S_ISCHR(file.st_mode)) return nullptr;
  const int opened = pipes == Pipes::accept ? ::open(name, O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC) : -1;
  const bool terminal = opened >= 0 && ::isatty(opened);
  if (opened >= 0) ::close(opened);
  return terminal ? nullptr : "a device";
}

}  // namespace

Result<void> check_input_file(const std::filesystem::path& file, std::string_view kind, std::uintmax_t most_bytes,
                              Pipes pipes) {
  struct stat there {};
  if (::stat(file.c_str(), &there) != 0)
    return tl::unexpected(fmt::format("{}: cannot be read ({})", file.string(), std::strerror(errno)));
  if (const char* unfit = unfit_kind(there, pipes, file.c_str()))
    return tl::unexpected(fmt::format("{}: is {}, not {}", file.string(), unfit, kind));
  if (S_ISREG(there.st_mode) && static_cast<std::uintmax_t>(there.st_size) > most_bytes)
    return tl::unexpected(fmt::format("{}: {}; it has {}", file.string(), too_long(most_bytes), there.st_size));
  return {};
}

tl::unexpected<Error> not_read(std::string_view file) {
  return work_failed(fmt::format("{}: cannot be read to its end ({})", file, std::strerror(errno)));
}

Result<std::string> read_at_most(std::istream& stream, std::string_view file, std::uintmax_t most_bytes) {
  constexpr std::size_t step = std::size_t{1} << 16;
  std::string bytes;
  while (stream) {
    const std::size_t before = bytes.size();
    if (before > most_bytes) return tl::unexpected(fmt::format("{}: {}", file, too_long(most_bytes)));
    bytes.resize(before + 1 + std::min<std::uintmax_t>(std::max(step, before) - 1, most_bytes - before));
    stream.read(bytes.data() + before, static_cast<std::streamsize>(bytes.size() - before));
    bytes.resize(before + static_cast<std::size_t>(stream.gcount()));
  }
  if (stream.bad()) return not_read(file);
  return bytes;
}

Result<std::string> read_input_file(const std::filesystem::path& file, std::string_view kind,
                                    std::uintmax_t most_bytes) {
  if (auto ok = check_input_file(file, kind, most_bytes, Pipes::refuse); !ok) return tl::unexpected(ok.error());
  std::ifstream stream(file, std::ios::binary);
  const int why = errno;
  if (!stream) return tl::unexpected(fmt::format("{}: cannot be read ({})", file.string(), std::strerror(why)));
  return read_at_most(stream, file.string(), most_bytes);
}

bool read_line(std::istream& stream, std::string& line, std::size_t most_bytes) {
  std::array<char, 4096> part;
  line.clear();
  while (stream.getline(part.data(), part.size()), stream.gcount() > 0) {
    const bool full = stream.fail() && !stream.eof(), line_feed = !full && !stream.eof();
    line.append(part.data(), static_cast<std::size_t>(stream.gcount()) - (line_feed ? 1 : 0));
    if (!full) return true;
    stream.clear(stream.rdstate() & ~std::ios::failbit);
    if (line.size() > most_bytes) return true;
  }
  return !line.empty() && !stream.bad();
}

}  // namespace tribotwin
