#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

namespace tribotwin::twin {

/// Finished tasks of unfinished work in one file, a record for each, appended when its result is there: a kill loses
/// none of them. For many small results that are needed until something larger is finished; PartStore (experiments) is
/// for results that stay. Data are forced to disk once a second, so a machine that loses power loses those of the last
/// second. Numbers lie as in memory: for the machine and the build that wrote them, which `identity` has to name.
class Journal {
 public:
  /// Goes on with `file` where an earlier process has left it, else it appears with the first result. A record that a
  /// kill has cut, and what follows a damaged one, do not count. ErrorKind::input where the file is of another identity
  /// or is none of these. Of what is no longer needed at most `spare` bytes more than of the rest stay in the file.
  static Result<Journal> open(const std::filesystem::path& file, const std::string& identity,
                              std::size_t spare = std::size_t{16} << 20);

  bool empty() const { return finished_.empty(); }
  /// The finished tasks whose names begin so: the rest of their names, and their results.
  std::vector<std::pair<std::string_view, std::string_view>> find(std::string_view beginning) const;
  /// Fails for good once it has failed.
  Result<void> keep(const std::string& task, std::string_view result);
  /// Results of tasks whose names begin so are no longer needed.
  Result<void> forget(std::string_view beginning);
  /// The work is finished: nothing is left to go on from.
  void remove();

  const std::filesystem::path& file() const { return file_; }

 private:
  Journal() = default;
  Result<void> read();
  Result<void> append(const std::string& record);
  Result<void> renew();

  std::filesystem::path file_;
  std::string identity_;
  std::map<std::string, std::string, std::less<>> finished_;
  std::size_t spare_ = 0, live_ = 0, dead_ = 0;  ///< bytes of records
  bool there_ = false;                           ///< the file
  Descriptor appended_;
  Result<void> state_;
  std::chrono::steady_clock::time_point forced_ = std::chrono::steady_clock::now();
};

}  // namespace tribotwin::twin
