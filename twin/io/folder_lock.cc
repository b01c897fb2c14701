#include <cerrno>
#include <cstring>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <tribotwin/twin/io/folder_lock.hpp>

namespace tribotwin::twin {

FolderLock::~FolderLock() { release(); }

void FolderLock::release() {
  if (file_ < 0) return;
  temporary_ = {};  // first: another process may take the name when it is free
  ::unlink(path_.c_str());
  file_.close();
}

Result<void> FolderLock::take(const std::filesystem::path& directory) {
  path_ = directory / "run.lock";
  for (;;) {
    file_ = Descriptor(::open(path_.c_str(), O_CREAT | O_RDWR | O_NOFOLLOW | O_CLOEXEC, 0666));
    if (file_ < 0) return work_failed(fmt::format("{}: cannot be written ({})", path_.string(), std::strerror(errno)));
    if (::flock(file_, LOCK_EX | LOCK_NB) != 0) {
      file_.close();
      return work_failed(
          fmt::format("{}: another run is writing into this folder; choose another with -o", directory.string()));
    }
    struct stat mine {
    }, there{};
    if (::fstat(file_, &mine) == 0 && ::stat(path_.c_str(), &there) == 0 && mine.st_ino == there.st_ino) {
      temporary_ = Temporary(path_);
      return {};
    }
    file_.close();  // its holder took the file away in between
  }
}

}  // namespace tribotwin::twin
