#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/live/live_file.hpp>
#include <tribotwin/twin/live/protocol/messages.hpp>
#include <tribotwin/twin/live/row_memory.hpp>

/// The commands `record` and `export`: rows of a live bench as files.
namespace tribotwin::twin::live {

/// A recording that goes on: a thread of its own writes what comes as MCAP.
class RowRecording {
 public:
  /// `ended` is called by that thread when the file is there, or could not be written and nothing is left of it.
  RowRecording(LiveFile file, const TelemetryOptions& head, McapMessages messages,
               std::function<void(Result<void>)> ended);
  ~RowRecording();
  void add(std::uint64_t number, std::span<const double> row);
  /// Gives what was added to the thread. Where the disk cannot keep up these rows are lost.
  void send();
  /// No more rows come.
  void finish();
  bool finishing() const { return finishing_; }
  const RowFile& so_far() const { return so_far_; }
  /// After `ended`: with the name that it has, which may be another if its own was taken meanwhile.
  RowFile final();

 private:
  void work();
  LiveFile file_;
  const TelemetryOptions& head_;
  const McapMessages messages_;
  const std::function<void(Result<void>)> ended_;
  RowFile so_far_;
  std::uint64_t next_ = 0;  // number of the row to come
  std::size_t width_;
  bool finishing_ = false;
  std::vector<double> batch_;
  std::mutex mutex_;  // of the three that follow
  std::condition_variable changed_;
  std::deque<std::vector<double>> waiting_;
  std::size_t waiting_values_ = 0;
  bool no_more_ = false;
  std::thread thread_;
};

/// What pages record and export. For the server's thread; the files are written by others.
class RowFiles {
 public:
  struct Options {
    std::filesystem::path folder;
    TelemetryOptions head;  ///< of the rows, behind time_s
    std::size_t memory_bytes;
  };
  /// Ways to the server's thread and its viewers.
  struct Ways {
    std::function<void(std::function<void()>)> post;  ///< from any thread
    std::function<void(const Done&)> done;
    std::function<void(const Event&)> event;
  };
  RowFiles(Options options, Ways ways);
  ~RowFiles();

  static bool obeys(std::string_view command) { return command == "record" || command == "export"; }
  /// Answers it, at once or when the file is there.
  void obey(const Command& command);
  void add(std::uint64_t number, std::span<const double> row);
  /// To be called after the rows that came together.
  void send();
  /// Of the recording that goes on; nullptr: there is none.
  const RowFile* recording();
  /// Ends a recording; what is being written then is finished.
  void end();
  /// Something is still written.
  bool busy() const { return recording_ || exporting_; }

 private:
  struct Export;
  void record(const Command& command, Mapping& keys);
  void begin_recording(const Command& command, McapMessages messages);
  void export_rows(const Command& command, Mapping& keys);
  void recorded(const Result<void>& written);
  void exported();
  void tell_note(const std::string& text);

  const Options options_;
  const Ways ways_;
  RowMemory memory_;
  double time_s_ = 0;  // of the newest row
  std::unique_ptr<RowRecording> recording_;
  std::optional<Command> stopped_by_;
  std::string failure_;  // of the last recording, until its end is asked for
  std::unique_ptr<Export> exporting_;
};

}  // namespace tribotwin::twin::live
