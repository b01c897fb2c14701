#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::twin::live {

/// A file that a live bench writes into its folder. Its name is chosen here and never comes from a page:
/// live-0012.5s.mcap by the simulated time, or live-0012.5s-2.mcap where that is taken. It is there whole or not at
/// all.
class LiveFile {
 public:
  /// `reserved`: a name that a file will have which is not there yet.
  static Result<LiveFile> create(const std::filesystem::path& folder, double time_s, std::string extension,
                                 const std::string& reserved);
  const std::string& name() const { return name_; }
  /// Where it is written until it is published.
  const std::filesystem::path& partial() const { return file_->partial(); }
  Result<void> write(std::string_view bytes);
  /// Forces it to disk and gives it its name, or the next one that is free where that was taken meanwhile.
  Result<void> publish();
  /// Leaves nothing.
  void discard() { file_.reset(); }
  /// Without the folder: pages learn no path of the disk.
  Error without_path(Error error) const;

 private:
  LiveFile(std::filesystem::path folder, double time_s, std::string extension);
  std::string numbered(int n) const;
  std::filesystem::path folder_;
  std::string stem_, extension_, name_;
  std::optional<NewFile> file_;
};

}  // namespace tribotwin::twin::live
